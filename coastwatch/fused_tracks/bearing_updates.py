"""Bearings as measurements of a position: certain across the line of sight, and as good as unknown along it."""

from __future__ import annotations

import numpy as np

from coastwatch.batches import Bools, Floats

ALONG_M = 1e5  # standard deviation along the line of sight: 1000 times what any vessel is known to


def bearing_positions(
    before: tuple[Floats, Floats],
    ahead_s: Floats,
    site_m: Floats,
    bearing_rad: Floats,
    variance: Floats,
    floor_m: float,
    gate_sigmas: float,
) -> tuple[Floats, Floats, Bools]:
    """Position (B, 2) and noise (B, 2, 2) as which a filter takes each bearing, and whether the bearing is in the gate (B,).

    The position is where the line of sight is nearest to the predicted vessel, so that the update is the extended Kalman update
    by the bearing. Vessels predicted on top of the sensor or behind it are not in the gate.
    Args: before: mean (B, 5) and covariance (B, 5, 5) of the filters; ahead_s: (B,) of the bearings from these; site_m: (B, 2) east,
    north of the sensor; bearing_rad, variance: (B,); floor_m: standard deviation across the line that is added.
    Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 10.3.
    """
    mean, spread = before
    t = ahead_s[:, None]
    predicted = mean[:, :2] + t * mean[:, 2:4] - site_m
    along = np.column_stack([np.sin(bearing_rad), np.cos(bearing_rad)])
    across = np.column_stack([along[:, 1], -along[:, 0]])
    distance, innovation = (predicted * along).sum(axis=1), (predicted * across).sum(axis=1)
    to_position = np.concatenate([across, t * across], axis=1)
    own = np.einsum("bi,bij,bj->b", to_position, spread[:, :4, :4], to_position)
    across_variance = distance**2 * variance + floor_m**2
    near = (innovation**2 <= gate_sigmas**2 * (own + across_variance)) & (distance > gate_sigmas * np.sqrt(own))
    noise = across_variance[:, None, None] * across[:, :, None] * across[:, None]
    noise += ALONG_M**2 * along[:, :, None] * along[:, None]
    return site_m + distance[:, None] * along, noise, near
