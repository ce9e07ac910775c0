"""Settings of `vimmjipda` for harbours, chosen for each Autoferry recording on the four others.

    python -m scaling.decisions.held_out_settings [--draws N]

The settings are drawn at random from the values below. The first draw has the defaults of the method, with a learnt clutter map
and two values that a recording shows without its truth. Every draw is scored on every recording. For each recording, the draw
with the least mean GOSPA of the other four is taken. Nothing but the sensors comes from `scenarios/autoferry-*`.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from functools import reduce
from typing import Any

import numpy as np
from tqdm import tqdm

from coastwatch.scenario import load_scenario
from coastwatch.tracks import TableTracker
from scaling.decisions.bearings_in_picture import COLUMNS, RECORDINGS, scores

FIXED = {"clutter.learnt": True, "upkeep.look_slack": -0.2, "upkeep.max_speed_kn": 40.0}
"""The radar stamps a whole turn alike."""
VALUES = {
    "upkeep.detection.false_plots_per_m2": (2e-5, 5e-5, 1e-4),
    "upkeep.show_existence": (0.5, 0.7, 0.8, 0.9),
    "upkeep.end_per_s": (0.001, 0.01, 0.03),
    "upkeep.visible_s": (6, 16),
    "upkeep.new_vessels_per_m2": (1e-7, 1e-6),
    "upkeep.echo_sigma_m": (0, 2),
    "motion.quiet_noise_m2_s3": (0.005, 0.02, 0.1),
    "motion.agile_noise_m2_s3": (0.3, 1),
    "upkeep.delete_misses": (4, 5),
    "clutter.cell_m": (8.0, 16.0),
}
DEFAULTS = {"clutter.cell_m": 8.0, "upkeep.detection.false_plots_per_m2": 5e-5}
"""What a recording says without truth: two standard deviations of range a cell, and plots in a turn over the area."""


def drawn(count: int) -> list[dict[str, float]]:
    """The settings of each draw."""
    random = np.random.default_rng(0)
    others = [{key: float(random.choice(values)) for key, values in VALUES.items()} for _ in range(count - 1)]
    return [dict(DEFAULTS), *others]


def tracker(settings: Mapping[str, float]) -> TableTracker:
    """The method with these settings. Args: settings: by their path, such as `upkeep.visible_s`."""
    tree: dict[str, Any] = {}
    for path, value in {**FIXED, **settings}.items():
        *groups, name = path.split(".")
        reduce(lambda level, group: level.setdefault(group, {}), groups, tree)[name] = value
    return TableTracker.model_validate({"method": "vimmjipda", **tree})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=60, help="settings that are tried (default: 60)")
    arguments = parser.parse_args()
    draws, every = drawn(arguments.draws), []
    for settings in tqdm(draws, unit="draw"):
        change = {"tracks": tracker(settings)}
        every.append([scores(n, load_scenario(f"autoferry-{n}").model_copy(update=change)) for n in RECORDINGS])
    found = np.array(every)  # (draws, recordings, columns)
    gospa, judged = found[:, :, 0], []
    print("recording", *COLUMNS)
    for k, number in enumerate(RECORDINGS):
        best = int(np.delete(gospa, k, axis=1).mean(axis=1).argmin())
        judged.append(found[best, k])
        print(number, " ".join(f"{x:7.3f}" for x in judged[-1]), json.dumps(draws[best]), flush=True)
    print("mean", " ".join(f"{x:7.3f}" for x in np.mean(judged, axis=0)))
    print("defaults", " ".join(f"{x:7.3f}" for x in found[0].mean(axis=0)))
    print("best of all five", " ".join(f"{x:7.3f}" for x in found[gospa.mean(axis=1).argmin()].mean(axis=0)))


if __name__ == "__main__":
    main()
