"""One point of the ellipsoid at a time: to a tangent plane and back. The scalar twin of coastwatch.geodesy, for other kernels.

Radians nowhere in the signatures: latitudes and longitudes are degrees, as reports bring them; the rest is metres.
"""

import math

from coastwatch.kernels.jit import jit

SEMI_MAJOR = 6378137.0
FLATTENING = 1.0 / 298.257223563
ECCENTRICITY2 = FLATTENING * (2.0 - FLATTENING)
STRETCH = 1.0 / ((1.0 - FLATTENING) * (1.0 - FLATTENING))
DEGREE = math.pi / 180.0


@jit
def centred(lat, lon):  # type: ignore[no-untyped-def]
    """Earth-centred x, y, z of a point on the ellipsoid, and its sin lat, cos lat, sin lon, cos lon.

    Source: NIMA TR8350.2, WGS 84, eq. 4-14.
    """
    sp, cp = math.sin(lat * DEGREE), math.cos(lat * DEGREE)
    sl, cl = math.sin(lon * DEGREE), math.cos(lon * DEGREE)
    n = SEMI_MAJOR / math.sqrt(1.0 - ECCENTRICITY2 * sp * sp)
    return n * cp * cl, n * cp * sl, n * (1.0 - ECCENTRICITY2) * sp, sp, cp, sl, cl


@jit
def to_tangent(lat, lon, anchor_lat, anchor_lon):  # type: ignore[no-untyped-def]
    """East, north and up of a point from an anchor: its place in the tangent plane (orthographic), and how deep below."""
    x, y, z, _, _, _, _ = centred(lat, lon)
    ax, ay, az, sp, cp, sl, cl = centred(anchor_lat, anchor_lon)
    x, y, z = x - ax, y - ay, z - az
    return cl * y - sl * x, cp * z - sp * (cl * x + sl * y), cp * (cl * x + sl * y) + sp * z


@jit
def from_tangent(east, north, anchor_lat, anchor_lon):  # type: ignore[no-untyped-def]
    """Latitude and longitude of a point of the plane, dropped to the ellipsoid by Newton's method: undoes `to_tangent`."""
    ax, ay, az, sp, cp, sl, cl = centred(anchor_lat, anchor_lon)
    x = ax - sl * east - sp * cl * north
    y = ay + cl * east - sp * sl * north
    z = az + cp * north
    ux, uy, uz = cp * cl, cp * sl, sp
    up = -0.5 * (east * east + north * north) / SEMI_MAJOR
    for _ in range(4):
        px, py, pz = x + up * ux, y + up * uy, z + up * uz
        level = px * px + py * py + STRETCH * pz * pz - SEMI_MAJOR * SEMI_MAJOR
        step = 0.5 * level / (px * ux + py * uy + STRETCH * pz * uz)
        up -= step
        if abs(step) < 1e-9:
            break
    px, py, pz = x + up * ux, y + up * uy, z + up * uz
    lat = math.atan2(pz, (1.0 - ECCENTRICITY2) * math.sqrt(px * px + py * py)) / DEGREE
    return lat, math.atan2(py, px) / DEGREE


@jit
def turn_to(lat, lon, anchor_lat, anchor_lon):  # type: ignore[no-untyped-def]
    """The matrix, row by row, that takes east and north components at a point to those of the plane at an anchor."""
    sp, cp = math.sin(lat * DEGREE), math.cos(lat * DEGREE)
    sa, ca = math.sin(anchor_lat * DEGREE), math.cos(anchor_lat * DEGREE)
    s, c = math.sin((lon - anchor_lon) * DEGREE), math.cos((lon - anchor_lon) * DEGREE)
    return c, -sp * s, sa * s, sa * sp * c + ca * cp
