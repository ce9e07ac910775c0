"""Which AIS messages radar tracks take: a track leaves messages that contradict its plots, and no track takes those of their MMSI then."""

from __future__ import annotations

import numpy as np

from coastwatch.batches import Bools, Floats, Ints, Messages
from coastwatch.tracks.radar import plots_alone
from coastwatch.tracks.radar.life.existence import KNOWN
from coastwatch.tracks.radar.messages.settings import MessageSettings
from coastwatch.tracks.radar.messages.weighing import begin_unnamed
from coastwatch.tracks.radar.parts import Parts
from coastwatch.tracks.radar.table import RadarMemory

CURRENT_TURNS = 4  # of the radar with the newest plot


def trusted(rules: MessageSettings, memory: RadarMemory, messages: Messages, time_s: float) -> Messages:
    """The messages without those of an MMSI that a track has left lately."""
    table, alone = memory.table, memory.plots_alone
    left = table.live[time_s - alone.left_s[table.live] < rules.distrust_s]
    return messages.take(~np.isin(messages.mmsi, alone.left_mmsi[left])) if len(left) else messages


def leave(rules: MessageSettings, parts: Parts, memory: RadarMemory, since_s: float, time_s: float, looks: int) -> Ints:
    """Tracks whose messages contradict their plots, or go to another track, go on by plots alone, in place.

    All tracks of that MMSI do.
    Args: since_s: time of the oldest message of this cycle: a track without one is not tested again; looks: of the slowest radar that
    sees the track, for which they contradict.
    Returns: their slots.
    """
    table, alone = memory.table, memory.plots_alone
    every = table.probable_ids(table.live, KNOWN)
    slots, mmsi = table.live[every >= 0], every[every >= 0]
    ids, of = np.unique(mmsi, return_inverse=True)
    newest_s = np.full(len(ids), -np.inf)
    np.maximum.at(newest_s, of, table.message_s[slots])
    gone = np.isfinite(table.message_s[slots]) & (table.message_s[slots] < newest_s[of] - rules.elsewhere_s)
    fresh = np.flatnonzero((table.message_s[slots] >= since_s) & _is_current(parts, memory, slots, time_s))
    bias = parts.registration * _plot_covariance(parts, memory, slots[fresh])
    contradicted = np.zeros(len(fresh), np.bool_)
    contradicted[plots_alone.contradicted(alone, table, parts, slots[fresh], bias, time_s, rules.doubt)] = True
    since = alone.doubted_s[slots[fresh]]
    alone.doubted_s[slots[fresh]] = np.where(contradicted, np.where(np.isnan(since), time_s, since), np.nan)
    gone |= time_s - alone.doubted_s[slots] >= looks * _period_s(
        parts, memory, slots, time_s
    )  # also where plots have left the gates of the track meanwhile
    gone = np.isin(mmsi, mmsi[gone])
    left = slots[gone]
    if not len(left):
        return left
    alone.left_mmsi[left], alone.left_s[left], alone.doubted_s[left] = mmsi[gone], time_s, np.nan
    with_plots = left[alone.has_filter(left)]
    plots_alone.begin_at(table.filters, table.estimates, with_plots, parts.bank, alone.estimates, with_plots)
    table.updated_s[with_plots] = alone.updated_s[with_plots]
    alone.updated_s[left] = table.message_s[left] = -np.inf
    table.ids[left], table.id_probability[left] = -1, 0.0
    begin_unnamed(rules, table, left)
    return left


def _is_current(parts: Parts, memory: RadarMemory, slots: Ints, time_s: float) -> Bools:
    """Which of these tracks have a plot of the last turns: without, a filter of plots alone says where the vessel was going. (N,)"""
    table, radars = memory.table, parts.sensors.radars
    if not len(radars):
        return np.zeros(len(slots), np.bool_)
    period_s = radars.period_s[table.radar_s[slots].argmax(axis=1)]
    out: Bools = time_s - memory.plots_alone.updated_s[slots] <= CURRENT_TURNS * period_s
    return out


def _period_s(parts: Parts, memory: RadarMemory, slots: Ints, time_s: float) -> Floats:
    """The period of the slowest radar that has seen each of these tracks in its last turns; else of that with the newest plot. (N,)"""
    period_s, seen_s = parts.sensors.radars.period_s, memory.table.radar_s[slots]
    if not len(period_s):
        return np.zeros(len(slots))
    slowest_s = np.where(time_s - seen_s <= CURRENT_TURNS * period_s, period_s, 0.0).max(axis=1)
    out: Floats = np.maximum(slowest_s, period_s[seen_s.argmax(axis=1)])
    return out


def _plot_covariance(parts: Parts, memory: RadarMemory, slots: Ints) -> Floats:
    """The covariance of a plot at these tracks, of the radar with the newest one. (N, 2, 2)"""
    table, radars = memory.table, parts.sensors.radars
    if not len(radars):
        return np.zeros((len(slots), 2, 2))
    radar = table.radar_s[slots].argmax(axis=1)
    off_m = np.nan_to_num(table.combined_mean[slots, :2] - memory.site_m[radar])
    range_m = np.hypot(off_m[:, 0], off_m[:, 1])
    along = off_m / np.maximum(range_m, 1.0)[:, None]
    outer = along[:, :, None] * along[:, None, :]
    across2 = (range_m * radars.azimuth_sigma_rad[radar]) ** 2
    out: Floats = across2[:, None, None] * (np.eye(2) - outer) + radars.range_sigma_m[radar][:, None, None] ** 2 * outer
    return out
