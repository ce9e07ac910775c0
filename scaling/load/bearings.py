"""The cases of bearing association, end to end, against what is asked of them.

python -m scaling.load.bearings [NAME ...] --seeds 1000-1009
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field

import numpy as np

from coastwatch.scores.confusion import Confusion
from scaling.load.seeds import scores_of

PATH = "bearing_associations.f1"
# On the southern border of the area, seaward, again half of it.
COAST = {
    "sonars.0.latitude_deg": "-23.13328",
    "sonars.0.range_nm": "5.9",
    "sonars.0.arc_from_deg": "270",
    "sonars.0.arc_to_deg": "90",
}
COLD = {"warmup_s": "30", "cycles": "10"}


@dataclass(frozen=True)
class Case:
    """A scenario with settings, and the least that a score of it should be."""

    name: str
    scenario: str
    settings: dict[str, str] = field(default_factory=dict)
    score: str = PATH
    asked: float | None = None  # none: to be reported
    less_than: str = ""  # a case that this one may fall short of by no more than `by`
    by: float = 0.0


CASES = (
    Case("100 centre", "context-driven-100", asked=0.997),
    Case("200 centre", "context-driven-200", asked=0.994),
    Case("500 centre", "context-driven-500", asked=0.983),
    Case("100 coast", "context-driven-100", COAST, asked=0.992),
    Case("200 coast", "context-driven-200", COAST, asked=0.981),
    Case("500 coast", "context-driven-500", COAST, asked=0.968),
    Case("200 centre, bias", "context-driven-200", {"input.sonar.bias_deg": "0.5"}, less_than="200 centre", by=0.001),
    Case("500 centre, bias", "context-driven-500", {"input.sonar.bias_deg": "0.5"}, less_than="500 centre", by=0.001),
    Case("200 centre, misses", "context-driven-200", {"input.sonar.miss_probability": "0.2"}),
    Case("500 centre, misses", "context-driven-500", {"input.sonar.miss_probability": "0.2"}),
    Case("500 centre, 30 to 57 s", "context-driven-500", COLD, asked=0.854),
    Case("500 centre, 30 to 57 s, signatures", "context-driven-500-signatures"),
)


def pooled(case: Case, seeds: range) -> tuple[float, float, float]:
    """F1 of all decisions of all seeds together, that of the worst seed, and MCC of all."""
    stage, _ = case.score.split(".")
    runs = [scores_of(case.scenario, case.settings, seed)[stage] for seed in seeds]
    counts = [Confusion(*(int(run[k]) for k in ("tp", "fn", "fp", "tn"))) for run in runs]
    every = sum(counts, start=Confusion()).as_dict()
    return every["f1"], float(np.min([c.as_dict()["f1"] for c in counts])), every["mcc"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", nargs="*", default=[], help="cases; none: all")
    parser.add_argument("--seeds", default="1000-1009", help="first-last")
    asked = parser.parse_args()
    first, last = (int(s) for s in asked.seeds.split("-"))
    print(f"# bearing association, F1 % (worst seed), MCC; seeds {asked.seeds}")
    found: dict[str, float] = {}
    for case in CASES:
        if asked.name and case.name not in asked.name:
            continue
        f1, worst, mcc = pooled(case, range(first, last + 1))
        found[case.name] = f1
        least = found[case.less_than] - case.by if case.less_than in found else case.asked
        verdict = "" if least is None else f"   asked {100 * least:6.2f}: {'met' if f1 >= least else 'MISSED'}"
        print(f"{case.name:<38} {100 * f1:6.2f} ({100 * worst:6.2f})   {mcc:.3f}{verdict}", flush=True)


if __name__ == "__main__":
    main()
