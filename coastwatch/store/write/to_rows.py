"""Batches of the pipeline as columns of rows, in the order of the tables' columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from coastwatch.batches import (
    AisAlarms,
    AisStatics,
    Array,
    Bools,
    Floats,
    Ints,
    Members,
    Picture,
    RadarCover,
    RegistrationState,
    Reports,
    Spots,
    StandingEchoes,
    member_rows,
)
from coastwatch.geodesy import ECCENTRICITY2
from coastwatch.kernels.tables.lookup import find
from coastwatch.store.rows import Categorical, Column, NullableId, motion

if TYPE_CHECKING:  # to read a database needs no stage of the pipeline, which are slow to import
    from coastwatch.centre import Cycle

UPPER = np.triu_indices(4)
SENSOR_KINDS = ("ais", "bearing", "feed", "radar", "tracks")  # in the order of the key

LastReport = dict[tuple[str, int], float]
"""Kind and number of a sensor -> arrival of its newest report, s."""


def vessel_rows(run_id: int, picture: Picture, sources: Categorical, interval_s: Floats) -> list[Column]:
    """Columns of table `vessel`.

    Args: picture: (V) sorted by vessel; sources: (V) from `source_texts`; interval_s: (V) from `ais_intervals`.
    """
    upper = picture.covariance[:, UPPER[0], UPPER[1]]
    covariance = np.ascontiguousarray(upper, "<f8").view("V80").ravel().astype(object)
    covariance[np.isnan(upper).any(1)] = None
    when: list[Column] = [
        picture.time_s,
        *picture.position_deg.T,
        *motion(picture.velocity_m_s, picture.covariance).T,
        picture.since_s,
        picture.updated_s,
    ]
    return [
        run_id,
        picture.vessel_id,
        *when,
        NullableId(picture.mmsi),
        picture.flags,
        sources,
        covariance,
        NullableId(picture.nav_status),
        interval_s,
        picture.existence,
        picture.echo_length_m,
        picture.echo_width_m,
        picture.echo_axis_deg,
        picture.alternative_m,
    ]


def ais_intervals(picture: Picture, members: Members, alarms: AisAlarms) -> Floats:
    """The interval at which AIS reports of each vessel are expected, the shortest of its tracks, NaN where it has none. (V,)

    Args: picture: sorted by vessel; alarms: one row for each AIS track.
    """
    order = np.argsort(alarms.track_id, kind="stable")
    at = find(alarms.track_id[order], members.track_id)
    row = find(picture.vessel_id, members.vessel_id)
    rows = np.flatnonzero((at >= 0) & (row >= 0))
    interval_s = np.full(len(picture), np.inf)
    np.fmin.at(interval_s, row[rows], alarms.interval_s[order[at[rows]]])
    return np.where(np.isfinite(interval_s), interval_s, np.nan)


def membership(cycle: Cycle) -> Ints:
    """(L, 3) vessel, source, track, sorted: the members of the picture and the bearing tracks that were given to a vessel."""
    rows = member_rows(cycle.members, cycle.picture.vessel_id, cycle.bearing_tracks, cycle.bearing_associations)
    return _sorted(rows[np.argsort(rows[:, 0], kind="stable")])


def changed_rows(before: Ints, now: Ints) -> tuple[Ints, Ints]:
    """Rows that are only in the first, and only in the second, of two tables that are sorted and have each row once.

    Each row is compared with the row of the same rank of its vessel (first column); only what differs there is sorted.
    """
    first, rank = np.searchsorted(before[:, 0], now[:, 0]), np.arange(len(now)) - np.searchsorted(now[:, 0], now[:, 0])
    at = np.flatnonzero(first + rank < len(before))
    partner = (first + rank)[at]
    same = (before[partner] == now[at]).all(1)
    left, came = np.ones(len(before), np.bool_), np.ones(len(now), np.bool_)
    left[partner[same]] = came[at[same]] = False
    gone, come = before[left], now[came]
    different = np.concatenate([gone, come])
    order = np.lexsort(different.T[::-1])
    twins = np.flatnonzero((different[order[1:]] == different[order[:-1]]).all(1))
    alone = np.ones(len(different), np.bool_)
    alone[order[twins]] = alone[order[twins + 1]] = False
    return gone[alone[: len(gone)]], come[alone[len(gone) :]]


def association_rows(run_id: int, number: int, cycle: Cycle, members: Ints) -> list[Column]:
    """Columns of table `association`, in key order. Args: members: (L, 3) from `membership`."""
    tracks, associations = cycle.tracks, cycle.associations
    ends = [column[row] for row in (associations.first, associations.second) for column in (tracks.source, tracks.track_id)]
    key = np.stack([_vessel_of(members, ends[0], ends[1]), *ends], 1)
    order = np.lexsort(key.T[::-1])
    return [run_id, number, *key[order].T, associations.statistic[order]]


def bearing_association_rows(run_id: int, number: int, cycle: Cycle) -> list[Column]:
    """Columns of table `bearing_association`, in key order."""
    tracks, associations = cycle.bearing_tracks, cycle.bearing_associations
    vessel, row = cycle.picture.vessel_id[associations.vessel_row], associations.bearing_row
    order = np.lexsort((tracks.track_id[row], tracks.source[row], vessel))
    row = row[order]
    bearing = np.degrees(tracks.bearing_rad[row]) % 360.0
    return [run_id, number, vessel[order], tracks.source[row], tracks.track_id[row], associations.statistic[order], bearing]


def bearing_track_rows(run_id: int, cycle: Cycle) -> list[Column]:
    """Columns of table `bearing_track`."""
    tracks, associations, picture = cycle.bearing_tracks, cycle.bearing_associations, cycle.picture
    vessel = np.full(len(tracks), -1, np.int64)
    vessel[associations.bearing_row] = picture.vessel_id[associations.vessel_row]
    where = (np.degrees(tracks.bearing_rad) % 360.0, np.degrees(tracks.rate_rad_s), *tracks.site_deg.T)
    return [run_id, tracks.source, tracks.track_id, *where, NullableId(vessel), tracks.updated_s]


def spot_rows(run_id: int, number: int, spots: Spots) -> list[Column]:
    """Columns of table `spot`."""
    x, y, z = spots.centre_m.T
    latitude = np.degrees(np.arctan2(z, (1.0 - ECCENTRICITY2) * np.hypot(x, y)))
    count = len(spots.centre_m)
    sizes = [np.bincount(spot_of_track, minlength=count) for spot_of_track in (spots.spot, spots.halo_spot)]
    return [run_id, number, np.arange(count), latitude, np.degrees(np.arctan2(y, x)), *sizes]


def timing_rows(
    run_id: int, number: int, cycle: Cycle, reports: Reports, seconds: Mapping[str, float], kinds: Sequence[str]
) -> list[Column]:
    """Columns of table `stage_timing`. Args: seconds: of each stage, in order; kinds: of the sources."""
    ais = int((np.array([kind == "ais" for kind in kinds], np.bool_)[cycle.tracks.source]).sum())
    counts = {
        "plots": len(reports.radar),
        "tracks": len(cycle.tracks) - ais,
        "ais_tracks": ais,
        "bearing_tracks": len(cycle.bearing_tracks),
        "spots": len(cycle.spots.centre_m),
        "associations": len(cycle.associations.first),
        "fused_tracks": len(cycle.fused),
        "picture": len(cycle.picture),
        "octants": len(cycle.octants.bearing_row),
        "bearing_associations": len(cycle.bearing_associations.bearing_row),
        "registration": len(cycle.corrections),
    }
    order, took = np.arange(len(seconds)), np.array([float(s) for s in seconds.values()])
    return [run_id, number, order, list(seconds), took, [counts.get(stage) for stage in seconds]]


def static_rows(reports: AisStatics) -> tuple[Ints, dict[str, Column]]:
    """One row an MMSI, sorted, and of each column the newest value: a message that leaves something out does not erase it."""
    order = np.argsort(reports.mmsi, kind="stable")
    mmsi = reports.mmsi[order]
    first = np.flatnonzero(np.append(True, mmsi[1:] != mmsi[:-1])[: len(mmsi)])

    def newest(is_stated: Bools) -> Array:
        """Row of the newest message of each MMSI that gives a value, -1: none does."""
        rows = np.maximum.reduceat(np.where(is_stated[order], np.arange(len(order)), -1), first)
        return np.where(rows < 0, -1, order[rows])

    def numbers(column: Array) -> Array:
        rows = newest(~np.isnan(column))
        return np.where(rows < 0, np.nan, column[rows])

    def texts(column: Array) -> list[Any]:
        # without what PostgreSQL cannot hold, and the padding of AIS
        cleaned = [text.replace("\x00", "").strip().rstrip("@") for text in column.tolist()]
        return [None if row < 0 else cleaned[row] for row in newest(np.array([x != "" for x in cleaned], np.bool_)).tolist()]

    ship_type = newest(reports.ship_type >= 0)
    return mmsi[first], {
        "name": texts(reports.name),
        "call_sign": texts(reports.call_sign),
        "ship_type": NullableId(np.where(ship_type < 0, -1, reports.ship_type[ship_type])),
        "length_m": numbers(reports.length_m),
        "beam_m": numbers(reports.beam_m),
        "updated_s": reports.received_s[newest(np.ones(len(reports), np.bool_))],
    }


def last_reports(before: LastReport, reports: Reports) -> LastReport:
    """When each sensor was received last. AIS reports do not say which receiver took them: they count for the first."""
    last = dict(before)
    for kind, part in (("radar", reports.radar), ("bearing", reports.bearing), ("tracks", reports.tracks)):
        newest_s = np.full(int(part.sensor.max(initial=-1)) + 1, -np.inf)
        np.maximum.at(newest_s, part.sensor, part.received_s)
        for sensor in np.flatnonzero(newest_s > -np.inf).tolist():
            last[kind, sensor] = max(float(newest_s[sensor]), last.get((kind, sensor), -np.inf))
    for video in reports.video.parts:
        if len(video):
            last["radar", video.sensor] = max(float(video.received_s.max()), last.get(("radar", video.sensor), -np.inf))
    if len(reports.ais):
        newest = float(reports.ais.received_s.max())
        last["ais", 0] = max(newest, last.get(("ais", 0), newest))
        for feed in np.unique(reports.ais.feed[reports.ais.feed >= 0]).tolist():
            newest = float(reports.ais.received_s[reports.ais.feed == feed].max())
            last["feed", feed] = max(newest, last.get(("feed", feed), newest))
    return last


def newest_reports(before: LastReport, after: LastReport) -> LastReport:
    """When each sensor was received last, of two such times."""
    return before | {sensor: max(heard_s, before.get(sensor, heard_s)) for sensor, heard_s in after.items()}


def cover_rows(run_id: int, number: int, cover: RadarCover) -> list[Column]:
    """Columns of table `sensor_cover`."""
    per_km2 = 1e6 * cover.false_plots_per_m2
    grids = cover.ais_detection, cover.ais_looks, cover.track_detection, cover.track_looks, per_km2
    as_bytes = [[grid.astype("<f4").tobytes() for grid in of_radars] for of_radars in grids]
    radars = np.arange(len(cover))
    return [run_id, radars, number, cover.site_deg[:, 0], cover.site_deg[:, 1], cover.range_m, cover.turns, *as_bytes]


def standing_echo_rows(run_id: int, number: int, echoes: StandingEchoes) -> list[Column]:
    """Columns of table `standing_echo`."""
    values = echoes.extent_m, echoes.plots_per_turn, echoes.turns
    return [run_id, np.arange(len(echoes)), echoes.radar, number, *echoes.position_deg.T, *values]


VIDEO_VALUES = (
    "turn_s", "spokes_a_turn", "spokes_lost", "parts_lost", "lost_share", "plots_a_turn", "threshold_db", "detection_probability",
    "false_plots_a_turn",
)  # fmt: skip
"""What is stored of a radar that sends video: columns of `sensor_registration`, in their order."""


def registration_rows(
    run_id: int, number: int, cycle: Cycle, last_report: LastReport, stations: int, feeds: int, video: Floats
) -> list[Column]:
    """Columns of table `sensor_registration`, in key order: AIS receivers, bearing sensors, feeds of AIS, radars, track
    sources.

    Args: stations: AIS receivers; feeds: of AIS; video: (R, 9) `VIDEO_VALUES` of the radars, NaN: not known; no rows: no video.
    """
    c, t, bias = cycle.corrections, cycle.track_sources, np.degrees(cycle.bearing_associations.sensor_bias_rad)
    counts = (stations, len(bias), feeds, len(c), len(t))
    kinds = np.repeat(np.arange(len(counts)), counts)
    numbers = np.concatenate([np.arange(n) for n in counts])
    sensors = [("ais", 0) if kind == 0 else (SENSOR_KINDS[kind], k) for kind, k in zip(kinds, numbers.tolist(), strict=True)]
    others = stations + len(bias) + feeds

    def of_radars(values: Floats) -> Floats:
        return np.concatenate([np.full(others, np.nan), np.where(np.isfinite(values), values, np.nan), np.full(len(t), np.nan)])

    azimuth = of_radars(np.degrees(c.azimuth_bias_rad))
    azimuth[stations : stations + len(bias)] = bias
    azimuth_sigma, sigma_rad = of_radars(np.degrees(c.azimuth_sigma_rad)), cycle.bearing_associations.sensor_bias_sigma_rad
    azimuth_sigma[stations : stations + len(sigma_rad)] = np.degrees(sigma_rad)
    radars = (c.range_bias_m, c.range_sigma_m, c.time_lag_s, c.estimated_lag_s, c.lag_sigma_s)
    none, jitter = np.full(others, -1), np.full(len(kinds), np.nan)
    after, before = np.full(len(t), -1), np.full(others + len(c), -1)
    heard_feeds = min(feeds, len(cycle.ais_feeds))
    jitter[stations + len(bias) :][:heard_feeds] = cycle.ais_feeds.time_jitter_s[:heard_feeds]

    def numbers_of_radars(values: Floats) -> NullableId:
        whole = np.where(np.isfinite(values), np.nan_to_num(values), -1.0).astype(np.int64)
        return NullableId(np.concatenate([none, whole, after]))

    evidence = np.degrees(c.candidate_azimuth_rad), c.candidate_range_m, c.odds, c.found_odds
    of_video = (video if len(video) else np.full((len(c), len(VIDEO_VALUES)), np.nan)).T
    turn_s, whole, others_of_video = of_video[0], of_video[1:4], of_video[4:]
    return [
        run_id,
        number,
        Categorical(kinds, SENSOR_KINDS),
        numbers,
        np.array([last_report.get(sensor, np.nan) for sensor in sensors], float),
        Categorical(np.concatenate([none, c.state, after]), [state.name.lower() for state in RegistrationState]),
        azimuth,
        azimuth_sigma,
        *map(of_radars, radars),
        NullableId(np.concatenate([none, c.references, t.partners])),
        of_radars(c.residuals),
        jitter,
        numbers_of_radars(c.compared),
        *map(of_radars, evidence),
        numbers_of_radars(c.voices),
        of_radars(c.rival_share),
        *(NullableId(np.concatenate([before, counted])) for counted in (t.states, t.dropped, t.tracks)),
        *(np.concatenate([before * np.nan, sigma]) for sigma in (t.position_sigma_m, t.velocity_sigma_m_s)),
        of_radars(np.where(np.isfinite(c.range_scale_sigma), c.range_scale, np.nan)),
        of_radars(c.range_scale_sigma),
        *map(of_radars, np.where(np.isfinite(c.site_sigma_m), c.site_error_m, np.nan).T),
        of_radars(c.site_sigma_m.max(axis=1)),
        *map(of_radars, c.noise_factor.T),
        of_radars(turn_s),
        *map(numbers_of_radars, whole),
        *map(of_radars, others_of_video),
    ]


def _sorted(rows: Ints) -> Ints:
    """Rows sorted by their columns; those of most cycles are sorted already."""
    differ = rows[1:] != rows[:-1]
    at = differ.argmax(1)
    k = np.arange(len(at))
    in_order = (rows[1:][k, at] >= rows[:-1][k, at]).all()
    return rows if in_order else rows[np.lexsort(rows.T[::-1])]


def _vessel_of(members: Ints, source: Ints, track: Ints) -> Ints:
    """The vessel that has each track, -1 where none has. Args: members: (L, 3) vessel, source, track; source, track: (A,)."""
    vessel = np.full(len(source), -1, np.int64)
    for number in np.unique(source).tolist():
        rows, of_source = np.flatnonzero(source == number), members[members[:, 1] == number]
        of_source = of_source[np.argsort(of_source[:, 2], kind="stable")]
        at = find(of_source[:, 2], track[rows])
        vessel[rows[at >= 0]] = of_source[at[at >= 0], 0]
    return vessel
