"""Evidence of an event in words: its figures, since when a sensor is silent, and which tracks the vessel has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache

import numpy as np

from coastwatch.batches import (
    AlarmKind,
    BearingAssociations,
    BearingTracks,
    Flag,
    Floats,
    Ints,
    Members,
    Picture,
    SensorHearing,
    Sensors,
    Tracks,
    VesselAlarms,
    nav_status_text,
)
from coastwatch.batches.events import EVENT_KINDS
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M, difference_m
from coastwatch.kernels.tables.lookup import find

WITH_STATUS = ("ais_sart", "man_overboard", "epirb", "not_under_command", "aground")
"""Kinds whose evidence has the navigational status: a distress device under test says "undefined"."""

MOST_NAMED = 3
"""Sensors that a text names; the others are counted."""


@dataclass(frozen=True, eq=False)
class Expected:
    """The sensors of a kind by name and site, where the picture counts on them, and the limit of the flag for their silence."""

    names: Sequence[str]
    site_deg: Floats  # (R, 2)
    range_m: Floats  # (R,)
    limit_s: float

    def in_range(self, position_deg: Floats) -> list[list[str]]:
        """The names of the sensors that reach each position, nearest first. Args: position_deg: (B, 2)."""
        if not self.names:
            return [[] for _ in position_deg]
        apart = difference_m(position_deg[:, None, :], self.site_deg[None])
        distance_m = np.hypot(apart[..., 0], apart[..., 1])
        reaches, order = distance_m <= self.range_m, np.argsort(distance_m, axis=1, kind="stable")
        return [[self.names[k] for k in of if there[k]] for of, there in zip(order.tolist(), reaches.tolist(), strict=True)]


@lru_cache(maxsize=4)
def expected_sensors(sensors: Sensors, margin: float, dark_after_s: float, unseen_after_s: float) -> tuple[Expected, Expected]:
    """The AIS stations and the radars. It is cached: the sensors are the same object throughout a run.

    Args: margin: share of a range that counts as covered; the others: limits of the flags DARK and AIS_WITHOUT_RADAR.
    """
    stations, radars = sensors.stations, sensors.radars
    return (
        Expected([str(name) for name in stations.name], stations.site_deg, margin * stations.range_m, dark_after_s),
        Expected([str(name) for name in radars.name], radars.site_deg, margin * radars.range_m, unseen_after_s),
    )


@dataclass(frozen=True, eq=False)
class Evidence:
    """What evidence needs beside the picture and the alarms."""

    tracks: Tracks  # of the cycle
    members: Members
    bearing_tracks: BearingTracks
    bearing_associations: BearingAssociations  # its rows of vessels are of the picture
    names: Sequence[str]  # of the sources
    stations: Expected
    radars: Expected
    ais_heard_s: Floats  # (V,) newest AIS report of each vessel; -inf: not known
    hearing: SensorHearing | None = None  # which sensors are heard; none: all

    def members_of(self, vessel_id: Ints, picture: Picture) -> Ints:
        """(L, 3) vessel, source, track, sorted: the tracks of some vessels, those of bearings among them."""
        m, bearings, found = self.members, self.bearing_tracks, self.bearing_associations
        of_bearings = (
            picture.vessel_id[found.vessel_row],
            bearings.source[found.bearing_row],
            bearings.track_id[found.bearing_row],
        )
        parts = [np.stack(columns, 1) for columns in ((m.vessel_id, m.source, m.track_id), of_bearings)]
        rows = np.concatenate([part[np.isin(part[:, 0], vessel_id)] for part in parts])
        return rows[np.lexsort(rows.T[::-1])]


def texts(
    row: Ints, kind: Ints, alarm: Ints, picture: Picture, alarms: VesselAlarms, time_s: float, evidence: Evidence
) -> list[str]:
    """One text for each event that begins.

    Args: row: (B,) of the picture, -1: the vessel has left; kind: (B,); alarm: (B,) row of the alarms, -1: the event is of a flag.
    """
    parts: list[list[str]] = [[] for _ in row]
    raised = np.flatnonzero(alarm >= 0)
    for k, text in zip(raised.tolist(), _of_alarms(alarms.take(alarm[raised]), picture, evidence), strict=True):
        parts[k].append(text)
    for flag, silence in ((Flag.DARK, _ais_silence), (Flag.AIS_WITHOUT_RADAR, _radar_silence)):
        of = np.flatnonzero((kind == flag.value.bit_length() - 1) & (alarm < 0))
        for k, text in zip(of.tolist(), silence(row[of], picture, time_s, evidence), strict=True):
            parts[k].append(text)
    here = np.flatnonzero(row >= 0)
    for k, text in zip(here.tolist(), _of_vessels(row[here], kind[here], picture, evidence), strict=True):
        parts[k].append(text)
    return ["; ".join(said) for said in parts]


def _ais_silence(row: Ints, picture: Picture, time_s: float, evidence: Evidence) -> list[str]:
    """Since when each vessel is not heard on AIS, and which stations should hear it. Args: row: (B,) of the picture."""
    heard_s = evidence.ais_heard_s[row] if len(evidence.ais_heard_s) else np.full(len(row), -np.inf)
    stations = evidence.stations
    near = stations.in_range(picture.position_deg[row])
    out = []
    for last_s, mmsi, names in zip(heard_s.tolist(), picture.mmsi[row].tolist(), near, strict=True):
        if last_s > -np.inf:
            said = f"last AIS {datetime.fromtimestamp(last_s, UTC):%Y-%m-%d %H:%M:%S} UTC, {time_s - last_s:.0f} s before"
        else:
            said = "no AIS since it came back" if mmsi >= 0 else "never heard on AIS"
        out.append(f"{said}{_named('AIS station', names)}; limit {stations.limit_s:g} s")
    return out


def _radar_silence(row: Ints, picture: Picture, time_s: float, evidence: Evidence) -> list[str]:
    """Which radars should see each vessel that has AIS alone. Args: row: (B,) of the picture."""
    radars = evidence.radars
    near = radars.in_range(picture.position_deg[row])
    return [f"AIS goes on without a radar track{_named('radar', names)}; limit {radars.limit_s:g} s" for names in near]


def _named(what: str, found: Sequence[str]) -> str:
    """Such as "; in range of radars north, south and 2 more"."""
    if not found:
        return ""
    shown, more = ", ".join(found[:MOST_NAMED]), len(found) - MOST_NAMED
    return f"; in range of {what}{'s' if len(found) > 1 else ''} {shown}" + (f" and {more} more" if more > 0 else "")


def _of_vessels(row: Ints, kind: Ints, picture: Picture, evidence: Evidence) -> list[str]:
    """The tracks of each vessel: how fast, how old and how far from the first they are; for some kinds other vessels and its status.

    Args: row: (B,) of the picture; kind: (B,).
    """
    members, tracks = evidence.members_of(picture.vessel_id[row], picture), evidence.tracks
    low, high = (np.searchsorted(members[:, 0], picture.vessel_id[row], side).tolist() for side in ("left", "right"))
    age_s = (picture.time_s[row] - picture.updated_s[row]).tolist()
    found = np.flatnonzero(np.isin(tracks.track_id, members[:, 2]))
    keys = zip(tracks.source[found].tolist(), tracks.track_id[found].tolist(), strict=True)
    at = dict(zip(keys, found.tolist(), strict=True))
    out = []
    for k, number in enumerate(kind.tolist()):
        of_vessel = [(source, track) for _, source, track in members[low[k] : high[k]].tolist()]
        seen = _of_tracks(of_vessel, at, evidence.names, tracks)
        text = f"seen by {', '.join(seen)}" if seen else f"no track, last report {age_s[k]:.0f} s before"
        if EVENT_KINDS[number] == "mmsi_twice":
            text += _of_same_mmsi(int(row[k]), picture)
        if EVENT_KINDS[number] in WITH_STATUS and picture.nav_status[row[k]] >= 0:
            text += f"; navigational status {nav_status_text(int(picture.nav_status[row[k]]))}"
        out.append(text)
    return out


def _of_tracks(
    members: Sequence[tuple[int, int]], at: Mapping[tuple[int, int], int], names: Sequence[str], tracks: Tracks
) -> list[str]:
    """A text for each track of a vessel, and for each sonar. Args: members: source, track; at: their rows; bearings have none."""
    rows = [at[member] for member in members if member in at]
    out = []
    for source, track in dict.fromkeys(member if member in at else (member[0], -1) for member in members):
        row = at.get((source, track))
        text = f"bearings of {names[source]}" if row is None else names[source]
        if row is not None:
            speed_kn = float(np.hypot(*tracks.velocity_m_s[row])) / KNOT_M_S
            about = [f"{speed_kn:.1f} kn"] if np.isfinite(speed_kn) else []
            about += [f"{tracks.time_s[row] - tracks.updated_s[row]:.0f} s old"]
            if row != rows[0]:
                away_m = np.hypot(*difference_m(tracks.position_deg[[row]], tracks.position_deg[rows[:1]])[0])
                about += [f"{away_m:.0f} m from the first"]
            text += f" ({', '.join(about)})"
        out.append(text)
    return out


def _of_same_mmsi(row: int, picture: Picture) -> str:
    """The other vessels with the MMSI of a row, and how far they are."""
    others = np.flatnonzero(picture.mmsi == picture.mmsi[row]) if picture.mmsi[row] >= 0 else np.zeros(0, np.int64)
    others = others[others != row]
    apart_m = np.hypot(*difference_m(picture.position_deg[others], picture.position_deg[[row] * len(others)]).T)
    pairs = zip(picture.vessel_id[others].tolist(), apart_m.tolist(), strict=True)
    return "".join(f"; same MMSI as vessel {vessel}, {metres:.0f} m away" for vessel, metres in pairs)


def _of_alarms(alarms: VesselAlarms, picture: Picture, evidence: Evidence) -> list[str]:
    """One text for each alarm: its zone, the other vessel or the silent sensor, and its figures."""
    speed_kn = np.hypot(*alarms.velocity_m_s.T) / KNOT_M_S
    other = find(picture.vessel_id, alarms.subject)
    age_s = np.append(picture.time_s - picture.updated_s, np.nan)
    own_s, other_s = age_s[find(picture.vessel_id, alarms.vessel_id)], age_s[other]
    out = []
    for k, number in enumerate(alarms.kind.tolist()):
        kind, name = AlarmKind(number), str(alarms.name[k])
        distance_m, range_m, interval_s = (
            float(column[k]) for column in (alarms.distance_m, alarms.range_m, alarms.interval_s)
        )
        if kind == AlarmKind.LINE_CROSSED:
            said = f"line {name}, to its {'right' if alarms.to_right[k] > 0 else 'left'}"
        elif kind == AlarmKind.ZONE_DWELL:
            said = f"zone {name}, inside for {interval_s:.0f} s"
        elif kind == AlarmKind.ZONE_SPEED:
            said = f"zone {name}, {speed_kn[k]:.1f} kn"
        elif kind == AlarmKind.CLOSE_APPROACH:
            mmsi = int(picture.mmsi[other[k]]) if other[k] >= 0 else -1
            called = f"vessel {alarms.subject[k]}" + (f" (MMSI {mmsi:09d})" if mmsi >= 0 else "")
            passing = f"CPA {distance_m / NAUTICAL_MILE_M:.2f} NM in {interval_s / 60.0:.1f} min"
            said = f"with {called}, {passing}, range {range_m / NAUTICAL_MILE_M:.2f} NM"
            if np.isfinite(own_s[k] + other_s[k]):
                said += f", positions {own_s[k]:.0f} and {other_s[k]:.0f} s old"
        elif kind == AlarmKind.ANCHOR_DRAG:
            said = f"{distance_m:.0f} m from where it lay for {interval_s / 60.0:.0f} min"
        elif kind == AlarmKind.LOST:
            said = f"no track for {interval_s:.0f} s, under way at {speed_kn[k]:.1f} kn before"
        elif kind in (AlarmKind.AIS_SILENT, AlarmKind.RADAR_SILENT, AlarmKind.SOURCE_SILENT):
            said = _of_silence(kind, int(alarms.subject[k]), name, interval_s, picture, evidence)
        else:
            said = f"zone {name}"
        out.append(said)
    return out


def _of_silence(kind: AlarmKind, number: int, name: str, interval_s: float, picture: Picture, evidence: Evidence) -> str:
    """Since when a sensor is silent, how much was heard of it before, and how many vessels nobody judges by it.

    Args: number: of the sensor, from 1 on; 0: AIS as a whole.
    """
    expected = evidence.radars if kind == AlarmKind.RADAR_SILENT else evidence.stations
    what, thing, known = {
        AlarmKind.AIS_SILENT: (f"AIS station {name}" if name else "AIS", "AIS report", "stations" if number else "ais"),
        AlarmKind.RADAR_SILENT: (f"radar {name}", "plot", "radars"),
        AlarmKind.SOURCE_SILENT: (f"track source {name}", "track", "track_sources"),
    }[kind]
    said = f"{what} is silent: no {thing} for {interval_s:.0f} s"
    if evidence.hearing is not None:
        of, row = getattr(evidence.hearing, known), max(number - 1, 0)
        amount = {"AIS report": "vessels on AIS", "plot": "plots a cycle", "track": "tracks a cycle"}[thing]
        said += f", one every {of.usual_s[row]:.1f} s or oftener before; {of.amount[row]:.0f} {amount} then"
    if kind != AlarmKind.SOURCE_SILENT:
        rows = range(len(expected.names)) if number == 0 else [number - 1]
        reached = np.zeros(len(picture), np.bool_)
        for row in rows:
            apart = difference_m(picture.position_deg, np.broadcast_to(expected.site_deg[row], picture.position_deg.shape))
            reached |= np.hypot(apart[:, 0], apart[:, 1]) <= expected.range_m[row]
        names = ", ".join(expected.names[row] for row in rows[:MOST_NAMED])
        more = f" and {len(rows) - MOST_NAMED} more" if len(rows) > MOST_NAMED else ""
        said += f"; vessels in range of {names}{more}: {int(reached.sum())}"
    return f"{said}; no flag and no loss follows from its silence"
