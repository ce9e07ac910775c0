"""Association of tracks that come without covariance, by method: `python -m scaling.decisions.without_covariance [--seeds 1000-1003]`.

The question: which method should associate the tracks of sources that give no covariance? The families of Sagild give
the tracks: AIS from its Kalman filter, without the covariances, and radar from `vimmjipda`. All methods see the same tracks. It prints the
true and the false positive rate and the time until the first right association, of all runs together.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from coastwatch.associations import AssociationInput, Associator
from coastwatch.batches import RadarCorrections, Tracks
from coastwatch.scenario import Scenario, load_scenario
from coastwatch.scores.track_pairs import PairScores, TruePairs
from coastwatch.stage import Running, serial
from coastwatch.tracks import AisInput, RegionInput
from scaling.load.seeds import seed_range

LOST_M = 100.0  # a radar track farther than this from its vessel is lost
FAMILIES = "easy", "normal", "difficult", "very-difficult"
METHODS: dict[str, dict[str, Any]] = {
    "windowed_covariance": {"method": "windowed_covariance"},
    "windowed_covariance, threshold 20": {"method": "windowed_covariance", "threshold": 20.0},
    "counting 30 m, 4, 3": {"method": "counting"},
    "counting 40 m, 4, 3": {"method": "counting", "threshold_m": 40.0},
    "counting 30 m, 6, 5": {"method": "counting", "hits": 6, "misses": 5},
    "two_countings 20 m or 40 m": {"method": "two_countings", "tight_m": 20.0, "loose_m": 40.0},
}


def run(scenario: Scenario, seed: int, methods: dict[str, Any]) -> dict[str, PairScores]:
    """The scores of each method on the tracks of one run."""
    sensors, plan = scenario.sensors(), scenario.plan()
    recording, none = scenario.input.load(sensors, seed, plan), RadarCorrections.empty(R=len(sensors.radars))
    assert recording.truth is not None
    converted, radar = scenario.plots.init(), scenario.tracks.init()
    ais, of_spots = scenario.ais_tracks.init(), scenario.spots.init()
    memories, scores = {name: method.init() for name, method in methods.items()}, dict.fromkeys(methods, PairScores())
    for cycle in range(plan.cycles):
        now_s = plan.instant_s(cycle)
        reports = recording.reports.between(plan.instant_s(cycle - 1) if cycle else -np.inf, now_s)
        converted, plots = scenario.plots.step(converted, reports.radar, sensors, none)
        radar, (radar_tracks, *_) = Running(scenario.tracks, radar).next(RegionInput.of_plots(plots, now_s, sensors))
        ais, (ais_tracks, _, _) = scenario.ais_tracks.step(ais, AisInput(reports.ais, now_s, sensors))
        unknown = replace(ais_tracks, covariance=np.full_like(ais_tracks.covariance, np.nan))
        tracks = scenario.alignment.step(Tracks.join([radar_tracks, unknown]), now_s)
        of_spots, spots = scenario.spots.step(of_spots, tracks)
        pairs = TruePairs.of(tracks, recording.truth.at(now_s), sensors.source_kinds, LOST_M)
        for name, method in methods.items():
            memories[name], found = method.step(memories[name], AssociationInput(tracks, spots, serial))
            scores[name] = scores[name].seen(pairs, found)
    return scores


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="1000-1003", help="first-last")
    parser.add_argument("--family", action="append", default=[], choices=FAMILIES)
    asked = parser.parse_args()
    methods = {name: TypeAdapter(Associator).validate_python(given) for name, given in METHODS.items()}
    for family in asked.family or FAMILIES:
        scenario = load_scenario(f"sagild-{family}")
        runs = [run(scenario, seed, methods) for seed in seed_range(asked.seeds)]
        for name in METHODS:
            dicts = [one[name].as_dict(scenario.period_s) for one in runs]
            tp, fn, fp, tn, waited_s, vessels = (
                sum(float(one[key] or 0.0) for one in dicts) for key in ("tp", "fn", "fp", "tn", "waited_s", "vessels")
            )
            rates = f"TPR {100 * tp / (tp + fn):6.2f} %  FPR {1e5 * fp / (fp + tn):6.1f}e-5  first {waited_s / vessels:5.1f} s"
            print(f"{family:<16}{name:<36}{rates}", flush=True)


if __name__ == "__main__":
    main()
