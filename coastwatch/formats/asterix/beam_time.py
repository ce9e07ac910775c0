"""When the beam of a radar points where, from stamps or arrivals that are coarse or late: a line of time over azimuth."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

FULL_TURN = 65_536  # units of azimuth of CAT 240 in a turn
TURN_SECTORS = 128  # in a turn; a point of the line is the mean of one sector
SECTOR = FULL_TURN // TURN_SECTORS  # width of a sector, units of azimuth
LEAST_SECTORS = 8  # points of a line
STUCK_CLOCK_SECTORS, STUCK_CLOCK_S = 32, 1.0  # least points and seconds of arrival over which a clock is judged
STUCK_CLOCK_RATE = 0.5  # seconds of the clock of the radar in a second of arrival, below which the clock is stuck
OUTLIER_S = 0.1  # distance of a point from the line, s, above which it is an outlier
MOST_OUTLIERS = 8  # outliers in a row after which a new line begins with them
PAUSE_S = 1.5  # from spoke to spoke, above which a new line begins; more than the tick of a clock of whole seconds
PAUSE_TURNS = 0.9  # a pause that is shorter, as where a sector is not sent, hides no turn
SET_BACK_S = 2.0  # by which a stamp is before the last one, where the clock of the radar was set back

TIME, ARRIVED = 1, 2  # columns of a point


class BeamTime:
    """The line through the last turn of one radar. What it says of a spoke does not depend on later ones."""

    def __init__(self) -> None:
        self.clock_stuck = False
        self._points: deque[tuple[float, float, float]] = deque(maxlen=TURN_SECTORS)  # mean angle, time and arrival of a sector
        self._outliers: list[tuple[float, float, float]] = []  # in a row, the newest last
        self._line: tuple[float, float, float] | None = None  # middle angle, time there, seconds a unit
        self._sector: float = -math.inf
        self._first = (0.0, 0.0, 0.0)  # angle, time and arrival of the first spoke of the sector
        self._count, self._angle, self._time, self._arrived = 0, 0.0, 0.0, 0.0  # spokes, and sums relative to the first
        self._newest_s = -math.inf
        self._before_s = (math.nan, math.nan)  # stamp and arrival of the spoke before
        self.paused = False  # whether the newest spoke came after a pause, or the clock of the radar was set back before it

    def time_s(self, angle: int, time_s: float, arrived_s: float) -> float:
        """When the beam was there. It falls only where the clock of the radar was set back.

        Args: angle: FULL_TURN a turn, growing from turn to turn; time_s: as stamped, or of arrival; arrived_s: NaN: not known.
        """
        sector, given_s, before_s = angle // SECTOR, (time_s, arrived_s), self._before_s
        step_s = given_s[self.clock_stuck] - before_s[self.clock_stuck]
        set_back = step_s < -SET_BACK_S
        self.paused = set_back or step_s > max(PAUSE_S, PAUSE_TURNS * FULL_TURN * self._line[2] if self._line else 0.0)
        self._before_s = given_s
        if self.paused:
            self._line, self._sector, self._count = None, -math.inf, 0
            self._points.clear()
            self._outliers.clear()
        if set_back:
            self._newest_s = -math.inf
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
            at_s = given_s[self.clock_stuck]
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
        given_s = point[ARRIVED if self.clock_stuck else TIME]
        if abs(given_s - there_s - (point[0] - middle) * unit_s) <= OUTLIER_S:
            self._outliers.clear()
            self._points.append(point)
        else:
            self._outliers.append(point)
            if len(self._outliers) < MOST_OUTLIERS:
                return
            self._points.clear()
            self._points.extend(self._outliers)
            self._outliers.clear()
            if given_s < self._newest_s - OUTLIER_S:  # its clock was set back
                self._newest_s = -math.inf
        self._fit()

    def _fit(self) -> None:
        """The line through the sectors of the last turn."""
        count = len(self._points)
        if count < LEAST_SECTORS:
            return
        points = np.array(self._points) - self._points[0]
        came_s, went_s = points[-1, ARRIVED], points[-1, TIME]
        if count >= STUCK_CLOCK_SECTORS and came_s > STUCK_CLOCK_S:
            self.clock_stuck = bool(went_s < STUCK_CLOCK_RATE * came_s)
        column = ARRIVED if self.clock_stuck else TIME
        angle, given_s = points[:, 0], points[:, column]
        off = angle - angle.mean()
        variance = float(off @ off)  # times the number of points
        if variance == 0.0:
            return
        unit_s = float(off @ given_s) / variance
        origin = self._points[0]
        self._line = (origin[0] + float(angle.mean()), origin[column] + float(given_s.mean()), unit_s) if unit_s > 0.0 else None
