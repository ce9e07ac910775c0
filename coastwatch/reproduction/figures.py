"""Mean and standard deviation over runs of every figure, a line for each method, and how it stands to the published value."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from coastwatch.reproduction.planning import Wanted
from coastwatch.reproduction.published import Figure, Ordering, Point, Published, Value, Variant

Record = Mapping[str, Any]


@dataclass(frozen=True)
class Spread:
    """A figure over runs."""

    values: tuple[float, ...] = ()  # one per run that has it

    @property
    def mean(self) -> float:
        """The mean; NaN if no run has the figure."""
        return float(np.mean(self.values)) if self.values else math.nan

    @property
    def std(self) -> float:
        """The standard deviation of one run, unbiased; NaN with fewer than two."""
        return float(np.std(self.values, ddof=1)) if len(self.values) > 1 else math.nan


@dataclass(frozen=True)
class Made:
    """A variant at a point of the sweeps, with the records of its runs."""

    wanted: Wanted
    records: tuple[Record, ...]


@dataclass(frozen=True)
class Line:
    """One method under one figure."""

    figure: Figure
    variant: Variant
    measured: Spread = field(default_factory=Spread)
    bound: Spread = field(default_factory=Spread)
    runs_published: int = 1  # that the published value is the mean of

    @property
    def published(self) -> float | None:
        """The value of the paper; None where the variant is not the method of the paper."""
        return self.figure.published if self.variant.name == self.figure.of_paper else None

    @property
    def asked(self) -> float | None:
        """What is asked of this variant."""
        return self.figure.asked if self.variant.name == self.figure.asked_of else None

    def written(self, value: float) -> str:
        """A value of the figure with its digits, a share in per cent; empty: NaN."""
        scale = 100.0 if self.figure.unit == "%" else 1.0
        return "" if math.isnan(value) else f"{scale * value:.{self.figure.digits}f}"

    @property
    def reached(self) -> bool | None:
        """Whether the target is reached; None without a target or a measurement, or of a scene laid out by hand."""
        asked, got = self.asked, self.measured.mean
        if asked is None or math.isnan(got) or self.figure.by_hand:
            return None
        return got <= asked if self.figure.better == "lower" else got >= asked

    @property
    def not_compared(self) -> str:
        """Why there is no comparison with a published value; empty if there is one."""
        if self.figure.by_hand:
            return "the scene was laid out by hand to give it"
        if self.published is None or not self.measured.values:
            return "not measured" if self.published is not None else "no published value of this method"
        return self.figure.why_not

    @property
    def against_published(self) -> str:
        """How the measured value stands to the published one of the same method; empty without a comparison."""
        if self.published is None or self.not_compared:
            return ""
        apart, error = self.measured.mean - self.published, self.measured.std / math.sqrt(len(self.measured.values))
        if self.figure.equal:
            error = math.hypot(error, self.measured.std / math.sqrt(self.runs_published))
        rounding = 0.5 * 10.0**-self.figure.digits * (0.01 if self.figure.unit == "%" else 1.0)
        if math.isnan(error) and self.figure.equal:
            return "not decided: one run"
        if abs(apart) <= (0.0 if math.isnan(error) else 2.0 * error) + rounding:
            return "equal within 2 standard errors"
        if self.figure.equal:
            return "differs"
        return "better" if (apart < 0.0) == (self.figure.better == "lower") else "worse"


@dataclass(frozen=True)
class Order:
    """A claim about two variants at one point of the sweeps."""

    ordering: Ordering
    point: Point
    difference: Spread  # the one that should be more, less the other, of the same seed

    @property
    def at(self) -> str:
        """The point in short; empty without a sweep."""
        return ", ".join(f"{value:g}" if isinstance(value, float) else str(value) for _, value in self.point)

    @property
    def error(self) -> float:
        """Standard error of the mean difference; NaN with fewer than two runs."""
        return self.difference.std / math.sqrt(max(len(self.difference.values), 1))

    @property
    def verdict(self) -> str:
        """Whether the claim holds by two standard errors."""
        if math.isnan(self.error):
            return "not measured"
        if abs(self.difference.mean) <= 2.0 * self.error:
            return "equal within 2 standard errors"
        return "holds" if self.difference.mean > 0.0 else "fails"


def orders(of: Published, made: Sequence[Made]) -> list[Order]:
    """Every claim of a folder at every point where both variants were run."""
    found = []
    for claim in of.ordering:
        for one in (m for m in made if m.wanted.variant.name == claim.less):
            point = dict(one.wanted.point)
            other = at(made, claim.more, {**point, **claim.against})
            if other is None or not all(point.get(key) in wanted for key, wanted in claim.at.items()):
                continue
            than = claim.than or claim.path
            pairs = [(at_path(a, claim.path), at_path(b, than)) for a, b in zip(one.records, other.records, strict=False)]
            apart = tuple(b - a for a, b in pairs if a is not None and b is not None)
            found.append(Order(claim, one.wanted.point, Spread(apart)))
    return found


def lines(of: Published, made: Sequence[Made]) -> list[Line]:
    """Every method under every figure of a folder. A method of ours never stands beside a value of another method."""
    return [
        Line(
            figure,
            of.named(name),
            _column(made, figure, name, figure.path),
            _column(made, figure, name, figure.bound) if figure.bound else Spread(),
            of.runs,
        )
        for figure in of.figure
        for name in figure.variants
    ]


def values(records: Sequence[Record], path: str) -> tuple[float, ...]:
    """The numbers at a path, of the runs that have one."""
    found = (at_path(record, path) for record in records)
    return tuple(value for value in found if value is not None)


def at_path(record: Record, path: str) -> float | None:
    """The number at a dotted path of a record, of which "scores." may be left out. None if there is none.

    A name may have a dot: "pairs.test 0.01.tpr".
    """
    parts = path.split(".")
    here = _below(record, parts if parts[0] in record else ["scores", *parts])
    return float(here) if isinstance(here, int | float) and math.isfinite(here) else None


def _below(here: object, parts: Sequence[str]) -> object:
    """What stands at these parts of a path; None if there is nothing."""
    if not parts or not isinstance(here, Mapping):
        return None if parts else here
    names = ((".".join(parts[:k]), parts[k:]) for k in range(1, len(parts) + 1))
    found = (_below(here[name], rest) for name, rest in names if name in here)
    return next((value for value in found if value is not None), None)


def at(made: Sequence[Made], variant: str, point: Mapping[str, Value]) -> Made | None:
    """A variant at the point with these settings; the first if other settings are swept too."""
    for one in made:
        have = dict(one.wanted.point)
        if one.wanted.variant.name == variant and all(have.get(key) == value for key, value in point.items()):
            return one
    return None


def _column(made: Sequence[Made], figure: Figure, variant: str, path: str) -> Spread:
    one = at(made, variant, figure.at) if variant else None
    if one is None:
        return Spread()
    below = at(made, variant, {**figure.at, **figure.against}) if figure.against else None
    mean = Spread(values(below.records, path)).mean if below is not None and figure.of_means else math.nan
    found: list[float] = []
    for k, record in enumerate(one.records):
        value = at_path(record, path)
        over = at_path(record, figure.over) if figure.over else 1.0
        if figure.of_means:
            over = mean
        elif below is not None:  # the same seed at the other point
            over = at_path(below.records[k], path) if k < len(below.records) else None
        if value is None and figure.statistic != "mean":
            found.append(math.inf if figure.better == "lower" else -math.inf)  # never: it counts as the worst
        elif value is not None and over and math.isfinite(over):
            found.append(value / over)
    if found and figure.statistic != "mean":  # one number of all runs, without a deviation
        worst = max(found) if figure.better == "lower" else min(found)
        found = [float(np.median(found)) if figure.statistic == "median" else worst]
    return Spread(tuple(found))
