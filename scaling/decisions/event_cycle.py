"""What do events of flags cost in a cycle of a large picture?

    python -m scaling.decisions.event_cycle [VESSELS [CYCLES]]

One vessel in twenty has a flag, and of a thousand vessels one changes a flag in each cycle. Processor time of `alarms.next_events`,
which writes evidence too, and of `events.write_events` into SQLite, medians.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from pathlib import Path
from time import process_time

import numpy as np

from coastwatch import store
from coastwatch.alarms import EventMemory, EvidenceContext, expected_sensors, next_events
from coastwatch.batches import (
    BearingAssociations,
    BearingTracks,
    Flag,
    Ints,
    Members,
    Picture,
    Tracks,
    VesselAlarms,
)
from coastwatch.operators.cli.arguments import count
from coastwatch.scenario import load_scenario
from coastwatch.store.schema.database import writing
from coastwatch.store.write.events import Timeline, write_events

WARM = 2  # cycles: in the first all flags begin
FLAGGED, CHANGING = 0.05, 0.001
GAP_S = 60.0
NONE = np.zeros(0, np.int64)
RADAR, AIS = 0, 1  # sources of the tracks of each vessel


def picture_of(flags: Ints, time_s: float) -> Picture:
    """Vessels with these flags."""
    n = len(flags)
    when, covariance = np.full(n, time_s), np.tile(np.eye(4), (n, 1, 1))
    position = np.stack([np.linspace(-35.0, 5.0, n), np.linspace(-55.0, -30.0, n)], 1)
    mmsi = 200_000_000 + np.arange(n)
    vessel = np.arange(1, n + 1)
    return Picture(vessel, when, position, np.ones((n, 2)), covariance, when, when, mmsi, flags, mmsi)


def tracks_of(picture: Picture) -> Tracks:
    """A radar and an AIS track of each vessel."""
    n = len(picture)
    both = np.repeat(np.arange(n), 2)
    when, mmsi = picture.time_s[both], np.where(np.tile([RADAR, AIS], n) == AIS, picture.mmsi[both], -1)
    covariance, position = picture.covariance[both], picture.position_deg[both]
    ids, source = np.arange(2 * n), np.tile([RADAR, AIS], n)
    velocity = picture.velocity_m_s[both]
    return Tracks(ids, source, when, position, velocity, covariance, covariance[:, :2, :2], when, when, mmsi, mmsi)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("vessels", nargs="?", type=count, default=100_000, help="default: 100,000")
    parser.add_argument("cycles", nargs="?", type=count, default=12, help=f"the first {WARM} do not count (default: 12)")
    asked = parser.parse_args()
    vessels, cycles = asked.vessels, asked.cycles
    rng, kinds = np.random.default_rng([17, vessels]), np.array([flag.value for flag in Flag])
    scenario = load_scenario("context-driven-100", {"cycles": str(cycles), "warmup_s": "0"})
    sensors, plan = scenario.sensors(), scenario.plan()
    names = sensors.source_names
    flags = np.where(rng.random(vessels) < FLAGGED, rng.choice(kinds, vessels), 0)
    members = Members(np.repeat(np.arange(1, vessels + 1), 2), np.arange(2 * vessels), np.tile([RADAR, AIS], vessels))
    no_bearings = BearingTracks.empty(), BearingAssociations(NONE, NONE, np.zeros(0), np.zeros(0))
    expected, heard_s = expected_sensors(sensors, 0.95, 60.0, 60.0), np.full(vessels, -np.inf)
    memory, ms, rows = EventMemory.none(), [], 0
    with tempfile.TemporaryDirectory() as folder, store.open_store(f"sqlite:///{Path(folder) / 'events.db'}") as opened:
        run = store.begin_run(opened, scenario="events", title="", seed=1, version="", settings={}, sensors=sensors, plan=plan)
        for number in range(cycles):
            change = rng.random(vessels) < CHANGING
            flags = np.where(change, np.where(flags > 0, 0, rng.choice(kinds, vessels)), flags)
            time_s = plan.instant_s(number)
            picture = picture_of(flags, time_s)
            tracks = tracks_of(picture)
            evidence = EvidenceContext(tracks, members, *no_bearings, names, *expected, heard_s)
            begun = process_time()
            memory, changes = next_events(memory, picture, VesselAlarms.empty(), time_s, GAP_S, evidence)
            extended = process_time()
            with writing(opened) as connection:
                rows += write_events(connection, run, number, changes, Timeline(plan.start_s, plan.period_s))
            ms.append((1e3 * (extended - begun), 1e3 * (process_time() - extended)))
    follow, write = (statistics.median(column) for column in zip(*ms[WARM:], strict=True))
    print(f"{vessels} vessels, {np.count_nonzero(flags)} with a flag, {rows} rows in {cycles} cycles")
    print(f"processor time a cycle: next_events {follow:.1f} ms, write_events {write:.1f} ms; first cycle {sum(ms[0]):.0f} ms")


if __name__ == "__main__":
    main()
