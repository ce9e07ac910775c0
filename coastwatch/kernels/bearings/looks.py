"""Looks of sensors that give bearings without contact numbers: which bearings belong together, as a sensor saw them in one turn."""

from __future__ import annotations

import math

import numpy as np

from coastwatch.kernels.jit import jit

CELLS = 720  # of a turn


@jit
def looks_of(sensor, time, bearing, half, longest):  # type: ignore[no-untyped-def]
    """The number of the look that each bearing is of, counted from 0 for each sensor. (M,)

    Bearings of one time are one look. A sensor that turns gives each bearing its own time: such bearings are one look until one comes
    near a direction that the look has already, or the look would be too long.
    Args: sensor, time, bearing: (M,) sorted by sensor, then time, radians; half: (K,) rad, within which directions are the same;
    longest: (K,) s, a look of bearings of different times.
    """
    look, taken = np.zeros(len(time), np.int64), np.zeros(CELLS, np.bool_)
    begin = 0
    while begin < len(time):
        k, number, first, single = sensor[begin], -1, -math.inf, False
        start = begin
        while start < len(time) and sensor[start] == k:
            end = start + 1
            while end < len(time) and sensor[end] == k and time[end] == time[start]:
                end += 1
            cell = math.floor(bearing[start] * (CELLS / (2.0 * math.pi))) % CELLS
            if end - start > 1 or not single or taken[cell] or not time[start] - first < longest[k]:
                number, first = number + 1, time[start]
                taken[:] = False
            single = end - start == 1
            reach = min(math.ceil(half[k] * (CELLS / (2.0 * math.pi))), CELLS // 2)
            for c in range(cell - reach, cell + reach + 1):
                taken[c % CELLS] = True
            for m in range(start, end):
                look[m] = number
            start = end
        begin = start
    return look
