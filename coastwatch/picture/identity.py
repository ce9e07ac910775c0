"""The picture: each vessel once, under an id that stays."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch.batches import AisAlarms, Associations, Flag, FusedTracks, Ints, Members, Picture, Sensors, Tracks
from coastwatch.picture.flags import FlagMemory, flags_of
from coastwatch.picture.succession import coasted, inherit, return_of_the_lost
from coastwatch.stage import Method


@dataclass(frozen=True, eq=False)
class PictureMemory:
    """What must outlive a cycle."""

    picture: Picture  # the newest row of every vessel that may come back, sorted by vessel_id
    track_id: Ints  # (L,) every track of the last cycle, sorted
    track_vessel: Ints  # (L,) the vessel it was in
    track_home: Ints  # (L,) the first vessel it ever was in
    next_id: int
    flags: FlagMemory


class Identity(Method):
    """Vessels from fused tracks, with an id that is never an MMSI and never reused.

    A vessel keeps its id while any of its tracks lives: every track votes for the vessel it was in (AIS counts a little more
    than a radar, an older vessel more than a younger), and votes are settled one-to-one. Where no track votes, a vessel
    without tracks may return: by its MMSI within `return_s`, by position and velocity within `hold_s`. A vessel without tracks
    is shown, predicted and flagged as coasting, for `coast_s`.
    """

    method: Literal["identity"] = "identity"
    coast_s: Annotated[float, Field(ge=0.0)] = 30.0
    hold_s: Annotated[float, Field(ge=0.0)] = 120.0
    return_s: Annotated[float, Field(ge=0.0)] = 3600.0
    return_gate: Annotated[float, Field(gt=0.0)] = 18.0  # squared Mahalanobis distance of position and velocity
    drift_m_s15: Annotated[float, Field(gt=0.0)] = 0.15  # growth of the uncertainty of a vessel without tracks
    max_speed_kn: Annotated[float, Field(gt=0.0)] = 60.0  # of a return by MMSI
    dark_after_s: Annotated[float, Field(ge=0.0)] = 60.0
    unseen_after_s: Annotated[float, Field(ge=0.0)] = 60.0  # AIS where a radar should see it and does not
    paired_s: Annotated[float, Field(ge=0.0)] = 30.0  # how long AIS and radar were one before their parting means anything
    contradicted_for_s: Annotated[float, Field(ge=0.0)] = 300.0
    contradicted_after_s: Annotated[float, Field(ge=0.0)] = 9.0
    contradicted_from_m: Annotated[float, Field(ge=0.0)] = 100.0
    cover_margin: Annotated[float, Field(gt=0.0, le=1.0)] = 0.95  # share of a sensor's range that counts as covered

    def init(self) -> PictureMemory:
        none = np.zeros(0, np.int64)
        return PictureMemory(Picture.empty(), none, none, none, 1, FlagMemory.empty())

    def step(
        self,
        memory: PictureMemory,
        tracks: Tracks,
        associations: Associations,
        fused: FusedTracks,
        alarms: AisAlarms,
        time_s: float,
        sensors: Sensors,
    ) -> tuple[PictureMemory, Picture, Members]:
        """The picture of this cycle, sorted by vessel_id, and the tracks in it.

        Args: tracks: (N); associations: of its rows; fused: (V) one row for each vessel number; alarms: of AIS tracks.
        """
        last = memory.picture
        vessel_id, home = inherit(
            memory.track_id, memory.track_vessel, memory.track_home, last, tracks, associations, time_s, sensors
        )
        present = self._row_of_tracks(tracks, associations, fused)
        vessel_id = return_of_the_lost(self, vessel_id, memory, present, tracks, time_s)
        fresh = vessel_id < 0
        vessel_id = np.where(fresh, memory.next_id + np.cumsum(fresh) - 1, vessel_id)
        present = _with_past(replace(present, vessel_id=vessel_id), last)
        present = present.take(np.argsort(present.vessel_id, kind="stable"))
        of_track = vessel_id[associations.vessel]
        lost = coasted(self, last, memory, present, tracks, of_track, time_s)
        shown = Picture.join([present, lost.take(time_s - lost.updated_s <= self.coast_s)])
        shown = shown.take(np.argsort(shown.vessel_id, kind="stable"))
        flag_memory, flags = flags_of(self, memory.flags, shown, tracks, of_track, alarms, time_s, sensors)
        shown = replace(shown, flags=flags)
        members = _members(tracks, of_track)
        kept = Picture.join([present, lost])
        order = np.argsort(tracks.track_id, kind="stable")
        after = PictureMemory(
            kept.take(np.argsort(kept.vessel_id, kind="stable")),
            tracks.track_id[order],
            of_track[order],
            np.where(home < 0, of_track, home)[order],
            memory.next_id + int(fresh.sum()),
            flag_memory,
        )
        return after, shown, members

    def _row_of_tracks(self, tracks: Tracks, associations: Associations, fused: FusedTracks) -> Picture:
        """One row a vessel with what its tracks say of it; the id is still open."""
        count, vessel = len(fused), associations.vessel
        since, updated = np.full(count, np.inf), np.full(count, -np.inf)
        mmsi, origin = np.full(count, -1, np.int64), np.full(count, -1, np.int64)
        np.minimum.at(since, vessel, tracks.started_s)
        np.maximum.at(updated, vessel, tracks.updated_s)
        named = tracks.mmsi >= 0
        np.maximum.at(origin, vessel[~named], tracks.origin[~named])
        mmsi[vessel[named]] = tracks.mmsi[named]
        origin[vessel[named]] = tracks.origin[named]
        return Picture(
            np.full(count, -1, np.int64),
            fused.time_s,
            fused.position_deg,
            fused.velocity_m_s,
            fused.covariance,
            since,
            updated,
            mmsi,
            np.full(count, int(Flag(0)), np.int64),
            origin,
        )


def _with_past(present: Picture, last: Picture) -> Picture:
    """The rows with since and MMSI as known before, where the vessel was known before."""
    if len(last) == 0:
        return present
    at = np.minimum(np.searchsorted(last.vessel_id, present.vessel_id), len(last) - 1)
    known = last.vessel_id[at] == present.vessel_id
    return replace(
        present,
        since_s=np.where(known, np.minimum(last.since_s[at], present.since_s), present.since_s),
        mmsi=np.where(known & (present.mmsi < 0), last.mmsi[at], present.mmsi),
    )


def _members(tracks: Tracks, of_track: Ints) -> Members:
    order = np.lexsort((tracks.track_id, tracks.source, of_track))
    return Members(of_track[order], tracks.track_id[order], tracks.source[order])
