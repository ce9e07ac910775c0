"""Bearing association, end to end: F1 of each case beside the required value.

python -m scaling.load.bearings [NAME ...] --seeds 1000-1009
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field

import numpy as np

from coastwatch.scores.confusion import Confusion
from scaling.load.seeds import conditions, scores_of, seed_range

PATH = "bearing_associations.f1"
# A sonar on the southern border of the area that looks seaward and again covers half of the area.
COAST = {
    "sonars.0.latitude_deg": "-23.13328",
    "sonars.0.range_nm": "5.9",
    "sonars.0.arc_from_deg": "270",
    "sonars.0.arc_to_deg": "90",
}
COLD_START = {"warmup_s": "30", "cycles": "10"}


@dataclass(frozen=True)
class Case:
    """A scenario with settings, and the least required score."""

    name: str
    scenario: str
    settings: dict[str, str] = field(default_factory=dict)
    score: str = PATH
    required: float | None = None  # None: the score is only reported
    reference: str = ""  # another case: this one may score at most `loss` less
    loss: float = 0.0


CASES = (
    Case("100 centre", "context-driven-100", required=0.997),
    Case("200 centre", "context-driven-200", required=0.994),
    Case("500 centre", "context-driven-500", required=0.983),
    Case("100 coast", "context-driven-100", COAST, required=0.992),
    Case("200 coast", "context-driven-200", COAST, required=0.981),
    Case("500 coast", "context-driven-500", COAST, required=0.968),
    Case("200 centre, bias", "context-driven-200", {"input.sonar.bias_deg": "0.5"}, reference="200 centre", loss=0.001),
    Case("500 centre, bias", "context-driven-500", {"input.sonar.bias_deg": "0.5"}, reference="500 centre", loss=0.001),
    Case("200 centre, misses", "context-driven-200", {"input.sonar.miss_probability": "0.2"}),
    Case("500 centre, misses", "context-driven-500", {"input.sonar.miss_probability": "0.2"}),
    Case("500 centre, 30 to 57 s", "context-driven-500", COLD_START, required=0.854),
    Case("500 centre, 30 to 57 s, signatures", "context-driven-500-signatures"),
)


def pooled(case: Case, seeds: range) -> tuple[float, float, float]:
    """F1 of all seeds together, F1 of the worst seed, and MCC of all seeds together, each 0 to 1."""
    stage, _ = case.score.split(".")
    runs = [scores_of(case.scenario, case.settings, seed)[stage] for seed in seeds]
    counts = [Confusion(*(int(run[k]) for k in ("tp", "fn", "fp", "tn"))) for run in runs]
    total = sum(counts, start=Confusion()).as_dict()
    return total["f1"], float(np.min([c.as_dict()["f1"] for c in counts])), total["mcc"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", nargs="*", default=[], metavar="NAME", help="cases; none: all")
    parser.add_argument("--seeds", default="1000-1009", help="first-last")
    options = parser.parse_args()
    names = {case.name for case in CASES}
    if not names.issuperset(options.name):
        parser.error(f"got {options.name}, needed some of {sorted(names)}")
    # A case that may lose only so much of another one needs it too.
    wanted = {*options.name, *(case.reference for case in CASES if case.name in options.name)} - {""} or names
    print(f"# bearing association, F1 % (worst seed), MCC; seeds {options.seeds}")
    found: dict[str, float] = {}
    for case in CASES:
        if case.name not in wanted:
            continue
        print(f"# {case.name}: {conditions(case.scenario, case.settings)}")
        f1, worst, mcc = pooled(case, seed_range(options.seeds))
        found[case.name] = f1
        least = found[case.reference] - case.loss if case.reference in found else case.required
        verdict = "" if least is None else f"   required {100 * least:6.2f}: {'met' if f1 >= least else 'MISSED'}"
        print(f"{case.name:<38} {100 * f1:6.2f} ({100 * worst:6.2f})   {mcc:.3f}{verdict}", flush=True)


if __name__ == "__main__":
    main()
