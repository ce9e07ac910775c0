"""The rows of the picture: which vessels are shown, under which ids, and where; and the tracks in each."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Bools, FusedTracks, Ints, Members, Picture, Tracks
from coastwatch.kernels.threads import in_blocks
from coastwatch.picture.match import IdentityMatch, KnownTracks
from coastwatch.picture.settings import IdentitySettings
from coastwatch.picture.vessels import KnownColumns, KnownVessels, predict, rows_of_groups


@dataclass(frozen=True, eq=False)
class VesselOrder:
    """The vessels of this cycle in order of their ids. A row is one of the picture; a vessel is one of the last cycle's `KnownVessels`."""

    vessel_id: Ints  # (R,)
    group_of_row: Ints  # (R,) -1: a vessel without tracks
    vessel_of_row: Ints  # (R,) -1: a new vessel
    was_dark: Bools  # (R,) stays so, and is shown, while radar loses it
    row_of_group: Ints  # (V,)
    hidden: Ints  # (H,) vessels that are hidden now
    merged: Ints  # (G,) vessels that are merged now
    next_of_vessel: Ints  # (K,) row of each vessel in the `KnownVessels` of the next cycle, -1: deleted


def order_vessels(
    settings: IdentitySettings, columns: KnownColumns, match: IdentityMatch, is_dark: Bools, time_s: float, next_id: int
) -> VesselOrder:
    """Decide who is shown, hidden and deleted, and give ids from next_id on to new vessels. Args: is_dark: (S,) shown before."""
    lifecycle = kernels.identity.lifecycle
    state = np.empty(len(columns.vessel_id), np.int8)
    limits = float(time_s), settings.coast_s, settings.hold_s, settings.return_s
    in_blocks(
        lifecycle.lifecycle,
        len(state),
        match.group_of_vessel,
        match.remembered,
        columns.updated_s,
        columns.mmsi,
        limits,
        state,
    )
    dark = np.append(is_dark, np.zeros(len(state) + 1 - len(is_dark), np.bool_))  # of known vessels, and False for a new one
    coasts = dark[:-1] & (state == lifecycle.HIDDEN) & (time_s - columns.updated_s <= settings.dark_coast_s)
    state[coasts] = lifecycle.COASTING
    shown = np.flatnonzero((state == lifecycle.PRESENT) | (state == lifecycle.COASTING))
    hidden, merged = np.flatnonzero(state == lifecycle.HIDDEN), np.flatnonzero(state == lifecycle.MERGED)
    new = np.flatnonzero(match.vessel_of_group < 0)

    vessel_id = np.append(columns.vessel_id[shown], next_id + np.arange(len(new)))
    order = np.argsort(vessel_id, kind="stable")  # sorted already but for vessels that come back
    vessel_of_row = np.append(shown, np.full(len(new), -1, np.int64))[order]
    group_of_row = np.append(match.group_of_vessel[shown], new)[order]

    with_tracks, old = np.flatnonzero(group_of_row >= 0), np.flatnonzero(vessel_of_row >= 0)
    row_of_group = np.empty(len(match.vessel_of_group), np.int64)
    row_of_group[group_of_row[with_tracks]] = with_tracks
    next_of_vessel = np.full(len(state), -1, np.int64)
    next_of_vessel[vessel_of_row[old]] = old
    not_shown = np.append(hidden, merged)
    next_of_vessel[not_shown] = len(order) + np.arange(len(not_shown))
    was_dark = dark[vessel_of_row]
    return VesselOrder(vessel_id[order], group_of_row, vessel_of_row, was_dark, row_of_group, hidden, merged, next_of_vessel)


def picture_of(
    settings: IdentitySettings,
    known: KnownVessels,
    columns: KnownColumns,
    match: IdentityMatch,
    order: VesselOrder,
    tracks: Tracks,
    fused: FusedTracks,
    time_s: float,
) -> tuple[Picture, KnownVessels]:
    """The picture, with no flag but COASTING, and the known vessels of the next cycle."""
    rows = rows_of_groups(order.group_of_row, order.vessel_of_row, match.groups, tracks, fused, columns)
    coasting = np.flatnonzero(order.group_of_row < 0)
    predicted = predict(known.take(order.vessel_of_row[coasting]), time_s, settings.drift_m_s15)
    for name in vars(rows):
        getattr(rows, name)[coasting] = getattr(predicted, name)
    picture = replace(rows, vessel_id=order.vessel_id)
    hidden = predict(known.take(order.hidden), time_s, settings.drift_m_s15)
    return picture, KnownVessels(picture, hidden, columns.vessel_id[order.merged])


def members_of(match: IdentityMatch, order: VesselOrder, tracks: Tracks) -> Members:
    """The tracks of each row of the picture, sorted by vessel, source and track id."""
    start, _ = match.groups
    with_tracks = order.group_of_row >= 0
    count = np.zeros(len(order.vessel_id), np.int64)
    count[with_tracks] = np.diff(start)[order.group_of_row[with_tracks]]
    member_start = np.append(0, np.cumsum(count))
    track_id, source = np.empty(len(tracks), np.int64), np.empty(len(tracks), np.int64)
    in_blocks(
        kernels.identity.picture_columns.members,
        len(count),
        order.group_of_row,
        member_start,
        match.groups,
        (tracks.track_id, tracks.source),
        (track_id, source),
    )
    return Members(np.repeat(order.vessel_id, count), track_id, source)


def tracks_of(match: IdentityMatch, order: VesselOrder, tracks: Tracks, group: Ints) -> KnownTracks:
    """The tracks of this cycle with their vessels, for the next cycle. Args: group: (N,) of each track."""
    vessel = order.row_of_group[group]
    # The row of a deleted vessel, which no track remembers, is never asked for; -1 of a new track asks for any.
    first = order.next_of_vessel[match.first_vessel] if len(order.next_of_vessel) else vessel
    # What has split off under a new id is first in that: so it has it again after the next split.
    keeps_first = (match.first_vessel >= 0) & (order.vessel_of_row[vessel] >= 0)
    return KnownTracks(tracks.track_id, vessel, np.where(keeps_first, first, vessel))
