"""Accuracy by case, over seeds: `python -m scaling.load.accuracy [--seeds FIRST-LAST] [--case NAME ...] [--set KEY=VALUE ...]`.

accuracy.toml lists the cases, with the required value of each figure.
"""

from __future__ import annotations

import argparse
import shlex
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from coastwatch.centre import Cycle
from coastwatch.scenario import load_scenario
from coastwatch.scores.confusion import Confusion, association
from coastwatch.stage import Settings
from scaling.load.seeds import conditions, scores_of, seed_range

CASES = Path(__file__).with_name("accuracy.toml")
COLD_START_F1 = 0.999  # required association F1 after a cold start
HEADS = "case", "figure", "required", "mean", "worst", "met"
WIDTHS = 22, 64, 8, 8, 8, 4


class Figure(Settings):
    """One figure of a case."""

    path: str  # in the scores of a run: stage.key
    over: str = ""  # path of the divisor, empty for none
    scale: float = 1.0  # factor before the figure is shown and compared
    required: float | None = None  # of every seed; None: the figure is only reported
    better: Literal["higher", "lower"] = "higher"


class Case(Settings):
    """One or more rows of the table: a scenario with settings, and figures of its scores."""

    name: str
    scenario: str = "context-driven-1000"
    extends: tuple[str, ...] = ()  # names of earlier cases whose settings come first
    settings: tuple[str, ...] = ()  # KEY=VALUE, as for --set
    cold_start_s: float | None = None  # after the start; from here F1 of all seeds together must be COLD_START_F1
    figure: Annotated[tuple[Figure, ...], Field(min_length=1)]


class Run(NamedTuple):
    """The result of one seed."""

    scores: dict[str, Any]
    decisions: list[tuple[float, Confusion]]  # seconds after the start and association decisions, each cycle of the warm-up


def load_cases(path: Path = CASES) -> list[Case]:
    """The cases of a file, with inherited settings. Raises: ValueError: a case extends an unknown case, or its name is not unique."""
    known: dict[str, Case] = {}
    for entry in tomllib.loads(path.read_text("utf-8"))["case"]:
        case = Case.model_validate(entry)
        unknown = [name for name in case.extends if name not in known]
        if unknown or case.name in known:
            raise ValueError(f"{path}: {case.name}: got extends = {unknown}, needed names of earlier cases, and a unique name")
        before = [pair for name in case.extends for pair in known[name].settings]
        known[case.name] = case.model_copy(update={"settings": (*before, *case.settings)})
    return list(known.values())


def run_case(case: Case, seed: int) -> Run:
    """One run of a case, with the decisions of the warm-up, which the scores leave out."""
    overrides = dict(pair.split("=", 1) for pair in case.settings)
    scenario = load_scenario(case.scenario, overrides)
    kinds, start_s = scenario.sensors().source_kinds, scenario.plan().start_s
    decisions: list[tuple[float, Confusion]] = []

    def keep_decisions(cycle: Cycle) -> None:
        if len(decisions) < scenario.warmup_cycles:
            decisions.append((cycle.time_s - start_s, association(cycle.tracks, cycle.associations, kinds)))

    return Run(scores_of(case.scenario, overrides, seed, keep_decisions), decisions)


def value_of(figure: Figure, scores: dict[str, Any]) -> float:
    """The value of a figure in the scores of one run."""
    value = _at(scores, figure.path)
    return figure.scale * (value / _at(scores, figure.over) if figure.over else value)


def _at(scores: dict[str, Any], path: str) -> float:
    stage, key = path.split(".")
    return float(scores[stage][key])


def cold_start(runs: Sequence[Run]) -> tuple[float, list[tuple[float, float]]]:
    """The time in seconds from which F1 of all runs together stays at COLD_START_F1, and (time, F1) of every instant of the warm-up."""
    pooled = []
    for instants in zip(*(run.decisions for run in runs), strict=True):
        total = sum((confusion for _, confusion in instants), Confusion())
        pooled.append((instants[0][0], total.as_dict()["f1"]))
    short = [k for k, (_, f1) in enumerate(pooled) if f1 < COLD_START_F1]
    first = short[-1] + 1 if short else 0
    return (pooled[first][0] if first < len(pooled) else float("inf")), pooled


def lines_of(case: Case, runs: Sequence[Run]) -> Iterator[str]:
    """The rows of a case in the table."""
    for figure in case.figure:
        values = [value_of(figure, run.scores) for run in runs]
        worst = min(values) if figure.better == "higher" else max(values)
        met = figure.required is None or (worst >= figure.required if figure.better == "higher" else worst <= figure.required)
        title = f"{figure.path} / {figure.over.split('.')[-1]}" if figure.over else figure.path
        yield _row(
            case.name, title, figure.required, float(np.mean(values)), worst, "" if figure.required is None else _verdict(met)
        )
    if case.cold_start_s is not None:
        reached_s, pooled = cold_start(runs)
        f1 = next(f1 for time_s, f1 in pooled if time_s >= case.cold_start_s)
        yield _row(
            case.name,
            f"F1 at {case.cold_start_s:g} s, %",
            100.0 * COLD_START_F1,
            100.0 * f1,
            None,
            _verdict(f1 >= COLD_START_F1),
        )
        yield _row(case.name, f"F1 {100 * COLD_START_F1:g} % from, s", None, reached_s, None, "")


def _verdict(met: bool) -> str:
    return "yes" if met else "NO"


def _row(*cells: str | float | None) -> str:
    texts = ["" if c is None else f"{c:.3f}" if isinstance(c, float) else str(c) for c in cells]
    return "  ".join(t.ljust(w) if k < 2 else t.rjust(w) for k, (t, w) in enumerate(zip(texts, WIDTHS, strict=True)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="1000-1009", help="first-last")
    parser.add_argument(
        "--case", action="append", default=[], metavar="NAME", help="only this case; more than once for several"
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="a setting of all cases, after their own"
    )
    parser.add_argument("--cases", type=Path, default=CASES, help="the file of cases")
    options = parser.parse_args()
    cases = [case for case in load_cases(options.cases) if not options.case or case.name in options.case]
    if len(cases) < len(set(options.case)):
        parser.error(f"--case: got {options.case}, needed names out of {[case.name for case in load_cases(options.cases)]}")
    given = [f" --case {shlex.quote(name)}" for name in options.case] + [f" --set {shlex.quote(pair)}" for pair in options.set]
    print(f"# python -m scaling.load.accuracy --seeds {options.seeds}{''.join(given)}")
    print(_row(*HEADS), flush=True)
    for case in cases:
        changed = case.model_copy(update={"settings": (*case.settings, *options.set)})
        print(f"# {case.name}: {conditions(case.scenario, dict(pair.split('=', 1) for pair in changed.settings))}", flush=True)
        runs = [run_case(changed, seed) for seed in seed_range(options.seeds)]
        print("\n".join(lines_of(case, runs)), flush=True)


if __name__ == "__main__":
    main()
