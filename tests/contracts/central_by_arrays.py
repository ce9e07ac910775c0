"""The filters of `CentralImm` carried on by sorting, seeking and copying: how the method was before its passes were linear.

The filter itself is the same kernel. `step` takes the settings of the method; `start` is the memory before the first cycle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from flags_by_sorting import find
from fused_by_arrays import intersection

from coastwatch.batches import Associations, Bools, Floats, FusedTracks, Ints, Measurements, SourceKind, Tracks
from coastwatch.fused_tracks import CentralImm
from coastwatch.fused_tracks.central_imm import KINDS, SEARCH_STEPS
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.kernels.filters.velocity_jumps import WIDTH, absorb, foresee

Estimates = tuple[Floats, ...]  # position (V, 2) degrees, velocity (V, 2), covariance (V, 4, 4)


@dataclass(frozen=True, eq=False)
class Bank:
    """The filters of V vessels, each in the plane at its anchor, and which tracks are in them."""

    anchor_deg: Floats  # (V, 2)
    filters: Floats  # (V, J, WIDTH), see coastwatch.kernels.kicked_imm
    mode: Floats  # (V, J)
    newest_s: Floats  # (V,) time of the newest measurement
    track_id: Ints  # (L,) sorted
    row: Ints  # (L,) of the filter

    @property
    def arrays(self) -> tuple[Floats, ...]:
        """What there is of each filter."""
        return self.anchor_deg, self.filters, self.mode, self.newest_s

    def take(self, rows: Ints) -> Bank:
        """These filters, without their tracks."""
        none = np.zeros(0, np.int64)
        anchor, filters, mode, newest_s = (part[rows] for part in self.arrays)
        return Bank(anchor, filters, mode, newest_s, none, none)


def start(settings: CentralImm) -> Bank:
    """No filter."""
    j, none = len(KINDS), np.zeros(0, np.int64)
    return Bank(np.zeros((0, 2)), np.zeros((0, j, WIDTH)), np.zeros((0, j)), np.zeros(0), none, none)


def step(
    settings: CentralImm,
    memory: Bank,
    tracks: Tracks,
    measurements: Measurements,
    associations: Associations,
    time_s: float,
    kinds: Ints,
) -> tuple[Bank, FusedTracks]:
    """One estimate a vessel.

    Args: tracks: (N); measurements: that went into them since the last cycle; associations: of the tracks; kinds: SourceKind of
    each source.
    Returns: memory and FusedTracks, one row for each vessel number.
    """
    vessel = associations.vessel
    if len(vessel) == 0:
        return start(settings), FusedTracks.empty()
    covariance = tracks.known_covariance(settings.unknown_velocity_sigma_m_s)
    size = np.bincount(vessel)
    going = going_on(vessel, former(memory.track_id, memory.row, tracks.track_id), len(size))
    rows = np.flatnonzero(going >= 0)
    bank = _heard(settings, memory.take(going[rows]), rows, tracks, measurements, vessel, kinds)
    whole = np.flatnonzero(newest(vessel, tracks.updated_s, len(size))[rows] <= bank.newest_s)
    rows, bank = rows[whole], bank.take(whole)
    begins = size > 1
    begins[rows] = False
    bank, followed = _shown(settings, bank, time_s)
    begun, first = _begun(settings, tracks, covariance, vessel, begins, time_s)
    lead = np.zeros(len(size), np.int64)
    lead[vessel] = np.arange(len(vessel))
    out = tracks.position_deg[lead], tracks.velocity_m_s[lead], covariance[lead]
    shown = (size > 1) | (np.bincount(vessel, kinds[tracks.source] == SourceKind.RADAR) > 0)
    for given, of_filter, of_tracks in zip(out, followed, first, strict=True):
        given[rows[shown[rows]]] = of_filter[shown[rows]]
        given[begins] = of_tracks
    bank = _with_tracks(bank, begun, np.append(rows, np.flatnonzero(begins)), tracks.track_id, vessel)
    return bank, FusedTracks(np.full(len(size), float(time_s)), *out)


def _heard(
    settings: CentralImm, bank: Bank, rows: Ints, tracks: Tracks, measurements: Measurements, vessel: Ints, kinds: Ints
) -> Bank:
    """The filters after the measurements of their vessels' tracks. Args: rows: (B,) the vessel of each filter."""
    filter_of = np.full(int(vessel.max()) + 1, -1, np.int64)
    filter_of[rows] = np.arange(len(rows))
    order = np.argsort(tracks.track_id, kind="stable")
    at = find(tracks.track_id[order], measurements.track_id)
    mine = np.where(at >= 0, filter_of[vessel[order[at]]], -1)
    m, mine = measurements.take(mine >= 0), mine[mine >= 0]
    with_ais = np.bincount(vessel, kinds[tracks.source] == SourceKind.AIS)[rows] > 0
    z = np.empty((len(m), 10))
    z[:, :2] = difference_m(m.position_deg, bank.anchor_deg[mine])
    z[:, 2:4] = m.velocity_m_s
    place = m.covariance[:, :2, :2] + _registration(settings, m) * with_ais[mine, None, None]
    z[:, 4:7] = place[:, [0, 1, 1], [0, 0, 1]]
    z[:, 7:] = m.covariance[:, [2, 3, 3], [2, 2, 3]]
    taken = np.lexsort((m.sensor, m.time_s, mine))
    begin = np.searchsorted(mine[taken], np.arange(len(rows) + 1))
    filters, mode, newest_s = bank.filters.copy(), bank.mode.copy(), bank.newest_s.copy()
    absorb(0, len(rows), filters, mode, newest_s, m.time_s, z, taken, begin, settings._models(), np.empty(len(rows)))
    return replace(bank, filters=filters, mode=mode, newest_s=newest_s)


