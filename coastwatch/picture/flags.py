"""What an operator should look at: dark, unseen, contradicted, doubled, impossible."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from coastwatch import kernels
from coastwatch.batches import AisAlarms, Bools, Flag, Floats, Members, Picture, Rows, Sensors, Tracks
from coastwatch.kernels.threads import in_blocks
from coastwatch.picture.cover import Cover, cover
from coastwatch.picture.succession import Heirs, LineUp

if TYPE_CHECKING:
    from coastwatch.picture.identity import Identity


Seen = NDArray[np.int8]


@dataclass(frozen=True, eq=False)
class FlagMemory:
    """Since when each vessel that is shown is as it is; and of each AIS track the radar track that was last one vessel with it."""

    no_ais_since_s: Floats  # (R,) inf: has AIS or is not where AIS is heard
    no_radar_since_s: Floats  # (R,) inf: has radar or is not where a radar sees
    mate: Rows  # (N,) row of the radar track, -1 where none
    paired_since_s: Floats  # (N,) inf where there is no mate
    parted_since_s: Floats  # (N,) inf while they are one

    @staticmethod
    def empty() -> FlagMemory:
        f = np.zeros(0)
        return FlagMemory(f, f, np.zeros(0, np.int32), f, f)


@dataclass(frozen=True, eq=False)
class Company:
    """Who is one vessel with whom."""

    seen_by: Seen  # (R,) 1 with a radar track, 2 with an AIS track, 3 with both
    mate: Rows  # (N,) the first radar track in the vessel of an AIS track, -1 where none
    paired: Bools  # (N,) whether a radar track is the mate of an AIS track


def together(heirs: Heirs, line: LineUp, tracks: Tracks, sensors: Sensors) -> tuple[Members, Company]:
    """The tracks of each row of the picture."""

    n = len(tracks)
    out = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.int64)
    pairs = np.empty(len(line.come), np.int8), np.full(n, -1, np.int32), np.zeros(n, np.bool_)
    given = heirs.start, heirs.row, (tracks.track_id, tracks.source), sensors.source_kinds
    in_blocks(
        kernels.identity.picture_columns.members, len(line.come), line.come, line.begin, line.vessel_id, *given, out, pairs
    )
    return Members(*out), Company(*pairs)


def flag(
    settings: Identity,
    memory: FlagMemory,
    heirs: Heirs,
    line: LineUp,
    company: Company,
    shown: Picture,
    tracks: Tracks,
    row: Rows,
    alarms: AisAlarms,
    time_s: float,
    sensors: Sensors,
) -> FlagMemory:
    """Adds the flags of this cycle to those of the picture, which was made for it. Args: row: (N,) of each track in the picture.

    Returns: the memory after this cycle.
    """

    heard, seen = (cover(by.site_deg, settings.cover_margin * by.range_m) for by in (sensors.stations, sensors.radars))
    since = np.empty(len(shown)), np.empty(len(shown))
    before = memory.no_ais_since_s, memory.no_radar_since_s
    late = settings.dark_after_s, int(Flag.DARK), settings.unseen_after_s, int(Flag.AIS_WITHOUT_RADAR)
    given = line.come, heirs.chosen, shown.position_deg, company.seen_by, heard, seen, before, (float(time_s), *late)
    in_blocks(kernels.identity.alerts.unseen, len(shown), *given, (*since, shown.flags))
    pairs, contradicted = _part(settings, memory, heirs, company, shown, tracks, row, time_s, seen)
    ais = np.flatnonzero(contradicted)
    for track in (ais, pairs[0][ais]):
        shown.flags[row[track]] |= int(Flag.AIS_CONTRADICTED)
    _alarm(alarms, tracks, row, shown)
    return FlagMemory(since[0], since[1], *pairs)


def _part(
    settings: Identity,
    memory: FlagMemory,
    heirs: Heirs,
    company: Company,
    shown: Picture,
    tracks: Tracks,
    row: Rows,
    time_s: float,
    seen: Cover,
) -> tuple[tuple[Rows, Floats, Floats], Bools]:
    """Mates with paired since and parted since, of this cycle and those of the past that still count; which are contradicted. (N,) each"""

    n, s = len(tracks), settings
    pairs, contradicted = (company.mate, np.empty(n), np.empty(n)), np.empty(n, np.bool_)
    past = memory.mate, memory.paired_since_s, memory.parted_since_s
    limits = float(time_s), s.paired_s, s.contradicted_for_s, s.contradicted_after_s, s.contradicted_from_m
    given = heirs.at, heirs.to, past, company.paired, row, shown.position_deg, tracks.position_deg, seen, limits
    in_blocks(kernels.identity.alerts.parted, n, *given, (*pairs, contradicted))
    return pairs, contradicted


def _alarm(alarms: AisAlarms, tracks: Tracks, row: Rows, shown: Picture) -> None:
    """Adds what is odd about AIS tracks to the flags. AIS tracks mostly are the last of all, in the order of the alarms."""

    for alarm, what in ((alarms.twice, Flag.MMSI_TWICE), (alarms.impossible_speed, Flag.IMPOSSIBLE_SPEED)):
        odd = np.flatnonzero(alarm)
        at = kernels.tables.match_ids.standing(tracks.track_id, alarms.track_id[odd], odd + (len(tracks) - len(alarms)))
        shown.flags[row[at[at >= 0]]] |= int(what)
