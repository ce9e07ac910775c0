"""What do R like regions cost, of what one costs, over threads, processes and Ray? What `workers.method = "auto"` rests on.

    python -m scaling.decisions.regions [VESSELS [CYCLES [WAYS [WORKERS]]]]

VESSELS are in each of 1, 2 and 4 regions of two radars that do not see each other. They run in turns with one region, cycle by
cycle. Times are of `tracks`: radar reports of all regions in, tracks and their plots out. WAYS are some of one (one thread), threads,
processes, ray. Way "ray-again" also brings the memories of the regions home every cycle.
"""

from __future__ import annotations

import argparse
import time
from contextlib import nullcontext

import numpy as np

from coastwatch.batches import Messages, RadarCorrections, RadarReports, Videos
from coastwatch.kernels.threads import threads
from coastwatch.operators.cli.arguments import count, names
from coastwatch.regional import reports_of_regions, start_region, step_of_regions
from coastwatch.stage import RegionMap, serial, serial_regions
from coastwatch.workers import Workers, open_workers
from scaling.load.chain.reports import initial_state, next_cycle
from scaling.load.chain.world import Size, World, build_world
from scaling.load.processes import processor_s

REGIONS = 1, 2, 4
SETTLING = 5  # cycles


def reports_of(world: World) -> list[RadarReports]:
    """The radar reports of each cycle."""
    state, out = initial_state(world), []
    for _ in range(world.plan.cycles):
        state, reports = next_cycle(world, state)
        out.append(reports.radar)
    return out


class Run:
    """Some regions, mapped in one way."""

    def __init__(self, world: World, number: int, regions: RegionMap, gather: bool) -> None:
        self.world, self.regions, self.gather = world, regions, gather
        self.memories = [start_region(world.scenario) for _ in range(number)]
        self.wall_s: list[float] = []
        self.processor_s: list[float] = []
        self.tracks: list[int] = []

    def cycle(self, number: int, reports: RadarReports) -> None:
        """One cycle of all regions."""
        scenario, sensors = self.world.scenario, self.world.sensors
        wall_s, begun = time.perf_counter(), processor_s()
        none, now_s = RadarCorrections.empty(R=len(sensors.radars)), self.world.plan.instant_s(number)
        messages = [Messages.empty()] * len(sensors.region_names)
        given, _ = reports_of_regions(reports, messages, none, now_s, sensors, Videos())
        found = self.regions(step_of_regions(scenario), self.memories, given[: len(self.memories)])
        self.memories = [memory for memory, _ in found]
        if self.gather:
            self.regions.gather(self.memories)
        self.wall_s.append(time.perf_counter() - wall_s)
        self.processor_s.append(processor_s() - begun)
        self.tracks = [len(region.tracks) for _, region in found]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("vessels", nargs="?", type=count, default=4000, help="in a region (default: 4,000)")
    parser.add_argument("cycles", nargs="?", type=count, default=20, help=f"after {SETTLING} that do not count (default: 20)")
    ways = "one", "threads", "processes"
    parser.add_argument("ways", nargs="?", type=names, default=ways, help=f"default: {','.join(ways)}")
    parser.add_argument("workers", nargs="?", type=count, default=2, help="default: 2")
    asked = parser.parse_args()
    vessels, cycles, workers = asked.vessels, asked.cycles, asked.workers
    size = Size(max(REGIONS) * vessels, SETTLING + cycles, region_vessels=vessels, apart=True)
    world = build_world(size, {}, 1)
    reports = reports_of(world)
    print(
        f"{vessels} vessels a region, {workers} workers; times of a cycle in ms; of one: of one region in one thread, in turns"
    )
    print(f"{'way':18s}{'regions':>8s}{'tracks':>8s}{'processor':>11s}{'of one':>8s}{'wall':>8s}{'of one':>8s}")
    for way in asked.ways:
        for regions in REGIONS:
            line(world, reports, way, regions, workers)


def line(world: World, reports: list[RadarReports], way: str, regions: int, workers: int) -> None:
    """Measure and print one way for some regions."""
    name, _, again = way.partition("-")
    opened = nullcontext(Workers(serial, serial_regions)) if name == "one" else open_workers(name, workers)
    with opened as maps:
        one, run = Run(world, 1, serial_regions, False), Run(world, regions, maps.regions, bool(again))
        for number in range(world.plan.cycles):
            with threads(1):
                one.cycle(number, reports[number])
            run.cycle(number, reports[number])
    assert run.tracks[:1] == one.tracks
    mine, alone = (float(np.mean(each.processor_s[SETTLING:])) for each in (run, one))
    clock, clock_alone = (float(np.median(each.wall_s[SETTLING:])) for each in (run, one))
    print(
        f"{way:18s}{regions:8d}{sum(run.tracks):8d}{1e3 * mine:11.1f}{mine / alone:8.2f}{1e3 * clock:8.1f}"
        f"{clock / clock_alone:8.2f}",
        flush=True,
    )


if __name__ == "__main__":
    main()
