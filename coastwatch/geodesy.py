"""WGS 84 to local planes and back, and differences in metres anywhere on Earth. Bare arrays, degrees in, metres out."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SEMI_MAJOR_M = 6378137.0
FLATTENING = 1.0 / 298.257223563
ECCENTRICITY2 = FLATTENING * (2.0 - FLATTENING)
KNOT_M_S = 1852.0 / 3600.0
NAUTICAL_MILE_M = 1852.0


def wrap_deg(angle: Any) -> Any:
    """The angle in (-180, 180]."""
    return -((-np.asarray(angle) + 180.0) % 360.0 - 180.0)


def wrap_rad(angle: Any) -> Any:
    """The angle in (-pi, pi]."""
    return -((-np.asarray(angle) + np.pi) % (2.0 * np.pi) - np.pi)


def earth_centred(position_deg: Floats) -> Floats:
    """Earth-centred, Earth-fixed metres of points on the ellipsoid.

    Args: position_deg: (..., 2) latitude, longitude.
    Returns: (..., 3).
    Source: NIMA TR8350.2, WGS 84, eq. 4-14.
    """
    lat, lon = np.radians(position_deg[..., 0]), np.radians(position_deg[..., 1])
    n = SEMI_MAJOR_M / np.sqrt(1.0 - ECCENTRICITY2 * np.sin(lat) ** 2)
    return np.stack(
        [n * np.cos(lat) * np.cos(lon), n * np.cos(lat) * np.sin(lon), n * (1.0 - ECCENTRICITY2) * np.sin(lat)], axis=-1
    )


def axes(position_deg: Floats) -> Floats:
    """Rows east, north, up of the tangent plane at each point, in Earth-centred axes.

    Args: position_deg: (..., 2). Returns: (..., 3, 3).
    """
    lat, lon = np.radians(position_deg[..., 0]), np.radians(position_deg[..., 1])
    sp, cp, sl, cl = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    rows = np.zeros((*lat.shape, 3, 3))
    rows[..., 0, 0], rows[..., 0, 1] = -sl, cl
    rows[..., 1, 0], rows[..., 1, 1], rows[..., 1, 2] = -sp * cl, -sp * sl, cp
    rows[..., 2, 0], rows[..., 2, 1], rows[..., 2, 2] = cp * cl, cp * sl, sp
    return rows


def scale_m_deg(latitude_deg: Floats) -> tuple[Floats, Floats]:
    """Metres a degree of latitude and of longitude at this latitude (radii of curvature of the ellipsoid)."""
    s = np.sin(np.radians(latitude_deg))
    w2 = 1.0 - ECCENTRICITY2 * s * s
    meridian = SEMI_MAJOR_M * (1.0 - ECCENTRICITY2) / (w2 * np.sqrt(w2))
    parallel = SEMI_MAJOR_M / np.sqrt(w2) * np.cos(np.radians(latitude_deg))
    return np.radians(meridian), np.radians(parallel)


def difference_m(to_deg: Floats, from_deg: Floats) -> Floats:
    """East and north metres from one point to another, for points within a few kilometres, by mid-latitude radii.

    Right to 0.1 m up to 5 km apart at |latitude| < 85 deg and across the antimeridian (tests/kernels/test_geodesy.py).
    Args: to_deg, from_deg: (..., 2). Returns: (..., 2).
    """
    north, east = scale_m_deg(0.5 * (to_deg[..., 0] + from_deg[..., 0]))
    return np.stack([wrap_deg(to_deg[..., 1] - from_deg[..., 1]) * east, (to_deg[..., 0] - from_deg[..., 0]) * north], axis=-1)


def offset_deg(from_deg: Floats, metres: Floats) -> Floats:
    """The point that lies these metres east and north of another: the inverse of `difference_m`.

    Args: from_deg: (..., 2); metres: (..., 2) east, north. Returns: (..., 2).
    """
    lat = from_deg[..., 0]
    for _ in range(3):
        north, east = scale_m_deg(0.5 * (lat + from_deg[..., 0]))
        lat = from_deg[..., 0] + metres[..., 1] / north
    north, east = scale_m_deg(0.5 * (lat + from_deg[..., 0]))
    return np.stack([lat, wrap_deg(from_deg[..., 1] + metres[..., 0] / east)], axis=-1)


def to_plane(position_deg: Floats, origin_deg: Floats) -> Floats:
    """East and north metres in the tangent plane at an origin (orthographic).

    Args: position_deg: (..., 2); origin_deg: (2,) or (..., 2). Returns: (..., 2).
    """
    d = earth_centred(position_deg) - earth_centred(np.asarray(origin_deg))
    east_north_m: Floats = np.einsum("...ij,...j->...i", axes(np.asarray(origin_deg))[..., :2, :], d)
    return east_north_m


def from_plane(metres: Floats, origin_deg: Floats) -> Floats:
    """Latitude and longitude of points of the tangent plane, dropped to the ellipsoid: the inverse of `to_plane`.

    Args: metres: (..., 2) east, north, under 300 km; origin_deg: (2,) or (..., 2). Returns: (..., 2).
    """
    origin_deg = np.asarray(origin_deg, float)
    frame, start = axes(origin_deg), earth_centred(origin_deg)
    flat, upward = start + np.einsum("...ij,...i->...j", frame[..., :2, :], metres), frame[..., 2, :]
    # the root near 0 of |flat + height upward|^2 = a^2, in coordinates in which the ellipsoid is a sphere
    weight = np.array([1.0, 1.0, 1.0 / (1.0 - FLATTENING) ** 2])
    square, half = (upward * upward * weight).sum(-1), (flat * weight * upward).sum(-1)
    level = (flat * flat * weight).sum(-1) - SEMI_MAJOR_M**2
    height = -level / (half + np.sqrt(half * half - square * level))
    p = flat + height[..., None] * upward
    lat = np.arctan2(p[..., 2], (1.0 - ECCENTRICITY2) * np.hypot(p[..., 0], p[..., 1]))
    return np.stack([np.degrees(lat), np.degrees(np.arctan2(p[..., 1], p[..., 0]))], axis=-1)


def turn(position_deg: Floats, origin_deg: Floats) -> Floats:
    """The 2 x 2 matrices that take east, north components at a point to those of the plane at an origin.

    Args: position_deg: (..., 2); origin_deg: (2,) or (..., 2). Returns: (..., 2, 2); orthogonal to 1e-4 within 100 km.
    """
    here, there = axes(position_deg)[..., :2, :], axes(np.asarray(origin_deg, float))[..., :2, :]
    matrices: Floats = np.einsum("...ik,...jk->...ij", there, here)
    return matrices


def within_any(position_deg: Floats, site_deg: Floats, range_m: Floats) -> NDArray[np.bool_]:
    """Whether each place is within range of any site. Args: (V, 2), (R, 2), (R,). Returns: (V,)."""
    is_within = np.zeros(len(position_deg), np.bool_)
    for site, reach in zip(site_deg, range_m, strict=True):
        near = np.abs(position_deg[:, 0] - site[0]) * 110_000.0 <= reach * 1.02 + 100.0
        rows = np.flatnonzero(near & ~is_within)
        is_within[rows] = np.linalg.norm(to_plane(position_deg[rows], site), axis=1) <= reach
    return is_within
