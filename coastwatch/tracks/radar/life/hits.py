"""The life of radar tracks: settings, confirmation by hits in looks, deletion by misses, and removal of duplicates."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch import kernels
from coastwatch.batches import Bools, Floats, Ints, Radars
from coastwatch.kernels.filters.gaussian import gate
from coastwatch.kernels.tracks.columns import RadarColumns
from coastwatch.kernels.tracks.track_life import LifeRules
from coastwatch.stage import Count, NotNegative, Positive, Probability, Settings
from coastwatch.tracks.radar.table import Duplicates, RadarMemory, Status, Table


class PlotSettings(Settings):
    """How plots are taken, and looks counted, however the tracks live."""

    echo_sigma_m: NotNegative = 0.0  # of the echo's place on a vessel, per axis, on top of the noise of the radar
    slice_s: Positive = 1.0  # plots are processed in slices of this length, at most half a turn of the fastest radar
    look_slack: Annotated[float, Field(gt=-0.5, lt=0.5)] = 0.1  # a look is counted as over after 1 + look_slack turns
    late_s: Positive = 5.0  # a plot up to this much older than its track is used
    ahead_s: Positive = 5.0  # a plot stamped more than this after the cycle is dropped


class TrackManagement(PlotSettings):
    """Gates, initiation, deletion by hits and misses. A look is one turn of a radar that covers the track."""

    method: Literal["hits"] = "hits"
    gate_probability: Probability = 0.999  # that a vessel's own plot is inside the gate
    detection_probability: Probability = 0.9  # of a vessel in one look
    false_plots_per_m2: Positive = 1e-6  # clutter and new vessels, in one look
    max_speed_kn: Positive = 50.0  # between the first two plots of a track
    confirm_hits: Annotated[int, Field(ge=2)] = 4
    confirm_looks: Count = 5
    delete_misses: Count = 5  # looks in a row
    misses_per_hit: Positive = 0.5  # a track ends after this many misses for each hit, at most `delete_misses`
    own_looks: bool = (
        True  # each radar counts its own looks: a new track those of radars that saw it, others by what they missed
    )
    coast_s: Positive = 30.0  # longest time without a plot, also outside the range of every radar
    merge_probability: Probability = 0.99  # that two tracks of one vessel pass the test for duplicates
    merge_looks: Count = 3  # turns after which the younger of two such tracks is deleted

    @model_validator(mode="after")
    def _hits_fit_into_looks(self) -> Self:
        if self.confirm_hits > self.confirm_looks:
            raise ValueError(f"confirm_hits: got {self.confirm_hits}, needed at most confirm_looks = {self.confirm_looks}")
        return self

    @property
    def rules(self) -> LifeRules:
        """The settings of confirmation and deletion as the kernel takes them."""
        return LifeRules(
            confirm_hits=self.confirm_hits,
            confirm_looks=self.confirm_looks,
            delete_misses=self.delete_misses,
            misses_per_hit=self.misses_per_hit,
            look_slack=self.look_slack,
            coast=self.coast_s,
            own_looks=self.own_looks,
        )

    def end_slice(self, memory: RadarMemory, radars: RadarColumns, ours: Ints, every: Radars, time_s: float) -> RadarMemory:
        """Confirm tracks with enough hits, and delete those with too many misses.

        Args: radars: of the region, as they are now; ours: (R,) their rows of `every`; time_s: of the newest plot, or now.
        """
        table = memory.table
        find_lost = kernels.tracks.track_life.confirm_and_find_lost
        lost = find_lost(table.life, table.estimates, table.live, radars, ours, self.rules, time_s)
        return replace(memory, table=table.without(lost)) if lost.any() else memory

    def shown(self, table: Table, time_s: float) -> Ints:
        """Slots of the tracks to report: the confirmed ones."""
        slots: Ints = table.live[table.status[table.live] == Status.CONFIRMED]
        return slots

    def existence(self, table: Table, slots: Ints, time_s: float) -> Floats:
        """Not estimated."""
        return np.full(len(slots), np.nan)


def remove_duplicates(management: TrackManagement, memory: RadarMemory, period_s: Floats, time_s: float) -> RadarMemory:
    """Delete the younger of two tracks that have been one vessel for `merge_looks` turns, and note the suspected pairs.

    Two tracks are suspected while their difference may be zero, by their covariances, and no radar gave both a plot in one look: a
    vessel gives a radar one plot a look.
    Args: period_s: (R,) of one turn; time_s: now.
    """
    table, duplicates = memory.table, memory.duplicates
    places = np.flatnonzero(table.status[table.live] != Status.SINGLE)
    slots = table.live[places]
    furthest = gate(management.merge_probability, 4)
    latest_s = float(table.updated_s[slots].max(initial=time_s))  # plots may be stamped a little ahead
    first, second = kernels.tracks.duplicates.possible_duplicates(table.estimates, slots, latest_s, furthest, 0.0)
    alone = ~seen_together(table, slots[first], slots[second], period_s)
    first, second = first[alone], second[alone]
    one, other = table.radar_s[slots[first]], table.radar_s[slots[second]]
    ids = table.track_id[slots[first]], table.track_id[slots[second]]
    before, now = np.rec.fromarrays((duplicates.first, duplicates.second)), np.rec.fromarrays(ids)
    _, old, new = np.intersect1d(before, now, assume_unique=True, return_indices=True)
    since = np.full(len(first), time_s)  # a pair that is suspected for the first time
    since[new] = duplicates.since_s[old]
    turn = np.where(np.isfinite(one) | np.isfinite(other), period_s, 0.0).max(axis=1, initial=0.0)
    same = time_s - since >= management.merge_looks * turn
    lost = np.zeros(len(table), np.bool_)
    status = table.status[slots]
    younger = np.where(status[first] < status[second], first, second)  # or of the lower status
    lost[places[younger[same]]] = True
    kept = ~lost[places[first]] & ~lost[places[second]]
    return replace(memory, table=table.without(lost), duplicates=Duplicates(ids[0][kept], ids[1][kept], since[kept]))


def seen_together(table: Table, first: Ints, second: Ints, period_s: Floats) -> Bools:
    """Which pairs of slots took a plot each of one radar in its newest look: a vessel gives a radar one plot a look. (A,)"""
    one, other = table.radar_s[first], table.radar_s[second]
    served = np.isfinite(one) & np.isfinite(other)
    apart = np.subtract(one, other, where=served, out=np.full(served.shape, np.inf))
    together: Bools = (np.abs(apart) < 0.5 * period_s).any(axis=1)
    return together
