"""How many bearings of a sensor are of vessels that nobody expects, by direction."""

from __future__ import annotations

import numpy as np

from coastwatch.kernels.arrays import Floats, Ints

CELLS = 360
SMOOTH_RAD = np.radians(20.0)  # standard deviation of the window that counts are averaged over
LEAST = 0.5  # bearings of unknown vessels in the whole arc, and
LEAST_SHARE = 0.05  # share of all bearings of a direction, that are assumed at least


def unknown_density(
    sensor: Ints, bearing_rad: Floats, of_vessel: Ints, expected_rad: Floats, detection: float, arc_rad: Floats
) -> Floats:
    """Bearings of unknown vessels a radian, at each bearing: all of that direction less those of expected vessels. (M,)

    Counts of both are averaged over directions, so that the noise of a bearing does not count, and a coast does.
    Args: sensor: (M,) of each bearing; of_vessel: (H,) sensor of each expected vessel; expected_rad: (H,) its bearing; detection:
    probability that it is heard; arc_rad: (K,) width of the arc of each sensor.
    """
    count, cell = len(arc_rad), _cell(bearing_rad)
    heard = np.bincount(sensor * CELLS + cell, minlength=count * CELLS)
    expected = np.bincount(of_vessel * CELLS + _cell(expected_rad), minlength=count * CELLS)
    turns = np.fft.rfftfreq(CELLS, 1.0 / CELLS)
    smooth = np.exp(-0.5 * (turns * SMOOTH_RAD) ** 2) * CELLS / (2.0 * np.pi)
    every, known = (
        np.fft.irfft(np.fft.rfft(c.reshape(count, CELLS), axis=1) * smooth, CELLS, axis=1)[sensor, cell]
        for c in (heard, detection * expected)
    )
    return np.asarray(np.maximum(every - known, np.maximum(LEAST_SHARE * every, LEAST / arc_rad[sensor])))


def _cell(angle_rad: Floats) -> Ints:
    """The cell of each direction."""
    return np.floor(angle_rad * (CELLS / (2.0 * np.pi))).astype(np.int64) % CELLS
