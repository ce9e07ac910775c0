"""`published.toml` of the scenario folders that reproduce a paper: published figures, and the variants of a run to compare."""

from __future__ import annotations

import itertools
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError, model_validator

from coastwatch.errors import InputError
from coastwatch.reproduction.side_by_side import SideBySide
from coastwatch.reproduction.systems import Systems
from coastwatch.reproduction.trackers import Trackers
from coastwatch.reproduction.two_filters import TwoFilters
from coastwatch.scenario.refusing import refusals
from coastwatch.shipped import scenarios_folder
from coastwatch.spelling import did_you_mean
from coastwatch.stage import Count, Positive, Settings

Value = float | int | str
Point = tuple[tuple[str, Value], ...]
"""One setting of each sweep, sorted by key."""


class Roc(Settings):
    """Asks for the scores of all candidate pairs of a variant."""

    threshold: float  # score from which the variant accepts, marked on the curve


class Targets(Settings):
    """Asks for the scores of the radar tracks of a few targets, in place of those of a whole run."""

    cutoff_m: float = 200.0  # of OSPA
    near_m: float = 100.0  # a track farther from every target is false
    within_m: float  # of the first radar; tracks farther away do not count


class TrackLoss(Settings):
    """Asks for the scores of whole paths of radar tracks, in place of those of a whole run."""

    limit_m: Positive = 15.0  # a path farther from its target may have lost it
    for_good: Positive = 10.0  # times the limit: then it has
    near_m: Positive = 50.0  # a track in a shadow is of a target within this
    after_looks: Count = 5  # after a shadow, when the track should be the same as before


class Variant(Settings):
    """One column: the folder's scenario with some settings changed."""

    name: str
    title: str
    settings: tuple[str, ...] = ()  # KEY=VALUE
    sweep: dict[str, tuple[Value, ...]] = Field(default_factory=dict)  # key to values, beyond those of the folder
    most_runs: Count | None = None  # of each point: fewer than the folder's, if a sweep needs fewer
    roc: Roc | None = None


class Figure(Settings):
    """One published or asked figure."""

    name: str
    source: str = ""
    published: float | None = None
    asked: float | None = None
    asked_by: str = ""
    asked_of: str = "default"  # the variant that must reach the target
    better: Literal["higher", "lower"] = "higher"
    equal: bool = False  # the measured value should be the published one, neither more nor less
    why_not: str = ""  # why the measured value is not compared with the published one; empty: it is
    by_hand: bool = False  # the scene was laid out by hand to give it: neither a comparison nor a target
    path: str  # path in the record
    over: str = ""  # path of the divisor
    bound: str = ""  # path of the physical bound
    at: dict[str, Value] = Field(default_factory=dict)  # which point of the sweeps
    against: dict[str, Value] = Field(default_factory=dict)  # divided by the same at this other point
    statistic: Literal["mean", "median", "worst"] = "mean"  # over the runs
    of_means: bool = False  # divided by the mean there over the runs, not run by run
    unit: str = ""  # "%": the value is a fraction of 1
    digits: int = 2
    literal: str = "literal"  # the variant that runs the method of the paper as it stands; empty: none
    default: str = "default"  # of ours, in a line of its own; that of the paper where `literal` is empty and a value published

    @property
    def of_paper(self) -> str:
        """The variant that stands beside the published value; empty: none."""
        return self.literal or (self.default if self.published is not None else "")

    @property
    def variants(self) -> tuple[str, ...]:
        """Every variant with a line of its own, that of the paper first."""
        asked = self.asked_of if self.asked is not None else ""
        return tuple(dict.fromkeys(name for name in (self.of_paper, asked, self.default) if name))


class Absent(Settings):
    """A figure or table of the paper that no scenario reproduces."""

    name: str
    why: str


class Ordering(Settings):
    """A claim about two variants at every point of the sweeps: a value of one is less than that of the other, seed by seed.

    With `than` it may be a claim about two methods of one variant.
    """

    path: str  # path in the record
    than: str = ""  # path of the value that is more, if it is another
    less: str  # variant
    more: str  # variant
    at: dict[str, tuple[Value, ...]] = Field(default_factory=dict)  # only at these points
    against: dict[str, Value] = Field(default_factory=dict)  # in which the point of `more` differs from that of `less`
    ours: bool = False  # a claim of the project, which the paper does not make

    @property
    def title(self) -> str:
        """The claim in short: the figure, what is less, what is more, and whether it is ours."""
        figure, less, more, among = self.path.partition(".")[2], self.less, self.more, ""
        if self.than:
            (less, _, figure), (more, _, _) = (path.partition(".")[2].rpartition(".") for path in (self.path, self.than))
            if self.less == self.more:
                among = f" ({self.less})"
            else:
                less, more = f"{less} of {self.less}", f"{more} of {self.more}"
        point = ", ".join(f"{key.split(',')[0].split('.')[-1]} {value}" for key, value in self.against.items())
        return f"{figure}: {less} < {more}{among}" + (f" at {point}" if point else "") + (" (ours)" if self.ours else "")


