"""What does a cycle of spots cost, and what would a tree of centroids? `python -m scaling.decisions.spots [TRACKS [THREADS]]`.

A coast of 2,000 km: ports, lanes and open water, each vessel twice, rows in any order, 0.2 % of the tracks new in each cycle. Both ways
find the same spots; the tree is asked for the nearest centroid alone, once, without means or halo. Load of the machine beside the times.
"""

import os
import sys
import time

import numpy as np

from coastwatch.batches import Floats, Ints, Tracks
from coastwatch.geodesy import earth_centred
from coastwatch.kernels.threads import threads
from coastwatch.spots import KMeansSpots

CYCLES, REPEATS = 5, 7


def coast(tracks: int) -> tuple[Floats, Floats]:
    """Positions and their change in a cycle, degrees, (tracks, 2) each."""
    rng = np.random.default_rng([1, 0])
    vessels, ports = tracks // 2, max(tracks // 4000, 3)
    kind, share = rng.choice(3, vessels, p=[0.5, 0.35, 0.15]), rng.dirichlet(np.full(ports, 0.5))
    port = rng.choice(ports, vessels, p=share)
    east, north = rng.uniform(0.0, 2000e3, ports)[port], rng.uniform(0.0, 30e3, ports)[port]
    width = 250.0 * np.sqrt(share * vessels)[port]
    along = rng.uniform(0.0, 2000e3, vessels)
    east = np.where(kind == 0, east + rng.normal(0.0, 1.0, vessels) * width, along)
    north = np.where(kind == 0, north + rng.normal(0.0, 1.0, vessels) * width, rng.normal(40e3, 6e3, vessels))
    north = np.where(kind == 2, rng.uniform(0.0, 350e3, vessels), north)
    vessel = rng.permutation(2 * vessels) // 2
    metres = np.column_stack([north, east])[vessel]
    moved = (rng.normal(0.0, 20.0, (vessels, 2)) * (kind != 0)[:, None])[vessel]
    scale = np.array([1.0 / 111e3, 1.0 / 85e3])
    return np.array([40.0, -10.0]) + (metres + rng.normal(0.0, 12.0, metres.shape)) * scale, moved * scale


def tracks_of(position_deg: Floats, track_id: Ints) -> Tracks:
    n = len(track_id)
    none, zero = np.full(n, -1), np.zeros(n)
    still = np.zeros((n, 2)), np.zeros((n, 4, 4)), np.zeros((n, 2, 2))
    return Tracks(track_id, np.zeros(n, np.int64), zero, position_deg, *still, zero, zero, none, track_id)


def main(tracks: int, count: int) -> None:
    from scipy.spatial import cKDTree

    position, moved = coast(tracks)
    method, rng = KMeansSpots(), np.random.default_rng([1, 1])
    memory, took, tree = method.init(), [], []
    first, _ = method.step(memory, tracks_of(position[:2000], np.arange(2000)))
    method.step(first, tracks_of(position[:2000], np.arange(2000)))  # compiled
    with threads(count):
        for cycle in range(CYCLES):
            rows = np.flatnonzero(rng.random(len(position)) > 0.002)
            seen = tracks_of(position[rows] + cycle * moved[rows], rows)
            begun = time.perf_counter()
            after, spots = method.step(memory, seen)
            cold = time.perf_counter() - begun
            if cycle == 0:
                print(
                    f"{tracks} tracks, {len(spots.centre_m)} spots, {count} threads, load {os.getloadavg()[0]:.1f}: cold {cold:.2f} s"
                )
            for _ in range(REPEATS if cycle else 0):
                begun = time.perf_counter()
                method.step(memory, seen)
                took.append(time.perf_counter() - begun)
            memory = after
            begun = time.perf_counter()
            nearest = cKDTree(spots.centre_m).query(earth_centred(seen.position_deg))[1]
            tree.append(time.perf_counter() - begun)
            assert (nearest == spots.spot).all()
    halo = len(spots.halo_row) / len(spots.spot)
    print(
        f"a cycle: median {1e3 * np.median(took):.1f} ms, least {1e3 * min(took):.1f} ms; halo {100 * halo:.0f} % of the tracks"
    )
    print(
        f"a search of a tree, numpy for the places, one thread: median {1e3 * np.median(tree):.1f} ms, least {1e3 * min(tree):.1f} ms"
    )


if __name__ == "__main__":
    main(*(int(a) for a in [*sys.argv[1:], *("400000", "2")[len(sys.argv) - 1 :]]))
