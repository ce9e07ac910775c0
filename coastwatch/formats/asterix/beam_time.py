"""When the beam of a radar points where, from stamps or arrivals that are coarse or late: a line of time over azimuth."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

FULL_TURN = 65_536  # units of azimuth of CAT 240
SECTOR = FULL_TURN // 128  # whose mean is a point of the line
TURN_SECTORS = 128
LEAST_SECTORS = 8  # of a line
STANDS_SECTORS, STANDS_S, STANDS_SHARE = 32, 1.0, 0.5
"""A clock stands that goes less than this share of the arrivals, over so many sectors and seconds."""

FAR_S, MOST_FAR = 0.1, 8
"""A sector that is so far off the line does not count; after so many of them in a row the line begins again."""

PAUSE_S = 1.5
"""A spoke so long after the one before begins a new line: the antenna may have turned unseen. Clocks may tick whole seconds."""

TIME, ARRIVED = 1, 2  # columns of a point


class BeamTime:
    """The line through the last turn of one radar. What it says of a spoke does not depend on later ones."""

    def __init__(self) -> None:
        self.clock_stands = False
        self._points: deque[tuple[float, float, float]] = deque(maxlen=TURN_SECTORS)  # mean angle, time and arrival of a sector
        self._far: list[tuple[float, float, float]] = []  # sectors in a row that are far off the line
        self._line: tuple[float, float, float] | None = None  # middle angle, time there, seconds a unit
        self._sector: float = -math.inf
        self._count, self._angle, self._time, self._arrived = (
            0,
            0.0,
            0.0,
            0.0,
        )  # sums of the sector, of what is over its first spoke
        self._first = (0.0, 0.0, 0.0)
        self._newest_s = -math.inf
        self._before_s = (math.nan, math.nan)  # stamp and arrival of the spoke before
        self.paused = False  # whether the newest spoke came after a pause

    def time_s(self, angle: int, time_s: float, arrived_s: float) -> float:
        """When the beam was there. It falls only where the clock of the radar was set back.

        Args: angle: FULL_TURN a turn, growing from turn to turn; time_s: as stamped, or of arrival; arrived_s: NaN: not known.
        """
        sector, given_s, before_s = angle // SECTOR, (time_s, arrived_s), self._before_s
        self.paused = given_s[self.clock_stands] - before_s[self.clock_stands] > PAUSE_S
        self._before_s = given_s
        if self.paused:
            self._line, self._sector, self._count = None, -math.inf, 0
            self._points.clear()
            self._far.clear()
        if sector > self._sector:
            if self._count:
                self._close()
            self._sector, self._first = sector, (float(angle), time_s, arrived_s)
            self._count, self._angle, self._time, self._arrived = 0, 0.0, 0.0, 0.0
        first = self._first
        self._count += 1
        self._angle += angle - first[0]
        self._time += time_s - first[TIME]
        self._arrived += arrived_s - first[ARRIVED]
        if self._line is not None:
            middle, there_s, unit_s = self._line
            at_s = there_s + (angle - middle) * unit_s
        else:
            at_s = given_s[self.clock_stands]
        self._newest_s = max(self._newest_s, at_s)
        return self._newest_s

    def _close(self) -> None:
        """Take a sector that is complete."""
        n, first = self._count, self._first
        point = (first[0] + self._angle / n, first[TIME] + self._time / n, first[ARRIVED] + self._arrived / n)
        if self._line is None:
            self._points.append(point)
            self._fit()
            return
        middle, there_s, unit_s = self._line
        given_s = point[ARRIVED if self.clock_stands else TIME]
        if abs(given_s - there_s - (point[0] - middle) * unit_s) <= FAR_S:
            self._far.clear()
            self._points.append(point)
        else:
            self._far.append(point)
            if len(self._far) < MOST_FAR:
                return
            self._points.clear()
            self._points.extend(self._far)
            self._far.clear()
            if given_s < self._newest_s - FAR_S:  # its clock was set back
                self._newest_s = -math.inf
        self._fit()

    def _fit(self) -> None:
        """The line through the sectors of the last turn."""
        count = len(self._points)
        if count < LEAST_SECTORS:
            return
        points = np.array(self._points) - self._points[0]
        came_s, went_s = points[-1, ARRIVED], points[-1, TIME]
        if count >= STANDS_SECTORS and came_s > STANDS_S:
            self.clock_stands = bool(went_s < STANDS_SHARE * came_s)
        column = ARRIVED if self.clock_stands else TIME
        angle, given_s = points[:, 0], points[:, column]
        off = angle - angle.mean()
        spread = float(off @ off)
        if spread == 0.0:
            return
        unit_s = float(off @ given_s) / spread
        origin = self._points[0]
        self._line = (origin[0] + float(angle.mean()), origin[column] + float(given_s.mean()), unit_s) if unit_s > 0.0 else None
