"""The region of a radar tracker: its input and output, and one cycle, in which batch after batch of plots updates the tracks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from coastwatch import kernels
from coastwatch.batches import (
    Bools,
    DecidedPath,
    Floats,
    Ints,
    Measurements,
    Messages,
    Plots,
    RadarExcess,
    Sensors,
    StandingEchoes,
    Tracks,
    Unproven,
)
from coastwatch.kernels.filters.gaussian import Estimates
from coastwatch.kernels.tracks.columns import PlotColumns
from coastwatch.stage import Method
from coastwatch.tracks.radar import plots_alone
from coastwatch.tracks.radar.association import AnyAssociation
from coastwatch.tracks.radar.clutter import standing_echoes
from coastwatch.tracks.radar.extent import (
    LEAST_PLOTS,
    LONGEST_M,
    MOST_WEIGHT,
    Hulls,
    as_one_ship,
    averaged,
    axes,
    ends_of_one,
    joined,
)
from coastwatch.tracks.radar.life.existence import KNOWN
from coastwatch.tracks.radar.messages import (
    WithMessages,
    begin_unnamed,
    in_order,
    trusted,
)
from coastwatch.tracks.radar.parts import Parts
from coastwatch.tracks.radar.report import Reported, report, report_decided, report_measurements
from coastwatch.tracks.radar.table import RadarMemory

NOTHING_DECIDED = DecidedPath.empty()
DAY_S = 86400.0  # older plots are from a clock that is not set
HELD = 0.98  # an id of this probability is reported as that of the vessel; the first message gives `correct_id`, 0.99


class RegionInput(NamedTuple):
    """What a radar tracker is given in a cycle. It uses a field or leaves it."""

    plots: Plots  # of this region, that arrived in this cycle, in any order
    messages: Messages  # AIS, of this cycle, in the plane of the region
    jumped: Bools  # (R,) radars whose corrections have jumped: their earlier plots lie elsewhere now
    time_s: float  # end of the cycle
    sensors: Sensors  # with the radars of the region
    region: int  # its number
    video: tuple[RadarExcess, ...] = ()  # of its radars, for trackers with `takes_video`

    @classmethod
    def of_plots(cls, plots: Plots, time_s: float, sensors: Sensors, region: int = 0) -> RegionInput:
        """Plots alone."""
        return cls(plots, Messages.empty(), np.zeros(len(sensors.radars), np.bool_), time_s, sensors, region)


class RegionOutput(NamedTuple):
    """What a radar tracker yields in a cycle."""

    tracks: Tracks  # the confirmed ones, predicted to the end of the cycle, sorted by track_id, which is never reused
    measurements: Measurements  # the plots of this cycle in them
    standing_echoes: StandingEchoes  # none where no clutter map is learnt
    dropped: int  # plots that are not finite, or from the future
    decided: DecidedPath = NOTHING_DECIDED  # the past that became final in this cycle; none for trackers that decide at once
    unproven: Unproven = Unproven()  # choices of several looks, of trackers that make such


class RadarMethod(Method):
    """A tracker that takes plots alone. A subclass adds `method`, `init` and `step(memory, RegionInput)`, and replaces what differs."""

    @property
    def takes_video(self) -> bool:
        """Whether it takes video as well as plots."""
        return False

    @property
    def takes_messages(self) -> bool:
        """Whether it takes AIS messages as well as plots."""
        return False

    @property
    def holds_messages(self) -> bool:
        """Whether AIS messages are in the tracks that it reports."""
        return self.takes_messages


@dataclass(frozen=True)
class PlotBatch:
    """Consecutive plots of a cycle. A batch of one radar that is shorter than half a turn gives a track one plot at most."""

    first: int  # row of the cycle's plots
    columns: PlotColumns
    ends_slice: bool  # it is the last batch of its slice of time


def cut(plots: Plots, slice_s: float, by_radar: bool) -> tuple[Plots, list[PlotBatch]]:
    """The plots in the order of their batches, and the batches. A batch is of one slice of time, sorted by time.

    Plots of one time are sorted by position, so that the order in which they came is of no matter.
    Args: by_radar: a batch for each radar in the slice.
    """
    order = np.argsort(plots.time_s, kind="stable")
    if (np.diff(plots.time_s[order]) == 0.0).any():
        order = np.lexsort((plots.position_m[:, 1], plots.position_m[:, 0], plots.time_s))
    slice_ = np.floor(plots.time_s[order] / slice_s)
    number: Ints = np.cumsum(np.diff(slice_, prepend=slice_[:1]) > 0.0)
    key = number
    if by_radar:
        key = number * (int(plots.sensor.max(initial=0)) + 1) + plots.sensor[order]
        by_key = np.argsort(key, kind="stable")
        key, number, order = key[by_key], number[by_key], order[by_key]
    p, begin = plots.take(order), np.flatnonzero(np.diff(key, prepend=-1))
    end, ends_slice = np.append(begin[1:], len(p))[: len(begin)], np.diff(number[begin], append=-1) != 0
    batches = []
    for first, last, ends in zip(begin.tolist(), end.tolist(), ends_slice.tolist(), strict=True):
        at = slice(first, last)
        columns = PlotColumns(p.time_s[at], p.position_m[at], p.covariance[at], p.sensor[at], p.origin[at])
        batches.append(PlotBatch(first, columns, ends))
    return p, batches


def is_usable(plots: Plots, time_s: float, ahead_s: float) -> Bools:
    """Which plots can be believed: finite, not from after the cycle, and not older than a day. (M,)"""
    numbers = np.column_stack([plots.time_s, plots.position_m, plots.covariance.reshape(-1, 4)])
    lived = (plots.time_s <= time_s + ahead_s) & (plots.time_s > time_s - DAY_S)
    good: Bools = np.logical_and(np.isfinite(numbers).all(axis=1), lived)
    return good


@dataclass
class _MessagesInTurn:
    """The messages of a cycle, taken as the time of the plots goes on."""

    association: AnyAssociation
    rules: WithMessages
    messages: Messages  # sorted by time
    done: int = 0

    def take(self, parts: Parts, memory: RadarMemory, until_s: float) -> RadarMemory:
        """The memory after the messages up to a time that were not taken before."""
        end = int(np.searchsorted(self.messages.time_s, until_s, side="right"))
        if end <= self.done:
            return memory
        part = self.messages.take(np.arange(self.done, end))
        self.done = end
        return self.association.take_messages(parts, self.rules, memory, part, until_s)


def update_region(
    association: AnyAssociation,
    rules: WithMessages | None,
    parts: Parts,
    memory: RadarMemory,
    given: RegionInput,
    tested: bool = False,
) -> tuple[RadarMemory, RegionOutput]:
    """The memory and the tracks after the plots and messages of a cycle. It consumes the memory.

    Args: rules: of messages, none: it takes none; tested: tracks leave messages that contradict their plots.
    """
    heard, time_s, sensors, region, models = given.messages, given.time_s, given.sensors, given.region, len(parts.bank.models)
    memory = memory.without_radars(given.jumped).fitting(models, len(sensors.radars))
    if rules and tested:
        memory = memory.with_plots_alone(models)
        heard = trusted(rules, memory, heard, time_s)
    queue = _MessagesInTurn(association, rules, in_order(rules, parts, heard, memory)) if rules else None
    memory = memory.with_clutter_map(parts.clutter, sensors.radars)
    usable = is_usable(given.plots, time_s, parts.upkeep.ahead_s)
    plots = _as_measured(parts, memory, given.plots if usable.all() else given.plots.take(usable), time_s)
    slice_s = min(parts.upkeep.slice_s, 0.5 * float(sensors.radars.period_s[parts.ours].min(initial=np.inf)))
    plots, batches = cut(plots, slice_s, association.by_radar)
    taken = np.full(len(plots), -1)
    for batch in batches:
        columns, rows = batch.columns, slice(batch.first, batch.first + len(batch.columns.time))
        _note_sites(memory, columns, plots.site_m[rows])
        if queue:
            memory = queue.take(parts, memory, float(columns.time[0]))
        before = len(memory.table)
        memory, slot = association.track_batch(parts, memory, columns)
        if rules:
            begin_unnamed(rules, memory.table, memory.table.live[before:])
        got = np.flatnonzero(slot >= 0)
        taken[rows][got] = memory.table.track_id[slot[got]]
        averaged(memory.table.extent, memory.table.extent_plots, slot[got], plots.extent[rows][got])
        if batch.ends_slice:
            memory = association.end_slice(parts, memory, float(columns.time[-1]))
    if queue:
        memory = queue.take(parts, memory, time_s)
    memory = association.end_slice(parts, memory, time_s)
    memory = _with_whole_ships(parts, association.end_cycle(parts, memory, time_s), time_s)
    if rules and tested:
        memory = association.leave_messages(parts, rules, memory, float(heard.time_s.min(initial=np.inf)), time_s)
    tracks = _shown_tracks(association, rules, parts, memory, time_s, tested)
    found = RegionOutput(
        tracks=tracks,
        measurements=report_measurements(tracks, taken, plots, sensors, region),
        standing_echoes=standing_echoes(parts.clutter, memory.clutter, sensors.radars, sensors.region_origin_deg[region]),
        dropped=int((~usable).sum()),
        decided=report_decided(memory.forest.decided, sensors, region),
        unproven=memory.forest.unproven,
    )
    return memory.without_reported(), found


def _as_measured(parts: Parts, memory: RadarMemory, plots: Plots, time_s: float) -> Plots:
    """The plots as measurements of vessels: the pieces of a hull are one plot, and the echo is somewhere on the vessel.

    A hull is that of a confirmed track of known length.
    """
    if not np.isnan(plots.extent[:, 0]).all():
        rows, hulls = _hulls(parts, memory, time_s, LEAST_PLOTS)
        plots, growth_m = joined(plots, hulls, parts.sensors.radars.period_s)
        if not len(memory.forest.leaves.slot):
            _move(memory, rows, growth_m, 2.0 * growth_m)  # it is as uncertain as the end that came into sight
    if parts.upkeep.echo_sigma_m > 0.0:
        plots = replace(plots, covariance=plots.covariance + parts.upkeep.echo_sigma_m**2 * np.eye(2))
    return plots


def _note_sites(memory: RadarMemory, batch: PlotColumns, site_m: Floats) -> None:
    """Note newest plot and site of the radars of a batch, in place. A late plot does not move the site back. Args: site_m: (M, 2)."""
    newest = batch.time >= memory.newest_plot_s[batch.sensor]
    memory.site_m[batch.sensor[newest]] = site_m[newest]
    np.maximum.at(memory.newest_plot_s, batch.sensor, batch.time)


def _shown_tracks(
    association: AnyAssociation, rules: WithMessages | None, parts: Parts, memory: RadarMemory, time_s: float, seen: bool
) -> Tracks:
    """The tracks that are reported at the end of a cycle, by their plots alone where messages guide the association.

    Args: seen: only those that a radar has seen lately.
    """
    table, sensors, of_plots = memory.table, parts.sensors, rules is not None and rules.guides
    rows = parts.upkeep.shown(table, time_s)
    if seen:
        rows = rows[plots_alone.seen(memory.plots_alone, table, parts, rows, time_s)]
    if of_plots:
        now, alternative_m = _by_plots(parts, memory, rows, time_s), np.zeros(0)
    else:
        now, alternative_m = association.predict(parts, memory, rows, time_s)
    extent, beam_m = np.full((len(rows), 3), np.nan), np.full(len(rows), np.nan)
    known = np.flatnonzero(table.extent_plots[rows] >= LEAST_PLOTS)
    if len(known):
        extent[known] = table.extent[rows[known]]
        beam_m[known] = _beam_m(memory, rows[known], now.mean[known, :2], sensors)
    reported = Reported(
        number=table.track_id[rows],
        updated_s=np.maximum(table.radar_s[rows].max(axis=1, initial=-np.inf), -np.inf if of_plots else table.message_s[rows]),
        started_s=table.started_s[rows],
        origin=kernels.tracks.report.most_frequent_origins(table.origins, table.hits, rows),
        held_mmsi=table.probable_ids(rows, HELD),
        existence=parts.upkeep.existence(table, rows, time_s),
        extent=extent,
        beam_m=beam_m,
        alternative_m=alternative_m,
    )
    return report(now, reported, parts.radars(memory), time_s, sensors, parts.region)


def _by_plots(parts: Parts, memory: RadarMemory, rows: Ints, time_s: float) -> Estimates:
    """The estimates of the tracks in these slots by plots alone."""
    table, alone = memory.table, memory.plots_alone
    has_filter = alone.has_filter(rows)
    by_plots = parts.bank.predict(alone.filters, alone.estimates, rows[has_filter], time_s)
    others = parts.bank.predict(table.filters, table.estimates, rows[~has_filter], time_s)
    now = Estimates(*(np.empty((len(rows), *column.shape[1:])) for column in others))
    for column, one, other in zip(now, by_plots, others, strict=True):
        column[has_filter], column[~has_filter] = one, other
    return now


def _beam_m(memory: RadarMemory, rows: Ints, position_m: Floats, sensors: Sensors) -> Floats:
    """The width of the beam at the tracks in these slots, of the radar with the newest plot. (N,)"""
    newest = memory.table.radar_s[rows].argmax(axis=1) if memory.table.radar_s.shape[1] else np.zeros(len(rows), np.int64)
    off_m = position_m - memory.site_m[newest]
    return np.asarray(sensors.radars.beam_rad[newest] * np.hypot(off_m[:, 0], off_m[:, 1]))


def _with_whole_ships(parts: Parts, memory: RadarMemory, time_s: float) -> RadarMemory:
    """The memory with one track for two that are the ends of one ship: the older, moved to the middle of both. In place.

    It takes the MMSI of the younger where it has none. Two of different MMSI are two ships.
    """
    table = memory.table
    if np.count_nonzero(table.extent_plots[table.live]) < 2 or len(memory.forest.leaves.slot):
        return memory
    rows, hulls = _hulls(parts, memory, time_s, MOST_WEIGHT)
    one, other = ends_of_one(hulls, time_s)
    own, younger = (table.probable_ids(rows[of], KNOWN) for of in (one, other))
    alike = (own < 0) | (younger < 0) | (own == younger)
    one, other, named = one[alike], other[alike], ((own < 0) & (younger >= 0))[alike]
    if not len(one):
        return memory
    to, of = rows[one[named]], rows[other[named]]
    table.ids[to], table.id_probability[to] = table.ids[of], table.id_probability[of]
    table.message_s[to] = np.maximum(table.message_s[to], table.message_s[of])
    shift_m, extent = as_one_ship(hulls, one, other, time_s)
    _move(memory, rows[one], shift_m, np.zeros_like(shift_m))
    table.extent[rows[one]] = extent
    return replace(memory, table=table.without(np.isin(table.live, rows[other])))


def _move(memory: RadarMemory, rows: Ints, shift_m: Floats, error_m: Floats) -> None:
    """Move the tracks in these slots to other places of their ships, in place. The velocity stays. Args: shift_m, error_m: (N, 2)."""
    added = error_m[:, :, None] * error_m[:, None, :]
    alone = memory.plots_alone
    has_filter = alone.has_filter(rows) if alone.models else np.zeros(len(rows), np.bool_)
    for of, at in ((memory.table, np.arange(len(rows))), (alone, np.flatnonzero(has_filter))):
        slots = rows[at]
        of.combined_mean[slots, :2] += shift_m[at]
        of.state[slots, :, :2] += shift_m[at, None, :]
        of.combined_covariance[slots, :2, :2] += added[at]
        of.covariance[slots, :, :2, :2] += added[at, None]


def _hulls(parts: Parts, memory: RadarMemory, time_s: float, least: int) -> tuple[Ints, Hulls]:
    """The slots of confirmed tracks of known length, the older first, and their hulls. Args: least: plots in the mean."""
    table = memory.table
    rows = parts.upkeep.shown(table, time_s)
    rows = rows[table.extent_plots[rows] >= least]
    length = axes(table.extent[rows])[0]
    beam_m = _beam_m(memory, rows, table.combined_mean[rows, :2], parts.sensors)
    rows = rows[(length > beam_m) & (length <= LONGEST_M)]
    count, extent = table.extent_plots[rows], table.extent[rows]
    return rows, Hulls(table.updated_s[rows], table.combined_mean[rows], extent, table.radar_s[rows], count)
