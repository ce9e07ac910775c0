"""The verdict on a run: which of its figures are below what was required, or worse than those of the last good run."""

from __future__ import annotations

import argparse
import operator
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from coastwatch.errors import InputError
from coastwatch.spelling import did_you_mean

HOLDS = {">=": operator.ge, "<=": operator.le, ">": operator.gt, "<": operator.lt}
REQUIREMENT = re.compile(r"\s*([a-z][\w.]*)\s*(>=|<=|>|<)\s*(\S+)\s*")

SHARES = ("f1", "precision", "recall", "accuracy", "specificity", "mcc", "dark_recall", "purity", "longest_single_id")
"""Figures of at most 1 that are better when larger."""

ERRORS = ("position_rmse_m", "course_rmse_deg", "speed_rmse_kn", "gospa_rms_m", "ospa_mean_m")
"""Figures that are better when smaller."""


class Requirement(NamedTuple):
    """What one figure must be."""

    figure: str  # "associations.f1"
    sign: str  # of HOLDS
    limit: float


def requirement(text: str) -> Requirement:
    """The requirement that is written as FIGURE>=NUMBER. Raises: argparse.ArgumentTypeError."""
    match = REQUIREMENT.fullmatch(text)
    try:
        limit = float(match[3]) if match else float("nan")
    except ValueError:
        limit = float("nan")
    if match is None or limit != limit:
        raise argparse.ArgumentTypeError(f"got {text!r}, needed FIGURE>=NUMBER or <=, >, <, such as associations.f1>=0.999")
    return Requirement(match[1], match[2], limit)


def check_known(requirements: Sequence[Requirement], names: Sequence[str]) -> None:
    """Raises: InputError where a required figure is none that a run may have. Args: names: of those."""
    for name, *_ in requirements:
        if name not in names:
            raise InputError(f"--require: got {name!r}, needed one of {', '.join(names)}{did_you_mean(name, names)}")


def below_required(scores: Mapping[str, object], requirements: Sequence[Requirement]) -> list[str]:
    """One sentence for each figure that is not as required. Args: scores: of a run; a figure that is absent does not hold."""
    scored, sentences = dict(figures(scores)), []
    for name, sign, limit in requirements:
        if name not in scored:
            sentences.append(
                f"{name} was not scored, required {sign} {limit:g}: scored were {', '.join(sorted(scored)) or 'none'}"
            )
        elif not HOLDS[sign](scored[name], limit):
            sentences.append(f"{name} is {scored[name]:.6g}, required {sign} {limit:g}")
    return sentences


def worse_than(scores: Mapping[str, object], run_id: int, before: Mapping[str, object], tolerance: float) -> list[str]:
    """One sentence for each figure that is worse than that of an earlier run, or is no longer scored.

    Args: before: scores of that run, whose number is run_id; tolerance: of SHARES as it is, of ERRORS as a share of the earlier
    figure.
    """
    now, sentences = dict(figures(scores)), []
    for name, value in figures(before):
        kind = name.rpartition(".")[2]
        allowed = tolerance if kind in SHARES else tolerance * abs(value)
        if kind not in SHARES + ERRORS:
            continue
        if name not in now:
            sentences.append(f"{name} was not scored, in run {run_id} it was {value:.6g}")
        elif (value - now[name] if kind in SHARES else now[name] - value) > allowed:
            verb = "fell" if kind in SHARES else "rose"
            sentences.append(f"{name} {verb} from {value:.6g} in run {run_id} to {now[name]:.6g}, tolerance {allowed:.3g}")
    return sentences


def figures(scores: Mapping[str, object], path: str = "") -> Iterator[tuple[str, float]]:
    """Each number of the scores that is finite, with its path."""
    for key, value in scores.items():
        name = f"{path}.{key}" if path else key
        if isinstance(value, Mapping):
            yield from figures(value, name)
        elif isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < float("inf"):
            yield name, float(value)
