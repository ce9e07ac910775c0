"""How well ships of a convoy can be told apart at all: `python -m scaling.decisions.convoy_bound [--seeds 1-3] [--spacing 50]`.

The bound is an associator that nobody can have. It knows the path of every ship, with AIS or without, and the noise of the radars. It
also knows which plots are of one ship, all of these since the start of the run. It gives plots to ships one to one by the greatest
likelihood. Beside it stands the default associator on the same input. No method can do better than the first; what separates them is at
most what a better method could gain.
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy.optimize import linear_sum_assignment

from coastwatch.batches import Floats, Ints, RadarReports, Sensors, SourceKind, Trajectories
from coastwatch.cycle import run_cycle, start_run
from coastwatch.geodesy import to_plane, wrap_rad
from coastwatch.scenario import load_scenario
from coastwatch.scores.confusion import Confusion, association, count_decisions
from coastwatch.sensors.simulated.radar import interpolated
from coastwatch.server.timing import Stopwatch
from coastwatch.stage import serial
from scaling.load.seeds import seed_range

AT_S = (9.0, 30.0, 60.0, 120.0, 180.0)  # after the start of the run
NEAR_M = 400.0  # farther off no ship is taken for another
NEVER = -1e6  # log-likelihood of a ship that is too far off


def log_likelihood(sensors: Sensors, plots: RadarReports, truth: Trajectories, ship: int) -> float:
    """Of these plots if they were of this ship, but for a constant."""
    at = to_plane(interpolated(truth)(np.full(len(plots), ship), plots.time_s), plots.site_deg)
    off = (plots.range_m - np.hypot(at[:, 0], at[:, 1])) / sensors.radars.range_sigma_m[plots.sensor]
    turned = wrap_rad(np.radians(plots.azimuth_deg) - np.arctan2(at[:, 0], at[:, 1]))
    turned = turned / sensors.radars.azimuth_sigma_rad[plots.sensor]
    return float(-0.5 * (off**2 + turned**2).sum())


def best_decisions(sensors: Sensors, plots: RadarReports, truth: Trajectories, ais: Ints, place_m: Floats) -> Confusion:
    """The decisions of the associator that nobody can have, one a ship with two plots or more. Args: place_m: (V, 2)."""
    ships, count = np.unique(plots.origin[plots.origin >= 0], return_counts=True)
    ships = ships[count > 1]
    fit = np.full((len(ships), len(place_m)), NEVER)
    for row, ship in enumerate(ships):
        mine = plots.take(plots.origin == ship)
        for other in np.flatnonzero(np.hypot(*(place_m - place_m[ship]).T) < NEAR_M):
            fit[row, other] = log_likelihood(sensors, mine, truth, int(other))
    _, chosen = linear_sum_assignment(-fit)
    exists, named, right = np.isin(ships, ais), np.isin(chosen, ais), chosen == ships
    return count_decisions(exists, named & right, named & ~right)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="1-3", help="first-last")
    parser.add_argument("--spacing", default="50", help="metres from ship to ship")
    asked = parser.parse_args()
    seeds = seed_range(asked.seeds)
    convoys = {f"input.convoys.spacing_{end}_m": asked.spacing for end in ("from", "to")}
    made = {"input.count": "300", "sonars": "[]", "input.convoys.share": "1.0", "warmup_s": "0", "cycles": "60", **convoys}
    scenario = load_scenario("context-driven-1000", made)
    sensors, plan = scenario.sensors(), scenario.plan()
    best, ours = dict.fromkeys(AT_S, Confusion()), dict.fromkeys(AT_S, Confusion())
    for seed in seeds:
        recording = scenario.input.load(sensors, seed, plan)
        truth, reports = recording.truth, recording.whole()
        assert truth is not None
        memory, before_s = start_run(scenario, sensors), float("-inf")
        for cycle in range(plan.cycles):
            now_s = plan.instant_s(cycle)
            part = reports.between(before_s, now_s)
            memory, made_now = run_cycle(scenario, sensors, memory, part, now_s, serial, Stopwatch())
            before_s = now_s
            since_s = now_s - plan.start_s
            if since_s not in best:
                continue
            ours[since_s] += association(made_now.tracks, made_now.associations, sensors.source_kinds)
            place_m = to_plane(truth.at(now_s).position_deg, sensors.region_origin_deg[0])
            ais = np.unique(made_now.tracks.origin[sensors.source_kinds[made_now.tracks.source] == SourceKind.AIS])
            plots = reports.radar.take(reports.radar.received_s <= now_s)
            best[since_s] += best_decisions(sensors, plots, truth, ais, place_m)
    print(f"# convoys of three at {asked.spacing} m, seeds {asked.seeds}: association F1, % (wrong pairs)")
    for at_s in AT_S:
        texts = [f"{100 * c.as_dict()['f1']:8.3f} ({c.fp})" for c in (best[at_s], ours[at_s])]
        print(f"{at_s:5.0f} s   bound {texts[0]}   default {texts[1]}")


if __name__ == "__main__":
    main()
