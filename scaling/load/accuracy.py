"""The table of accuracy: `python -m scaling.load.accuracy [--seeds FIRST-LAST] [--case NAME ...] [--set KEY=VALUE ...]`.

The cases stand in accuracy.toml.
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

from coastwatch.pipeline import Cycle
from coastwatch.scenario import load_scenario
from coastwatch.scores.confusion import Confusion, association
from coastwatch.stage import Settings
from scaling.load.seeds import scores_of

CASES = Path(__file__).with_name("accuracy.toml")
REACHED = 0.999  # association F1 that is asked after a cold start
HEADS = "case", "figure", "asked", "mean", "worst", "met"
WIDTHS = 22, 64, 7, 8, 8, 4


class Figure(Settings):
    """One figure of a case."""

    path: str  # in the scores of a run: stage.key
    over: str = ""  # path of what it is divided by; none: by nothing
    scale: float = 1.0  # what it is multiplied by before it is shown and compared
    asked: float | None = None  # of every seed; none: the figure is only reported
    better: Literal["higher", "lower"] = "higher"


class Case(Settings):
    """One row of the table, or several: a scenario with settings, and what is read from its scores."""

    name: str
    scenario: str = "context-driven-1000"
    like: tuple[str, ...] = ()  # names of earlier cases whose settings come first
    settings: tuple[str, ...] = ()  # KEY=VALUE, as for --set
    cold_start_s: float | None = (
        None  # after the start of the run: the association F1 then, over all seeds together, is asked to be REACHED
    )
    figure: Annotated[tuple[Figure, ...], Field(min_length=1)]


class Run(NamedTuple):
    """What one seed gave."""

    scores: dict[str, Any]
    decisions: list[
        tuple[float, Confusion]
    ]  # seconds after the start and decisions of association, of every cycle of the warm-up


def load_cases(path: Path = CASES) -> list[Case]:
    """The cases of a file, each with the settings of the cases it is like. Raises: ValueError: it is like no earlier case."""
    known: dict[str, Case] = {}
    for entry in tomllib.loads(path.read_text("utf-8"))["case"]:
        case = Case.model_validate(entry)
        unknown = [name for name in case.like if name not in known]
        if unknown or case.name in known:
            raise ValueError(f"{path}: {case.name}: got like = {unknown}, needed names of earlier cases, and a name of its own")
        before = [pair for name in case.like for pair in known[name].settings]
        known[case.name] = case.model_copy(update={"settings": (*before, *case.settings)})
    return list(known.values())


def run_case(case: Case, seed: int) -> Run:
    """One run of a case, with the decisions of the warm-up, which its scores leave out."""
    overrides = dict(pair.split("=", 1) for pair in case.settings)
    scenario = load_scenario(case.scenario, overrides)
    kinds, start_s = scenario.sensors().source_kinds, scenario.plan().start_s
    decisions: list[tuple[float, Confusion]] = []

    def note(cycle: Cycle) -> None:
        if len(decisions) < scenario.warmup_cycles:
            decisions.append((cycle.time_s - start_s, association(cycle.tracks, cycle.associations, kinds)))

    return Run(scores_of(case.scenario, overrides, seed, note), decisions)


def value_of(figure: Figure, scores: dict[str, Any]) -> float:
    """A figure of one run."""
    value = _at(scores, figure.path)
    return figure.scale * (value / _at(scores, figure.over) if figure.over else value)


def _at(scores: dict[str, Any], path: str) -> float:
    stage, key = path.split(".")
    return float(scores[stage][key])


def cold_start(runs: Sequence[Run]) -> tuple[float, list[tuple[float, float]]]:
    """From when on the F1 of each instant of the warm-up stays at REACHED, over all runs together, and the F1 of every instant."""
    pooled = []
    for instants in zip(*(run.decisions for run in runs), strict=True):
        total = sum((confusion for _, confusion in instants), Confusion())
        pooled.append((instants[0][0], total.as_dict()["f1"]))
    short = [k for k, (_, f1) in enumerate(pooled) if f1 < REACHED]
    first = short[-1] + 1 if short else 0
    return (pooled[first][0] if first < len(pooled) else float("inf")), pooled


def lines_of(case: Case, runs: Sequence[Run]) -> Iterator[str]:
    """The rows of a case."""
    for figure in case.figure:
        values = [value_of(figure, run.scores) for run in runs]
        worst = min(values) if figure.better == "higher" else max(values)
        met = figure.asked is None or (worst >= figure.asked if figure.better == "higher" else worst <= figure.asked)
        title = f"{figure.path} / {figure.over.split('.')[-1]}" if figure.over else figure.path
        yield _row(case.name, title, figure.asked, float(np.mean(values)), worst, "" if figure.asked is None else _word(met))
    if case.cold_start_s is not None:
        reached_s, pooled = cold_start(runs)
        f1 = next(f1 for time_s, f1 in pooled if time_s >= case.cold_start_s)
        yield _row(case.name, f"F1 at {case.cold_start_s:g} s, %", 100.0 * REACHED, 100.0 * f1, None, _word(f1 >= REACHED))
        yield _row(case.name, f"F1 {100 * REACHED:g} % from, s", None, reached_s, None, "")


def _word(met: bool) -> str:
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
    asked = parser.parse_args()
    cases = [case for case in load_cases(asked.cases) if not asked.case or case.name in asked.case]
    if len(cases) < len(set(asked.case)):
        parser.error(f"--case: got {asked.case}, needed names out of {[case.name for case in load_cases(asked.cases)]}")
    first, last = (int(s) for s in asked.seeds.split("-"))
    given = [f" --case {shlex.quote(name)}" for name in asked.case] + [f" --set {shlex.quote(pair)}" for pair in asked.set]
    print(f"# python -m scaling.load.accuracy --seeds {asked.seeds}{''.join(given)}")
    print(_row(*HEADS), flush=True)
    for case in cases:
        changed = case.model_copy(update={"settings": (*case.settings, *asked.set)})
        runs = [run_case(changed, seed) for seed in range(first, last + 1)]
        print("\n".join(lines_of(case, runs)), flush=True)


if __name__ == "__main__":
    main()
