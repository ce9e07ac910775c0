"""What Prometheus may ask of the server."""

from __future__ import annotations

import time
from typing import Any

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from prometheus_client.core import GaugeMetricFamily

from coastwatch.operators.api.wire import FULL
from coastwatch.server.live_picture import LivePicture

KIND_AT = 5
"""Byte of a message that says which kind it is."""


class Metrics:
    """Counters and gauges of one server."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        of: dict[str, Any] = {"registry": self.registry}
        self.vessels = Gauge("coastwatch_vessels", "Vessels in the picture", **of)
        self.time = Gauge("coastwatch_picture_time_seconds", "Time of the picture, Unix time", **of)
        self.viewers = Gauge("coastwatch_viewers", "Open sockets of viewers", **of)
        self.slow_closed = Counter("coastwatch_viewers_slow_closed", "Viewers closed because they did not read", **of)
        self.skipped = Counter("coastwatch_frames_skipped", "Frames that viewers skipped because they were slow", **of)
        self.bytes = Counter("coastwatch_sent_bytes", "Bytes of frames sent", **of)
        frames = Counter("coastwatch_frames_sent", "Frames sent", ["kind"], **of)
        self.full, self.delta = frames.labels("full"), frames.labels("delta")
        self.requests = Counter("coastwatch_requests", "Requests answered", ["status"], **of)
        self.cycle = Histogram(
            "coastwatch_cycle_seconds", "Time of a cycle", buckets=(0.05, 0.1, 0.25, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0), **of
        )
        self.registry.register(_Age(self))
        self._time_s = 0.0

    @property
    def age_s(self) -> float:
        """How old the picture is, s; 0 before the first one."""
        return time.time() - self._time_s if self._time_s else 0.0

    def picture(self, picture: LivePicture) -> None:
        """Note a new picture."""
        self._time_s = picture.time_s
        self.vessels.set(len(picture))
        self.time.set(picture.time_s)

    def sent(self, message: bytes, skipped: int) -> None:
        """Note a message to a viewer, and how many frames the viewer skipped."""
        (self.full if message[KIND_AT] == FULL else self.delta).inc()
        self.bytes.inc(len(message))
        if skipped > 0:
            self.skipped.inc(skipped)

    def text(self) -> bytes:
        """All of them in the text format of Prometheus."""
        return generate_latest(self.registry)


class _Age:
    """The age of the picture when it is asked for."""

    def __init__(self, metrics: Metrics) -> None:
        self._metrics = metrics

    def collect(self) -> list[GaugeMetricFamily]:
        return [GaugeMetricFamily("coastwatch_picture_age_seconds", "Age of the picture", self._metrics.age_s)]
