"""The runs of a reproduction: a job for every variant, point of the sweeps and seed. Equal jobs run once."""

from __future__ import annotations

import hashlib
import json
import sys
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass

from pydantic import ValidationError

from coastwatch.errors import InputError
from coastwatch.reproduction.published import Point, Published, Roc, Targets, TrackLoss, Variant, settings_of
from coastwatch.reproduction.side_by_side import SideBySide
from coastwatch.reproduction.systems import Systems
from coastwatch.reproduction.trackers import Trackers
from coastwatch.reproduction.two_filters import TwoFilters
from coastwatch.scenario import Scenario, ScenarioError, load_scenario
from coastwatch.scenario.refusing import refusals

FIRST_SEED = 1000
ROC_SEEDS = 2  # the statistics of all pairs are large, and two runs are enough


@dataclass(frozen=True)
class Job:
    """One run and the statistics that its record needs."""

    key: str  # digest of everything that determines the record, with the code
    subject: Scenario | TwoFilters  # what is run
    seed: int
    history_s: tuple[float, ...] = ()
    picture: bool = False
    roc: Roc | None = None  # settings of the statistics of all pairs
    serial: bool = False
    asked: SideBySide | Systems | Targets | Trackers | TrackLoss | None = None  # as of `Published`

    @property
    def scenario(self) -> Scenario:
        """The scenario of a job that has one. Raises: TypeError for two filters."""
        if not isinstance(self.subject, Scenario):
            raise TypeError("job: got two filters, needed a scenario")
        return self.subject

    @property
    def name(self) -> str:
        """What is run, for messages."""
        return self.subject.name if isinstance(self.subject, Scenario) else "two filters"


@dataclass(frozen=True)
class Wanted:
    """The runs of one variant at one point."""

    variant: Variant
    point: Point
    settings: tuple[str, ...]
    jobs: tuple[Job, ...]


def plan(
    folders: Mapping[str, Published], runs: int | None, code: str, further: tuple[str, ...] = (), seed: int = FIRST_SEED
) -> dict[str, list[Wanted]]:
    """The runs of each folder.

    Args: runs: instead of the folders' own number; code: digest of the code; further: settings of all runs; seed: of the first run
    of each variant; the others follow.
    """
    if runs is not None and runs < 1:
        raise InputError(f"--runs: got {runs}, needed 1 or more")
    planned: dict[str, list[Wanted]] = {name: [] for name in folders}
    for name, of in folders.items():
        for variant in of.variant:
            count = min(runs or of.runs, variant.most_runs or sys.maxsize)
            for point in of.points(variant):
                settings = settings_of(variant, point)
                subject = _subject(name, of, variant, (*settings, *further))
                jobs = (_job(of, subject, seed + k, variant.roc if k < ROC_SEEDS else None, code) for k in range(count))
                planned[name].append(Wanted(variant, point, settings, tuple(jobs)))
    return planned


def unlike(plan: Mapping[str, list[Wanted]]) -> list[Job]:
    """Every job of a plan once, those that must run alone last."""
    found = {job.key: job for wanted in plan.values() for one in wanted for job in one.jobs}
    return sorted(found.values(), key=lambda job: job.serial)


def _subject(name: str, of: Published, variant: Variant, settings: tuple[str, ...]) -> Scenario | TwoFilters:
    """The scenario, or the two filters, of a folder with these settings."""
    try:
        if of.two_filters is None:
            return load_scenario(name, dict(pair.split("=", 1) for pair in settings))
        changed = tomllib.loads("\n".join(settings).replace("=", " = "))
        return TwoFilters.model_validate({**of.two_filters.model_dump(), **changed})
    except ScenarioError as error:
        raise InputError(f"published.toml, variant {variant.name!r}: {error}") from error
    except ValidationError as error:
        refused = "; ".join(refusals(error, TwoFilters))
        raise InputError(f"published.toml, variant {variant.name!r}: two_filters: {refused}") from error


def _job(of: Published, subject: Scenario | TwoFilters, seed: int, roc: Roc | None, code: str) -> Job:
    """A job. Its key leaves out the names of a run, so that two tables can share runs."""
    decides = {
        "settings": subject.model_dump(mode="json", exclude={"name", "title", "workers", "seed"}),
        "seed": seed,
        "history_s": of.history_s,
        "picture": of.picture,
        "roc": roc and roc.model_dump(mode="json"),
        "serial": of.serial,
        "asked": of.asked and [type(of.asked).__name__, of.asked.model_dump(mode="json")],
        "code": code,
    }
    key = hashlib.sha256(json.dumps(decides, sort_keys=True).encode()).hexdigest()[:20]
    return Job(key, subject, seed, of.history_s, of.picture, roc, of.serial, of.asked)
