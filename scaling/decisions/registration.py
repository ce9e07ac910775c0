"""How soon after the start association is as good with misregistered radars as with right ones, and what is found of their errors.

    python -m scaling.decisions.registration [--seeds 1-3] [--scenario context-driven-1000] [--only CASE ...] [--set KEY=VALUE]

One line for each case. First the seconds from the start until association F1 of every later half minute is within 0.2 points of the
same seed without errors. Then F1 of the last half minute of both, the errors found, their standard deviations and the true ones.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from coastwatch.batches import RadarCorrections, RegistrationState
from coastwatch.centre import Cycle
from coastwatch.operators.cli.arguments import pair
from coastwatch.scenario import load_scenario
from coastwatch.scores.confusion import Confusion, association
from coastwatch.sensors import Simulated
from coastwatch.server.run import run_scenario
from scaling.load.seeds import seed_range

LASTS_S = 300.0
WITHIN = 0.002  # of F1
OVER = 10  # cycles: half a minute
WRONG = "azimuth_bias_deg=5.0, time_bias_s=1.5"
CASES = {
    "as they are, registration off": ("", {"registration.method": "none"}),
    "as they are": ("", {}),
    "5 deg and 1.5 s, registration off": (WRONG, {"registration.method": "none"}),
    "5 deg and 1.5 s": (WRONG, {}),
    "5 deg and 1.5 s, first radar only": (WRONG, {"first": "1"}),
    "-15 deg, 60 m and 2 s": ("azimuth_bias_deg=-15.0, range_bias_m=60.0, time_bias_s=2.0", {}),
    "0.3 deg": ("azimuth_bias_deg=0.3", {}),
    "0.3 deg, registration off": ("azimuth_bias_deg=0.3", {"registration.method": "none"}),
    "1 deg and 6 deg an hour": ("azimuth_bias_deg=1.0, azimuth_drift_deg_h=6.0", {}),
}


class Course(NamedTuple):
    """One run: counts and corrections of each cycle."""

    counts: list[Confusion]
    corrections: list[RadarCorrections]
    vessels: list[int]


def run(name: str, seed: int, wrong: str, more: dict[str, str]) -> Course:
    """A run of five minutes from the start, every cycle counted."""
    rest = {k: v for k, v in more.items() if k != "first"}
    names = [r.name for r in load_scenario(name).radars]
    named = names[:1] if "first" in more else names
    settings = {"warmup_s": "0", "cycles": str(round(LASTS_S / load_scenario(name).period_s)), **rest}
    simulated = load_scenario(name, settings).input
    if not isinstance(simulated, Simulated):
        raise SystemExit(f"error: scenario {name}: got input {simulated.method!r}, needed one whose radars are simulated")
    every = simulated.radar.model_dump(exclude_defaults=True)  # a named radar takes nothing from it
    said = [*(f"{key}={value}" for key, value in every.items()), wrong]
    table = "[" + ", ".join(f'{{name="{n}", {", ".join(said)}}}' for n in named) + "]"
    scenario = load_scenario(name, settings | ({"input.radars": table} if wrong else {}))
    kinds, out = scenario.sensors().source_kinds, Course([], [], [])

    def note(cycle: Cycle) -> None:
        out.counts.append(association(cycle.tracks, cycle.associations, kinds))
        out.corrections.append(cycle.corrections)
        out.vessels.append(len(cycle.picture))

    with tempfile.TemporaryDirectory() as folder:
        run_scenario(scenario, seed=seed, database=f"sqlite:///{Path(folder) / 'run.db'}", on_cycle=note)
    return out


def smoothed(course: Course) -> np.ndarray:
    """F1 over half a minute up to each cycle."""
    return np.array(
        [sum(course.counts[max(k - OVER + 1, 0) : k + 1], Confusion()).as_dict()["f1"] for k in range(len(course.counts))]
    )


def told(corrections: RadarCorrections) -> str:
    """What is known of each radar."""
    c = corrections
    return "; ".join(
        f"{np.degrees(c.azimuth_bias_rad[k]):.3f}+-{np.degrees(c.azimuth_sigma_rad[k]):.3f} deg "
        f"{c.range_bias_m[k]:.1f}+-{c.range_sigma_m[k]:.1f} m {c.estimated_lag_s[k]:.2f}+-{c.lag_sigma_s[k]:.2f} s "
        f"{RegistrationState(int(c.state[k])).name.lower()}"
        for k in range(len(c))
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="context-driven-1000")
    parser.add_argument("--seeds", default="1-1", help="first-last (default: 1-1)")
    cases = "; ".join(f"{number} {title}" for number, title in enumerate(CASES))
    parser.add_argument(
        "--only", nargs="*", type=int, choices=range(len(CASES)), metavar="CASE", help=f"numbers of cases: {cases}"
    )
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", type=pair, help="a setting of all cases")
    parser.add_argument("--course", action="store_true", help="F1 each quarter of a minute too")
    asked = parser.parse_args()
    common = dict(asked.set)
    period_s = load_scenario(asked.scenario).period_s
    for seed in seed_range(asked.seeds):
        right = run(asked.scenario, seed, "", {**common, "registration.method": "none"})
        best = smoothed(right)
        for number, (title, (wrong, more)) in enumerate(CASES.items()):
            if asked.only and number not in asked.only:
                continue
            course = run(asked.scenario, seed, wrong, {**common, **more}) if wrong or not more else right
            f1 = smoothed(course)
            short = np.flatnonzero(f1 < best - WITHIN)
            since = (short[-1] + 2) * period_s if len(short) else 0.0
            when = f"{since:.0f} s" if since < LASTS_S else "never"
            print(
                f"seed {seed}, {title}: {when}; F1 {100 * f1[-1]:.3f} % against {100 * best[-1]:.3f} %; {course.vessels[-1]} vessels"
            )
            print(f"    {told(course.corrections[-1])}", flush=True)
            if asked.course:
                print("    " + " ".join(f"{100 * v:.2f}" for v in f1[4::5]), flush=True)


if __name__ == "__main__":
    main()
