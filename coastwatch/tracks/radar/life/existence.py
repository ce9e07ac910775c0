"""The life of tracks by their probability of existence: settings, confirmation, deletion, and removal of duplicates."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch import kernels
from coastwatch.batches import Bools, Floats, Ints, Radars
from coastwatch.geodesy import KNOT_M_S
from coastwatch.kernels.filters.gaussian import gate
from coastwatch.kernels.tracks.columns import DetectionColumns, RadarColumns
from coastwatch.kernels.tracks.existence import ExistenceChain
from coastwatch.stage import Count, NotNegative, Positive, Probability, Settings
from coastwatch.tracks.radar.life.hits import PlotSettings, seen_together
from coastwatch.tracks.radar.rates import LearntRates, RateSettings
from coastwatch.tracks.radar.table import RadarMemory, Status, Table

SPEED_SIGMAS = 3.0  # by which the speed of a confirmed track may err
KNOWN = 0.5  # probability of an id by which two tracks are told apart


class Detection(Settings):
    """What a radar detects in one look."""

    detection_probability: Probability = 0.9  # of a visible vessel
    false_plots_per_m2: Positive = 1e-6


class ExistenceManagement(PlotSettings):
    """Detection, gates, existence and visibility of tracks. A look is one turn of a radar that covers the track.

    A visible vessel becomes invisible after `visible_s` on average, and visible again after `hidden_s`. Only a visible one gives plots.
    """

    method: Literal["existence"] = "existence"
    detection: Detection = Detection()  # of radars without settings of their own
    by_radar: dict[str, Detection] = Field(default_factory=dict)  # by name of the radar
    rates: RateSettings = RateSettings()  # of each radar, from these on
    new_vessels_per_m2: Positive = 5e-8  # vessels without a track, in one look
    new_visibility: Probability = 0.9  # of such a vessel
    end_per_s: NotNegative = 0.001  # rate at which vessels cease to exist
    visible_s: Positive = 16.0
    hidden_s: Positive = 3.1
    hides: bool = True  # false: every vessel is visible
    gate_probability: Probability = 0.998  # that a vessel's own plot is inside the gate
    exact_up_to: Annotated[int, Field(ge=1, le=16)] = (
        8  # tracks or plots of a cluster that is solved exactly; larger: sum-product
    )
    least_model_probability: Annotated[float, Field(gt=0.0, lt=0.1)] = 1e-3  # so that a model can recover
    begin_existence: Probability = 0.005  # a plot begins a track that exists with this probability or more
    confirm_existence: Probability = 0.99  # a track that exists with this probability is confirmed
    show_existence: NotNegative = 0.5  # a confirmed track is reported while it exists with this probability or more
    delete_existence: Probability = 0.01  # a track that exists with less probability is deleted
    delete_misses: Count = 5  # looks in a row without a plot in the gate; as many more as a radar misses more than stated
    coast_s: Positive = 30.0  # longest time without a plot in the gate, also outside the range of every radar
    max_speed_kn: Positive = 60.0  # a track that is surely faster is deleted
    merge_probability: Probability = 0.5  # that two tracks of one vessel pass the test for duplicates
    merge_correlation: Annotated[float, Field(ge=0.0, lt=0.5)] = 0.4  # of the errors of two such tracks

    @property
    def chain(self) -> ExistenceChain:
        """The rates of change as the kernels take them."""
        if not self.hides:
            return ExistenceChain(self.end_per_s, 0.0, 0.0)
        return ExistenceChain(self.end_per_s, 1.0 / self.visible_s, 1.0 / self.hidden_s)

    @property
    def visible_share(self) -> float:
        """The share of time in which a vessel is visible."""
        return self.visible_s / (self.visible_s + self.hidden_s) if self.hides else 1.0

    def by_number(self, known: LearntRates, radars: Radars) -> tuple[DetectionColumns, Floats]:
        """What each radar detects, and its false plots in a square metre, as learnt. (R,)"""
        each = [self.by_radar.get(name, self.detection) for name in radars.name.tolist()]
        stated = np.array([d.false_plots_per_m2 for d in each])
        detection = known.detection(self.rates, np.array([d.detection_probability for d in each]), self.visible_share)
        return detection, known.false_plots_per_m2(self.rates, radars, stated)

    def new_per_m2(self, detection: Floats) -> Floats:
        """The density of plots of vessels without a track, in one look. Args: detection: P_D."""
        return self.new_vessels_per_m2 * self.new_visibility * detection

    def least_existence(self, detection: Floats, false_per_m2: Floats) -> tuple[Floats, Floats]:
        """The existence with which a plot begins a track, and below which a track is deleted.

        Among many false plots that of any plot is lower than the settings, and then they would let no track begin.
        """
        single = self.new_per_m2(detection) / (false_per_m2 + self.new_per_m2(detection))
        return np.minimum(self.begin_existence, 0.5 * single), np.minimum(self.delete_existence, 0.75 * single)

    def end_slice(
        self,
        memory: RadarMemory,
        radars: RadarColumns,
        ours: Ints,
        every: Radars,
        time_s: float,
        until_s: Floats | None = None,
    ) -> RadarMemory:
        """Count the looks that gave no plot, confirm and delete tracks.

        Args: as of `TrackManagement.end_slice`; until_s: (S,) up to which looks without a plot end no track.
        """
        table = memory.table
        detection, false_per_m2 = self.by_number(memory.rates, every)
        count_missed = kernels.tracks.existence.count_missed_looks
        count_missed(table.existing, table.estimates, table.live, radars, ours, detection, self.look_slack, self.chain)
        live, now = table.live, self.existence(table, table.live, time_s)
        table.status[live[now >= self.confirm_existence]] = Status.CONFIRMED
        least = self.least_existence(detection.probability[ours], false_per_m2[ours])[1].min(initial=self.delete_existence)
        unseen = (table.misses[live] > self.delete_misses - 0.5) | (time_s - table.updated_s[live] > self.coast_s)
        lost = (now < least) | (unseen if until_s is None else unseen & (until_s[live] < time_s))
        lost |= self._is_too_fast(table, live) & (table.status[live] != Status.SINGLE)
        return replace(memory, table=table.without(lost))

    def _is_too_fast(self, table: Table, slots: Ints) -> Bools:
        """Which of these tracks are faster than a ship; a confirmed one by more than its speed may err. (N,)"""
        velocity, covariance = table.combined_mean[slots, 2:], table.combined_covariance[slots, 2:, 2:]
        speed = np.hypot(*velocity.T)
        variance = np.einsum("ni,nij,nj->n", velocity, covariance, velocity) / np.maximum(speed, 1.0) ** 2
        margin = np.where(table.status[slots] == Status.CONFIRMED, SPEED_SIGMAS * np.sqrt(np.maximum(variance, 0.0)), 0.0)
        return np.asarray(speed > self.max_speed_kn * KNOT_M_S + margin)

    def shown(self, table: Table, time_s: float) -> Ints:
        """Slots of the tracks to report: the confirmed ones that probably still exist."""
        there = self.existence(table, table.live, time_s) >= self.show_existence
        slots: Ints = table.live[there & (table.status[table.live] == Status.CONFIRMED)]
        return slots

    def existence(self, table: Table, slots: Ints, time_s: float) -> Floats:
        """The probability of existence of each of these tracks at a time not before its newest look. (N,)"""
        since = np.maximum(time_s - table.existence_s[slots], 0.0)
        now: Floats = table.existence[slots] * np.exp(-self.end_per_s * since)
        return now


def merge_duplicates(management: ExistenceManagement, memory: RadarMemory, period_s: Floats, time_s: float) -> RadarMemory:
    """Delete the younger of two tracks whose difference may be zero.

    Two tracks that took a plot each of one radar in one look are two. So are two whose ids are known and differ.
    Args: period_s: (R,) of one turn; time_s: now.
    """
    table = memory.table
    slots, limit = table.live, gate(management.merge_probability, 4)
    latest_s = float(table.updated_s[slots].max(initial=time_s))  # plots may be stamped a little ahead
    possible, correlation = kernels.tracks.duplicates.possible_duplicates, management.merge_correlation
    first, second = possible(table.estimates, slots, latest_s, limit, correlation)
    alone = ~seen_together(table, slots[first], slots[second], period_s)
    one, other = (table.probable_ids(slots[rows], KNOWN) for rows in (first, second))
    alone &= (one < 0) | (other < 0) | (one == other)
    lost = np.zeros(len(table), np.bool_)
    lost[second[alone]] = True
    return replace(memory, table=table.without(lost))
