"""The feed `live_feeds`: nothing of its own. All reports come by the live feeds of a server."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NoReturn

from coastwatch.batches import Sensors
from coastwatch.errors import InputError
from coastwatch.stage import Method, Plan

NO_INPUT = "input: got none, needed [input] with a method, or live feeds: coastwatch serve SCENARIO --feed ais+tcp://HOST:PORT"


class LiveFeeds(Method):
    """The live feeds of a server and nothing else: what a scenario without `[input]` has. `run` and `feed` refuse it."""

    method: Literal["live_feeds"] = "live_feeds"

    def load(self, sensors: Sensors, seed: int, plan: Plan) -> NoReturn:
        """There is no report to load. Raises: InputError."""
        raise InputError(NO_INPUT)

    def span(self, sensors: Callable[[], Sensors], after_s: float, to_the_end: bool) -> NoReturn:
        """It has no end. Raises: InputError."""
        raise InputError(NO_INPUT)
