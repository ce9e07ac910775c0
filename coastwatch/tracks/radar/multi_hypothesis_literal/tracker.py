"""Track-oriented multiple hypothesis tracking with AIS as a thesis has it: one tree a vessel, N-scan pruning, termination by score.

Source: E. Liland, AIS aided multi hypothesis tracker, master thesis, NTNU, 2017, chapter 4. Where text and program differ, the program.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from coastwatch import kernels
from coastwatch.batches import Bools, Floats, Ints, Messages, Plots, Sensors, StandingEchoes, Tracks, Unproven
from coastwatch.kernels.filters.gaussian import Estimates
from coastwatch.kernels.tracks.columns import RadarColumns
from coastwatch.kernels.tracks.thesis_growth import (
    Children,
    GrowthRules,
    LeafStates,
    Look,
    LookReports,
    plot_score,
    process_noise,
    report_score,
)
from coastwatch.stage import Count, CountOrZero, NotNegative, Positive, Probability
from coastwatch.tracks.radar.multi_hypothesis_literal.forest import Decided, ForestMemory, Leaves
from coastwatch.tracks.radar.multi_hypothesis_literal.initiation import InitiationSettings, begin, transition
from coastwatch.tracks.radar.region import RadarMethod, RegionInput, RegionOutput, is_usable
from coastwatch.tracks.radar.report import Reported, radars_of, report, report_measurements

AHEAD_S = 5.0  # a plot stamped more than this after the cycle is dropped
ROUNDS = 100  # of prices, in the solver
NODES = 200_000  # of the solver: so many that the choice is nearly always proven, as of the solver of the thesis
SENDERS_A_TREE = 0.5  # of the density of foreign reports

Scalar = TypeVar("Scalar", bound=np.generic)


class _Taken(NamedTuple):
    """One look as it is taken."""

    time_s: float
    position_m: Floats  # (M, 2) sorted by east
    origin: Ints  # (M,)
    row: Ints  # (M,) of the plots of the cycle


class MultiHypothesisLiteral(RadarMethod, InitiationSettings):
    """Track-oriented multiple hypothesis tracking of plots and AIS reports, as in a thesis. Of a paper, for comparison.

    All plots of a radar in a cycle are one look at one time, so a cycle should be one turn of the radar.
    """

    method: Literal["multi_hypothesis_literal"] = "multi_hypothesis_literal"
    window: Annotated[int, Field(ge=1, le=30)] = 3  # N: number of looks that stay open
    detection_probability: Probability = 0.9  # of a vessel, in one look
    clutter_per_m2: NotNegative = 1e-5  # false plots in one look
    new_per_m2: Positive = 2e-8  # new vessels in one look
    plot_sigma_m: Positive = 2.5  # of a plot, per axis
    process_noise: Positive = 1.0  # factor of the matrix of the program
    gate: Positive = 5.99  # squared distance of a plot from a track
    report_gate: Positive = 9.49  # squared distance of a report from a track, position and velocity
    ais_score: Literal["ratio", "zero"] = "ratio"  # (4.19), or none: reports are pure aiding
    known_mmsi: Literal["gated", "every_report"] = "gated"  # of its MMSI a leaf takes reports in its gate, or all
    ais_gate: Literal["own_time", "look_time"] = "own_time"  # reports are gated at their own time, or moved to that of the look
    similar: bool = False  # a miss goes if a sibling is near it, in a tree that shares no measurement with another
    similar_distance: Positive = 4.0  # of the states of a track with and without the miss, metres and m/s mixed
    most_leaves: CountOrZero = 0  # a tree with more than this number of leaves loses a look of its window; 0: no limit
    end_share: Positive = 0.8  # a track ends where its score a look is more than this share of that of a miss
    end_score: Positive = 3.0  # or where its score since its start is more than this number
    looks_apart: Count = 1  # a cycle without plots is a look after so many turns

    @property
    def takes_messages(self) -> bool:
        return True

    def init(self) -> ForestMemory:
        return ForestMemory.empty(W=self.window + 1)

    def begun(self, state: Floats, time_s: float) -> ForestMemory:
        """The memory of tracks that are known at a time. Args: state: (B, 4) east, north, and their rates in the region's plane."""
        covariance = np.tile(np.diag(self.start_variance), (len(state), 1, 1))
        memory = self.init().with_trees(state, covariance, time_s, self.window)
        memory.look_s[-1] = time_s
        return memory

    def step(self, memory: ForestMemory, given: RegionInput) -> tuple[ForestMemory, RegionOutput]:
        """The tracks of one region at the end of a cycle.

        Raises: ValueError where the memory is of another window.
        """
        plots, _, jumped, time_s, sensors, region, _ = given
        if len(memory.look_s) != self.window + 1:
            raise ValueError(f"memory of hypotheses: got a window of {len(memory.look_s) - 1}, needed {self.window}")
        if jumped.any():
            memory = replace(self.init(), next_number=memory.next_number)
        good = is_usable(plots, time_s, AHEAD_S)
        plots = plots.take(good)
        radars = radars_of(sensors, region)
        waiting = Messages.join([memory.waiting, given.messages])
        memory = replace(memory, waiting=waiting, decided=Decided.empty(), unproven=Unproven())
        number = np.full(len(plots), -1)
        for look in self._looks(memory, plots, time_s, radars):
            memory, taken = self._take(memory, look, radars)
            number[look.row] = taken
        tracks = self._report(memory, radars, time_s, sensors, region)
        measurements = report_measurements(tracks, number, plots, sensors, region)
        dropped = int((~good).sum())
        return memory, RegionOutput(tracks, measurements, StandingEchoes.empty(), dropped, unproven=memory.unproven)

    def _looks(self, memory: ForestMemory, plots: Plots, time_s: float, radars: RadarColumns) -> list[_Taken]:
        """The looks of a cycle by time: the plots of each radar, or a look without plots if none has come for a turn."""
        out = []
        for radar in np.unique(plots.sensor).tolist():
            rows = np.flatnonzero(plots.sensor == radar)
            rows = rows[np.lexsort((plots.time_s[rows], plots.position_m[rows, 1], plots.position_m[rows, 0]))]
            newest_s = float(plots.time_s[rows].max())
            out.append(_Taken(newest_s, np.ascontiguousarray(plots.position_m[rows]), plots.origin[rows], rows))
        last_s, turn_s = float(memory.look_s[-1]), float(radars.period.max(initial=0.0))
        if not out and time_s - last_s >= self.looks_apart * turn_s and np.isfinite(last_s):
            none = np.zeros(0, np.int64)
            out.append(_Taken(time_s, np.zeros((0, 2)), none, none))
        return sorted(out, key=lambda look: look.time_s)

    def _take(self, memory: ForestMemory, look: _Taken, radars: RadarColumns) -> tuple[ForestMemory, Ints]:
        """The memory after a look, and the number of the track that took each plot, -1: none. (M,)"""
        last_s = float(memory.look_s[-1])
        elapsed_s = max(look.time_s - last_s, 0.0) if np.isfinite(last_s) else 0.0
        memory, reports = self._reports(memory, look.time_s, elapsed_s)
        leaves, children = self._grown(memory, look, reports, elapsed_s, radars)
        memory = replace(memory, look_s=np.append(memory.look_s[1:], max(look.time_s, last_s)))
        leaves, choice = self._chosen(memory, leaves, children)
        best, unproven = choice.leaf, Unproven.of(choice.excess)
        used, heard = np.zeros(len(look.row), np.bool_), np.zeros(len(reports.age), np.bool_)
        newest, message = leaves.plot[:, -1], leaves.message[:, -1]
        used[newest[newest >= 0] - memory.next_plot] = True
        heard[message[message >= 0] - memory.next_message] = True
        taken, number = np.full(len(look.row), -1), newest[best]
        taken[number[number >= 0] - memory.next_plot] = memory.trees.number[number >= 0]
        memory = replace(memory, leaves=leaves, best=best, unproven=memory.unproven + unproven)
        memory = self._pruned(memory, radars)
        begun = begin(
            self,
            memory.preliminary,
            memory.single_m,
            (look.position_m[~used], self.plot_sigma_m**2),
            LookReports._make(column[~heard] for column in reports),
            (elapsed_s, self.process_noise),
        )
        memory = replace(
            memory,
            preliminary=begun.preliminary,
            single_m=begun.single_m,
            next_plot=memory.next_plot + len(look.row),
            next_message=memory.next_message + len(reports.age),
        )
        return self._with_new(memory, begun.state, begun.covariance, look.time_s), taken

    def _reports(self, memory: ForestMemory, time_s: float, elapsed_s: float) -> tuple[ForestMemory, LookReports]:
        """The newest report of each MMSI since the look before; those after this look wait."""
        heard, after = memory.waiting, memory.waiting.time_s > time_s
        old = after | (time_s - heard.time_s > elapsed_s) | ~np.isfinite(heard.velocity_m_s).all(axis=1)
        now = heard.take(~old)
        now = now.take(np.lexsort((now.position_m[:, 1], now.position_m[:, 0], now.time_s, now.mmsi)))
        now = now.take(np.append(now.mmsi[1:] != now.mmsi[:-1], True)[: len(now)])
        state = np.hstack([now.position_m, now.velocity_m_s])
        reports = LookReports(state, now.covariance[:, 0, 0].copy(), time_s - now.time_s, now.mmsi)
        return replace(memory, waiting=heard.take(after)), reports

    def _grown(
        self, memory: ForestMemory, look: _Taken, reports: LookReports, elapsed_s: float, radars: RadarColumns
    ) -> tuple[Leaves, Children]:
        """The children of all leaves."""
        leaves, area_m2 = memory.leaves, np.pi * float(radars.range.max(initial=1.0)) ** 2
        miss = -float(np.log(1.0 - self.detection_probability))
        rules = GrowthRules(
            noise=self.process_noise,
            gate=self.gate,
            report_gate=self.report_gate,
            miss=miss,
            plot=plot_score(self.clutter_per_m2 + self.new_per_m2, self.detection_probability),
            report=report_score(max(len(memory.trees), 1) * SENDERS_A_TREE / area_m2),
            scored=self.ais_score == "ratio",
            at_look=self.ais_gate == "look_time",
            gates_known=self.known_mmsi == "gated",
        )
        made: Children = kernels.tracks.thesis_growth.grow(
            LeafStates(np.ascontiguousarray(leaves.state), leaves.covariance, leaves.mmsi),
            Look(look.position_m, self.plot_sigma_m**2, elapsed_s),
            reports,
            rules,
        )
        parent, has_plot, has_report = made.parent, made.plot >= 0, made.report >= 0
        origin, mmsi = np.append(look.origin, -1)[made.plot], np.append(reports.mmsi, -1)[made.report]
        sent_s = look.time_s - np.append(reports.age, np.inf)[made.report]
        grown = Leaves(
            tree=leaves.tree[parent],
            mmsi=np.where(has_report, mmsi, leaves.mmsi[parent]),
            plot=_shifted(leaves.plot[parent], np.where(has_plot, memory.next_plot + made.plot, -1)),
            message=_shifted(leaves.message[parent], np.where(has_report, memory.next_message + made.report, -1)),
            origin=_shifted(leaves.origin[parent], origin),
            score=_shifted(leaves.score[parent], made.score),
            path=_shifted(leaves.path[parent], made.state),
            path_covariance=_shifted(leaves.path_covariance[parent], made.covariance),
            life_score=leaves.life_score[parent] + made.score,
            updated_s=np.where(has_plot, look.time_s, np.maximum(leaves.updated_s[parent], sent_s)),
        )
        return grown, made

    def _chosen(
        self, memory: ForestMemory, leaves: Leaves, made: Children
    ) -> tuple[Leaves, kernels.association.global_hypothesis.Choice]:
        """The leaves, less those that are similar if these go, and the choice of one of each tree, (4.21) to (4.23)."""
        choice, trees = _choice(leaves, len(memory.trees)), len(memory.trees)
        if self.similar and trees:
            alone = np.bincount(choice.cluster)[choice.cluster] == 1
            like = kernels.tracks.thesis_growth.like_their_miss(
                made.parent, made.plot, made.report, made.state, self.similar_distance
            )
            gone = like & alone[leaves.tree]
            if gone.any():
                leaves = leaves.take(~gone)
                choice = _choice(leaves, trees)
        return leaves, choice

    def _pruned(self, memory: ForestMemory, radars: RadarColumns) -> ForestMemory:
        """The memory without the tracks that end, and without the leaves that differ from the chosen ones before the window."""
        leaves, trees, best, w = memory.leaves, memory.trees, memory.best, len(memory.look_s)
        trees = replace(trees, age=trees.age + 1, window=self._windows(memory))
        memory = replace(memory, trees=trees)
        old = np.flatnonzero(trees.age >= w)
        first_s, leaf = np.full(len(old), memory.look_s[0]), best[old]
        oldest = Decided(trees.number[old], first_s, leaves.path[leaf, 0], leaves.path_covariance[leaf, 0])
        decided = [memory.decided, oldest]
        ends = self._ends(memory, radars)
        decided.append(memory.open_path(ends))
        mine, column = best[leaves.tree], np.arange(w - 1)
        differs = (leaves.plot[:, :-1] != leaves.plot[mine, :-1]) | (leaves.message[:, :-1] != leaves.message[mine, :-1])
        closed = column[None] <= (w - 1 - trees.window[leaves.tree])[:, None]
        kept = ~(differs & closed).any(axis=1) & ~ends[leaves.tree]
        row, tree = np.cumsum(kept) - 1, np.cumsum(~ends) - 1
        leaves = leaves.take(kept)
        return replace(
            memory,
            leaves=replace(leaves, tree=tree[leaves.tree]),
            trees=trees.take(~ends),
            best=row[best[~ends]],
            decided=Decided.join(decided),
        )

    def _windows(self, memory: ForestMemory) -> Ints:
        """The window of each tree, one look less where it has too many leaves, else one more up to the full one, section 4.8.1."""
        window = memory.trees.window
        if not self.most_leaves:
            return window
        large = np.bincount(memory.leaves.tree, minlength=len(window)) > self.most_leaves
        return np.where(large, np.maximum(window - 1, 1), np.minimum(window + 1, self.window))

    def _ends(self, memory: ForestMemory, radars: RadarColumns) -> Bools:
        """Which tracks end: outside the range of every radar, or by their scores, section 4.9."""
        leaves, best = memory.leaves, memory.best
        position_m, miss = leaves.state[best, :2], -np.log(1.0 - self.detection_probability)
        apart = np.hypot(*(position_m[:, None] - radars.site[None]).transpose(2, 0, 1))
        outside = (apart > radars.range).all(axis=1)
        bad = leaves.score[best].sum(axis=1) / len(memory.look_s) > self.end_share * miss
        ends: Bools = outside | bad | (leaves.life_score[best] > self.end_score)
        return ends

    def _with_new(self, memory: ForestMemory, state: Floats, covariance: Floats, time_s: float) -> ForestMemory:
        """The memory with these new tracks that are near no leaf, nor another new one before them."""
        new: list[int] = []
        for k in range(len(state)):
            others = np.concatenate([memory.leaves.state[:, :2], state[new, :2]])
            if np.hypot(*(others - state[k, :2]).T).min(initial=np.inf) >= self.nearest_new_m:
                new.append(k)
        return memory.with_trees(state[new], covariance[new], time_s, self.window) if new else memory

    def _report(self, memory: ForestMemory, radars: RadarColumns, time_s: float, sensors: Sensors, region: int) -> Tracks:
        """The chosen leaves, predicted to the end of the cycle."""
        leaves, trees = memory.leaves.take(memory.best), memory.trees
        elapsed_s = max(time_s - float(memory.look_s[-1]), 0.0) if len(trees) else 0.0
        move = transition(elapsed_s)
        now = Estimates(
            np.full(len(trees), time_s),
            leaves.state @ move.T,
            move @ leaves.covariance @ move.T + process_noise(elapsed_s, self.process_noise),
            np.full(len(trees), self.process_noise),
        )
        alike = ((leaves.origin[:, :, None] == leaves.origin[:, None]) & (leaves.origin >= 0)[:, :, None]).sum(axis=2)
        origin = leaves.origin[np.arange(len(trees)), alike.argmax(axis=1)]
        said = Reported(trees.number, leaves.updated_s, trees.started_s, origin, leaves.mmsi)
        return report(now, said, radars, time_s, sensors, region)


def _shifted(before: NDArray[Scalar], new: NDArray[Scalar]) -> NDArray[Scalar]:
    """Columns of the window with those of a new look behind. Args: before: (L, W, ...); new: (L, ...)."""
    return np.concatenate([before[:, 1:], new[:, None]], axis=1)


def _choice(leaves: Leaves, trees: int) -> kernels.association.global_hypothesis.Choice:
    """The global hypothesis: a leaf of each tree, no plot and no report twice."""
    used = [column - column[column >= 0].min(initial=2**62) for column in (leaves.plot, leaves.message)]
    plots = int(used[0].max(initial=-1)) + 1
    return kernels.association.global_hypothesis.choose(
        np.searchsorted(leaves.tree, np.arange(trees + 1)),
        leaves.score.sum(axis=1),
        np.hstack([np.maximum(used[0], -1), np.where(used[1] >= 0, plots + used[1], -1)]),
        plots + int(used[1].max(initial=-1)) + 1,
        np.full(trees, np.inf),
        ROUNDS,
        NODES,
    )