class Published(Settings):
    """The whole file."""

    paper: str
    order: int  # in the report
    title: str
    runs: Count = 10  # unless --runs is given
    serial: bool = False  # its runs are timed: one at a time
    why: str = ""  # the differences and their causes, for the report
    history_s: tuple[float, ...] = ()  # times after a cold start at which decisions are counted separately
    picture: bool = False  # draw the picture
    targets: Targets | None = None  # score radar tracks alone
    track_loss: TrackLoss | None = None  # score whole paths of radar tracks alone
    side_by_side: SideBySide | None = None  # score several methods on the same tracks
    systems: Systems | None = None  # score the vessels of the whole chain
    trackers: Trackers | None = None  # score several radar trackers on the same plots
    two_filters: TwoFilters | None = None  # two filters of one target in place of a scenario; settings are theirs
    bound_name: str = "bound"  # heading of that column
    plots: tuple[
        Literal[
            "picture",
            "time_shares",
            "noise",
            "history",
            "roc",
            "convergence",
            "anees",
            "pairs",
            "targets",
            "steps",
            "ospa",
            "paths",
            "scan",
        ],
        ...,
    ] = ()
    short: tuple[str, ...] = ()  # settings of a quick test
    sweep: dict[str, tuple[Value, ...]] = Field(default_factory=dict)
    variant: tuple[Variant, ...]
    figure: tuple[Figure, ...] = ()
    ordering: tuple[Ordering, ...] = ()
    unpublished: str = "no value is printed in the paper"  # why figures without a published value have none
    absent: tuple[Absent, ...] = ()  # what no scenario reproduces, and why

    @property
    def asked(self) -> SideBySide | Systems | Targets | Trackers | TrackLoss | None:
        """The scores that are asked for in place of those of whole runs; None: whole runs are scored."""
        return self.side_by_side or self.systems or self.targets or self.trackers or self.track_loss

    @model_validator(mode="after")
    def _figures_name_existing_variants(self) -> Published:
        names = [v.name for v in self.variant]
        if len(set(names)) < len(names):
            raise ValueError(f"variant: got names {names}, needed each once")
        for claim in self.ordering:
            if not {claim.less, claim.more} <= set(names):
                raise ValueError(f"ordering of {claim.path!r}: got {claim.less!r} and {claim.more!r}, needed two of {names}")
        for figure in self.figure:
            missing = {figure.literal, figure.default, figure.asked_of if figure.asked is not None else ""} - {*names, ""}
            if missing:
                raise ValueError(f"figure {figure.name!r}: got variants {sorted(missing)}, needed some of {names}")
            for key, value in {**figure.at, **figure.against}.items():
                known = [*self.sweep.get(key, ()), *(one for v in self.variant for one in v.sweep.get(key, ()))]
                if value not in known:
                    raise ValueError(f"figure {figure.name!r}: got {key} = {value}, needed one of {known}")
        return self

    def points(self, variant: Variant) -> Iterator[Point]:
        """Every combination of the swept settings of a variant; one empty point without a sweep."""
        swept = sorted({**self.sweep, **variant.sweep}.items())
        for values in itertools.product(*(values for _, values in swept)):
            yield tuple(zip((key for key, _ in swept), values, strict=True))

    def named(self, name: str) -> Variant:
        """The variant of this name."""
        return next(v for v in self.variant if v.name == name)


def settings_of(variant: Variant, point: Point) -> tuple[str, ...]:
    """KEY=VALUE of all settings that a variant changes at a point. A swept key may be several, with commas between."""
    written = ((keys, f"{value:g}" if isinstance(value, float) else value) for keys, value in point)
    swept = (f"{key}={value}" for keys, value in written for key in keys.split(","))
    return (*variant.settings, *swept)


@cache
def papers() -> dict[str, dict[str, Published]]:
    """Paper, then scenario, to its published.toml, in the order of the report; read once. Raises: InputError for a wrong file."""
    found: dict[str, dict[str, Published]] = {}
    for path in scenarios_folder().glob("*/published.toml"):
        made = read(path)
        if made is not None:
            found.setdefault(made.paper, {})[path.parent.name] = made
    return {paper: dict(sorted(of.items(), key=lambda item: item[1].order)) for paper, of in sorted(found.items())}


def read(path: Path) -> Published | None:
    """The content of a file; None if it belongs to no paper. Raises: InputError that names file and key."""
    try:
        data: dict[str, Any] = tomllib.loads(path.read_text("utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from error
    if "paper" not in data:
        return None
    other = data.pop("variants_of", None)
    if other is not None:
        data |= _variants(path, other)
    try:
        return Published.model_validate(data)
    except ValidationError as error:
        raise InputError(f"{path}: {'; '.join(refusals(error, Published))}") from error


def _variants(path: Path, folder: object) -> dict[str, object]:
    """The variants of another scenario's file, and its trackers if it has some."""
    there = scenarios_folder() / str(folder) / "published.toml"
    every = tomllib.loads(there.read_text("utf-8")) if there.is_file() else {}
    if not every.get("variant"):
        raise InputError(f"{path}: variants_of: got {folder!r}, needed a scenario with [[variant]] in its published.toml")
    return {key: every[key] for key in ("variant", "trackers") if key in every}


def chosen(paper: str, only: tuple[str, ...]) -> dict[str, Published]:
    """The folders of a paper, or some of them; the name of the paper may be left out. Raises: InputError."""
    known = papers()
    if paper not in known:
        raise InputError(f"reproduce: got {paper!r}, needed one of {', '.join(known)}{did_you_mean(paper, known)}")
    folders = known[paper]
    wanted = [name if name in folders else f"{paper}-{name}" for name in only]
    unknown = [name for name, whole in zip(only, wanted, strict=True) if whole not in folders]
    if unknown:
        raise InputError(
            f"--only: got {', '.join(unknown)}, needed some of {', '.join(folders)}{did_you_mean(unknown[0], folders)}"
        )
    return {name: of for name, of in folders.items() if not only or name in wanted}
