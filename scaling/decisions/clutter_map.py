"""What a learnt clutter map costs and changes at a shore radar: `python -m scaling.decisions.clutter_map [--vessels 16000]`.

The question: may the density of false plots be learnt by place also where it is even? The same plots go to the tracker with the
constant and with the map, in turns in one run. Processor time of the stage `tracks` alone. Input: that of `region_tracker`.
"""

from __future__ import annotations

import argparse
import math
from time import process_time

import numpy as np

from coastwatch.batches import RadarCorrections
from coastwatch.geodesy import to_plane
from coastwatch.kernels.tables.lookup import row_of
from coastwatch.scenario import load_scenario
from coastwatch.tracks import RegionInput, TableTracker
from coastwatch.tracks.radar.clutter import ClutterSettings
from scaling.decisions.region_tracker import LAST, NEAR_M, settings


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vessels", type=int, default=16_000)
    parser.add_argument("--clutter", default="5e-7", help="false plots per m2 and turn")
    parser.add_argument("--cycles", type=int, default=20, help="after the warm-up of 30 s")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    scenario = load_scenario("context-driven-1000", settings(asked.vessels, asked.clutter, "sided_imm", asked.cycles))
    sensors, plan = scenario.sensors(), scenario.plan()
    recording, none = scenario.input.load(sensors, asked.seed, plan), RadarCorrections.empty(R=len(sensors.radars))
    assert recording.truth is not None
    origin = sensors.region_origin_deg[0]
    site = to_plane(sensors.radars.site_deg, origin)
    assert isinstance(scenario.tracks, TableTracker)
    methods = {
        learnt: scenario.tracks.model_copy(update={"clutter": ClutterSettings(learnt=learnt)}) for learnt in (False, True)
    }
    memory = {learnt: method.init() for learnt, method in methods.items()}
    cost_ms: dict[bool, list[float]] = {False: [], True: []}
    rows: dict[bool, list[tuple[float, ...]]] = {False: [], True: []}
    converted = scenario.plots.init()
    for cycle in range(plan.cycles):
        now_s = plan.instant_s(cycle)
        since_s = plan.instant_s(cycle - 1) if cycle else -math.inf
        converted, plots = scenario.plots.step(converted, recording.whole().between(since_s, now_s).radar, sensors, none)
        truth = recording.truth.at(now_s)
        place = to_plane(truth.position_deg, origin)
        seen = (np.linalg.norm(place[:, None] - site, axis=2) < sensors.radars.range_m - 300.0).any(axis=1)
        for learnt, method in methods.items():
            begin = process_time()
            memory[learnt], (tracks, *_) = method.step(memory[learnt], RegionInput.of_plots(plots, now_s, sensors))
            cost_ms[learnt].append(1e3 * (process_time() - begin))
            own = tracks.take(tracks.origin >= 0)
            at = row_of(truth.vessel, own.origin)
            off = np.linalg.norm(to_plane(own.position_deg, origin) - place[at], axis=1)
            vessels, first = np.unique(at[off < NEAR_M], return_index=True)
            off = off[off < NEAR_M][first]
            complete = float(np.isin(np.flatnonzero(seen), vessels).mean())
            rows[learnt].append((len(plots), complete, len(tracks) - len(vessels), math.sqrt((off**2).mean())))
    for learnt in methods:
        plots_, complete, false, rmse = np.mean(rows[learnt][-LAST:], axis=0).tolist()
        cost = float(np.median(cost_ms[learnt][-LAST:]))
        said = f"{plots_:.0f} plots, completeness {complete:.5f}, false tracks {false:.1f}, RMSE {rmse:.3f} m"
        print(f"{'clutter map' if learnt else 'constant   '}  {cost:.1f} ms a cycle, {said}")
    ratio = np.array(cost_ms[True][-LAST:]) / np.array(cost_ms[False][-LAST:])
    print(f"ratio of times, median: {np.median(ratio):.3f}; cells {len(memory[True].clutter.plots)}")


if __name__ == "__main__":
    main()
