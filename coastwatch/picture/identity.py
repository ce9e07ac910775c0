"""The picture: each vessel once, under an id that stays."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coastwatch.batches import Bools, Flag, Picture
from coastwatch.geodesy import within_any
from coastwatch.kernels.tables.row_numbers import require_rows
from coastwatch.picture.confirmed import Confirmations, confirm
from coastwatch.picture.flags import FlagMemory, ais_flags, flag, nav_statuses
from coastwatch.picture.former_names import AisNow, AisPast, name_flags, next_past, outdated
from coastwatch.picture.inputs import PictureInput, PictureOutput
from coastwatch.picture.match import KnownTracks, match_identities
from coastwatch.picture.order import members_of, order_vessels, picture_of, tracks_of
from coastwatch.picture.settings import IdentitySettings
from coastwatch.picture.vessels import KnownVessels, with_details

JUMP_REACH = 1.25  # of the range of a radar: what it showed may have coasted out of it since


@dataclass(frozen=True, eq=False)
class PictureMemory:
    """The memory of the picture between cycles."""

    known: KnownVessels
    tracks: KnownTracks
    next_id: int
    flags: FlagMemory
    ais_past: AisPast
    confirmations: Confirmations
    confirmed: Bools  # (R,) of the newest picture: the vessels that are shown

    def check_rows(self) -> None:
        """Check the row numbers, as after reading a checkpoint: kernels do not. Raises: ValueError that names the field."""
        vessels, tracks = len(self.known.columns().vessel_id), len(self.tracks.track_id)
        require_rows("KnownTracks.vessel", self.tracks.vessel, vessels)
        require_rows("KnownTracks.first_vessel", self.tracks.first_vessel, vessels)
        require_rows("TrackPairs.ais", self.flags.pairs.ais, tracks)
        require_rows("TrackPairs.radar", self.flags.pairs.radar, tracks)


class Identity(IdentitySettings):
    """Vessels from fused tracks, with an id that is never an MMSI and never reused.

    A vessel keeps its id while any of its tracks exists. Every track votes for the vessel that it was in; an AIS track counts a
    little more than a radar track, an older vessel more than a younger one. The greatest sum of votes is assigned one-to-one.
    A group without votes may be a vessel without tracks that returns: by its MMSI within `return_s`, by position and velocity
    within `hold_s`. A vessel that loses its AIS goes on under its MMSI until AIS of that MMSI is in another vessel. A vessel without
    tracks is shown, predicted and flagged as coasting, for `coast_s`; one that is dark for `dark_coast_s`. While bearings hold it, it
    is shown where they say, flagged as coasting too.
    """

    def init(self) -> PictureMemory:
        vessels, tracks, flags, past = KnownVessels.empty(), KnownTracks.empty(), FlagMemory.empty(), AisPast.empty()
        return PictureMemory(vessels, tracks, 1, flags, past, Confirmations.empty(), np.zeros(0, np.bool_))

    def step(self, memory: PictureMemory, given: PictureInput) -> tuple[PictureMemory, PictureOutput]:
        """The picture of this cycle, and the tracks in it."""
        tracks, time_s, bearing_only = given.tracks, given.time_s, given.bearing_only_vessels
        known = memory.known.with_estimates(bearing_only)
        columns = known.columns()
        columns.updated_s[known.rows_of(bearing_only.vessel_id)] = time_s
        match = match_identities(self, known, columns, memory.tracks, given)
        is_dark = _are_dark(known.shown, match.group_of_vessel[: len(known.shown)] < 0, given)
        order = order_vessels(self, columns, match, is_dark, time_s, memory.next_id)
        picture, known = picture_of(self, known, columns, match, order, tracks, given.fused, time_s)
        members = members_of(match, order, tracks)
        track_memory = tracks_of(match, order, tracks, given.associations.vessel)
        now = AisNow.of(tracks, track_memory.vessel, given.sensors.ais_source, len(picture))
        past = next_past(memory.ais_past, picture, known.hidden.vessel_id, now, time_s)
        picture, known = _without_outdated(picture, known, past, now)
        status = nav_statuses(picture.nav_status, tracks, track_memory.vessel, given.alarms)
        picture = replace(picture, nav_status=status)
        flag_memory, flags = flag(self, memory.flags, match, order, picture, past, now, given)
        flags |= ais_flags(picture.mmsi, status) | name_flags(self, past, picture, now, time_s)
        picture = with_details(replace(picture, flags=flags), tracks, track_memory.vessel)
        next_id = memory.next_id + int((match.vessel_of_group < 0).sum())
        confirmations, confirmed = confirm(
            self, memory.confirmations, tracks, track_memory.vessel, len(picture), time_s, given.sensors
        )
        shown = replace(known, shown=picture)
        after = PictureMemory(shown, track_memory, next_id, flag_memory, past, confirmations, confirmed)
        return after, PictureOutput(picture, members)


def _are_dark(shown: Picture, is_lost: Bools, given: PictureInput) -> Bools:
    """Which vessels of the last picture are dark, but for those without tracks where a radar's registration has jumped. (S,)

    These are where that radar showed them wrongly, and it shows them elsewhere now. Args: is_lost: (S,) have no track.
    """
    out: Bools = (shown.flags & Flag.DARK) != 0
    if given.jumped is not None and given.jumped.any():
        radars = given.sensors.radars
        reach_m = JUMP_REACH * radars.range_m[given.jumped]
        out &= ~(is_lost & within_any(shown.position_deg, radars.site_deg[given.jumped], reach_m))
    return out


def _without_outdated(picture: Picture, known: KnownVessels, past: AisPast, now: AisNow) -> tuple[Picture, KnownVessels]:
    """The picture, and the vessels of the next cycle, without the former MMSI and status of those that lose it."""
    hidden, shown = known.hidden, len(picture)
    mmsi, vessel_id = np.append(picture.mmsi, hidden.mmsi), np.append(picture.vessel_id, hidden.vessel_id)
    lost = outdated(mmsi, vessel_id, np.append(now.has_ais, np.zeros(len(hidden), np.bool_)), past, now)
    mmsi[lost] = -1
    status = np.where(lost, -1, np.append(picture.nav_status, hidden.nav_status))
    hidden = replace(hidden, mmsi=mmsi[shown:], nav_status=status[shown:])
    return replace(picture, mmsi=mmsi[:shown], nav_status=status[:shown]), replace(known, hidden=hidden)
