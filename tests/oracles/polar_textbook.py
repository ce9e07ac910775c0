"""Polar to Cartesian: unbiased conversion of range and azimuth, with covariance. Vectorised numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def polar_to_plane(distance: Floats, azimuth: Floats, distance_sigma: Floats, azimuth_sigma: Floats) -> tuple[Floats, Floats]:
    """East and north of measured points, without the bias of the plain conversion, and their covariance given the measurement.

    The plain r sin, r cos comes out short by exp(-sigma^2 / 2) of the azimuth, which is divided out.
    Args: distance, distance_sigma: (M,) m, distance not negative; azimuth, azimuth_sigma: (M,) rad, clockwise from north.
    Returns: (M, 2) m and (M, 2, 2) m2.
    Source: Mo Longbin, Song Xiaoquan, Zhou Yiyu, Sun Zhong Kang, Y. Bar-Shalom, Unbiased converted measurements for tracking,
        IEEE Trans. AES 34(3), 1998, eqs. 5 and 11.
    """
    short = np.exp(-0.5 * azimuth_sigma**2)
    shorter = short**4
    point = np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1) * (distance / short)[:, None]
    square, spread = distance**2, distance**2 + distance_sigma**2
    loss = 1.0 / short**2 - 2.0
    sin2, cos2 = np.sin(2.0 * azimuth), np.cos(2.0 * azimuth)
    out = np.empty((len(distance), 2, 2))
    out[:, 0, 0] = 0.5 * (loss * square * (1.0 - cos2) + spread * (1.0 - shorter * cos2))
    out[:, 1, 1] = 0.5 * (loss * square * (1.0 + cos2) + spread * (1.0 + shorter * cos2))
    out[:, 0, 1] = out[:, 1, 0] = 0.5 * sin2 * (loss * square + shorter * spread)
    return point, out
