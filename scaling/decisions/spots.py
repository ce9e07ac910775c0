"""What does a cycle of spots cost, and what would a tree of centroids? `python -m scaling.decisions.spots [TRACKS [THREADS]]`.

Over the national picture. Both ways find the same spots; the tree is asked for the nearest centroid alone, once, without means or halo.
"""

import os
import sys
import time

import numpy as np

from coastwatch.geodesy import earth_centred
from coastwatch.kernels.threads import threads
from scaling.load import national

CYCLES, REPEATS = 4, 9


def main(count: int, workers: int) -> None:
    from scipy.spatial import cKDTree

    world = national.build_world(count, 1)
    scenario = national.scenario_of(world, {})
    state, sensors, method = national.initial_state(world), scenario.sensors(), scenario.spots
    memory, took, tree = method.init(), [], []
    with threads(workers):
        for cycle in range(CYCLES):
            state, received = national.next_cycle(world, state, sensors)
            tracks = scenario.alignment.step(received.tracks, world.time_s(cycle))
            if cycle == 0:
                some, _ = method.step(memory, tracks.take(np.arange(2000)))
                method.step(some, tracks.take(np.arange(2000)))  # compiled
            begun = time.perf_counter()
            after, spots = method.step(memory, tracks)
            if cycle == 0:
                print(f"{len(tracks)} tracks, {len(spots.centre_m)} spots, {workers} threads, load {os.getloadavg()[0]:.1f}")
                print(f"the first cycle {time.perf_counter() - begun:.2f} s")
            for _ in range(REPEATS if cycle else 0):
                begun = time.perf_counter()
                method.step(memory, tracks)
                took.append(time.perf_counter() - begun)
            memory = after
            points, begun = earth_centred(tracks.position_deg), time.perf_counter()
            nearest = cKDTree(spots.centre_m).query(points)[1]
            tree.append(time.perf_counter() - begun)
            assert (nearest == spots.spot).all()
    halo = len(spots.halo_row) / len(spots.spot)
    print(
        f"a cycle: median {1e3 * np.median(took):.1f} ms, least {1e3 * min(took):.1f} ms; halo {100 * halo:.0f} % of the tracks"
    )
    print(f"a search of a tree, one thread: median {1e3 * np.median(tree):.1f} ms, least {1e3 * min(tree):.1f} ms")


if __name__ == "__main__":
    main(*(int(a) for a in [*sys.argv[1:], *("400000", "2")[len(sys.argv) - 1 :]]))
