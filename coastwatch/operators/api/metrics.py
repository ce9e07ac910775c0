"""What Prometheus may ask of the server."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from prometheus_client import (
    CollectorRegistry,
    Counter,
    Gauge,
    Histogram,
    ProcessCollector,
    disable_created_metrics,
    generate_latest,
)
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric

from coastwatch.operators.api.wire import FULL
from coastwatch.server.live_picture import LivePicture
from coastwatch.server.troubles import Trouble

Asked = Callable[[], tuple[bool, Mapping[str, float], Sequence[Mapping[str, Any]], Sequence[Trouble]]]
"""Returns whether there is a picture of now, the counts of a live run, its feeds, and what is wrong."""

OF_RUN = {
    "cycles": "Cycles computed",
    "cycles_late": "Cycles that were more than a period late",
    "late_s": "How long after it was due the last picture was ready",
    "cycles_merged": "Cycles that were merged with the next one, because the run was behind",
    "restarts": "How often the run failed and was begun again",
    "store_waiting": "Cycles that wait for the database",
    "store_skipped": "Cycles whose picture was not stored",
    "store_failures": "Attempts to write to the database that failed",
    "store_forgotten": "Events and changes by operators that could not be stored",
    "alarms_forgotten": "Ended alarms that nobody acknowledged, and that are in the database alone",
    "log_bytes": "Size of the write-ahead log of an SQLite database",
}
GAUGES = ("late_s", "store_waiting", "log_bytes")
OF_RADAR = ("spokes", "spokes_lost", "parts_lost")
RADAR_STATE = ("turn_s", "spokes_a_turn", "plots_a_turn", "threshold_db", "detection_probability", "false_plots_a_turn")
OF_FEED = ("bytes", "records", "refused", "late", "before_run", "dropped", "connections")

disable_created_metrics()  # type: ignore[no-untyped-call]  # a time for each counter that nobody asks for

KIND_AT = 5
"""Byte of a message that says which kind it is."""


class Metrics:
    """Counters and gauges of one server."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        registry: dict[str, Any] = {"registry": self.registry}
        self.vessels = Gauge("coastwatch_vessels", "Vessels in the picture", **registry)
        self.time = Gauge("coastwatch_picture_time_seconds", "Time of the picture, Unix time", **registry)
        self.viewers = Gauge("coastwatch_viewers", "Open sockets of viewers", **registry)
        self.slow_closed = Counter("coastwatch_viewers_slow_closed", "Viewers closed because they did not read", **registry)
        self.skipped = Counter("coastwatch_frames_skipped", "Frames that viewers skipped because they were slow", **registry)
        self.bytes = Counter("coastwatch_sent_bytes", "Bytes of frames sent", **registry)
        frames = Counter("coastwatch_frames_sent", "Frames sent", ["kind"], **registry)
        self.full, self.delta = frames.labels("full"), frames.labels("delta")
        self.requests = Counter("coastwatch_requests", "Requests answered", ["status"], **registry)
        self.webhooks = Counter("coastwatch_webhook", "Messages to web hooks", ["webhook", "count"], **registry)
        self.cycle = Histogram(
            "coastwatch_cycle_seconds", "Time of a cycle", buckets=(0.05, 0.1, 0.25, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0), **registry
        )
        self._newest: tuple[float, float] | None = (
            None  # age of the newest picture when it came, and when by the monotonic clock
        )
        self.source: Asked = lambda: (False, {}, [], [])
        ProcessCollector(registry=self.registry)
        self.registry.register(_Asked(self))

    def certificate(self, left_s: Callable[[], float]) -> None:
        """Tell how long the TLS certificate is valid, s, whenever that is asked for."""
        left = Gauge(
            "coastwatch_tls_expires_seconds", "Until the TLS certificate ends; negative: it has", registry=self.registry
        )
        left.set_function(left_s)

    def disk(self, free_bytes: Callable[[], float]) -> None:
        """Tell how much room the disk of the database has, whenever that is asked for."""
        free = Gauge("coastwatch_disk_free_bytes", "Free bytes of the disk of an SQLite database", registry=self.registry)
        free.set_function(free_bytes)

    def ask(self, source: Asked) -> None:
        """Read the counts of a run and of its feeds from this function whenever they are asked for."""
        self.source = source

    @property
    def age_s(self) -> float:
        """How old the picture is, s; 0 before the first one. A step of the clock of this machine does not change it."""
        return 0.0 if self._newest is None else self._newest[0] + self.waited_s

    @property
    def waited_s(self) -> float:
        """For how long no picture has come, s; 0 before the first one."""
        return 0.0 if self._newest is None else time.monotonic() - self._newest[1]

    def picture(self, picture: LivePicture, now_s: float) -> None:
        """Note a new picture. Args: now_s: by the clock of its source."""
        self._newest = now_s - picture.time_s, time.monotonic()
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


class _Asked:
    """What is read when it is asked for: the age of the picture, counts of a live run and of its feeds."""

    def __init__(self, metrics: Metrics) -> None:
        self._metrics = metrics

    def collect(self) -> Iterator[Metric]:
        yield GaugeMetricFamily("coastwatch_picture_age_seconds", "Age of the picture", self._metrics.age_s)
        ready, counts, feeds, troubles = self._metrics.source()
        yield GaugeMetricFamily("coastwatch_ready", "1: there is a picture of now", float(ready))
        for name, meaning in OF_RUN.items():
            if name in counts:
                kind = GaugeMetricFamily if name in GAUGES else CounterMetricFamily
                yield kind(
                    f"coastwatch_{name.removesuffix('_s')}" + ("_seconds" if name.endswith("_s") else ""), meaning, counts[name]
                )
        wrong = GaugeMetricFamily("coastwatch_trouble", "1: something is wrong", labels=["kind", "name", "serious"])
        for kind_of, name, serious in sorted({(one.kind, one.name, str(one.is_serious).lower()) for one in troubles}):
            wrong.add_metric([kind_of, name, serious], 1.0)
        yield wrong
        of_feeds = CounterMetricFamily("coastwatch_feed", "Counts of a feed", labels=["feed", "count"])
        connected = GaugeMetricFamily(
            "coastwatch_feed_connected",
            "1: a feed has a connection, or needs none, as one that is sent over UDP",
            labels=["feed"],
        )
        silent = GaugeMetricFamily("coastwatch_feed_silent_seconds", "For how long nothing has come of a feed", labels=["feed"])
        of_radars = CounterMetricFamily("coastwatch_radar", "Counts of the video of a radar", labels=["feed", "radar", "count"])
        states = GaugeMetricFamily(
            "coastwatch_radar_state", "What is known of the video of a radar", labels=["feed", "radar", "value"]
        )
        stopped = GaugeMetricFamily(
            "coastwatch_radar_silent_seconds", "For how long no video of a radar has come", labels=["feed", "radar"]
        )
        for feed in feeds:
            of_feed = str(feed["name"])
            for radar in feed.get("radars", ()):
                of = [of_feed, str(radar["name"])]  # two feeds may have video of one radar
                for name in OF_RADAR:
                    of_radars.add_metric([*of, name], float(radar[name]))
                for name in RADAR_STATE:
                    if radar[name] is not None:
                        states.add_metric([*of, name], float(radar[name]))
                stopped.add_metric(of, float(radar["silent_s"]))
            for name in OF_FEED:
                of_feeds.add_metric([of_feed, name], float(feed[name]))
            connected.add_metric([of_feed], float(feed["connected"]))
            silent.add_metric([of_feed], float(feed["silent_s"]))
        yield from (of_feeds, connected, silent, of_radars, states, stopped)
