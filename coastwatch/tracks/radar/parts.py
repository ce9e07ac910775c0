"""What the parts of a tracker share while they process a cycle of a region: filters, upkeep, clutter and sensors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Floats, Ints, Sensors
from coastwatch.kernels.arrays import Records
from coastwatch.kernels.filters.gaussian import Estimates, gate
from coastwatch.kernels.tracks.columns import Candidates, DetectionColumns, PlotColumns, RadarColumns
from coastwatch.kernels.tracks.existence import EXISTS
from coastwatch.kernels.tracks.joint_update import Hypotheses
from coastwatch.tracks.radar.clutter import ClutterSettings
from coastwatch.tracks.radar.life import ExistenceManagement, TrackManagement
from coastwatch.tracks.radar.local_bursts import local_burst_per_m2
from coastwatch.tracks.radar.motion import Filters, Prior
from coastwatch.tracks.radar.report import radars_of
from coastwatch.tracks.radar.table import RadarMemory, Status, Table

LOCAL_TURNS = 20.0  # of a radar before it has local bursts: by then vessels have tracks, and standing echoes a clutter map
LIKELY = 0.5  # a plot is reported as taken by the track that it belongs to with more than this probability


class FilterBank(Protocol):
    """Filters of many tracks, one a track. Its functions write into the table that they are given."""

    @property
    def prior(self) -> Prior:
        """The models of motion and their prior."""
        ...

    @property
    def models(self) -> Records:
        """The models of each filter. (J,) MODEL"""
        ...

    @property
    def particles(self) -> int:
        """Particles of each filter; 0: it has none."""
        ...

    def begin(self, table: Table, slots: Ints, plots: Ints, batch: PlotColumns) -> None:
        """Begin the filters in these slots: they know one plot and no velocity. Args: plots: (N,) rows of the batch."""
        ...

    def predict(self, filters: Filters, estimates: Estimates, rows: Ints, time_s: float) -> Estimates:
        """The combined estimates of these slots (N), predicted to a time by all models; one that is newer is not taken back."""
        ...


@runtime_checkable
class SingleUpdates(Protocol):
    """What a bank needs where a track takes one plot."""

    def update(self, filters: Filters, estimates: Estimates, rows: Ints, plots: Ints, columns: PlotColumns) -> None:
        """Predict each filter to the time of its plot and update it. A slot may come again: its plots are taken in this order.

        A plot older than its filter is moved to the filter's time by the velocity; its covariance grows accordingly.
        """
        ...


@runtime_checkable
class JointUpdates(Protocol):
    """What a bank needs where a track weighs all plots in its gate."""

    def predict_to_plots(self, table: Table, pairs: Candidates, batch: PlotColumns, added: Floats | None = None) -> Hypotheses:
        """Predict each track to the newest of its plots, in place. Returns: the pairs by track, with their likelihoods by model.

        Args: added: (S,) share of the covariance of a plot that is added to it, for each slot; none: nothing is.
        """
        ...

    def likelihood(self, table: Table, pairs: Hypotheses) -> Floats:
        """The likelihood of each plot, given its track. (A,)"""
        ...

    def update_by_shares(self, table: Table, pairs: Hypotheses, share: Floats, batch: PlotColumns, least: float) -> None:
        """Update each track by all of its plots, in place.

        Args: share: (A,) probability of each, given that the track exists; least: probability of a model afterwards.
        """
        ...


@dataclass(frozen=True)
class Parts:
    """Filters and settings of the tracker of a region, and its radars. The tracker has checked that they fit together."""

    bank: FilterBank
    upkeep: TrackManagement | ExistenceManagement
    clutter: ClutterSettings
    sensors: Sensors
    region: int  # its number
    registration: float = 0.0  # share of a plot's covariance that is added for a track that AIS messages guide

    @property
    def ours(self) -> Ints:
        """The radars of the region, as rows of all. (R,)"""
        return np.flatnonzero(self.sensors.radars.region == self.region)

    def radars(self, memory: RadarMemory) -> RadarColumns:
        """The radars of the region, as they are now."""
        return radars_of(self.sensors, self.region, memory.site_m, memory.newest_plot_s)

    @property
    def single(self) -> SingleUpdates:
        """The filters, where a track takes one plot."""
        assert isinstance(self.bank, SingleUpdates)
        return self.bank

    @property
    def joint(self) -> JointUpdates:
        """The filters, where a track weighs all plots in its gate."""
        assert isinstance(self.bank, JointUpdates)
        return self.bank

    @property
    def hits(self) -> TrackManagement:
        """The upkeep of tracks that live by hits."""
        assert isinstance(self.upkeep, TrackManagement)
        return self.upkeep

    @property
    def existence(self) -> ExistenceManagement:
        """The upkeep of tracks that live by their probability of existence."""
        assert isinstance(self.upkeep, ExistenceManagement)
        return self.upkeep


class ExpectedPlots(NamedTuple):
    """What a look of a radar gives at a batch of M plots, by what is learnt of the radars so far."""

    radars: DetectionColumns  # what each radar detects (R,)
    false_of_radar_per_m2: Floats  # (R,)
    detection: float  # probability of a plot of a visible vessel, of this radar
    false_per_m2: Floats  # (M,) density of false plots at each plot
    unborn_per_m2: float  # density of plots of vessels without a track

    @property
    def untracked_per_m2(self) -> Floats:
        """The density of plots of no track at each plot. (M,)"""
        return self.false_per_m2 + self.unborn_per_m2


def begin_look(parts: Parts, memory: RadarMemory, batch: PlotColumns) -> ExpectedPlots:
    """What this look of a radar gives. What is learnt of the radar fades to its time, in place."""
    _learn_turn(parts, memory, batch)
    rules, radar = parts.existence, int(batch.sensor[0])
    detects, every = rules.by_number(memory.rates, parts.sensors.radars)
    detection, density = float(detects.probability[radar]), float(every[radar])
    false_per_m2 = _false_plots_at(parts, memory, batch, density)
    return ExpectedPlots(detects, every, detection, false_per_m2, float(rules.new_per_m2(detects.probability)[radar]))


def _learn_turn(parts: Parts, memory: RadarMemory, batch: PlotColumns) -> None:
    """Let what is learnt of a radar fade to this batch of its plots, and notice a burst of clutter, in place."""
    rules, radars, radar = parts.existence, parts.sensors.radars, int(batch.sensor[0])
    if not rules.rates.learnt:
        return
    passed = memory.rates.turn(rules.rates, radar, float(batch.time.max()), float(radars.period_s[radar]))
    area_m2 = np.pi * float(radars.range_m[radar]) ** 2
    stated = rules.by_radar.get(str(radars.name[radar]), rules.detection).false_plots_per_m2 * area_m2
    free = len(batch.time) - int(np.count_nonzero(memory.table.existence[memory.table.live] >= EXISTS))
    memory.rates.notice_burst(rules.rates, radar, stated, area_m2, free, passed)


def _false_plots_at(parts: Parts, memory: RadarMemory, batch: PlotColumns, density: float) -> Floats:
    """The density of false plots in one look at each plot of a batch of one radar, also in a local burst. (M,)

    A plot counts the less for a local burst the denser the clutter map is there: standing echoes are none. Args: density: of this radar.
    """
    rates, radar, table = parts.existence.rates, int(batch.sensor[0]), memory.table
    false = memory.false_plots_per_m2(parts.clutter, batch, density)
    if not rates.learnt or memory.rates.turns[radar] < LOCAL_TURNS:
        return false
    existing = table.live[table.existence[table.live] >= EXISTS]
    range_m = float(parts.sensors.radars.range_m[radar])
    unexplained = np.minimum(density / false, 1.0)
    site_m = memory.site_m[radar]
    plots_m, tracks_m = batch.position - site_m, table.combined_mean[existing, :2] - site_m
    burst = local_burst_per_m2(plots_m, unexplained, tracks_m, range_m, density)
    return np.maximum(false, burst)


def begin_tracks(bank: FilterBank, memory: RadarMemory, plots: Ints, batch: PlotColumns) -> RadarMemory:
    """This memory with a new track for each of these rows of a batch of plots or messages."""
    table, slots = memory.table.with_slots(memory.next_id + np.arange(len(plots)))
    bank.begin(table, slots, plots, batch)
    table.status[slots] = Status.SINGLE
    table.hits[slots] = 1
    table.started_s[slots] = batch.time[plots]
    table.radar_s[slots] = -np.inf
    by_radar = batch.sensor[plots] >= 0
    table.radar_s[slots[by_radar], batch.sensor[plots[by_radar]]] = batch.time[plots[by_radar]]
    table.message_s[slots] = np.where(by_radar, -np.inf, batch.time[plots])
    table.ids[slots], table.id_probability[slots] = -1, 0.0
    table.began_m[slots] = batch.position[plots]
    table.began_m2[slots] = np.trace(batch.covariance[plots], axis1=1, axis2=2)
    table.moved[slots] = False
    table.existence[slots] = table.visibility[slots] = 1.0
    table.existence_s[slots] = batch.time[plots]
    table.looked_s[slots] = batch.time[plots][:, None]
    table.misses[slots] = 0
    table.extent_plots[slots] = 0
    table.origins[slots] = -1
    table.origins[slots, 0] = batch.origin[plots]
    alone = memory.plots_alone
    if alone.models:
        alone = alone.with_room("S", len(table.track_id))
        alone.updated_s[slots], alone.left_mmsi[slots], alone.left_s[slots] = -np.inf, -1, -np.inf
        alone.doubted_s[slots], alone.plots_s[slots] = np.nan, -np.inf
    return replace(memory, table=table, next_id=memory.next_id + len(plots), plots_alone=alone)


def candidates_by_largest_noise(
    parts: Parts, estimates: Estimates, rows: Ints, batch: PlotColumns, widened: float = 1.0
) -> Candidates:
    """The plots or messages in the gates of these rows of estimates, each gate as wide as by the liveliest model.

    The average of the models would lose vessels that manoeuvre while they are missed. Args: widened: factor of the squared distance.
    """
    lively = estimates._replace(noise=np.full(len(estimates.noise), parts.bank.models["noise"].max()))
    limit = widened * gate(parts.upkeep.gate_probability, 2)
    pairs: Candidates = kernels.tracks.gate.candidates(lively, rows, batch, limit, parts.upkeep.late_s)
    return pairs


def gated_by_plots(parts: Parts, table: Table, batch: PlotColumns) -> tuple[Candidates, Floats]:
    """The plots in the gates of the tracks, and the share of a plot's covariance that is added for each slot. (S,)

    AIS knows where a vessel is, and a radar whose registration is not known yet sees it elsewhere by as much as its noise. Its plots
    would begin a second track of the vessel.
    """
    added = np.where(np.isfinite(table.message_s), parts.registration, 0.0)
    guided = added[table.live] > 0.0
    if not guided.any():
        return candidates_by_largest_noise(parts, table.estimates, table.live, batch), added
    wider = batch._replace(covariance=(1.0 + parts.registration) * batch.covariance)
    near = candidates_by_largest_noise(parts, table.estimates, table.live[~guided], batch)
    near_guided = candidates_by_largest_noise(parts, table.estimates, table.live[guided], wider)
    return Candidates(*(np.concatenate(columns) for columns in zip(near, near_guided, strict=True))), added
