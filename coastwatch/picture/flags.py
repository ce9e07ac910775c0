"""What an operator should look at: dark, AIS without radar, AIS contradicted by radar, MMSI in two places, impossible speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch import kernels
from coastwatch.batches import AisAlarms, Bools, Flag, Floats, Ints, Picture, Sensors, SourceKind, Tracks
from coastwatch.geodesy import difference_m
from coastwatch.kernels.geometry.sensor_coverage import Coverage
from coastwatch.picture.match import IdentityMatch
from coastwatch.picture.order import VesselOrder
from coastwatch.picture.settings import IdentitySettings


@dataclass(frozen=True, eq=False)
class TrackPairs:
    """AIS tracks with the first radar track of their vessel, now or until lately. Tracks are rows of a cycle; no AIS track twice."""

    ais: Ints  # (P,)
    radar: Ints  # (P,)
    paired_since_s: Floats  # (P,)
    split_since_s: Floats  # (P,) inf while they are one vessel


@dataclass(frozen=True, eq=False)
class FlagMemory:
    """What the flags need of the last cycle."""

    no_ais_since_s: Floats  # (R,) of each row of the picture: radar without AIS where a station should hear it; inf if not so
    no_radar_since_s: Floats  # (R,) AIS without radar where a radar should see it; inf if not so
    pairs: TrackPairs

    @classmethod
    def none(cls) -> FlagMemory:
        row, none = np.zeros(0, np.int64), np.zeros(0)
        return cls(none, none, TrackPairs(row, row, none, none))


def flag(
    settings: IdentitySettings,
    memory: FlagMemory,
    match: IdentityMatch,
    order: VesselOrder,
    picture: Picture,
    tracks: Tracks,
    row_of_track: Ints,
    alarms: AisAlarms,
    time_s: float,
    sensors: Sensors,
) -> tuple[FlagMemory, Ints]:
    """The flags of each row of the picture, with those it has. Args: row_of_track: (N,) of the picture. Returns: memory, (R,)."""
    margin = settings.cover_margin
    coverage_of = kernels.geometry.sensor_coverage.coverage_of
    heard = coverage_of(sensors.stations.site_deg, margin * sensors.stations.range_m, 0.0)
    seen = coverage_of(sensors.radars.site_deg, margin * sensors.radars.range_m, 0.0)
    kind = sensors.source_kinds[tracks.source]
    has_radar, has_ais = (_rows_with(row_of_track[kind == k], len(picture)) for k in (SourceKind.RADAR, SourceKind.AIS))

    no_ais = _within(heard, picture, has_radar & ~has_ais)
    no_radar = _within(seen, picture, has_ais & ~has_radar)
    no_ais_since_s = _since(no_ais, memory.no_ais_since_s, order.vessel_of_row, time_s)
    no_radar_since_s = _since(no_radar, memory.no_radar_since_s, order.vessel_of_row, time_s)
    pairs = _track_pairs(settings, memory.pairs, match, picture, row_of_track, kind, time_s, seen)

    flags = picture.flags.copy()
    flags[time_s - no_ais_since_s >= settings.dark_after_s] |= int(Flag.DARK)
    flags[time_s - no_radar_since_s >= settings.unseen_after_s] |= int(Flag.AIS_WITHOUT_RADAR)
    contradicted = _contradicted(settings, pairs, tracks, time_s)
    for track in (pairs.ais[contradicted], pairs.radar[contradicted]):
        flags[row_of_track[track]] |= int(Flag.AIS_CONTRADICTED)
    for alarm, what in ((alarms.twice, Flag.MMSI_TWICE), (alarms.impossible_speed, Flag.IMPOSSIBLE_SPEED)):
        odd = np.isin(tracks.track_id, alarms.track_id[alarm])
        flags[row_of_track[odd]] |= int(what)
    return FlagMemory(no_ais_since_s, no_radar_since_s, pairs), flags


def _rows_with(rows: Ints, count: int) -> Bools:
    """Which of so many rows are among these."""
    out = np.zeros(count, np.bool_)
    out[rows] = True
    return out


def _within(coverage: Coverage, picture: Picture, asked: Bools) -> Bools:
    """Which of the rows that are asked for are in cover. (R,)"""
    out, rows = np.zeros(len(asked), np.bool_), np.flatnonzero(asked)
    out[rows] = kernels.geometry.sensor_coverage.in_any_range(coverage, picture.position_deg[rows])
    return out


def _since(holds: Bools, before_s: Floats, vessel_of_row: Ints, time_s: float) -> Floats:
    """Since when a condition holds: as at the last cycle, or now if it is new; inf where it does not hold. (R,)

    Args: holds: (R,); before_s: (S,) of the shown vessels of the last cycle; vessel_of_row: (R,).
    """
    out = np.full(len(holds), np.inf)
    rows = np.flatnonzero(holds)
    out[rows] = time_s
    rows = rows[(vessel_of_row[rows] >= 0) & (vessel_of_row[rows] < len(before_s))]
    out[rows] = np.minimum(before_s[vessel_of_row[rows]], time_s)
    return out


def _track_pairs(
    settings: IdentitySettings,
    before: TrackPairs,
    match: IdentityMatch,
    picture: Picture,
    row_of_track: Ints,
    kind: Ints,
    time_s: float,
    seen: Coverage,
) -> TrackPairs:
    """The pairs of this cycle, and those of the past that still count.

    A pair that has split counts until either track ends, either has another partner, the AIS track leaves the cover of radars, or
    `contradicted_for_s` is over; never if it was one vessel for less than `paired_s`.
    """
    radars, count = np.flatnonzero(kind == SourceKind.RADAR), len(kind)
    first_radar = np.full(len(picture), -1, np.int64)
    first_radar[row_of_track[radars[::-1]]] = radars[::-1]  # the last one written is the first of its vessel
    ais = np.flatnonzero(kind == SourceKind.AIS)
    ais = ais[first_radar[row_of_track[ais]] >= 0]
    radar = first_radar[row_of_track[ais]]

    ais_before, radar_before = match.track_now[before.ais], match.track_now[before.radar]

    pair_before = np.full(count, -1, np.int64)
    pair_before[ais_before[ais_before >= 0]] = np.flatnonzero(ais_before >= 0)
    paired_since_s = np.full(len(ais), float(time_s))
    old = np.flatnonzero(pair_before[ais] >= 0)
    pair = pair_before[ais[old]]
    same = radar_before[pair] == radar[old]
    paired_since_s[old[same]] = before.paired_since_s[pair[same]]

    has_partner = np.zeros(count, np.bool_)
    has_partner[ais] = has_partner[radar] = True
    split = np.flatnonzero((ais_before >= 0) & (radar_before >= 0))
    split = split[~has_partner[ais_before[split]] & ~has_partner[radar_before[split]]]
    split_since_s = np.minimum(before.split_since_s, time_s)
    long_enough = split_since_s[split] - before.paired_since_s[split] >= settings.paired_s
    split = split[long_enough & (time_s - split_since_s[split] <= settings.contradicted_for_s)]
    position_deg = picture.position_deg[row_of_track[ais_before[split]]]
    split = split[kernels.geometry.sensor_coverage.in_any_range(seen, position_deg)]
    return TrackPairs(
        np.append(ais, ais_before[split]),
        np.append(radar, radar_before[split]),
        np.append(paired_since_s, before.paired_since_s[split]),
        np.append(np.full(len(ais), np.inf), split_since_s[split]),
    )


def _contradicted(settings: IdentitySettings, pairs: TrackPairs, tracks: Tracks, time_s: float) -> Ints:
    """Pairs that have been split for long enough and are farther apart than a poor association would explain."""
    late = np.flatnonzero(time_s - pairs.split_since_s >= settings.contradicted_after_s)
    apart = difference_m(tracks.position_deg[pairs.ais[late]], tracks.position_deg[pairs.radar[late]])
    is_far = np.linalg.norm(apart, axis=1) >= settings.contradicted_from_m
    return np.asarray(late[is_far])
