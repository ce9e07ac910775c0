"""Scores of a scenario over seeds, mean and worst: `python -m scaling.load.seeds SCENARIO --seeds 1000-1009 [--set KEY=VALUE ...]`."""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from coastwatch.operators.cli.arguments import pair
from coastwatch.scenario import load_scenario
from coastwatch.server.run import OnCycle, run_scenario

FIGURES = (
    ("associations", "f1", 100.0, "association F1, %", min),
    ("bearing_associations", "f1", 100.0, "bearing association F1, %", min),
    ("bearing_associations", "mcc", 1.0, "bearing association MCC", min),
    ("fused_tracks", "position_rmse_m", 1.0, "fused position RMSE, m", max),
    ("fused_tracks", "bound_position_rmse_m", 1.0, "bound of it, m", max),
    ("fused_tracks", "radar_position_rmse_m", 1.0, "radar track position RMSE, m", max),
    ("fused_tracks", "radar_bound_position_rmse_m", 1.0, "bound of it, m", max),
    ("picture", "dark_recall", 100.0, "instants at which a dark vessel was flagged, %", min),
    ("picture", "dark_false_rate", 100.0, "instants at which another was, %", max),
)  # stage, key, scale, title, worst over seeds


def scores_of(name: str, overrides: dict[str, str], seed: int, on_cycle: OnCycle | None = None) -> dict[str, Any]:
    """The scores of one run into a temporary database. Args: on_cycle: called with the result of each cycle."""
    with tempfile.TemporaryDirectory() as folder:
        database = f"sqlite:///{Path(folder) / 'run.db'}"
        return run_scenario(load_scenario(name, overrides), seed=seed, database=database, on_cycle=on_cycle).scores


def conditions(scenario: str, settings: dict[str, str]) -> str:
    """One line that names a scenario and the settings that differ from its file, to be printed with its figures."""
    return f"{scenario}; settings beside its file: {' '.join(f'{k}={v}' for k, v in settings.items()) or 'none'}"


def seed_range(text: str) -> range:
    """The seeds of FIRST-LAST, both included. Ends the process with one sentence where it is something else."""
    first, _, last = text.partition("-")
    if not (first.isdecimal() and last.isdecimal() and int(first) <= int(last)):
        raise SystemExit(f"error: --seeds: got {text!r}, needed FIRST-LAST, such as 1000-1009")
    return range(int(first), int(last) + 1)


def table(scores: list[dict[str, Any]]) -> list[str]:
    """One line per figure: mean, standard deviation and worst over the runs that have it."""
    lines = []
    for stage, key, scale, title, worst in FIGURES:
        values = [scale * s[stage][key] for s in scores if s.get(stage, {}).get(key) is not None]
        if values:
            lines.append(f"{title:<48} {np.mean(values):9.3f} +- {np.std(values):6.3f}   worst {worst(values):9.3f}")
    for part, title in (("", "fused"), ("radar_", "radar track")):
        own, best = f"{part}position_rmse_m", f"{part}bound_position_rmse_m"
        ratios = [f[own] / f[best] for s in scores if (f := s["fused_tracks"])[best] and f["bound_count"] == f["count"]]
        if ratios:
            text = f"{np.mean(ratios):9.3f} +- {np.std(ratios):6.3f}   worst {max(ratios):9.3f}"
            lines.append(f"{f'{title} position RMSE over its bound':<48} {text}")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario")
    parser.add_argument("--seeds", default="1000-1009", help="first-last")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", type=pair, help="a setting of the scenario")
    parser.add_argument("--json", action="store_true", help="the scores of every seed instead of the table")
    options = parser.parse_args()
    overrides = dict(options.set)
    scores = [scores_of(options.scenario, overrides, seed) for seed in seed_range(options.seeds)]
    if not options.json:
        print(f"# {conditions(options.scenario, overrides)}; seeds {options.seeds}")
    print(json.dumps(scores) if options.json else "\n".join(table(scores)))


if __name__ == "__main__":
    main()
