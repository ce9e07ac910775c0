"""When flags and alarms begin and end, and why each begins, in words. One that returns soon goes on with its event."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import lru_cache
from string import Formatter

import numpy as np

from coastwatch import kernels
from coastwatch.alarms.lasting import KEYS
from coastwatch.batches import (
    AlarmKind,
    BearingAssociations,
    BearingTracks,
    BegunEvents,
    Bools,
    EventChanges,
    EventSpans,
    Flag,
    Floats,
    Hearing,
    Ints,
    Members,
    Picture,
    SensorHearing,
    Sensors,
    Tracks,
    VesselAlarms,
    joint_keys,
    member_rows,
    nav_status_text,
)
from coastwatch.batches.kinds import FLAG_NUMBERS, KINDS, Subject
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M, difference_m
from coastwatch.kernels.tables.lookup import find

MOST_NAMED = 3
"""Sensors that a text names; the others are counted."""

SILENT_SENSORS = {
    Subject.STATION: ("AIS report", "vessels on AIS"),
    Subject.RADAR: ("plot", "plots, or spokes of video, a cycle"),
    Subject.SOURCE: ("track", "tracks a cycle"),
}
"""What a sensor sends, and what was counted of it before it fell silent."""


@dataclass(frozen=True, eq=False)
class EventMemory:
    """The events that last, and those that ended lately. E rows, sorted; of each key and subject at most one."""

    key: Ints  # (E,)
    subject: Ints  # (E,) of an alarm: number of the zone or sensor, or id of the other vessel; 0: none
    start_s: Floats  # (E,)
    end_s: Floats  # (E,) time of the last cycle with the flag or alarm; NaN: it lasts
    time_s: float  # of the newest cycle; -inf before the first

    @classmethod
    def none(cls) -> EventMemory:
        """Before the first cycle."""
        number, time = np.zeros(0, np.int64), np.zeros(0)
        return cls(number, number, time, time, -np.inf)

    def spans(self, rows: Ints | Bools) -> EventSpans:
        """Some of the events."""
        vessel_id, kind = np.divmod(self.key[rows], KEYS)
        return EventSpans(vessel_id, kind, self.subject[rows], self.start_s[rows], self.end_s[rows])


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
        offset_m = difference_m(position_deg[:, None, :], self.site_deg[None])
        distance_m = np.hypot(offset_m[..., 0], offset_m[..., 1])
        reaches, order = distance_m <= self.range_m, np.argsort(distance_m, axis=1, kind="stable")
        return [[self.names[k] for k in rows if there[k]] for rows, there in zip(order.tolist(), reaches.tolist(), strict=True)]


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
class EvidenceContext:
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
        rows = member_rows(self.members, picture.vessel_id, self.bearing_tracks, self.bearing_associations)
        rows = rows[find(np.unique(vessel_id), rows[:, 0]) >= 0]
        return rows[np.lexsort(rows.T[::-1])]


def next_events(
    memory: EventMemory, picture: Picture, alarms: VesselAlarms, time_s: float, gap_s: float, context: EvidenceContext
) -> tuple[EventMemory, EventChanges]:
    """The events after a cycle, and what it changed.

    Args: picture: sorted by vessel; alarms: that hold; gap_s: a flag or alarm that was there so lately goes on with its event.
    """
    key, subject = _keys(picture, alarms)
    old, now = joint_keys((memory.key, memory.subject), (key, subject))
    lasts = np.isnan(memory.end_s)
    at = find(old, now)
    was_there = at >= 0
    returns = np.zeros(len(now), np.bool_)
    returns[was_there] = ~lasts[at[was_there]] & (time_s - memory.end_s[at[was_there]] <= gap_s)
    new = ~(was_there & (returns | lasts[at])) if len(old) else np.ones(len(now), np.bool_)
    gone = lasts & (find(now, old) < 0)
    returned = memory.spans(at[returns])

    end_s = memory.end_s.copy()
    end_s[gone] = memory.time_s
    ended = replace(memory, end_s=end_s).spans(gone)
    end_s[at[returns]] = np.nan
    kept = np.isnan(end_s) | (time_s - end_s <= gap_s)
    begins = np.full(int(new.sum()), time_s)
    order = np.argsort(np.append(old[kept], now[new]), kind="stable")
    after = EventMemory(
        np.append(memory.key[kept], key[new])[order],
        np.append(memory.subject[kept], subject[new])[order],
        np.append(memory.start_s[kept], begins)[order],
        np.append(end_s[kept], np.full(len(begins), np.nan))[order],
        time_s,
    )
    changes = EventChanges(_begun(key[new], subject[new], time_s, picture, alarms, context), ended, returned)
    return after, changes


def _keys(picture: Picture, alarms: VesselAlarms) -> tuple[Ints, Ints]:
    """Key and subject of each flag that is set and of each alarm, sorted."""
    rows = np.flatnonzero(picture.flags)
    at, flag = np.nonzero((picture.flags[rows, None] >> FLAG_NUMBERS) & 1)
    key, subject = picture.vessel_id[rows[at]] * KEYS + FLAG_NUMBERS[flag], np.zeros(len(at), np.int64)
    if len(alarms):
        key, subject = np.append(key, alarms.vessel_id * KEYS + alarms.kind), np.append(subject, alarms.subject)
        order = np.lexsort((subject, key))
        key, subject = key[order], subject[order]
    return key, subject


def _begun(
    key: Ints, subject: Ints, time_s: float, picture: Picture, alarms: VesselAlarms, context: EvidenceContext
) -> BegunEvents:
    """The events that begin. A flag has the position of its vessel in the picture, an alarm its own: the vessel may have left."""
    if not len(key):
        return BegunEvents.empty()
    vessel_id, kind = np.divmod(key, KEYS)
    row = find(picture.vessel_id, vessel_id)
    of_alarms, wanted = joint_keys((alarms.vessel_id * KEYS + alarms.kind, alarms.subject), (key, subject))
    alarm = find(of_alarms, wanted)
    raised = alarm >= 0
    position_deg, velocity_m_s = np.full((len(key), 2), np.nan), np.full((len(key), 2), np.nan)
    mmsi = np.full(len(key), -1, np.int64)
    for column, of_picture, of_alarm in (
        (position_deg, picture.position_deg, alarms.position_deg),
        (velocity_m_s, picture.velocity_m_s, alarms.velocity_m_s),
        (mmsi, picture.mmsi, alarms.mmsi),
    ):
        column[~raised] = of_picture[row[~raised]]
        column[raised] = of_alarm[alarm[raised]]
    speed_kn = np.hypot(*velocity_m_s.T) / KNOT_M_S
    try:
        evidence = texts(row, kind, alarm, picture, alarms, time_s, context)
    except Exception as error:  # an alarm without its evidence is better than no alarm, and than no picture
        evidence = [f"no evidence, {type(error).__name__}: {error}"] * len(key)
    start_s = np.full(len(key), time_s)
    return BegunEvents(vessel_id, kind, subject, start_s, position_deg, speed_kn, mmsi, np.array(evidence, object))


@dataclass(frozen=True, eq=False)
class Beginning:
    """The events of one kind that begin in a cycle. B rows."""

    kind: Flag | AlarmKind
    row: Ints  # (B,) of the picture; -1: the vessel has left
    alarms: VesselAlarms  # (B) rows; of a flag none
    tracks: Sequence[str]  # (B,) texts
    picture: Picture
    time_s: float
    context: EvidenceContext


def texts(
    row: Ints, kind: Ints, alarm: Ints, picture: Picture, alarms: VesselAlarms, time_s: float, context: EvidenceContext
) -> list[str]:
    """The evidence of each event that begins, by the form that the table of kinds has for it.

    Args: row: (B,) of the picture, -1: the vessel has left; kind: (B,); alarm: (B,) row of the alarms, -1: the event is of a flag.
    """
    evidence, here = [""] * len(row), np.flatnonzero(row >= 0)
    tracks = [""] * len(row)
    for k, text in zip(here.tolist(), _track_texts(row[here], picture, context), strict=True):
        tracks[k] = text
    for number in np.unique(kind).tolist():
        rows = np.flatnonzero(kind == number)
        of_kind = alarms.take(alarm[rows][alarm[rows] >= 0])
        begins = Beginning(KINDS[number], row[rows], of_kind, [tracks[k] for k in rows.tolist()], picture, time_s, context)
        form = begins.kind.evidence
        fields = {name: FIELDS[name](begins) for name in field_names(form)}
        for at, k in enumerate(rows.tolist()):
            evidence[k] = form.format_map({name: values[at] for name, values in fields.items()}).removesuffix("; ")
    return evidence


@lru_cache(maxsize=64)
def field_names(form: str) -> tuple[str, ...]:
    """The fields that the form of an evidence has."""
    return tuple(dict.fromkeys(name for _, name, _, _ in Formatter().parse(form) if name))


def _ais_silence(begins: Beginning) -> list[str]:
    """Since when each vessel is not heard on AIS, and which stations should hear it."""
    row, picture, stations, known_s = begins.row, begins.picture, begins.context.stations, begins.context.ais_heard_s
    heard_s = known_s[row] if len(known_s) else np.full(len(row), -np.inf)
    near = stations.in_range(picture.position_deg[row])
    sentences = []
    for last_s, mmsi, names in zip(heard_s.tolist(), picture.mmsi[row].tolist(), near, strict=True):
        if last_s > -np.inf:
            text = (
                f"last AIS {datetime.fromtimestamp(last_s, UTC):%Y-%m-%d %H:%M:%S} UTC, {begins.time_s - last_s:.0f} s before"
            )
        else:
            text = "no AIS since it came back" if mmsi >= 0 else "never heard on AIS"
        sentences.append(f"{text}{_in_range_of('AIS station', names)}; limit {stations.limit_s:g} s")
    return sentences


def _radar_silence(begins: Beginning) -> list[str]:
    """Which radars should see each vessel that has AIS alone."""
    radars = begins.context.radars
    near = radars.in_range(begins.picture.position_deg[begins.row])
    return [f"AIS goes on without a radar track{_in_range_of('radar', names)}; limit {radars.limit_s:g} s" for names in near]


def _in_range_of(what: str, names: Sequence[str]) -> str:
    """Such as "; in range of radars north, south and 2 more"."""
    return f"; in range of {what}{'s' if len(names) > 1 else ''} {_some_of(names)}" if names else ""


def _some_of(names: Sequence[str]) -> str:
    """Such as "north, south, east and 2 more"."""
    unnamed = len(names) - MOST_NAMED
    return ", ".join(names[:MOST_NAMED]) + (f" and {unnamed} more" if unnamed > 0 else "")


def _track_texts(row: Ints, picture: Picture, context: EvidenceContext) -> list[str]:
    """The tracks of each vessel: how fast, how old and how far from the first they are. Args: row: (B,) of the picture."""
    vessel_id, tracks = picture.vessel_id[row], context.tracks
    members = context.members_of(vessel_id, picture)
    at = kernels.tables.match_ids.index_of(tracks.track_id, members[:, 2].copy())
    at[np.append(tracks.source, -1)[at] != members[:, 1]] = -1  # a bearing, whose id another track may have
    low, high = (np.searchsorted(members[:, 0], vessel_id, side).tolist() for side in ("left", "right"))
    is_track = np.flatnonzero(at >= 0)
    row_of, first = at[is_track], is_track[np.searchsorted(members[is_track, 0], members[is_track, 0])]
    away_m = np.hypot(*difference_m(tracks.position_deg[row_of], tracks.position_deg[at[first]]).T)
    speed_kn = np.hypot(*tracks.velocity_m_s[row_of].T) / KNOT_M_S
    age_s = tracks.time_s[row_of] - tracks.updated_s[row_of]
    text = [f"bearings of {context.names[source]}" for source in members[:, 1].tolist()]
    values = zip(is_track.tolist(), first.tolist(), speed_kn.tolist(), age_s.tolist(), away_m.tolist(), strict=True)
    for k, k_first, speed, age, away in values:
        about = f"{speed:.1f} kn, {age:.0f} s old" if np.isfinite(speed) else f"{age:.0f} s old"
        about += "" if k == k_first else f", {away:.0f} m from the first"
        text[k] = f"{context.names[members[k, 1]]} ({about})"
    without_s = (picture.time_s[row] - picture.updated_s[row]).tolist()
    keys = list(zip(at.tolist(), text, strict=True))
    of_vessel = [[text for _, text in dict.fromkeys(keys[a:b])] for a, b in zip(low, high, strict=True)]
    return [
        f"seen by {', '.join(some)}" if some else f"no track, last report {age:.0f} s before"
        for some, age in zip(of_vessel, without_s, strict=True)
    ]


def _same_mmsi(begins: Beginning) -> list[str]:
    """The other vessels with the MMSI of each, and how far they are."""
    picture, sentences = begins.picture, []
    for row in begins.row.tolist():
        others = np.flatnonzero(picture.mmsi == picture.mmsi[row]) if picture.mmsi[row] >= 0 else np.zeros(0, np.int64)
        others = others[others != row]
        apart_m = np.hypot(*difference_m(picture.position_deg[others], picture.position_deg[[row] * len(others)]).T)
        pairs = zip(picture.vessel_id[others].tolist(), apart_m.tolist(), strict=True)
        sentences.append("".join(f"; same MMSI as vessel {vessel}, {metres:.0f} m away" for vessel, metres in pairs))
    return sentences


def _status(begins: Beginning) -> list[str]:
    """The navigational status of each, if one was sent: a distress device under test says "undefined"."""
    codes = begins.picture.nav_status[begins.row].tolist()
    return [f"; navigational status {nav_status_text(code)}" if code >= 0 else "" for code in codes]


def _other_vessels(begins: Beginning) -> list[str]:
    """The other vessel of each alarm, with its MMSI."""
    vessel_id, sentences = begins.alarms.subject, []
    for vessel, row in zip(vessel_id.tolist(), find(begins.picture.vessel_id, vessel_id).tolist(), strict=True):
        mmsi = int(begins.picture.mmsi[row]) if row >= 0 else -1
        sentences.append(f"vessel {vessel}" + (f" (MMSI {mmsi:09d})" if mmsi >= 0 else ""))
    return sentences


def _ages(begins: Beginning) -> list[str]:
    """How old the positions of both vessels of each alarm are."""
    picture, alarms = begins.picture, begins.alarms
    age_s = np.append(picture.time_s - picture.updated_s, np.nan)
    pairs = np.stack([age_s[find(picture.vessel_id, ids)] for ids in (alarms.vessel_id, alarms.subject)], 1)
    return [f", positions {own:.0f} and {other:.0f} s old" if np.isfinite(own + other) else "" for own, other in pairs.tolist()]


def _habits(begins: Beginning) -> list[str]:
    """How often each silent sensor was heard before, and how much of it."""
    hearing, amount = begins.context.hearing, SILENT_SENSORS[begins.kind.subject][1]
    sentences = []
    for number in begins.alarms.subject.tolist():
        heard, row = None if hearing is None else _hearing_of(hearing, begins.kind.subject, number), max(number - 1, 0)
        if heard is None:
            sentences.append("")
        elif not np.isfinite(heard.heard_s[row]):
            sentences.append(", and none since the start of the run")
        else:
            usual = f"one every {heard.usual_s[row]:.1f} s or oftener before"
            sentences.append(f", {usual}; {heard.amount[row]:.0f} {amount} then")
    return sentences


def _hearing_of(hearing: SensorHearing, subject: Subject, number: int) -> Hearing:
    """The sensors among which one is. Args: number: of the sensor, from 1 on; 0: AIS as a whole."""
    if subject == Subject.STATION:
        return hearing.stations if number else hearing.ais
    return hearing.radars if subject == Subject.RADAR else hearing.track_sources


def _reach(begins: Beginning) -> list[str]:
    """How many vessels are in range of each silent sensor: nobody judges them by it."""
    if begins.kind.subject == Subject.SOURCE:
        return [""] * len(begins.alarms)
    picture = begins.picture
    expected = begins.context.radars if begins.kind.subject == Subject.RADAR else begins.context.stations
    sentences = []
    for number in begins.alarms.subject.tolist():
        rows = range(len(expected.names)) if number == 0 else [number - 1]
        reached = np.zeros(len(picture), np.bool_)
        for row in rows:
            offset_m = difference_m(picture.position_deg, np.broadcast_to(expected.site_deg[row], picture.position_deg.shape))
            reached |= np.hypot(offset_m[:, 0], offset_m[:, 1]) <= expected.range_m[row]
        names = _some_of([expected.names[row] for row in rows])
        sentences.append(f"; vessels in range of {names}: {int(reached.sum())}")
    return sentences


FIELDS: Mapping[str, Callable[[Beginning], Sequence[object]]] = {
    "name": lambda begins: begins.alarms.name.tolist(),
    "distance_m": lambda begins: begins.alarms.distance_m.tolist(),
    "distance_nm": lambda begins: (begins.alarms.distance_m / NAUTICAL_MILE_M).tolist(),
    "range_nm": lambda begins: (begins.alarms.range_m / NAUTICAL_MILE_M).tolist(),
    "interval_s": lambda begins: begins.alarms.interval_s.tolist(),
    "interval_min": lambda begins: (begins.alarms.interval_s / 60.0).tolist(),
    "speed_kn": lambda begins: (np.hypot(*begins.alarms.velocity_m_s.T) / KNOT_M_S).tolist(),
    "side": lambda begins: ["right" if right > 0 else "left" for right in begins.alarms.to_right.tolist()],
    "other": _other_vessels,
    "ages": _ages,
    "sensor": lambda begins: [f"{begins.kind.subject} {name}" if name else "AIS" for name in begins.alarms.name.tolist()],
    "report": lambda begins: [SILENT_SENSORS[begins.kind.subject][0]] * len(begins.alarms),
    "habit": _habits,
    "reach": _reach,
    "ais_silence": _ais_silence,
    "radar_silence": _radar_silence,
    "same_mmsi": _same_mmsi,
    "status": _status,
    "tracks": lambda begins: begins.tracks,
}
"""The fields that evidence may have: a value for each event of a kind that begins. The forms stand in `batches.kinds`."""