def _registration(settings: CentralImm, m: Measurements) -> Floats:
    """What is added to the covariance of each plot's place, along and across its beam; nothing for AIS. (M, 2, 2)"""
    out, plots = np.zeros((len(m), 2, 2)), m.sensor >= 0
    beam = difference_m(m.position_deg[plots], m.site_deg[plots])
    along = beam / np.maximum(np.hypot(beam[:, 0], beam[:, 1]), 1.0)[:, None]
    across = np.column_stack([-along[:, 1], along[:, 0]])
    for share, axis in ((settings.range_registration, along), (settings.azimuth_registration, across)):
        variance = np.einsum("mi,mij,mj->m", axis, m.covariance[plots, :2, :2], axis)
        out[plots] += (share * variance)[:, None, None] * axis[:, :, None] * axis[:, None, :]
    return out


def _shown(settings: CentralImm, bank: Bank, time_s: float) -> tuple[Bank, Estimates]:
    """The filters with their anchors at where the vessels are at this time, and what they make of the vessels then."""
    mean, spread = np.empty((len(bank.mode), 5)), np.empty((len(bank.mode), 5, 5))
    foresee(0, len(bank.mode), bank.filters, bank.mode, bank.newest_s, float(time_s), settings._models(), mean, spread)
    position, filters = offset_deg(bank.anchor_deg, mean[:, :2]), bank.filters.copy()
    filters[:, :, :2] -= mean[:, None, :2]
    return replace(bank, anchor_deg=position, filters=filters), (position, mean[:, 2:4], spread[:, :4, :4])


def _begun(
    settings: CentralImm, tracks: Tracks, covariance: Floats, vessel: Ints, begins: Bools, time_s: float
) -> tuple[Bank, Estimates]:
    """Filters of these vessels from their tracks alone, and the same as estimates. Args: begins: (V,) which."""
    count, member = int(begins.sum()), begins[vessel]
    number = np.cumsum(begins) - 1
    if count == 0:
        first = np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 4, 4))
    else:
        first = intersection(tracks.take(member), covariance[member], number[vessel[member]], SEARCH_STEPS)
    filters = np.zeros((count, len(KINDS), WIDTH))
    low = np.tril_indices(4)
    filters[:, :, 2:4] = first[1][:, None]
    filters[:, :, 5:15] = first[2][:, None, low[0], low[1]]
    filters[:, :, 19] = np.radians(settings.turn_rate_sigma_deg_s) ** 2
    mode = np.tile(np.array(settings.share) / sum(settings.share), (count, 1))
    none = np.zeros(0, np.int64)
    bank = Bank(first[0], filters, mode, np.full(count, float(time_s)), none, none)
    return bank, (first[0], first[1], first[2])


def _with_tracks(bank: Bank, begun: Bank, rows: Ints, track_id: Ints, vessel: Ints) -> Bank:
    """Both banks as one, with the tracks of their vessels. Args: rows: the vessel of each filter, of the first bank, then the second."""
    filter_of = np.full(int(vessel.max()) + 1, -1, np.int64)
    filter_of[rows] = np.arange(len(rows))
    row = filter_of[vessel]
    order = np.argsort(track_id, kind="stable")
    order = order[row[order] >= 0]
    anchor, filters, mode, newest_s = (np.concatenate(both) for both in zip(bank.arrays, begun.arrays, strict=True))
    return Bank(anchor, filters, mode, newest_s, track_id[order], row[order])


def former(known_id: Ints, known_row: Ints, track_id: Ints) -> Ints:
    """The filter that each track was in; -1 where none. Args: known_id: (L,) sorted; known_row: (L,); track_id: (N,)."""
    at = find(known_id, track_id)
    return np.where(at >= 0, known_row[at], -1).astype(np.int64) if len(known_id) else at


def going_on(vessel: Ints, before: Ints, vessels: int) -> Ints:
    """The filter with which each vessel goes on; -1: with none.

    A filter goes on where all of its tracks that still live are, and no track of another filter: then nothing that it heard was of
    another vessel. Tracks may have ended, and tracks without a filter may have come.
    Args: vessel: (N,) of each track; before: (N,) its filter, -1 where none; vessels: how many. Returns: (V,).
    """
    filters = int(before.max(initial=-1)) + 1
    lowest, highest = np.full(vessels, filters, np.int64), np.full(vessels, -1, np.int64)
    old = before >= 0
    np.minimum.at(lowest, vessel[old], before[old])
    np.maximum.at(highest, vessel[old], before[old])
    alive = np.bincount(before[old], minlength=filters)
    here = np.bincount(vessel[old], minlength=vessels)
    one = (highest >= 0) & (lowest == highest)
    whole = one.copy()
    whole[one] = alive[highest[one]] == here[one]
    return np.where(whole, highest, -1)


def newest(vessel: Ints, updated_s: Floats, vessels: int) -> Floats:
    """When the tracks of each vessel were updated last: a filter that has heard of nothing so new was not told of it. (V,)

    Args: vessel: (N,) of each track; updated_s: (N,); vessels: how many.
    """
    out = np.full(vessels, -np.inf)
    np.maximum.at(out, vessel, updated_s)
    return out
