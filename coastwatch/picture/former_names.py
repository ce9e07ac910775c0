"""Under which MMSI a vessel goes on once it has no AIS, and what an AIS track says against the vessel that had its MMSI before.

- A former MMSI stays with a vessel until a live AIS track of that MMSI is in another vessel. Of several vessels without AIS the one
  that was heard last keeps it. So no two vessels have one MMSI unless both have a live AIS track of it.
- MMSI_TWICE: live AIS tracks of one MMSI are in two vessels.
- AIS_CONTRADICTED: AIS and radar were one vessel for `paired_s`, its AIS track ended, and an AIS track of its MMSI is now in another
  vessel, `taken_from_m` or farther from the radar track that is still there. It lasts for `contradicted_for_s`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from coastwatch.batches import Bools, Flag, Floats, Ints, Picture, Struct, Tracks, column
from coastwatch.geodesy import difference_m
from coastwatch.kernels.tables.groups import ranges
from coastwatch.kernels.tables.lookup import find
from coastwatch.kernels.tables.match_ids import index_of
from coastwatch.picture.settings import IdentitySettings


@dataclass(frozen=True, eq=False)
class AisPast(Struct):
    """The newest AIS of each vessel that is shown or hidden and ever had any."""

    vessel_id: Ints = column(np.int64, "S")  # ascending
    mmsi: Ints = column(np.int64, "S")
    track_id: Ints = column(np.int64, "S")
    heard_s: Floats = column(np.float64, "S")  # newest report
    paired_since_s: Floats = column(
        np.float64, "S"
    )  # since when AIS and radar were one vessel at that time; inf: they were not
    elsewhere_since_s: Floats = column(np.float64, "S")  # since when its MMSI is in another vessel; inf: it is not
    ended: Bools = column(np.bool_, "S")  # its AIS track had ended when its MMSI came elsewhere: its sender fell silent


@dataclass(frozen=True, eq=False)
class AisNow:
    """What AIS tracks say of the vessels of a cycle. B tracks, sorted by MMSI; R rows of the picture."""

    mmsi: Ints  # (B,) ascending
    row: Ints  # (B,) of the picture
    row_of_track: Ints  # (N,) of every track of the cycle
    track_id: Ints  # (B,)
    track_of_row: Ints  # (R,) id of the AIS track that names each row; -1: none
    has_ais: Bools  # (R,)
    has_radar: Bools  # (R,)
    heard_s: Floats  # (R,) newest report; -inf: none

    @classmethod
    def of(cls, tracks: Tracks, row_of_track: Ints, ais_source: int, rows: int) -> AisNow:
        """Args: row_of_track: (N,) of a picture of so many rows."""
        ais, track_of_row = np.flatnonzero(tracks.source == ais_source), np.full(rows, -1, np.int64)
        track_of_row[row_of_track[ais]] = tracks.track_id[ais]  # the last one written names it
        ais = ais[np.argsort(tracks.mmsi[ais], kind="stable")]
        has_ais, has_radar, heard_s = np.zeros(rows, np.bool_), np.zeros(rows, np.bool_), np.full(rows, -np.inf)
        has_ais[row_of_track[ais]] = True
        has_radar[row_of_track[tracks.source < ais_source]] = True
        np.maximum.at(heard_s, row_of_track[ais], tracks.updated_s[ais])
        row, track_id = row_of_track[ais], tracks.track_id[ais]
        return cls(tracks.mmsi[ais], row, row_of_track, track_id, track_of_row, has_ais, has_radar, heard_s)


def next_past(before: AisPast, picture: Picture, hidden_id: Ints, now: AisNow, time_s: float) -> AisPast:
    """The newest AIS of every vessel after a cycle. Args: picture: sorted by vessel; hidden_id: (H,) of vessels that may return."""
    rows = np.flatnonzero(now.has_ais)
    vessel_id, mmsi = picture.vessel_id[rows], picture.mmsi[rows]
    at = index_of(before.vessel_id, vessel_id)
    had = np.zeros(len(before.vessel_id), np.bool_)
    same = np.flatnonzero(at >= 0)
    had[at[same]] = True
    same = same[(before.mmsi[at[same]] == mmsi[same]) & np.isinf(before.elsewhere_since_s[at[same]])]
    paired_since_s = np.full(len(rows), float(time_s))
    paired_since_s[same] = np.minimum(before.paired_since_s[at[same]], time_s)
    paired_since_s[~now.has_radar[rows]] = np.inf

    old = np.flatnonzero(~had)
    silent_id = before.vessel_id[old]
    old = old[(find(picture.vessel_id, silent_id) >= 0) | (index_of(hidden_id, silent_id) >= 0)]
    is_live = find(now.mmsi, before.mmsi[old]) >= 0
    elsewhere_since_s = np.where(is_live, np.minimum(before.elsewhere_since_s[old], time_s), before.elsewhere_since_s[old])
    ended = before.ended[old] | (np.isinf(before.elsewhere_since_s[old]) & (index_of(now.track_id, before.track_id[old]) < 0))
    columns: tuple[Any, ...] = (
        np.append(vessel_id, before.vessel_id[old]),
        np.append(mmsi, before.mmsi[old]),
        np.append(now.track_of_row[rows], before.track_id[old]),
        np.append(now.heard_s[rows], before.heard_s[old]),
        np.append(paired_since_s, before.paired_since_s[old]),
        np.append(np.full(len(rows), np.inf), elsewhere_since_s),
        np.append(np.zeros(len(rows), np.bool_), ended),
    )
    order = np.argsort(columns[0], kind="stable")
    return AisPast(*(column[order] for column in columns))


def outdated(mmsi: Ints, vessel_id: Ints, has_ais: Bools, past: AisPast, now: AisNow) -> Bools:
    """Which vessels lose their former MMSI. (K,) Args: mmsi, vessel_id, has_ais: (K,) of shown and hidden vessels."""
    is_outdated, former = np.zeros(len(mmsi), np.bool_), np.flatnonzero((mmsi >= 0) & ~has_ais)
    is_outdated[former] = find(now.mmsi, mmsi[former]) >= 0
    rest = former[~is_outdated[former]]
    heard_s = np.append(past.heard_s, -np.inf)[find(past.vessel_id, vessel_id[rest])]
    order = rest[np.lexsort((vessel_id[rest], -heard_s, mmsi[rest]))]
    is_outdated[order[1:][mmsi[order[1:]] == mmsi[order[:-1]]]] = True
    return is_outdated


def had_ais(settings: IdentitySettings, past: AisPast, vessel_id: Ints) -> Bools:
    """Which vessels had AIS, together with radar, for `paired_s`. Args: (R,). Returns: (R,)."""
    return np.append(_was_paired(settings, past), False)[find(past.vessel_id, vessel_id)]


def name_flags(settings: IdentitySettings, past: AisPast, picture: Picture, now: AisNow, time_s: float) -> Ints:
    """MMSI_TWICE and AIS_CONTRADICTED, as far as they follow from who had an MMSI before. (R,)"""
    flags = np.zeros(len(picture), np.int64)
    if len(now.mmsi):
        start = np.flatnonzero(np.append(True, now.mmsi[1:] != now.mmsi[:-1]))
        in_two = np.minimum.reduceat(now.row, start) != np.maximum.reduceat(now.row, start)
        flags[now.row[np.repeat(in_two, np.diff(np.append(start, len(now.mmsi))))]] |= int(Flag.MMSI_TWICE)

    since_s = time_s - past.elsewhere_since_s
    former = np.flatnonzero(
        _was_paired(settings, past) & past.ended & (since_s >= 0.0) & (since_s <= settings.contradicted_for_s)
    )
    row = find(picture.vessel_id, past.vessel_id[former])
    there = row >= 0
    there[there] = now.has_radar[row[there]] & ~now.has_ais[row[there]]
    former, row = former[there], row[there]
    first, last = (np.searchsorted(now.mmsi, past.mmsi[former], side) for side in ("left", "right"))
    count = last - first
    former_of_pair = np.repeat(np.arange(len(former)), count)
    other_row = now.row[ranges(first, count)]
    offset_m = difference_m(picture.position_deg[other_row], picture.position_deg[row[former_of_pair]])
    far = np.hypot(offset_m[:, 0], offset_m[:, 1]) >= settings.taken_from_m
    for contradicted in (row[former_of_pair][far], other_row[far]):
        flags[contradicted] |= int(Flag.AIS_CONTRADICTED)
    return flags


def _was_paired(settings: IdentitySettings, past: AisPast) -> Bools:
    """Which of them had AIS and radar for `paired_s` or longer. (S,)"""
    return np.asarray(past.heard_s - past.paired_since_s >= settings.paired_s)
