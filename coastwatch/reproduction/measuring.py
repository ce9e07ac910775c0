"""One run to its record: scores, decisions cycle by cycle, the scores of all candidate pairs, the picture; plain values for JSON."""

from __future__ import annotations

import base64
import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from coastwatch.associations import AssociationInput, step_with_candidates
from coastwatch.batches import Floats, Sensors, SourceKind
from coastwatch.centre import Cycle
from coastwatch.reproduction import side_by_side, systems, targets, track_loss, trackers, two_filters
from coastwatch.reproduction.planning import Job
from coastwatch.reproduction.published import Targets, TrackLoss
from coastwatch.reproduction.side_by_side import SideBySide
from coastwatch.reproduction.systems import Systems
from coastwatch.reproduction.trackers import Trackers
from coastwatch.scenario import Scenario
from coastwatch.scores.confusion import Confusion, association, bearing_association
from coastwatch.server.run import run_scenario
from coastwatch.shipped import scenarios_folder
from coastwatch.spelling import json_value

NOWHERE = "sqlite://"  # in memory, deleted after the run
Draw = Callable[[str, int, str], tuple[dict[str, int], bytes]]
"""Database, run and file of land to the counts of vessels and the PNG of its last picture. A module-level function."""

ASKED: dict[type, tuple[str, Callable[[Scenario, int, Any], object]]] = {
    SideBySide: ("", side_by_side.measure),
    Systems: ("system", systems.measure),
    Targets: ("targets", targets.measure),
    Trackers: ("trackers", trackers.measure),
    TrackLoss: ("paths", track_loss.measure),
}
"""What scores a run by what is asked for, and the name of the scores in the record; empty: they have names of their own."""

AROUND = 1  # cycles before and after an instant that are counted with it
KEPT_WRONG = 5000  # stored pairs of two vessels, those with the greatest scores; the others are counted
EVERY = 8  # scored cycles between those whose pairs are stored: neighbouring cycles are correlated


class Decisions:
    """Counts of every cycle: decisions, and number of tracks."""

    def __init__(self, sensors: Sensors) -> None:
        self._kinds = sensors.source_kinds
        self.rows: dict[str, list[tuple[Confusion, int]]] = {"associations": [], "bearing_associations": []}

    def add(self, cycle: Cycle) -> None:
        """Count one cycle."""
        radar = int((self._kinds[cycle.tracks.source] == SourceKind.RADAR).sum())
        counts = association(cycle.tracks, cycle.associations, self._kinds)
        self.rows["associations"].append((counts, radar))
        bearings = bearing_association(cycle.bearing_tracks, cycle.picture, cycle.bearing_associations)
        self.rows["bearing_associations"].append((bearings, len(cycle.bearing_tracks)))

    def between(self, stage: str, first: int, stop: int) -> dict[str, float]:
        """The sums over some cycles, with swaps and with the F1 of "always associate" on the same decisions."""
        rows = self.rows[stage][max(first, 0) : stop]
        total, decisions = sum((c for c, _ in rows), Confusion()), sum(n for _, n in rows)
        exists = total.tp + total.fn
        return {
            **total.as_dict(),
            "decisions": decisions,
            "swaps": total.tp + total.fn + total.fp + total.tn - decisions,
            "always_f1": 2.0 * exists / (exists + decisions) if decisions else 0.0,
        }


class Pairs:
    """A second associator beside that of the run, which stores the scores of all candidate pairs."""

    def __init__(self, scenario: Scenario) -> None:
        self._method: Any = scenario.associations
        self._memory: Any = self._method.init()
        self._from, self._cycle = scenario.warmup_cycles, 0
        self._true: list[Floats] = []
        self._wrong: list[Floats] = []

    def add(self, cycle: Cycle) -> None:
        """The scores of one cycle's candidates."""
        self._memory, _, found = step_with_candidates(self._method, self._memory, AssociationInput(cycle.tracks, cycle.spots))
        number, self._cycle = self._cycle - self._from, self._cycle + 1
        if number < 0 or number % EVERY:
            return
        origin = cycle.tracks.origin
        true = (origin[found.first] == origin[found.second]) & (origin[found.first] >= 0)
        self._true.append(found.score[true])
        self._wrong.append(found.score[~true])

    def as_object(self) -> dict[str, list[float] | int]:
        """Scores of the true pairs, and the greatest scores of the wrong pairs; both sorted, greatest first."""
        true, wrong = (np.sort(np.concatenate([np.zeros(0), *part]))[::-1] for part in (self._true, self._wrong))
        kept = wrong[:KEPT_WRONG]
        return {
            "true": [float(f"{v:.5g}") for v in true[np.isfinite(true)]],
            "wrong": [float(f"{v:.5g}") for v in kept[np.isfinite(kept)]],
            "true_count": len(true),
            "wrong_count": len(wrong),
        }


def measure(job: Job, draw: Draw) -> dict[str, object] | None:
    """The record of a run; None if it was interrupted.

    Returns: seed, elapsed_s, scores (with the counts of decisions of the scored cycles), timings_s, and on request `history`
    (seconds after the start to scores), `roc`, `picture`. Of targets and the like only seed
    and scores.
    """
    if isinstance(job.subject, two_filters.TwoFilters):
        return {"seed": job.seed, "scores": {"two_filters": two_filters.measure(job.subject, job.seed)}}
    if job.asked is not None:
        name, scores_of = ASKED[type(job.asked)]
        scores = scores_of(job.scenario, job.seed, job.asked)
        return {"seed": job.seed, "scores": {name: scores} if name else scores}
    decisions = Decisions(job.scenario.sensors())
    pairs = Pairs(job.scenario) if job.roc else None

    def on_cycle(cycle: Cycle) -> None:
        decisions.add(cycle)
        if pairs:
            pairs.add(cycle)

    with tempfile.TemporaryDirectory(prefix="coastwatch-") as folder:
        database = f"sqlite:///{Path(folder) / 'run.db'}" if job.picture else NOWHERE
        scenario = job.scenario if job.picture else _unkept(job)
        result = run_scenario(scenario, seed=job.seed, workers=1, database=database, on_cycle=on_cycle)
        if result.interrupted:
            return None
        shown: dict[str, int | str] | None = None
        if job.picture:
            counts, png = draw(database, result.run_id, str(scenarios_folder() / "guanabara" / "coastline.geojson"))
            shown = {**counts, "png": base64.b64encode(png).decode()}
    history = {}
    for at_s in job.history_s:  # the decisions around the first instant at this time after the start
        cycle = math.ceil(at_s / job.scenario.period_s) - 1
        around = cycle - AROUND, cycle + AROUND + 1
        history[f"{at_s:g}"] = {stage: decisions.between(stage, *around) for stage in decisions.rows}
    first = job.scenario.warmup_cycles
    counted = {
        stage: {**result.scores.get(stage, {}), **decisions.between(stage, first, result.cycles)} for stage in decisions.rows
    }
    plain: dict[str, object] = json_value(
        {
            "seed": job.seed,
            "elapsed_s": result.elapsed_s,
            "scores": {**result.scores, **counted},
            "timings_s": result.timings_s,
            "history": history,
            "roc": pairs.as_object() if pairs else None,
            "picture": shown,
        }
    )
    return plain


def _unkept(job: Job) -> Scenario:
    """The scenario with as little stored as possible: nothing reads the database."""
    every = dict.fromkeys(("spots_every", "associations_every", "registration_every", "checkpoint_every"), 10**9)
    seldom = {**every, "history_error_m": 1e9, "history_max_s": 1e9}
    return job.scenario.model_copy(update={"store": job.scenario.store.model_copy(update=seldom)})
