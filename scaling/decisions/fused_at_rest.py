"""Errors of fused vessels at rest and under way beside their AIS: `python -m scaling.decisions.fused_at_rest SCENARIO [--seed 1]`.

The question: is a fused vessel ever worse than its AIS alone, as a ship at anchor sends each three minutes only? Counted are vessels
of one radar and one AIS track or more, all of one true vessel, as for the fused RMSE of a run.
"""

from __future__ import annotations

import argparse

import numpy as np

from coastwatch.centre import Cycle
from coastwatch.kernels.tables.lookup import row_of
from coastwatch.operators.cli.arguments import pair
from coastwatch.scenario import load_scenario
from coastwatch.scores.rmse import Errors, fusion_errors
from scaling.load.seeds import conditions, scores_of

AT_REST_M_S = 0.25


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", type=pair, help="a setting of the scenario")
    asked = parser.parse_args()
    settings = dict(asked.set)
    scenario = load_scenario(asked.scenario, settings)
    sensors = scenario.sensors()
    truths = scenario.input.load(sensors, asked.seed, scenario.plan()).truth
    if truths is None:
        raise SystemExit(f"error: {asked.scenario}: has no true positions")
    sums = {True: [Errors(), Errors()], False: [Errors(), Errors()]}  # of fused vessels and of AIS, by whether they rest

    def count(cycle: Cycle) -> None:
        """Add the errors of a cycle after the warm-up."""
        if cycle.time_s < scenario.plan().instant_s(scenario.warmup_cycles):
            return
        now = truths.at(cycle.time_s)
        at_rest = np.hypot(now.velocity_m_s[:, 0], now.velocity_m_s[:, 1]) < AT_REST_M_S
        for rests, own in sums.items():
            some = now.take(at_rest == rests)
            if (row_of(some.vessel, cycle.tracks.origin) >= 0).any():
                found = fusion_errors(some, cycle.tracks, cycle.associations, cycle.fused, sensors.source_kinds)
                own[0] += found.fused
                own[1] += found.ais

    scores = scores_of(asked.scenario, settings, asked.seed, count)
    print(f"{conditions(asked.scenario, settings)}; seed {asked.seed}; NEES of all {scores['fused_tracks']['nees']:.1f}")
    for rests, (fused, ais) in sums.items():
        said = [
            f"{name} {error.as_dict()['position_rmse_m'] or np.nan:.2f} m" for name, error in (("fused", fused), ("AIS", ais))
        ]
        print(f"{'at rest' if rests else 'under way'}: {', '.join(said)}, {fused.count} instants")


if __name__ == "__main__":
    main()
