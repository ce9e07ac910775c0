"""What a track and scan cost by existence, and a scan of a dense cluster: `python -m scaling.decisions.joint_speed [--tracks 4000]`.

The question: does a scan of 4,000 tracks of `vimmjipda` cost 10 us a track at most? Does a scan in which 40 vessels meet cost 20 ms at
most? And how many times as much is another `--method`? How large are its memory and its checkpoint? Of multi-hypothesis tracks it also
prints the leaves of a tree: the mean, and the most after any scan.
Processor time of one thread, after scans that compile kernels and confirm tracks. One radar turns every 3 s and detects 0.9 of the vessels;
clutter and spacing are those of `context-driven-1000`. The 40 vessels start evenly on a circle of 300 m and sail to its centre. The last
line is the kernel alone: the probabilities of 40 tracks and 40 plots of which every pair is possible.
"""

from __future__ import annotations

import argparse
from time import process_time
from typing import NamedTuple, get_args

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Floats, Ints, Plots, Radars, Sensors, Sonars, Stations
from coastwatch.batches.struct import size_bytes
from coastwatch.geodesy import NAUTICAL_MILE_M
from coastwatch.server.checkpoint import save
from coastwatch.tracks import RadarMemory, RegionInput, TableTracker
from coastwatch.tracks.radar.life import Detection
from coastwatch.tracks.radar.presets import Name

PERIOD_S = 3.0
DENSITY_M2 = 10.0 / NAUTICAL_MILE_M**2  # of vessels
CLUTTER_M2 = 5e-7  # of false plots in one turn
DETECTED = 0.9
SIGMA_M = 10.0  # of a plot, per axis
SPEED_M_S = 6.0
CIRCLE_M = 300.0
MEETING = 40  # vessels
ORIGIN_DEG = np.array([-22.95, -43.1])


def sensors_of(range_m: float) -> Sensors:
    """One radar at the origin of its region."""
    one = np.ones(1)
    radars = Radars(
        np.array(["radar"]), np.zeros(1, np.int64), ORIGIN_DEG[None], range_m * one, PERIOD_S * one, SIGMA_M * one, 1e-3 * one
    )
    return Sensors(radars, Stations.empty(), Sonars.empty(), ("region",), ORIGIN_DEG[None])


def plots_of(place_m: Floats, time_s: float, reach_m: float, rng: np.random.Generator) -> Plots:
    """The plots of one turn, all stamped alike. Args: place_m: (V, 2)."""
    seen = place_m[rng.random(len(place_m)) < DETECTED]
    false = rng.uniform(-reach_m, reach_m, (rng.poisson(4.0 * CLUTTER_M2 * reach_m**2), 2))
    z = np.concatenate([seen + SIGMA_M * rng.standard_normal(seen.shape), false])
    count, number = len(z), np.zeros(len(z), np.int64)
    noise, distance, azimuth = np.tile(SIGMA_M**2 * np.eye(2), (count, 1, 1)), np.hypot(*z.T), np.arctan2(*z.T)
    time = np.full(count, time_s)
    return Plots(number, number, time, z, noise, np.zeros((count, 2)), distance, azimuth, np.full(count, -1))


class Scan(NamedTuple):
    """What one scan of a run was."""

    ms: float  # processor time
    tracks: int  # that are reported
    spread_m: float  # of the vessels
    leaves: Ints  # (T,) of each tree, after the scan


def scans(
    start_m: Floats, velocity_m_s: Floats, count: int, seed: int, name: Name = "vimmjipda"
) -> tuple[list[Scan], RadarMemory]:
    """Each scan of a run, and the memory at its end."""
    rng, reach_m = np.random.default_rng([seed, 1]), float(np.abs(start_m).max()) + 500.0
    upkeep = TableTracker(method=name).upkeep.model_copy(update={"detection": Detection(false_plots_per_m2=CLUTTER_M2)})
    method = TableTracker(method=name, upkeep=upkeep)
    sensors, memory, found = sensors_of(2.0 * reach_m), method.init(), []
    for k in range(count):
        time_s = PERIOD_S * (k + 1)
        place_m = start_m + time_s * velocity_m_s
        plots = plots_of(place_m, time_s - 0.5, reach_m, rng)
        begin = process_time()
        memory, (tracks, *_) = method.step(memory, RegionInput.of_plots(plots, time_s, sensors))
        ms, leaves = 1e3 * (process_time() - begin), np.bincount(memory.forest.leaves.slot)
        found.append(Scan(ms, len(tracks), float(place_m.std(axis=0).max()), leaves[leaves > 0]))
    return found, memory


def print_size(scanned: list[Scan], memory: RadarMemory) -> None:
    """Print how large the memory of a run is, and how many leaves its trees had."""
    print(f"memory {1e-6 * size_bytes(memory):.1f} MB, checkpoint {1e-6 * len(save(memory)):.1f} MB (asked: 40 MB each)")
    if len(scanned[-1].leaves):
        most = max(int(one.leaves.max()) for one in scanned)
        print(f"leaves a tree: {np.mean([one.leaves.mean() for one in scanned]):.2f}, most {most} (asked: 20)")


def spread_out(vessels: int, seed: int) -> tuple[Floats, Floats]:
    """Places and velocities of vessels at the density of the scene. (V, 2), (V, 2)"""
    rng = np.random.default_rng([seed, 2])
    side_m, course = np.sqrt(vessels / DENSITY_M2), rng.uniform(0.0, 2.0 * np.pi, vessels)
    return rng.uniform(-0.5, 0.5, (vessels, 2)) * side_m, SPEED_M_S * np.column_stack([np.sin(course), np.cos(course)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tracks", type=int, default=4000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--method", default="vimmjipda", choices=get_args(Name))
    asked = parser.parse_args()
    every, memory = scans(*spread_out(asked.tracks, asked.seed), 30, asked.seed, asked.method)
    cost, tracks = np.array([one.ms for one in every[15:]]), np.mean([one.tracks for one in every[15:]])
    each = 1e3 * cost / tracks
    print(f"{tracks:.0f} tracks: {np.median(each):.2f} us a track and scan, worst {each.max():.2f} (asked: 10)")
    print_size(every[15:], memory)
    angle = np.linspace(0.0, 2.0 * np.pi, MEETING, endpoint=False)
    out = np.column_stack([np.sin(angle), np.cos(angle)])
    every, memory = scans(CIRCLE_M * out, -SPEED_M_S * out, 25, asked.seed, asked.method)
    worst = max(every[2:], key=lambda one: one.ms)
    where = f"with {worst.tracks} tracks over {worst.spread_m:.0f} m"
    print(f"{MEETING} vessels meet: worst scan {worst.ms:.2f} ms, {where} (asked: 20 ms)")
    print_size(every[2:], memory)
    plot, track = (rows.ravel() for rows in np.indices((MEETING, MEETING)))
    weight = np.random.default_rng([asked.seed, 3]).exponential(10.0, MEETING**2)
    taken = []
    for _ in range(20):
        begin = process_time()
        kernels.association.marginals.marginals(plot, track, weight, MEETING, MEETING, 8)
        taken.append(1e3 * (process_time() - begin))
    print(f"probabilities of {MEETING} x {MEETING} pairs: median {np.median(taken):.2f} ms")


if __name__ == "__main__":
    main()
