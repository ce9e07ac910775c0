"""WGS 84, one point at a time: Earth-centred and local coordinates. The compiled twin of `coastwatch.geodesy`, for other kernels.

Latitudes and longitudes are degrees, everything else is metres. ECEF is Earth-centred, Earth-fixed; ENU is east, north, up in the
tangent plane at an anchor.
"""

from __future__ import annotations

import math

import numpy as np

from coastwatch.geodesy import ECCENTRICITY2, FLATTENING, SEMI_MAJOR_M
from coastwatch.kernels.arrays import Floats, Ints
from coastwatch.kernels.jit import jit
from coastwatch.kernels.threads import in_blocks

DEGREE = math.pi / 180.0  # radians
SEMI_MAJOR = SEMI_MAJOR_M
SHORTEST_RADIUS = 6_330_000.0  # less than any radius of curvature
SHORTEST_DEGREE = SHORTEST_RADIUS * DEGREE  # less than any degree of latitude
NEAR_M = 1000.0  # north: below it one round finds the mid-latitude to rounding, two do up to 100 km
POLAR_STRETCH = 1.0 / ((1.0 - FLATTENING) * (1.0 - FLATTENING))


@jit
def sine_cosine(degrees):  # type: ignore[no-untyped-def]
    """Sine and cosine of an angle."""
    return math.sin(degrees * DEGREE), math.cos(degrees * DEGREE)


@jit
def wrap_degrees(longitude):  # type: ignore[no-untyped-def]
    """A longitude, or the difference of two, in (-180, 180]. Args: longitude: in (-540, 540]."""
    if longitude > 180.0:
        return longitude - 360.0
    return longitude + 360.0 if longitude <= -180.0 else longitude


@jit
def metres_per_degree(latitude):  # type: ignore[no-untyped-def]
    """Metres per degree of latitude and per degree of longitude: `geodesy.scale_m_deg`."""
    sine, cosine = sine_cosine(latitude)
    w2 = 1.0 - ECCENTRICITY2 * sine * sine
    equatorial = SEMI_MAJOR * DEGREE / math.sqrt(w2)
    return equatorial * (1.0 - ECCENTRICITY2) / w2, equatorial * cosine


@jit
def enu_offset(lat, lon, from_lat, from_lon):  # type: ignore[no-untyped-def]
    """East and north metres to a point from another, by the radii at their mid-latitude: `geodesy.difference_m`."""
    north, east = metres_per_degree(0.5 * (from_lat + lat))
    return wrap_degrees(lon - from_lon) * east, (lat - from_lat) * north


@jit
def add_enu_offset(lat, lon, east_m, north_m):  # type: ignore[no-untyped-def]
    """Latitude and longitude of the point so many metres east and north, up to 100 km: the inverse of `enu_offset`."""
    north, east = metres_per_degree(lat)
    for _ in range(1 if abs(north_m) < NEAR_M else 2):
        north, east = metres_per_degree(lat + 0.5 * north_m / north)
    return lat + north_m / north, wrap_degrees(lon + east_m / east)


@jit
def ecef_and_axes(lat, lon):  # type: ignore[no-untyped-def]
    """ECEF x, y, z of a point on the ellipsoid, and the sines and cosines that span its plane: sin lat, cos lat, sin lon, cos lon.

    Source: NIMA TR8350.2, WGS 84, eq. 4-14.
    """
    sin_lat, cos_lat = sine_cosine(lat)
    sin_lon, cos_lon = sine_cosine(lon)
    n = SEMI_MAJOR / math.sqrt(1.0 - ECCENTRICITY2 * sin_lat * sin_lat)
    return n * cos_lat * cos_lon, n * cos_lat * sin_lon, n * (1.0 - ECCENTRICITY2) * sin_lat, sin_lat, cos_lat, sin_lon, cos_lon


@jit
def to_ecef(lat, lon):  # type: ignore[no-untyped-def]
    """ECEF x, y, z of a point on the ellipsoid."""
    x, y, z, _, _, _, _ = ecef_and_axes(lat, lon)
    return x, y, z


