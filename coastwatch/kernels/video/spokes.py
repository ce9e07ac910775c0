"""Angles of spokes that grow from turn to turn, whatever the radar sends."""

from __future__ import annotations

import numpy as np

from coastwatch.kernels.jit import jit

TURN = 2.0 * np.pi
BACK = np.radians(10.0)  # a spoke that is less than this behind the one before stepped back, by jitter
MOST_STALLED = 16  # spokes without a step forward, one after the other: a beam that stands fills no memory
AVERAGED = 64.0  # steps whose mean is the width of a spoke


@jit
def unwrapped(azimuth, before, gap):  # type: ignore[no-untyped-def]
    """The angle of each spoke, which never falls; the mean step then; and which spokes are kept. (S,), (S,), (S,)

    A step back counts as none: windows go by these angles, moments by the azimuths themselves.
    Args: azimuth: (S,) rad; before: angle, mean step and stalled spokes after the spoke before, (3,), NaN for the first one, written;
    gap: rad, a longer step is a gap and no width of a spoke.
    """
    angle, step, kept = np.empty(len(azimuth)), np.empty(len(azimuth)), np.ones(len(azimuth), np.bool_)
    for s in range(len(azimuth)):
        if np.isnan(before[0]):
            before[0], before[1], before[2] = azimuth[s] % TURN, 0.0, 0.0
        else:
            forward = (azimuth[s] - before[0]) % TURN
            if forward > TURN - BACK:
                forward = 0.0
            if forward == 0.0:
                before[2] += 1.0
            else:
                before[2] = 0.0
            kept[s] = before[2] <= MOST_STALLED
            before[0] += forward
            if forward <= gap and kept[s]:
                before[1] += (forward - before[1]) / AVERAGED if before[1] > 0.0 else forward
        angle[s], step[s] = before[0], before[1]
    return angle, step, kept
