"""Statistics of a run beside its scores: decisions cycle by cycle, and the scores of all candidate pairs."""

from __future__ import annotations

from typing import Any

import numpy as np

from coastwatch.associations import AssociationInput, step_with_candidates
from coastwatch.batches import Floats, Sensors, SourceKind
from coastwatch.centre import Cycle
from coastwatch.scenario import Scenario
from coastwatch.scores.confusion import Confusion, association, bearing_association

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
