"""Consistency of fusion for vessels that never keep their course: `python -m scaling.decisions.restless_fusion [--seeds 1000-1003]`.

The question: is `central_imm` too sure of restless vessels because it leaves its agile model too soon? The families of Sagild, pairs of one
true vessel, AIS every 12, 6 or 3 s. It prints mean and standard error over seeds of the ANEES (4 is right) and of the RMSE of the position.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from coastwatch.reproduction.side_by_side import SideBySide, measure
from coastwatch.scenario import load_scenario
from scaling.load.seeds import seed_range

FAMILIES = "easy", "normal", "difficult", "very-difficult"
AGILE_S = 60.0, 300.0, 1000.0, 3000.0  # mean time in the agile model


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="1000-1003", help="first-last")
    parser.add_argument("--family", action="append", default=[], choices=FAMILIES)
    asked = parser.parse_args()
    kinds = {f"central_imm, agile {s:g} s": {"method": "central_imm", "sojourn_s": [600.0, 300.0, s, 3000.0]} for s in AGILE_S}
    others = {name: {"method": name} for name in ("convex", "covariance_intersection")}
    wanted = SideBySide.model_validate({"associations": {}, "fused_tracks": {**others, **kinds}})
    for family in asked.family or FAMILIES:
        scenario = load_scenario(f"sagild-{family}")
        runs = [measure(scenario, seed, wanted)["fusion"] for seed in seed_range(asked.seeds)]
        for name in runs[0]:
            rows = np.array([[run[name]["anees"], run[name]["position_rmse_m"]] for run in runs], float)
            mean, error = rows.mean(axis=0), rows.std(axis=0) / math.sqrt(max(len(runs) - 1, 1))
            print(
                f"{family:<16}{name:<28}ANEES {mean[0]:5.2f} +- {error[0]:.2f}   {mean[1]:5.2f} +- {error[1]:.2f} m", flush=True
            )


if __name__ == "__main__":
    main()
