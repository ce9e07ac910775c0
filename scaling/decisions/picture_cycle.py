"""What fused tracks and the picture cost in a cycle, at any size and number of threads, against plain sorting and searching.

    python -m scaling.decisions.picture_cycle [--tracks N ...] [--threads N ...] [--method convex] [--cycles 12] [--numpy-up-to N]

Tracks are those of the national picture (scaling/load). Tracks of one true vessel are associated, but for three in a thousand.
Columns, in ms: median wall time of each stage and of both, the least of both, processor time of all threads. The last is how many times
as much processor time the oracles in tests/oracles take in the same run (fused_by_arrays, picture_by_sorting).
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from coastwatch.batches import Associations, FusedTracks, Tracks
from coastwatch.centre import Received
from coastwatch.fused_tracks import FusionInput
from coastwatch.kernels.threads import threads
from coastwatch.picture import PictureInput
from coastwatch.scenario import Scenario
from scaling.load import national

ORACLES = Path(__file__).parents[2] / "tests" / "oracles"
APART = 0.003  # share of the tracks that are taken for a vessel of their own, in each cycle others
WARMUP = 4  # cycles that do not count
PARTS = ("fused_tracks", "picture")


class Given(NamedTuple):
    """What the two stages get in a cycle."""

    time_s: float
    received: Received
    tracks: Tracks
    associations: Associations


def cycles(scenario: Scenario, world: national.World, count: int) -> Iterator[Given]:
    """The tracks of so many cycles, and which of them are one vessel."""
    rng, state, sensors = np.random.default_rng([1, 71]), national.initial_state(world), scenario.sensors()
    none = np.zeros(0, np.int64)
    for cycle in range(count):
        state, received = national.next_cycle(world, state, sensors)
        tracks = scenario.alignment.step(received.tracks, world.time_s(cycle))
        apart = np.where(rng.random(len(tracks)) < APART, 1 + tracks.source, 0)
        _, first, of = np.unique(
            tracks.origin * (len(sensors.source_names) + 1) + apart, return_index=True, return_inverse=True
        )
        number = np.empty(len(first), np.int64)
        number[np.argsort(first)] = np.arange(len(first))
        yield Given(world.time_s(cycle), received, tracks, Associations(none, none, np.zeros(0), number[of]))


class Clock:
    """Wall and processor time of named parts, in seconds, one of each a cycle."""

    def __init__(self) -> None:
        self.wall: dict[str, list[float]] = {}
        self.cpu: dict[str, list[float]] = {}

    def run(self, name: str, work: Any, *given: Any) -> Any:
        """work(*given), timed."""
        wall, cpu = time.perf_counter(), time.process_time()
        done = work(*given)
        self.wall.setdefault(name, []).append(time.perf_counter() - wall)
        self.cpu.setdefault(name, []).append(time.process_time() - cpu)
        return done

    def median_ms(self, times: dict[str, list[float]], names: tuple[str, ...]) -> float:
        """Of the sum of parts, after the warm-up."""
        return 1e3 * float(np.median(np.sum([times[name][WARMUP:] for name in names], axis=0)))


class Sorting:
    """Both stages as plain sorting and searching, with their memory."""

    def __init__(self, scenario: Scenario) -> None:
        sys.path.insert(0, str(ORACLES))
        import fused_by_arrays
        import picture_by_sorting

        self.fuse, self.identify = fused_by_arrays.convex, picture_by_sorting.step
        self.settings, self.sensors, self.memory = scenario.picture, scenario.sensors(), picture_by_sorting.start()

    def step(self, given: Given) -> None:
        """A cycle."""
        vessel = given.associations.vessel
        position, velocity, covariance = self.fuse(given.tracks, given.tracks.known_covariance(0.5), vessel)
        fused = FusedTracks(np.full(len(position), given.time_s), position, velocity, covariance)
        given_to = given.associations, fused, given.received.alarms, given.time_s, self.sensors
        self.memory, *_ = self.identify(self.settings, self.memory, given.tracks, *given_to)


def measure(tracks: int, count: int, method: str, cycle_count: int, with_numpy: bool) -> str:
    """A line of figures for one size and number of threads."""
    world = national.build_world(tracks, 1)
    scenario = national.scenario_of(world, {"fused_tracks.method": method})
    sensors, fuser, picture, clock = scenario.sensors(), scenario.fused_tracks, scenario.picture, Clock()
    memory, past, sorting = fuser.init(), picture.init(), Sorting(scenario)
    kinds = sensors.source_kinds
    with threads(count):
        for given in cycles(scenario, world, WARMUP + cycle_count):
            t, m = given.tracks, given.received.measurements
            fusion = FusionInput(t, m, given.associations, given.time_s, kinds)
            memory, fused = clock.run(PARTS[0], fuser.step, memory, fusion)
            shown = PictureInput(t, given.associations, fused, given.received.alarms, given.time_s, sensors)
            past, _ = clock.run(PARTS[1], picture.step, past, shown)
            if with_numpy:
                clock.run("numpy", sorting.step, given)
    each = "".join(f"{clock.median_ms(clock.wall, (name,)):9.1f}" for name in PARTS)
    wall, cpu = clock.median_ms(clock.wall, PARTS), clock.median_ms(clock.cpu, PARTS)
    least = 1e3 * min(np.sum([clock.wall[name][WARMUP:] for name in PARTS], axis=0))
    slower = f"{clock.median_ms(clock.cpu, ('numpy',)) / cpu:8.1f}" if with_numpy else f"{'-':>8}"
    return f"{tracks:10d}{count:8d}{each}{wall:9.1f}{least:9.1f}{cpu:9.1f}{slower}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tracks", type=int, nargs="+", default=[10_000, 100_000, 400_000, 1_000_000])
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--method", default="convex")
    parser.add_argument("--cycles", type=int, default=12)
    parser.add_argument("--numpy-up-to", type=int, default=100_000, help="tracks beyond which numpy is not run")
    asked = parser.parse_args()
    print(
        f"# {asked.method}, {os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}; ms a cycle, medians of {asked.cycles}"
    )
    print("    tracks threads    fused  picture     both    least      cpu  oracle")
    for tracks in asked.tracks:
        for count in asked.threads:
            with_numpy = asked.method == "convex" and tracks <= asked.numpy_up_to
            print(measure(tracks, count, asked.method, asked.cycles, with_numpy), flush=True)


if __name__ == "__main__":
    main()
