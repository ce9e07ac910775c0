"""What do threads and processes gain in the work of spots? What `workers.method = "auto"` rests on.

    python -m scaling.decisions.workers [TRACKS [WORKERS [CYCLES]]]

First the association of tracks, over the national picture after CYCLES cycles. It has time by the clock and of all processors, median
of nine in turns, and the size of the arrays that processes share. Then fusion by `central_imm` for half as many vessels, with a plot
each: its processor time in one thread. Beside it stands the time to move its filters to another process and back.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import numpy as np

from coastwatch.associations.windowed_covariance import score_spots
from coastwatch.fused_tracks import CentralImm
from coastwatch.kernels.filters import fused_filters
from coastwatch.kernels.threads import threads
from coastwatch.operators.cli.arguments import count
from coastwatch.stage import Map, serial
from coastwatch.workers.processes import Processes
from coastwatch.workers.shared_memory import Publisher, Reader
from scaling.decisions.association_cycle import last_cycle
from scaling.load.processes import processor_s

SETTLING, REPEATS = 5, 9
MB = 1e6


def association(tracks: int, workers: int, cycles: int) -> None:
    """Print the times of the association in one thread, over threads, and over processes."""
    arrays, spots, *_, method = last_cycle(tracks, cycles)
    with ExitStack() as stack:
        pool = stack.enter_context(Processes(workers))
        ways: dict[str, tuple[int, Map]] = {"one thread": (1, serial), "threads": (workers, serial), "processes": (1, pool)}
        wall: dict[str, list[float]] = {way: [] for way in ways}
        processor: dict[str, list[float]] = {way: [] for way in ways}
        pairs = {}
        for _ in range(SETTLING + REPEATS):
            for way, (of_kernels, map_) in ways.items():
                with threads(of_kernels):
                    begun, begun_cpu = time.perf_counter(), processor_s()
                    parts = map_(score_spots, method, arrays, spots)
                    wall[way].append(time.perf_counter() - begun)
                    processor[way].append(processor_s() - begun_cpu)
                pairs[way] = sum(len(part[0]) for part in parts)
    assert len(set(pairs.values())) == 1
    one = np.median(wall["one thread"][SETTLING:])
    for way, each in wall.items():
        clock, cpu = np.median(each[SETTLING:]), np.mean(processor[way][SETTLING:])
        print(f"{way:12s}{1e3 * clock:8.1f} ms, {one / clock:5.2f} times as fast as one thread; processor {1e3 * cpu:8.1f} ms")
    shared = {name: np.asarray(array).nbytes / MB for name, array in arrays.items() if not isinstance(array, tuple)}
    print(f"shared with processes: {sum(shared.values()):.0f} MB, of which the history is {shared['values']:.0f} MB")


def fusion(vessels: int) -> None:
    """Print the processor time of fusion, and of moving its filters."""
    rng = np.random.default_rng([1, 0])
    method = CentralImm()
    models = method._models(method.init().evidence)
    j = len(models)
    state = rng.normal(0.0, 1.0, (vessels, j, 5)) * [10.0, 10.0, 1.0, 1.0, 1e-3]
    covariance = np.tile(np.diag([100.0, 100.0, 1.0, 1.0, 1e-6]), (vessels, j, 1, 1))
    filters = state, covariance, np.full((vessels, j), 1.0 / j), np.zeros(vessels), np.zeros(vessels)
    z = np.column_stack([rng.normal(0.0, 10.0, (vessels, 2)), np.full((vessels, 2), np.nan)])
    noise = np.tile(np.diag([400.0, 400.0, np.nan, np.nan]), (vessels, 1, 1))
    always, never = np.full(vessels, np.inf), np.zeros(vessels, np.bool_)
    measured = fused_filters.TimedMeasurements(np.full(vessels, 2.0), z, noise, always, never)
    compared, evidence = fused_filters.Alternatives(np.ones(1), np.ones(1)), np.zeros((vessels, 2))
    mean, total = np.empty((vessels, 5)), np.empty((vessels, 5, 5))

    def fuse() -> None:
        fused_filters.update(0, vessels, filters, measured, np.arange(vessels + 1), models, compared, evidence)
        fused_filters.estimate(0, vessels, filters, 3.0, models, mean, total)
        filters[3][:] = filters[4][:] = 0.0

    publisher, reader = Publisher(), Reader()

    def move() -> None:
        for _ in range(2):
            [array.copy() for array in reader.views(publisher.publish({"filters": filters}))["filters"]]

    size = sum(array.nbytes for array in filters) / MB
    print(
        f"fusion of {vessels} vessels: {1e3 * least(fuse):.1f} ms; its {size:.0f} MB there and back: {1e3 * least(move):.1f} ms"
    )
    publisher.close()


def least(work: Callable[[], Any]) -> float:
    """The least processor seconds of some calls."""
    seconds = []
    for _ in range(REPEATS):
        begun = time.process_time()
        work()
        seconds.append(time.process_time() - begun)
    return min(seconds)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tracks", nargs="?", type=count, default=100_000, help="default: 100,000")
    parser.add_argument("workers", nargs="?", type=count, default=2, help="default: 2")
    parser.add_argument("cycles", nargs="?", type=count, default=22, help="default: 22; windows are full after 20")
    asked = parser.parse_args()
    association(asked.tracks, asked.workers, asked.cycles)
    fusion(asked.tracks // 2)


if __name__ == "__main__":
    main()
