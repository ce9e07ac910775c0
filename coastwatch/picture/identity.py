"""The picture: each vessel once, under an id that stays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch.batches import AisAlarms, Associations, FusedTracks, Ints, Members, Picture, Rows, Sensors, Tracks
from coastwatch.picture.flags import FlagMemory, flag, together
from coastwatch.picture.known import Known, few
from coastwatch.picture.returns import returned
from coastwatch.picture.rows import pictured, unnamed
from coastwatch.picture.succession import Heirs, inherit, line_up, remember
from coastwatch.stage import Method


@dataclass(frozen=True, eq=False)
class PictureMemory:
    """What must outlive a cycle. Rows are those of `Known`."""

    known: Known
    track_id: Ints  # (L,) every track of the last cycle, in its order
    track_vessel: Rows  # (L,) slot of the vessel it was in
    track_home: Rows  # (L,) slot of the first vessel it ever was in
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
        no_slot = np.zeros(0, np.int32)
        return PictureMemory(Known.nobody(), none, no_slot, no_slot, 1, FlagMemory.empty())

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
        known, vessel, ids = memory.known, associations.vessel, memory.known.ids
        heirs = inherit(memory, ids, tracks, associations, len(fused), time_s, sensors)
        self._take_back(known, heirs, tracks, fused, time_s)
        line = line_up(self, known, ids, heirs, time_s, memory.next_id)
        shown, hidden = pictured(self, known, heirs, line, tracks, fused, time_s)
        members, company = together(heirs, line, tracks, sensors)
        was_in, was_home = remember(heirs, line, vessel)
        flags = flag(self, memory.flags, heirs, line, company, shown, tracks, was_in, alarms, time_s, sensors)
        after = Known(shown, hidden, line.gone_id)
        next_id = memory.next_id + int((heirs.chosen < 0).sum())
        return PictureMemory(after, tracks.track_id, was_in, was_home, next_id, flags), shown, members

    def _take_back(self, known: Known, heirs: Heirs, tracks: Tracks, fused: FusedTracks, time_s: float) -> None:
        """Gives vessels without tracks to the new vessels that are them."""
        free = few((heirs.taken[: len(known)] < 0) & ~heirs.alive[: len(known)])
        fresh = few(heirs.chosen < 0)
        if len(free) > 0 and len(fresh) > 0:
            rows, slots = returned(self, known, free, unnamed(fresh, heirs, tracks, fused), time_s)
            heirs.give(fresh[rows], slots)