@jit
def _ecef_of_rows(low, high, position, row, out):  # type: ignore[no-untyped-def]
    for i in range(low, high):
        out[i, 0], out[i, 1], out[i, 2] = to_ecef(position[row[i], 0], position[row[i], 1])


def ecef_of_rows(position: Floats, row: Ints) -> Floats:
    """ECEF of some rows of many points. Args: position: (N, 2) latitude, longitude; row: (M,). Returns: (M, 3)."""
    out = np.empty((len(row), 3))
    in_blocks(_ecef_of_rows, len(row), position, row, out)
    return out


@jit
def to_enu(lat, lon, anchor_lat, anchor_lon):  # type: ignore[no-untyped-def]
    """East, north and up of a point in the tangent plane at an anchor: `geodesy.to_plane`, with how deep the point lies below."""
    x, y, z = to_ecef(lat, lon)
    ax, ay, az, sin_lat, cos_lat, sin_lon, cos_lon = ecef_and_axes(anchor_lat, anchor_lon)
    x, y, z = x - ax, y - ay, z - az
    outward = cos_lon * x + sin_lon * y
    return cos_lon * y - sin_lon * x, cos_lat * z - sin_lat * outward, cos_lat * outward + sin_lat * z


@jit
def from_plane(east, north, frame):  # type: ignore[no-untyped-def]
    """Latitude and longitude of a point of the plane, dropped to the ellipsoid, and the matrix to east and north there, row by row.

    The inverse of `to_enu`. The matrix is `enu_rotation` of the anchor in the plane at the point. At a pole the longitude is 0.
    Args: frame: `ecef_and_axes` of the anchor.
    """
    ax, ay, az, sin_lat, cos_lat, sin_lon, cos_lon = frame
    ux, uy, uz = cos_lat * cos_lon, cos_lat * sin_lon, sin_lat
    nx, ny, nz = -sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat
    x, y, z = ax - sin_lon * east + nx * north, ay + cos_lon * east + ny * north, az + nz * north
    # the root near 0 of |p + up u|^2 = a^2, in coordinates in which the ellipsoid is a sphere
    square = ux * ux + uy * uy + POLAR_STRETCH * uz * uz
    half = x * ux + y * uy + POLAR_STRETCH * z * uz
    level = x * x + y * y + POLAR_STRETCH * z * z - SEMI_MAJOR * SEMI_MAJOR
    up = -level / (half + math.sqrt(half * half - square * level))
    x, y, z = x + up * ux, y + up * uy, (z + up * uz) / (1.0 - ECCENTRICITY2)  # along the normal of the ellipsoid there
    outward = math.sqrt(x * x + y * y)
    normal = math.sqrt(outward * outward + z * z)
    sin_here, cos_here, sin_lon_here, cos_lon_here, longitude = z / normal, outward / normal, 0.0, 1.0, 0.0
    if outward > 0.0:
        sin_lon_here, cos_lon_here, longitude = y / outward, x / outward, math.atan2(y, x) / DEGREE
    hx, hy, hz = -sin_here * cos_lon_here, -sin_here * sin_lon_here, cos_here  # north there
    ee, en = sin_lon_here * sin_lon + cos_lon_here * cos_lon, cos_lon_here * ny - sin_lon_here * nx
    ne, nn = hy * cos_lon - hx * sin_lon, hx * nx + hy * ny + hz * nz
    return math.atan2(z, outward) / DEGREE, longitude, (ee, en, ne, nn)


@jit
def enu_rotation(lat, lon, anchor_lat, anchor_lon):  # type: ignore[no-untyped-def]
    """The 2 x 2 matrix, row by row, that takes east and north at a point to those of the plane at an anchor: `geodesy.turn`."""
    sin_lat, cos_lat = sine_cosine(lat)
    sin_anchor, cos_anchor = sine_cosine(anchor_lat)
    sine, cosine = sine_cosine(lon - anchor_lon)
    return cosine, -sin_lat * sine, sin_anchor * sine, sin_anchor * sin_lat * cosine + cos_anchor * cos_lat
