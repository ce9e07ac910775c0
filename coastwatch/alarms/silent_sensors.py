"""Silent sensors: what holds of vessels that only they would see stands still, and an alarm for each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from coastwatch.alarms.watched import AIS, RADAR, Watched
from coastwatch.batches import AlarmKind, Array, Floats, Hearing, Ints, Picture, SensorHearing, Sensors, VesselAlarms
from coastwatch.batches.hearing import SensorCover

NO_VESSEL = 0
"""Id of the vessel in alarms that are of a sensor: ids of vessels begin at 1."""


def standing(
    watched: Watched,
    rows: Ints,
    covers: tuple[SensorCover, SensorCover],
    track_sources: Hearing,
    then_deg: Floats,
    time_s: float,
) -> Watched:
    """The watched vessels, of which those that only silent sensors would see are as old as when these were heard last.

    A vessel that had a track then is not lost when its sensors are heard again, since it may return under another id. When and
    where it was seen last stay true: `placed_s` and `position_deg`.
    Args: rows: (K,) vessels without a track; covers: of AIS stations and radars; track_sources: what only a silent
    one tracked stands wherever it is; then_deg: (K, 2) where each would be.
    """
    from_s, is_seen = np.full(len(rows), np.inf), np.zeros(len(rows), np.bool_)
    for bit, cover in zip((AIS, RADAR), covers, strict=True):
        of_kind = (watched.sources[rows] & bit) != 0
        is_seen |= cover.within(then_deg, of_kind)
        from_s = np.minimum(from_s, cover.stands_from_s(then_deg, of_kind))
    source = watched.track_source[rows]
    given_s = np.append(track_sources.stands_from_s, np.inf)[source]
    by_source = np.isfinite(given_s)
    from_s[by_source], is_seen[by_source] = given_s[by_source], False
    stands = np.isfinite(from_s) & ~is_seen
    if not stands.any():
        return watched
    at, from_s = rows[stands], from_s[stands]
    sources, seen_s, since_s = watched.sources.copy(), watched.seen_s.copy(), watched.since_s.copy()
    away_s = from_s - seen_s[at]
    sources[at[away_s <= 0.0]] = 0
    moved_s = time_s - np.maximum(away_s, 0.0) - seen_s[at]
    seen_s[at] += moved_s
    since_s[at] += moved_s
    return replace(watched, sources=sources, seen_s=seen_s, since_s=since_s)


def sensor_alarms(hearing: SensorHearing, sensors: Sensors, picture: Picture, time_s: float) -> VesselAlarms:
    """An alarm for each sensor that is silent, and one for AIS where no station is heard.

    Its subject is the number of the sensor from 1 on, 0 for AIS as a whole; its name the name of the sensor.
    """
    stations, radars, sources = sensors.stations, sensors.radars, sensors.track_sources
    parts: list[VesselAlarms] = []
    if len(stations):
        if hearing.ais.silent[0]:
            name = str(stations.name[0]) if len(stations) == 1 else ""
            centre_deg = stations.site_deg[[int(np.argmax(stations.range_m))]]
            parts.append(_alarms(AlarmKind.AIS_SILENT, hearing.ais, np.array([name]), centre_deg, -1, time_s))
        else:
            parts.append(_alarms(AlarmKind.AIS_SILENT, hearing.stations, stations.name, stations.site_deg, 0, time_s))
    parts.append(_alarms(AlarmKind.RADAR_SILENT, hearing.radars, radars.name, radars.site_deg, 0, time_s))
    site_deg = np.where(np.isfinite(sources.site_deg), sources.site_deg, _middle_deg(picture, sensors))
    parts.append(_alarms(AlarmKind.SOURCE_SILENT, hearing.track_sources, sources.name, site_deg, 0, time_s))
    return VesselAlarms.join(parts)


def _alarms(kind: AlarmKind, hearing: Hearing, name: Array, site_deg: Floats, first: int, time_s: float) -> VesselAlarms:
    """The alarms of one kind. Args: name, site_deg: of each sensor; first: number of the first, less one."""
    rows = np.flatnonzero(hearing.silent)
    since_s = np.where(
        np.isfinite(hearing.heard_s), hearing.heard_s, hearing.stands_from_s
    )  # never heard: the start of the run
    number, nan = np.zeros(len(rows), np.int64), np.full(len(rows), np.nan)
    return VesselAlarms(
        number + NO_VESSEL,
        number + int(kind),
        rows + 1 + first,
        name[rows].astype("U64"),
        site_deg[rows],
        np.full((len(rows), 2), np.nan),
        number - 1,
        nan,
        nan,
        time_s - since_s[rows],
        nan,
    )


def _middle_deg(picture: Picture, sensors: Sensors) -> Floats:
    """Somewhere among the vessels, for a source of which nobody said where it is. (2,)"""
    if len(picture):
        return np.asarray(picture.position_deg[len(picture) // 2])
    sites = np.concatenate([sensors.radars.site_deg, sensors.stations.site_deg, sensors.region_origin_deg, np.zeros((1, 2))])
    return np.asarray(sites[0])
