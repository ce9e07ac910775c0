"""OSPA of radar tracks by existence, beside the bound: `python -m scaling.decisions.joint_tracks 100 200 [KEY=VALUE ...]`.

The question: how far are the tracks of `vimmjipda` from the same filters with the origin of every plot known? It prints mean and
standard error of the mean, at four detection probabilities. Arguments: the first seed and the one after the last; settings of
`hem-figure-2`, such as `tracks.method=vimmjipda_sequential`.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from coastwatch.operators.cli.arguments import count, pair, whole
from coastwatch.reproduction.published import Targets
from coastwatch.reproduction.targets import measure
from coastwatch.scenario import load_scenario

KEYS = (
    "ospa_m",
    "genie_ospa_m",
    "error_m",
    "genie_error_m",
    "nees",
    "probability",
    "false_tracks",
    "breaks",
    "id_right",
    "id_wrong",
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", type=whole, help="first seed")
    parser.add_argument("end", type=count, help="the one after the last")
    parser.add_argument("further", nargs="*", type=pair, metavar="KEY=VALUE", help="settings of hem-figure-2")
    asked = parser.parse_args()
    for probability in ("0.98", "0.9", "0.7", "0.5"):
        settings: dict[str, str] = dict(asked.further)
        settings |= {"input.detection_probability": probability}
        settings |= {"tracks.upkeep.detection.detection_probability": probability}
        scenario = load_scenario("hem-figure-2", settings)
        found = [measure(scenario, seed, Targets(within_m=510.0)) for seed in range(asked.first, asked.end)]
        every = {key: np.array([one[key] for one in found if one[key] is not None], float) for key in KEYS}
        shown = (f"{key} {v.mean():.3g} +- {v.std() / math.sqrt(len(v)):.2g}" for key, v in every.items())
        print(f"P_D {probability}   " + "   ".join(shown), flush=True)


if __name__ == "__main__":
    main()
