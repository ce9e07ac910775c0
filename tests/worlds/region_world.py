"""A region whose cycles of tracks are made up, and a centre that runs on them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import store_world

from coastwatch import store
from coastwatch.geodesy import offset_deg
from coastwatch.operators.api.service import Service
from coastwatch.scenario import Scenario, load_scenario
from coastwatch.server.deployment import of_centre
from coastwatch.server.feeds.live_input import LiveInput
from coastwatch.server.live import LiveRun
from coastwatch.server.regions.client import parsed_region
from coastwatch.server.regions.message import RegionCycle, RegionTracks, encode
from coastwatch.server.regions.publisher import Publisher
from coastwatch.store import ForCentres, Store
from coastwatch.store.journal import write_for_centres
from coastwatch.store.schema.database import writing
from scaling.page.fleet import Simulated

START_S, PERIOD_S, VESSELS = 1_750_000_000.0, 3.0, 8
START_UTC = "2025-06-15T15:06:40Z"


def region_tracks(number: int) -> RegionTracks:
    """Vessels that sail straight on, 1 km apart."""
    time_s = (number + 1) * PERIOD_S
    velocity = np.stack([np.linspace(2.0, 6.0, VESSELS), np.linspace(-5.0, 5.0, VESSELS)], 1)
    first = offset_deg(np.full((VESSELS, 2), (-22.9, -43.1)), np.stack([np.arange(VESSELS) * 1000.0, np.zeros(VESSELS)], 1))
    covariance = np.broadcast_to(np.diag([100.0, 100.0, 0.25, 0.25]), (VESSELS, 4, 4)).copy()
    place = offset_deg(first, velocity * time_s)
    return RegionTracks(np.arange(VESSELS) + 11, np.full(VESSELS, START_S + time_s), place, velocity, covariance)


class Region:
    """A region with a database, of which a test decides when it writes a cycle."""

    def __init__(self, opened: Store) -> None:
        self.service = Service(opened, publisher=Publisher(opened))
        self.service.source = Simulated()
        self._store, self._run, self.cycles = opened, store_world.begin(opened), 0

    def write(self, cycles: int) -> None:
        """Write so many further cycles."""
        publisher = self.service.publisher
        assert publisher is not None
        for number in range(self.cycles, self.cycles + cycles):
            time_s = START_S + (number + 1) * PERIOD_S
            key = store.run_key(self._store, self._run) or ""
            message = encode(RegionCycle(key, number + 1, time_s, region_tracks(number)))
            with writing(self._store) as connection:
                write_for_centres(connection, self._run, number, time_s, ForCentres(message), 600)
            publisher.written(self._run, number, message)
        self.cycles += cycles


def centre_scenario() -> Scenario:
    """A centre of the region `north` without other sensors, from the start of the region on."""
    scenario = load_scenario("guanabara", {"start_utc": START_UTC, "warmup_s": "0", "store.recording": "true"})
    return of_centre(scenario.model_copy(update={"sonars": ()}), ["north"])


def centre(opened: Store, path: Path, address: str) -> tuple[LiveInput, LiveRun]:
    """A centre that is not started yet."""
    scenario = centre_scenario()
    source = LiveInput([], scenario.sensors(), regions=[parsed_region(f"ws://{address}?name=north")], clock="feeds")
    service = Service(opened)
    run = LiveRun(scenario, source, service.receive, database=f"sqlite:///{path}", workers=1, resume=True)
    service.source = run
    return source, run
