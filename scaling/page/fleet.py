"""A server with a live picture of simulated vessels about ports of north-west Europe, without a pipeline behind it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from coastwatch.batches import Array, Flag, Floats, Radars, Sensors, Sonars, Stations
from coastwatch.operators.api.application import application
from coastwatch.operators.api.guard import Guard
from coastwatch.operators.api.service import Service
from coastwatch.operators.api.wire import ahead
from coastwatch.operators.cli.serving import bound, server_of
from coastwatch.server.alarm_book import AlarmBook
from coastwatch.server.link import FeedState
from coastwatch.server.live_picture import OWN, LivePicture
from coastwatch.server.live_video import LiveVideo
from coastwatch.server.troubles import Trouble
from coastwatch.stage import Plan
from coastwatch.store import Table, begin_run, open_store

PERIOD_S = 3.0
START_UP_S = 60.0
NAMES, SITES, NONE = np.zeros(0, "U1"), np.zeros((0, 2)), np.zeros(0)
NO_SENSORS = Sensors(
    Radars(NAMES, np.zeros(0, np.int64), SITES, NONE, NONE, NONE, NONE),
    Stations(NAMES, SITES, NONE),
    Sonars(NAMES, SITES, NONE, NONE, NONE, NONE, NONE),
    (),
    SITES,
)


@dataclass
class Fleet:
    """Vessels that hold their courses for minutes; a third is moored. V vessels."""

    random: np.random.Generator
    latitude_deg: Floats  # (V,)
    longitude_deg: Floats
    sog_kn: Floats
    cog_deg: Floats
    kind: Array  # sum of 1 AIS, 2 radar
    flags: Array

    @classmethod
    def of(cls, vessels: int, seed: int) -> Fleet:
        """A fleet about 40 ports."""
        random = np.random.default_rng([seed, vessels])
        ports = np.stack([random.uniform(49.0, 61.0, 40), random.uniform(-5.0, 12.0, 40)], 1)
        position = ports[random.integers(0, 40, vessels)] + random.normal(0.0, [0.45, 0.7], (vessels, 2))
        moored = random.random(vessels) < 0.3
        return cls(
            random,
            position[:, 0],
            position[:, 1],
            np.where(moored, 0.0, random.gamma(6.0, 2.0, vessels)),
            random.uniform(0.0, 360.0, vessels),
            random.choice(np.array([1, 2, 3], np.uint8), vessels, p=[0.3, 0.3, 0.4]),
            np.where(random.random(vessels) < 0.01, int(Flag.DARK), 0),
        )

    def move(self, seconds: float) -> None:
        """Go on: one vessel in fifty turns, estimates wander a little."""
        random, n = self.random, len(self.cog_deg)
        turn = np.where(random.random(n) < 0.02, random.normal(0.0, 20.0, n), random.normal(0.0, 0.3, n))
        self.cog_deg = np.where(self.sog_kn > 0.0, (self.cog_deg + turn) % 360.0, self.cog_deg)
        self.latitude_deg, self.longitude_deg = ahead(
            self.latitude_deg, self.longitude_deg, self.sog_kn, self.cog_deg, np.full(n, seconds)
        )

    def picture(self, run_id: int, cycle: int, time_s: float) -> LivePicture:
        """The picture of now."""
        n = len(self.cog_deg)
        found: dict[str, Any] = {
            "vessel_id": np.arange(1, n + 1),
            "mmsi": np.where(self.kind & 1, 200_000_000 + np.arange(n), -1),
            "major_m": np.full(n, 12.0),
            "minor_m": np.full(n, 7.0),
            "orientation_deg": self.cog_deg,
            "nav_status": np.full(n, -1),
        }
        found |= dict.fromkeys(("time_s", "since_s", "updated_s"), np.full(n, time_s))
        absent = np.full(n, np.nan)  # columns of the picture that the page does not show
        own = Table(OWN, tuple(found[name] if name in found else getattr(self, name, absent) for name in OWN))
        return LivePicture(run_id, cycle, time_s, own, self.kind, np.zeros(n, np.int64), ["radar,ais"], {})


class Simulated:
    """The source of the pictures, as `Service` asks for it."""

    live, failed = True, False

    def __init__(self) -> None:
        self.alarms = AlarmBook()

    def error(self) -> None:
        return None

    def feeds(self) -> list[FeedState]:
        return []

    def cycle_s(self) -> None:
        return None

    def counts(self) -> dict[str, float]:
        return {}

    def troubles(self) -> list[Trouble]:
        return []

    def now_s(self) -> float:
        return time.time()

    def about(self) -> None:
        return None

    def later(self, job: Callable[[], Any]) -> Future[Any]:
        made: Future[Any] = Future()
        made.set_result(job())
        return made


@contextmanager
def listening(service: Service, web: Path) -> Iterator[str]:
    """Serve the page and the API in a thread. Yields: the address of the page."""
    server = server_of(application(service, Guard(), web))
    with bound("127.0.0.1", 0) as opened:
        port = opened.getsockname()[1]
        thread = threading.Thread(target=server.run, kwargs={"sockets": [opened]})
        thread.start()
        end = time.monotonic() + START_UP_S
        while not server.started and time.monotonic() < end:
            time.sleep(0.02)
        try:
            yield f"http://127.0.0.1:{port}"
        finally:
            server.should_exit = True
            thread.join()


@contextmanager
def served_fleet(vessels: int, seed: int, folder: Path, web: Path, video: LiveVideo | None = None) -> Iterator[str]:
    """Serve a fleet whose picture comes every 3 s. Yields: the address of the page."""
    fleet, stop = Fleet.of(vessels, seed), threading.Event()
    with open_store(str(folder / "fleet.db")) as opened:
        plan = Plan(start_s=time.time(), period_s=PERIOD_S, cycles=1_000_000)
        about = {"title": f"{vessels:,} simulated vessels", "version": "", "settings": {}, "sensors": NO_SENSORS}
        run_id = begin_run(opened, scenario="fleet", seed=seed, plan=plan, **about)  # type: ignore[arg-type]
        service = Service(opened, video=video)
        service.source = Simulated()

        def go_on() -> None:
            cycle = 0
            while not stop.is_set():
                service.receive(fleet.picture(run_id, cycle, time.time()))
                cycle += 1
                stop.wait(PERIOD_S)
                fleet.move(PERIOD_S)

        thread = threading.Thread(target=go_on)
        thread.start()
        try:
            with listening(service, web) as address:
                yield address
        finally:
            stop.set()
            thread.join()
