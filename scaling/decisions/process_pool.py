"""Could joblib's pool of processes, with memory-mapped arguments, replace the pool of `coastwatch.workers.processes`?

    python -m scaling.decisions.process_pool [TRACKS [WORKERS [CYCLES]]]

Two centres fuse the same national picture in turns, cycle by cycle. They differ in the pool that maps spots. Times are of a whole
cycle of the high-level centre: medians over CYCLES cycles, after the history windows are full.

Answer: no. At 20,000 tracks a cycle takes 4.1 times as long with joblib, and 1.8 times the processor time: asked were 1.25. It
also must map its arguments anew in each call. Within a `with` block it keeps one map for each array object, and the history windows
are written in place, so the next cycle would see old values. Figures: scaling/results/workers.md.
"""

from __future__ import annotations

import argparse
import sys
import time
from contextlib import ExitStack

import numpy as np
from joblib import Parallel, delayed  # type: ignore[import-untyped]

from coastwatch.batches import Array
from coastwatch.centre import run_centre, start_centre
from coastwatch.kernels.threads import threads
from coastwatch.operators.cli.arguments import count
from coastwatch.server.timing import Stopwatch
from coastwatch.stage import Arrays, Groups, Map, S, Work, serial
from coastwatch.workers.costs import deal
from coastwatch.workers.processes import CHUNKS_A_WORKER, Processes
from scaling.load import national
from scaling.load.processes import processor_s

WARM_UP = 22  # cycles; history windows of tracks are full after 20
MAPPED_BYTES = 100_000  # larger arrays are memory-mapped, smaller ones are sent with each chunk


class JoblibPool:
    """A Map over a pool of joblib's default backend, loky."""

    def __init__(self, workers: int) -> None:
        self._count = workers

    def __call__(self, work: Work[S], settings: S, arrays: Arrays, spots: Groups) -> list[tuple[Array, ...]]:
        """The result of work(settings, arrays, chunk) for each chunk."""
        if len(spots) < 2:
            return serial(work, settings, arrays, spots)
        chunks = deal(np.diff(spots.start).astype(float), min(self._count * CHUNKS_A_WORKER, len(spots)))
        # Not in a `with` block: there a map is kept for each array object, and the history, which is written in place, would be stale.
        parallel = Parallel(n_jobs=self._count, max_nbytes=MAPPED_BYTES, mmap_mode="r", batch_size=1, pre_dispatch="all")
        found: list[tuple[Array, ...]] = parallel(delayed(work)(settings, dict(arrays), spots.take(chunk)) for chunk in chunks)
        return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tracks", nargs="?", type=count, default=20_000, help="default: 20,000")
    parser.add_argument("workers", nargs="?", type=count, default=2, help="default: 2")
    parser.add_argument("cycles", nargs="?", type=count, default=21, help="default: 21")
    asked = parser.parse_args()
    world = national.build_world(asked.tracks, 1)
    scenario = national.scenario_of(world, {})
    sensors, state = scenario.sensors(), national.initial_state(world)
    with ExitStack() as stack:
        stack.enter_context(threads(asked.workers))
        ways: dict[str, Map] = {
            "own pool": stack.enter_context(Processes(asked.workers)),
            "joblib": JoblibPool(asked.workers),
        }
        memories = {way: start_centre(scenario) for way in ways}
        clock_s: dict[str, list[float]] = {way: [] for way in ways}
        cpu_s: dict[str, list[float]] = {way: [] for way in ways}
        for number in range(WARM_UP + asked.cycles):
            state, received = national.next_cycle(world, state, sensors)
            pairs = set()
            for way, spread in ways.items():
                begun, begun_cpu = time.perf_counter(), processor_s()
                memories[way], cycle = run_centre(
                    scenario, sensors, memories[way], received, world.time_s(number), spread, Stopwatch()
                )
                clock_s[way].append(time.perf_counter() - begun)
                cpu_s[way].append(processor_s() - begun_cpu)
                pairs.add((cycle.associations.first.tobytes(), cycle.associations.second.tobytes()))
            assert len(pairs) == 1
            print(*(f"{way} {1e3 * each[-1]:.0f} ms" for way, each in clock_s.items()), file=sys.stderr, flush=True)
    own, own_cpu = (float(np.median(each["own pool"][WARM_UP:])) for each in (clock_s, cpu_s))
    print(f"{asked.tracks} tracks, {asked.workers} workers, {asked.cycles} cycles in turns; of own: of that of the own pool")
    print(f"{'pool':12s}{'clock ms':>10s}{'of own':>8s}{'processor ms':>14s}{'of own':>8s}")
    for way in ways:
        clock, cpu = (float(np.median(each[way][WARM_UP:])) for each in (clock_s, cpu_s))
        print(f"{way:12s}{1e3 * clock:10.1f}{clock / own:8.2f}{1e3 * cpu:14.1f}{cpu / own_cpu:8.2f}")


if __name__ == "__main__":
    main()
