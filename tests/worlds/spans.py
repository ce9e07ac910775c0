"""The span of a recorded feed without a scenario around it."""

from __future__ import annotations

import math
from typing import Any

from coastwatch.batches import Sensors
from coastwatch.sensors.recorded.tables.feed import NO_SENSORS


def span_of(feed: Any, sensors: Sensors = NO_SENSORS) -> tuple[float, float]:
    """Whole seconds around all of its reports. Args: feed: of any kind that is recorded."""
    span: tuple[float, float] = feed.span(lambda: sensors, -math.inf, to_the_end=False)
    return span
