"""The clock of a server: Unix time that goes on evenly when the clock of the machine is set."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

STEP_S = 2.0
"""A difference that is larger did not come little by little: the clock of the machine was set."""

SLEW = 0.01
"""How fast a smaller difference is taken over, seconds a second."""


def monotonic_s() -> float:
    """Seconds since any instant, the time in which the machine was suspended among them where the system says it."""
    return time.clock_gettime(time.CLOCK_BOOTTIME) if hasattr(time, "CLOCK_BOOTTIME") else time.monotonic()


class SteadyClock:
    """Unix time by the monotonic clock. It follows small corrections of the machine's clock slowly, and steps only by `adopt`.

    Tracks, feeds and cycles need a time that neither jumps nor stands. A restart of the server takes the time of the machine.
    """

    def __init__(self, wall: Callable[[], float] | None = None, monotonic: Callable[[], float] | None = None) -> None:
        """Args: wall: Unix time of the machine; monotonic: seconds since any instant. None: those of `time`."""
        self._wall, self._monotonic = wall or (lambda: time.time()), monotonic or monotonic_s
        self._lock = threading.Lock()
        self._at_s = self._monotonic()
        self._offset_s = self._wall() - self._at_s
        self._step_s = 0.0

    def now_s(self) -> float:
        """Unix time. It never goes back."""
        with self._lock:
            at_s = self._monotonic()
            apart_s = self._wall() - at_s - self._offset_s
            if abs(apart_s) <= STEP_S:
                most_s = SLEW * (at_s - self._at_s)
                self._offset_s += min(max(apart_s, -most_s), most_s)
            self._step_s = apart_s if abs(apart_s) > STEP_S else 0.0
            self._at_s = at_s
            return at_s + self._offset_s

    @property
    def step_s(self) -> float:
        """By how much the clock of the machine was ahead of this one at the last look, after it was set; 0: it was not."""
        return self._step_s

    def adopt(self) -> None:
        """Take the time of the machine as it is now."""
        with self._lock:
            self._at_s = self._monotonic()
            self._offset_s, self._step_s = self._wall() - self._at_s, 0.0


class ClockSet(RuntimeError):
    """The time of the run is no longer that of its clock: the run begins again."""


CLOCK = SteadyClock()
"""That of this process."""


def now_s() -> float:
    """Unix time by the clock of this process."""
    return CLOCK.now_s()
