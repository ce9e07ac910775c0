"""What does the association of tracks take in one thread, over threads, over processes? What `workers.method = "auto"` rests on.

python -m scaling.decisions.workers [TRACKS [WORKERS [CYCLES]]]: seconds by the clock of the work that is mapped over spots, median of
nine in turns, over the national picture after CYCLES cycles.
"""

from __future__ import annotations

import sys
import time
from contextlib import ExitStack

import numpy as np

from coastwatch.associations.windowed_covariance import score_spots
from coastwatch.kernels.threads import threads
from coastwatch.stage import Map, serial
from coastwatch.workers.processes import Processes
from scaling.decisions.association_cycle import last_cycle

SETTLING, REPEATS = 5, 9


def main() -> None:
    tracks, workers, cycles = (
        int(sys.argv[k]) if len(sys.argv) > k else default for k, default in ((1, 100_000), (2, 2), (3, 22))
    )
    arrays, spots, *_, method = last_cycle(tracks, cycles)
    with ExitStack() as stack:
        pool = stack.enter_context(Processes(workers))
        ways: dict[str, tuple[int, Map]] = {"one thread": (1, serial), "threads": (workers, serial), "processes": (1, pool)}
        seconds: dict[str, list[float]] = {way: [] for way in ways}
        pairs = {}
        for repeat in range(SETTLING + REPEATS):
            for way, (count, map_) in ways.items():
                with threads(count):
                    begun = time.perf_counter()
                    parts = map_(score_spots, method, arrays, spots)
                    if repeat >= SETTLING:
                        seconds[way].append(time.perf_counter() - begun)
                pairs[way] = sum(len(part[0]) for part in parts)
    assert len(set(pairs.values())) == 1
    one = np.median(seconds["one thread"])
    for way, each in seconds.items():
        print(f"{way:12s}{1e3 * np.median(each):8.1f} ms  {one / np.median(each):5.2f} times as fast as one thread")


if __name__ == "__main__":
    main()
