"""Bearing association F1 beside what the best association of bearings alone would have, who knows where every vessel is.

    python -m scaling.decisions.bearing_bound SCENARIO --seeds FIRST-LAST [--set KEY=VALUE ...]

The bound knows the true positions of all vessels, those that nobody else has seen included, which of them are in range at each time, and
the noise of the sensor. Without contact numbers it assigns the bearings of the newest look, with them the whole window of each track:

- likeliest: the one-to-one assignment of the greatest likelihood.
- expected: each bearing to the vessel of its greatest marginal probability over all one-to-one assignments, by sum-product. On average
  no rule has more right pairs. It is given without contact numbers.

A bearing given to a vessel that is not in the picture counts as given to none. The scenario is simulated, with one sensor of bearings.
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy.optimize import linear_sum_assignment

from coastwatch.batches import BearingReports, BearingTracks, Bools, Floats, Ints, Recording, Sensors, Trajectories
from coastwatch.centre import Cycle
from coastwatch.geodesy import to_plane, wrap_rad
from coastwatch.kernels.association.marginals import marginals
from coastwatch.operators.cli.arguments import pair
from coastwatch.scenario import load_scenario
from coastwatch.scores.confusion import Confusion, bearing_association, count_decisions
from scaling.load.seeds import conditions, scores_of, seed_range

EVERY = 5  # cycles between two that the bound is computed for
GATE_SIGMAS, EXACT = 5.0, 10
MISFITS = 2  # bearings that a track may have while a vessel was out of range, or the reverse: stamps are interpolated
NEVER = 1e6  # cost of a pair that cannot be


def directions(truth: Trajectories, time_s: Floats, sensors: Sensors) -> tuple[Floats, Bools]:
    """The true bearing of each vessel at each time, and whether it is in range. (V, T), (V, T)"""
    bearing, near = np.full((len(truth.vessel), len(time_s)), np.nan), np.zeros((len(truth.vessel), len(time_s)), np.bool_)
    for k, t in enumerate(time_s):
        there = truth.at(float(t))
        row, offset = np.searchsorted(truth.vessel, there.vessel), to_plane(there.position_deg, sensors.sonars.site_deg[0])
        bearing[row, k] = np.arctan2(offset[:, 0], offset[:, 1])
        near[row, k] = np.hypot(offset[:, 0], offset[:, 1]) <= sensors.sonars.range_m[0]
    return bearing, near


def decided(origin: Ints, partner: Ints, known: Ints) -> Confusion:
    """The counts of decisions. Args: origin: (N,) true vessel of each bearing; partner: (N,) vessel chosen; known: those in the picture."""
    exists, chosen = np.isin(origin, known), np.isin(partner, known)
    right = exists & (partner == origin)
    return count_decisions(exists, right, chosen & ~right)


def of_look(look: BearingReports, truth: Trajectories, known: Ints, sensors: Sensors) -> list[Confusion]:
    """The two bounds of one look without contact numbers."""
    bearing, near = directions(truth, look.time_s[:1], sensors)
    heard, sigma = np.flatnonzero(near[:, 0]), sensors.sonars.bearing_sigma_rad[0]
    off = wrap_rad(np.radians(look.bearing_deg)[:, None] - bearing[heard, 0]) / sigma
    row, column = linear_sum_assignment(off**2)
    likeliest, expected = np.full(len(look), -1), np.full(len(look), -1)
    likeliest[row] = truth.vessel[heard[column]]
    row, column = np.nonzero(np.abs(off) < GATE_SIGMAS)
    probability = marginals(row, column, NEVER * np.exp(-0.5 * off[row, column] ** 2), *off.shape, EXACT)
    order = np.argsort(probability, kind="stable")  # the greatest of each row is written last
    expected[row[order]] = truth.vessel[heard[column[order]]]
    return [decided(look.origin, partner, known) for partner in (likeliest, expected)]


def of_windows(tracks: BearingTracks, truth: Trajectories, known: Ints, sensors: Sensors) -> list[Confusion]:
    """The bound of tracks of numbered contacts."""
    there = np.isfinite(tracks.window_time_s)
    time_s = np.unique(tracks.window_time_s[there])
    bearing, near = directions(truth, time_s, sensors)
    measured = np.full((len(tracks), len(time_s)), np.nan)
    row, column = np.nonzero(there)[0], np.searchsorted(time_s, tracks.window_time_s[there])
    measured[row, column] = tracks.window_bearing_rad[there]
    heard = np.flatnonzero(near[:, -1])
    cost = np.empty((len(tracks), len(heard)))
    for k, vessel in enumerate(heard):
        squared = np.nansum(wrap_rad(measured - bearing[vessel]) ** 2, axis=1) / sensors.sonars.bearing_sigma_rad[0] ** 2
        misfits = (np.isfinite(measured) != near[vessel]).sum(axis=1)
        cost[:, k] = np.where(misfits > MISFITS, NEVER, squared)
    row, column = linear_sum_assignment(cost)
    partner = np.full(len(tracks), -1)
    partner[row] = truth.vessel[heard[column]]
    return [decided(tracks.origin, partner, known)]


def figures(name: str, overrides: dict[str, str], seed: int) -> tuple[float, list[float]]:
    """F1 of a run over its scored cycles, and the bounds, from every `EVERY`th of them."""
    scenario = load_scenario(name, overrides)
    sensors, plan = scenario.sensors(), scenario.plan()
    recording: Recording = scenario.input.load(sensors, seed, plan)
    reports, truth = recording.whole().bearing, recording.truth
    if truth is None or len(sensors.sonars) != 1:
        raise SystemExit(
            f"error: {name}: got no truth, or {len(sensors.sonars)} sensors of bearings, needed one and a simulation"
        )
    first, number, bounds = scenario.warmup_cycles, 0, [Confusion()] * 2
    ours = Confusion()

    def keep(cycle: Cycle) -> None:
        nonlocal number, bounds, ours
        number += 1
        if number <= first:
            return
        ours += bearing_association(cycle.bearing_tracks, cycle.picture, cycle.bearing_associations)
        if (number - first) % EVERY != 1:
            return
        known, newest = cycle.picture.origin, reports.time_s[reports.time_s <= cycle.time_s].max()
        if (reports.contact >= 0).all():
            more = of_windows(cycle.bearing_tracks, truth, known, sensors)
        else:
            more = of_look(reports.take(reports.time_s == newest), truth, known, sensors)
        bounds = [a + b for a, b in zip(bounds, more, strict=False)]

    scores_of(name, overrides, seed, keep)
    return 100.0 * ours.as_dict()["f1"], [100.0 * c.as_dict()["f1"] for c in bounds]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario")
    parser.add_argument("--seeds", default="3001-3003", help="first-last")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", type=pair, help="a setting of the scenario")
    options = parser.parse_args()
    overrides = dict(options.set)
    print(f"# {conditions(options.scenario, overrides)}")
    print("seed    F1 %    bound, likeliest    bound, expected", flush=True)
    for seed in seed_range(options.seeds):
        ours, bounds = figures(options.scenario, overrides, seed)
        print(f"{seed}  {ours:6.2f}  " + "  ".join(f"{b:18.2f}" for b in bounds), flush=True)


if __name__ == "__main__":
    main()
