"""Vessels known from the last cycle, vessels of groups of tracks, and where a vessel without tracks is by now."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Array, Flag, Floats, FusedTracks, HeldVessels, Ints, Picture, Rows, Tracks
from coastwatch.batches.struct import Struct, column, part
from coastwatch.kernels.threads import in_blocks

Groups = tuple[Rows, Rows]
"""Tracks by group: start (V + 1,), row (N,). The tracks of group g are row[start[g]:start[g + 1]]."""


class KnownColumns(NamedTuple):
    """What is asked of every known vessel."""

    vessel_id: Ints  # (K,)
    since_s: Floats  # (K,) inf if merged
    updated_s: Floats  # (K,) -inf if merged
    mmsi: Ints  # (K,) -1 if unknown or merged
    nav_status: Ints  # (K,) the same


@dataclass(frozen=True, eq=False)
class KnownVessels(Struct):
    """Vessels of the last cycle that may go on under their ids. Known vessel k is row k of shown, hidden and merged together."""

    shown: Picture = part(Picture)  # the picture of the last cycle, sorted by id
    hidden: Picture = part(Picture)  # without tracks and no longer shown; they may return by MMSI or position
    # Ids whose tracks went into other vessels; they return if a track that was first in them splits off
    merged_id: Ints = column(np.int64, "G")

    def columns(self) -> KnownColumns:
        """Columns over all known vessels."""
        merged = self.merged_id

        def joined(name: str, of_merged: Array) -> Array:
            return np.concatenate([getattr(self.shown, name), getattr(self.hidden, name), of_merged])

        return KnownColumns(
            joined("vessel_id", merged),
            joined("since_s", np.full(len(merged), np.inf)),
            joined("updated_s", np.full(len(merged), -np.inf)),
            joined("mmsi", np.full(len(merged), -1, np.int64)),
            joined("nav_status", np.full(len(merged), -1, np.int64)),
        )

    def rows_of(self, shown_id: Ints) -> Ints:
        """The rows of vessels of the last picture. Args: shown_id: (H,), all in it."""
        return np.searchsorted(self.shown.vessel_id, shown_id)

    def with_estimates(self, bearing_only: HeldVessels) -> KnownVessels:
        """The same with the estimates of vessels that bearings hold."""
        if len(bearing_only) == 0:
            return self
        rows, columns = self.rows_of(bearing_only.vessel_id), {}
        for name in ("time_s", "position_deg", "velocity_m_s", "covariance", "updated_s"):
            columns[name] = getattr(self.shown, name).copy()
            columns[name][rows] = getattr(bearing_only, name)
        return replace(self, shown=replace(self.shown, **columns))

    def take(self, rows: Ints) -> Picture:
        """The rows of these known vessels, shown or hidden, in this order. Args: rows: (B,)."""
        of_shown = rows < len(self.shown)
        parts = self.shown.take(rows[of_shown]), self.hidden.take(rows[~of_shown] - len(self.shown))
        place = np.empty(len(rows), np.int64)
        place[np.flatnonzero(of_shown)] = np.arange(len(parts[0]))
        place[np.flatnonzero(~of_shown)] = len(parts[0]) + np.arange(len(parts[1]))
        return Picture.join(list(parts)).take(place)


def rows_of_groups(
    group_of_row: Ints, vessel_of_row: Ints, groups: Groups, tracks: Tracks, fused: FusedTracks, known: KnownColumns
) -> Picture:
    """Rows of the picture for groups of tracks; ids are -1 and flags 0 so far.

    Args: group_of_row: (R,) -1: the vessel has no tracks, and the row is left unwritten; vessel_of_row: (R,) -1: a new vessel.
    """
    n = len(group_of_row)
    time_s, since_s, updated_s = np.empty(n), np.empty(n), np.empty(n)
    position, velocity, covariance = np.empty((n, 2)), np.empty((n, 2)), np.empty((n, 4, 4))
    mmsi, origin = np.empty(n, np.int64), np.empty(n, np.int64)
    in_blocks(
        kernels.identity.picture_columns.vessel_columns,
        n,
        group_of_row,
        groups,
        (fused.time_s, fused.position_deg, fused.velocity_m_s, fused.covariance),
        (tracks.started_s, tracks.updated_s, tracks.mmsi, tracks.origin),
        (vessel_of_row, known.since_s, known.mmsi),
        (time_s, position, velocity, covariance, since_s, updated_s, mmsi, origin),
    )
    vessel_id, flags = np.full(n, -1, np.int64), np.zeros(n, np.int64)
    status = np.append(known.nav_status, -1)[vessel_of_row]
    return Picture(vessel_id, time_s, position, velocity, covariance, since_s, updated_s, mmsi, flags, origin, status)


def with_details(picture: Picture, tracks: Tracks, row_of_track: Ints) -> Picture:
    """The picture with what tracks say of each vessel beside its motion; NaN where none does. Args: row_of_track: (N,) of the picture.

    Existence is that of its likeliest track, size and axis are those of its longest echo. `alternative_m` is the least of its tracks, and
    NaN where one of them is sure.
    """
    rows = len(picture)
    existence, has_existence = np.full(rows, np.nan), np.flatnonzero(np.isfinite(tracks.existence))
    np.fmax.at(existence, row_of_track[has_existence], tracks.existence[has_existence])
    alternative_m, doubtful = np.full(rows, np.nan), np.isfinite(tracks.alternative_m)
    if doubtful.any():
        alternative_m[:] = np.inf
        np.minimum.at(alternative_m, row_of_track, np.where(doubtful, tracks.alternative_m, -np.inf))
        alternative_m[~np.isfinite(alternative_m)] = np.nan
    every = np.full((3, rows), np.nan)
    known = np.flatnonzero(np.isfinite(tracks.echo_length_m))
    if len(known):
        known = known[np.lexsort((tracks.echo_length_m[known], row_of_track[known]))]
        for column, values in zip(every, (tracks.echo_length_m, tracks.echo_width_m, tracks.echo_axis_deg), strict=True):
            column[row_of_track[known]] = values[known]  # of equal rows the last, the longest, stays
    length, width, axis = every
    return replace(
        picture,
        existence=existence,
        alternative_m=alternative_m,
        echo_length_m=length,
        echo_width_m=width,
        echo_axis_deg=axis,
    )


def predict(vessels: Picture, time_s: float, drift_m_s15: float) -> Picture:
    """Vessels without tracks at a later time: straight motion with white acceleration, flagged as coasting.

    Args: drift_m_s15: root of the density of the acceleration noise.
    """
    position, covariance = np.empty_like(vessels.position_deg), np.empty_like(vessels.covariance)
    states = vessels.position_deg, vessels.velocity_m_s, vessels.covariance
    advance = kernels.fusion.alignment.advance
    in_blocks(advance, len(vessels), time_s - vessels.time_s, states, drift_m_s15**2, position, covariance)
    return replace(
        vessels,
        time_s=np.full(len(vessels), float(time_s)),
        position_deg=position,
        covariance=covariance,
        flags=np.full(len(vessels), int(Flag.COASTING), np.int64),
    )
