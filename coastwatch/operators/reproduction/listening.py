"""What a run says beyond its scores: decisions investigation by investigation, and the scores of all candidate pairs."""

from __future__ import annotations

from typing import Any

import numpy as np

from coastwatch.associations import step_with_candidates
from coastwatch.batches import Floats, Sensors, SourceKind
from coastwatch.pipeline import Cycle
from coastwatch.scenario import Scenario
from coastwatch.scores.confusion import Confusion, association, bearing_association

KEPT_WRONG = 5000  # pairs of two vessels that look most like one; the others only count
EVERY = 8  # scored cycles between those whose pairs are kept: neighbours say the same


class Decisions:
    """Counts of every cycle: what was decided, and of how many tracks."""

    def __init__(self, sensors: Sensors) -> None:
        self._kinds = sensors.source_kinds
        self.rows: dict[str, list[tuple[Confusion, int]]] = {"associations": [], "bearing_associations": []}

    def hear(self, cycle: Cycle) -> None:
        """Count one cycle."""
        radar = int((self._kinds[cycle.tracks.source] == SourceKind.RADAR).sum())
        counts = association(cycle.tracks, cycle.associations, self._kinds)
        self.rows["associations"].append((counts, radar))
        heard = bearing_association(cycle.bearing_tracks, cycle.picture, cycle.bearing_associations)
        self.rows["bearing_associations"].append((heard, len(cycle.bearing_tracks)))

    def between(self, stage: str, first: int, stop: int) -> dict[str, float]:
        """What some cycles add up to, with swaps and with what "always associate" would have scored on the same decisions."""
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
    """A second associator beside the run's own, whose scores of all candidate pairs are kept."""

    def __init__(self, scenario: Scenario) -> None:
        self._method: Any = scenario.associations
        self._memory: Any = self._method.init()
        self._from, self._cycle = scenario.warmup_cycles, 0
        self._true: list[Floats] = []
        self._wrong: list[Floats] = []

    def hear(self, cycle: Cycle) -> None:
        """The scores of one cycle's candidates."""
        self._memory, _, found = step_with_candidates(self._method, self._memory, cycle.tracks, cycle.spots)
        number, self._cycle = self._cycle - self._from, self._cycle + 1
        if number < 0 or number % EVERY:
            return
        origin = cycle.tracks.origin
        true = (origin[found.first] == origin[found.second]) & (origin[found.first] >= 0)
        self._true.append(found.score[true])
        self._wrong.append(found.score[~true])

    def said(self) -> dict[str, Any]:
        """Scores of pairs of one vessel, and of the wrong pairs that look most like one; both sorted, greatest first."""
        true, wrong = (np.sort(np.concatenate([np.zeros(0), *part]))[::-1] for part in (self._true, self._wrong))
        kept = wrong[:KEPT_WRONG]
        return {
            "true": [float(f"{v:.5g}") for v in true[np.isfinite(true)]],
            "wrong": [float(f"{v:.5g}") for v in kept[np.isfinite(kept)]],
            "true_count": len(true),
            "wrong_count": len(wrong),
        }
