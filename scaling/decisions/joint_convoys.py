"""Ships that sail or pass close together, by radar tracker: `python -m scaling.decisions.joint_convoys [--seeds 1000-1002]`.

The question: does weighing all plots in the gate keep neighbours apart, where taking the best plot mixes them?
300 vessels of `context-driven-1000` with clutter and misses sail in convoys of three ships 50 or 120 m apart, or pass each other at
30 m, or go their own way on an open sea in four times the clutter, where a turn shows 0.6 of them. `--set` changes spacing,
detection and clutter, e.g. `--set input.radar.detection_probability=0.7`. All else is the default. It prints means over seeds with
their standard errors: breaks and changes are counts of a run. Plots of a confirmed track go to the fusion at once. Where a later look
gives a plot to no track or to another, it cannot be taken out there: the share of those is printed as taken back.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass, field
from typing import Any
from unittest.mock import patch

import numpy as np

from coastwatch.batches import Bools, Floats, Ints, SourceKind, Truth
from coastwatch.centre import Cycle
from coastwatch.cycle import run_cycle, start_run
from coastwatch.geodesy import difference_m
from coastwatch.kernels.tables.match_ids import index_of
from coastwatch.scenario import load_scenario
from coastwatch.scores.confusion import Confusion, association
from coastwatch.server.timing import Stopwatch
from coastwatch.stage import serial
from coastwatch.tracks.radar.leaves import Forest
from coastwatch.tracks.radar.multi_hypothesis import tracking
from coastwatch.tracks.radar.multi_hypothesis.choice import Pruned
from coastwatch.tracks.radar.multi_hypothesis.trees import decide
from coastwatch.tracks.radar.table import Status, Table
from scaling.load.seeds import seed_range

PLOTS = {"sonars": "[]", "input.radar.detection_probability": "0.9", "input.radar.clutter_per_m2": "5e-7", "input.count": "300"}


def convoys(spacing_m: str) -> dict[str, str]:
    """Settings of a scene in which all vessels sail in convoys, so far apart."""
    return {"input.convoys.share": "1.0", **{f"input.convoys.spacing_{end}_m": spacing_m for end in ("from", "to")}}


CASES: dict[str, dict[str, str]] = {
    "convoys of 50 m": convoys("50"),
    "convoys of 120 m": convoys("120"),
    "passings": {"input.passings.share": "1.0", "input.passings.overtaking_share": "0.5"},
    "open sea": {"input.radar.detection_probability": "0.6", "input.radar.clutter_per_m2": "2e-6"},
}
METHODS: dict[str, dict[str, str]] = {
    "sided_imm": {"tracks.method": "sided_imm", "tracks.plot_origin": "estimated"},
    "guided_vimmjipda": {
        "tracks.method": "guided_vimmjipda",
        "tracks.plot_origin": "estimated",
    },  # AIS says which plots are likely
    "sided_vimmjipda": {"tracks.method": "sided_vimmjipda"},
    "vimmjipda": {"tracks.method": "vimmjipda"},
    "multi_hypothesis": {"tracks.method": "multi_hypothesis", "tracks.messages.method": "none"},
    "sided_multi_hypothesis": {"tracks.method": "sided_multi_hypothesis", "tracks.messages.method": "none"},
    "vimmjipda_sequential": {"tracks.method": "vimmjipda_sequential"},
}
HEADS = "F1, %", "fused m", "fused m/s", "radar m", "radar m/s", "breaks", "changes", "taken back, %"


@dataclass
class TakenBack:
    """The plots that tracks of several hypotheses took, and those that they have for good. All radars are of one region."""

    taken: list[Ints] = field(default_factory=list)  # (n, 2) track and plot
    final: list[Ints] = field(default_factory=list)

    def decide(self, forest: Forest, table: Table, pruned: Pruned, looked: Bools) -> Forest:
        """As `decide` of the tracker, which this calls."""
        slot, first = pruned.slot, pruned.start[:-1]
        here = looked[slot] & (table.status[slot] == Status.CONFIRMED)
        track, plot = table.track_id[slot[here]], pruned.leaves.plot[first[here]]
        for parts, column in ((self.taken, -1), (self.final, 0)):
            has = plot[:, column] >= 0
            parts.append(np.column_stack([track, plot[:, column]])[has])
        return decide(forest, table, pruned, looked)

    def share(self) -> float:
        """Of the plots that were taken no later than one that the same track has for good; NaN: there is none."""
        if not self.taken:
            return math.nan
        taken, final = np.concatenate(self.taken), np.concatenate(self.final)
        last = np.full(int(max(taken[:, 0].max(initial=0), final[:, 0].max(initial=0))) + 1, -1)
        np.maximum.at(last, final[:, 0], final[:, 1])
        taken = taken[taken[:, 1] <= last[taken[:, 0]]]
        plots = int(last.max()) + 1
        kept = np.isin(taken[:, 0] * plots + taken[:, 1], final[:, 0] * plots + final[:, 1])
        return float(1.0 - kept.mean()) if len(taken) else math.nan


@dataclass
class Scores:
    """What one run gave, after its warm-up."""

    decisions: Confusion = field(default_factory=Confusion)
    fused: list[Floats] = field(default_factory=list)  # squared errors of position and velocity, (B, 2)
    radar: list[Floats] = field(default_factory=list)  # the same of radar tracks
    breaks: int = 0  # a vessel had a radar track in the last cycle and has none now
    changes: int = 0  # of the true vessel of a radar track
    held: Ints = field(default_factory=lambda: np.zeros(0, np.int64))  # vessels with a radar track in the last cycle
    vessel_of: dict[int, int] = field(default_factory=dict)  # of each radar track
    taken: TakenBack = field(default_factory=TakenBack)

    def add(self, cycle: Cycle, truth: Truth, kinds: Ints) -> None:
        """Count one cycle."""
        tracks, found = cycle.tracks, cycle.associations
        self.decisions += association(tracks, found, kinds)
        is_radar, at = kinds[tracks.source] == SourceKind.RADAR, index_of(truth.vessel, tracks.origin)
        radar = np.flatnonzero(is_radar & (at >= 0))
        self.radar.append(_squares(tracks, radar, truth, at[radar]))
        ais = np.flatnonzero(~is_radar & (at >= 0))
        partner = index_of(found.vessel[ais], found.vessel[radar])
        right = (partner >= 0) & (tracks.origin[ais[partner]] == tracks.origin[radar])
        self.fused.append(_squares(cycle.fused, found.vessel[radar[right]], truth, at[radar[right]]))
        now = np.unique(tracks.origin[radar])
        self.breaks += len(np.setdiff1d(np.intersect1d(self.held, truth.vessel), now))
        pairs = dict(zip(tracks.track_id[radar].tolist(), tracks.origin[radar].tolist(), strict=True))
        self.changes += sum(self.vessel_of.get(track, vessel) != vessel for track, vessel in pairs.items())
        self.held, self.vessel_of = now, pairs

    def row(self) -> list[float]:
        """The figures, in the order of HEADS."""
        rms = [math.sqrt(float(mean)) for parts in (self.fused, self.radar) for mean in np.concatenate(parts).mean(axis=0)]
        decided = 100.0 * self.decisions.as_dict()["f1"]
        return [decided, *rms, float(self.breaks), float(self.changes), 100.0 * self.taken.share()]


def _squares(estimate: Any, rows: Ints, truth: Truth, at: Ints) -> Floats:
    """Squared errors of position and velocity of these rows. (B, 2)"""
    off = difference_m(estimate.position_deg[rows], truth.position_deg[at])
    return np.column_stack([(off**2).sum(1), ((estimate.velocity_m_s[rows] - truth.velocity_m_s[at]) ** 2).sum(1)])


def run(settings: dict[str, str], seed: int) -> Scores:
    """The scores of one run."""
    scenario = load_scenario("context-driven-1000", settings)
    sensors, plan = scenario.sensors(), scenario.plan()
    recording = scenario.input.load(sensors, seed, plan)
    assert recording.truth is not None
    memory, before_s, scores = start_run(scenario, sensors), float("-inf"), Scores()
    for number in range(plan.cycles):
        now_s = plan.instant_s(number)
        reports = recording.reports.between(before_s, now_s)
        with patch.object(tracking, "decide", scores.taken.decide):
            memory, cycle = run_cycle(scenario, sensors, memory, reports, now_s, serial, Stopwatch())
        before_s = now_s
        if number >= scenario.warmup_cycles:
            scores.add(cycle, recording.truth.at(now_s), sensors.source_kinds)
    return scores


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="1000-1002", help="first-last")
    parser.add_argument("--cycles", default="20", help="that are scored")
    parser.add_argument("--methods", nargs="+", default=list(METHODS), choices=METHODS)
    parser.add_argument("--cases", nargs="+", default=list(CASES), choices=CASES)
    parser.add_argument("--set", nargs="+", default=[], dest="changed", metavar="PATH=VALUE", help="settings of every run")
    asked = parser.parse_args()
    changed = dict(pair.split("=", 1) for pair in asked.changed)
    seeds = seed_range(asked.seeds)
    print("  ".join([f"{'case':<16}", f"{'method':<22}", *(f"{head:>14}" for head in HEADS)]), flush=True)
    for case in asked.cases:
        for method in asked.methods:
            settings = {**PLOTS, **CASES[case], **METHODS[method], **changed, "cycles": asked.cycles}
            rows = np.array([run(settings, seed).row() for seed in seeds])
            mean, error = rows.mean(axis=0), rows.std(axis=0) / math.sqrt(max(len(seeds) - 1, 1))
            cells = [f"{m:.2f} +- {e:.2f}" for m, e in zip(mean, error, strict=True)]
            print("  ".join([f"{case:<16}", f"{method:<22}", *(f"{cell:>14}" for cell in cells)]), flush=True)


if __name__ == "__main__":
    main()
