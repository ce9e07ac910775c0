"""Range and azimuth of radars to the planes of their regions, with covariance, in one pass.

The compiled twin of `oracles.polar_textbook` of the tests, with the way over latitude and longitude (`geodesy.from_plane`,
`geodesy.to_plane`, `geodesy.turn`). All that depends on the antenna's position alone is computed when that position changes.
"""

import math

import numpy as np

from coastwatch.geodesy import ECCENTRICITY2
from coastwatch.kernels.geometry.ellipsoid import POLAR_STRETCH, SEMI_MAJOR, sine_cosine, to_enu
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.copies import copy_into


@jit
def to_region(radar, distance, azimuth, site, sigma, origin):  # type: ignore[no-untyped-def]
    """Plots of several radars in the planes of their regions: position (M, 2) and covariance (M, 2, 2), and the antennas there (M, 2).

    The point of the antenna's tangent plane is dropped to the ellipsoid, then to the plane of the region: one square root, exact.
    Args: radar: (M,) row of each plot in sigma and origin; distance: (M,) m, not negative; azimuth: (M,) rad, clockwise from north;
    site: (M, 2) latitude, longitude of the antenna; sigma: (R, 2) m, rad, of range and azimuth; origin: (R, 2) of the region.
    Source: Mo Longbin et al., Unbiased converted measurements for tracking, IEEE Trans. AES 34(3), 1998, eqs. 5 and 11.
    """
    position, covariance, site_m = np.empty((len(radar), 2)), np.empty((len(radar), 2, 2)), np.empty((len(radar), 2))
    known, shift = np.full(sigma.shape, np.nan), np.empty(sigma.shape)
    rotation, drop, short = np.empty((len(sigma), 2, 3)), np.empty((len(sigma), 4)), np.exp(-0.5 * sigma[:, 1] ** 2)
    for k in range(len(radar)):
        r = radar[k]
        if site[k, 0] != known[r, 0] or site[k, 1] != known[r, 1]:
            copy_into(known[r], site[k])
            _set_frame(site[k], origin[r], rotation[r], shift[r], drop[r])
        turn = rotation[r]
        sine, cosine, d = math.sin(azimuth[k]), math.cos(azimuth[k]), distance[k]
        east, north = sine * d / short[r], cosine * d / short[r]
        up = _height(east, north, drop[r])
        for i in range(2):
            position[k, i] = turn[i, 0] * east + turn[i, 1] * north + turn[i, 2] * up + shift[r, i]
            site_m[k, i] = shift[r, i]
        square, spread = d * d, d * d + sigma[r, 0] ** 2
        loss, shorter = 1.0 / short[r] ** 2 - 2.0, short[r] ** 4
        cos2, sin2 = cosine * cosine - sine * sine, 2.0 * sine * cosine
        ee = 0.5 * (loss * square * (1.0 - cos2) + spread * (1.0 - shorter * cos2))
        nn = 0.5 * (loss * square * (1.0 + cos2) + spread * (1.0 + shorter * cos2))
        en = 0.5 * sin2 * (loss * square + shorter * spread)
        for i in range(2):
            for j in range(2):
                a, b, c, e = turn[i, 0], turn[i, 1], turn[j, 0], turn[j, 1]
                covariance[k, i, j] = a * c * ee + (a * e + b * c) * en + b * e * nn
    return position, covariance, site_m


@jit
def _set_frame(site, origin, rotation, shift, drop):  # type: ignore[no-untyped-def]
    """Write what `to_region` needs of one antenna.

    Args: site, origin: latitude, longitude; rotation: (2, 3) from east, north, up there to the plane of the region; shift: (2,) m, of the
    antenna in it; drop: (4,) coefficients of the height of the ellipsoid over the tangent plane, see `_height`.
    """
    shift[0], shift[1], _ = to_enu(site[0], site[1], origin[0], origin[1])
    sin_lat, cos_lat = sine_cosine(site[0])
    sin_origin, cos_origin = sine_cosine(origin[0])
    sine, cosine = sine_cosine(site[1] - origin[1])
    rotation[0, 0], rotation[0, 1], rotation[0, 2] = cosine, -sin_lat * sine, cos_lat * sine
    rotation[1, 0] = sin_origin * sine
    rotation[1, 1] = sin_origin * sin_lat * cosine + cos_origin * cos_lat
    rotation[1, 2] = cos_origin * sin_lat - sin_origin * cos_lat * cosine
    flattened = POLAR_STRETCH - 1.0
    drop[0] = 1.0 + flattened * cos_lat * cos_lat
    drop[1] = SEMI_MAJOR / math.sqrt(1.0 - ECCENTRICITY2 * sin_lat * sin_lat)  # radius of curvature in the prime vertical
    drop[2] = flattened * sin_lat * cos_lat
    drop[3] = 1.0 + flattened * sin_lat * sin_lat


@jit
def _height(east, north, drop):  # type: ignore[no-untyped-def]
    """Height of the ellipsoid over a point of a tangent plane: not positive.

    The root near 0 of |point + height up|^2 = a^2, in coordinates in which the ellipsoid is a sphere. The antenna is on it and the
    plane is tangent, so the terms of the antenna alone cancel. Args: drop: (4,) of `_set_frame`.
    """
    level = east * east + drop[0] * north * north
    half = drop[1] + drop[2] * north
    return -level / (half + math.sqrt(half * half - drop[3] * level))
