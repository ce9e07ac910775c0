"""Events: from when until when a vessel had a flag or an alarm. One that returns soon goes on with its event: flapping is one event.

Rows are written only when a flag is set or cleared, or an alarm begins or ends. A gap within an event is a row of `event_gap`: from it
a run that goes on from an older checkpoint restores when the event had ended.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from sqlalchemy import Connection, delete, func, or_, select, update

from coastwatch.batches import AlarmKind, Bools, Flag, Floats, Ints, Picture, Tracks, VesselAlarms, joint_keys, nav_status_text
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M, difference_m
from coastwatch.kernels.tables.lookup import find
from coastwatch.store.read.rows import fetch_arrays
from coastwatch.store.schema.tables import EVENT, EVENT_GAP
from coastwatch.store.write.expected import Expected, reasons
from coastwatch.store.write.insert import Categorical, Column, NullableId, clear_columns, insert, update_rows

OF_FLAGS = {flag.value.bit_length() - 1: str(flag.name).lower() for flag in Flag}
"""Bit of a flag -> kind of its events."""

KINDS = OF_FLAGS | {int(kind): kind.name.lower() for kind in AlarmKind}
"""Bit of a flag, or number of a kind of alarm -> kind of its events."""

OF_STATUS = ("ais_sart", "man_overboard", "epirb", "not_under_command", "aground")
"""Kinds of events whose evidence has the navigational status: a distress device under test says "undefined"."""

BITS = 64
"""A key is vessel_id * BITS + bit of the flag, or number of the kind of alarm."""

E = EVENT.c


@dataclass(frozen=True, eq=False)
class Events:
    """The events that last, and those that ended lately. E rows, sorted; of each key and subject at most one."""

    key: Ints  # (E,)
    subject: Ints  # (E,) of an alarm: number of the zone or id of the other vessel; 0: none
    from_cycle: Ints  # (E,)
    to_cycle: Ints  # (E,) last cycle with the flag; -1: it lasts
    end_s: Floats  # (E,) its time; NaN: it lasts

    def take(self, rows: Ints | Bools) -> Events:
        """Some of them."""
        return Events(*(getattr(self, name)[rows] for name in vars(self)))


class Why(NamedTuple):
    """What evidence needs beside the picture and its tracks."""

    expected: Expected
    ais_heard_s: Floats  # (V,) newest AIS report of each vessel of the picture; none: not known

    @classmethod
    def nothing(cls) -> Why:
        """Nothing is known."""
        return cls(Expected.none(), np.zeros(0))


class Changes(NamedTuple):
    """What a cycle changes."""

    number: int  # of the cycle
    time_s: float
    ended: Events  # whose flag was set until the cycle before
    returned: Events  # as they had ended
    begun: Ints  # (B,) keys
    subjects: Ints  # (B,) of those that have begun


def extend(
    before: Events, number: int, time_s: float, before_s: float, picture: Picture, alarms: VesselAlarms, gap_s: float
) -> tuple[Events, Changes]:
    """The events after a cycle.

    Args: before: after the cycle before, whose time is before_s; picture: sorted by vessel; gap_s: a flag or alarm that was there so
    lately goes on with its event.
    """
    key, subject = _keys(picture, alarms)
    old, now = joint_keys((before.key, before.subject), (key, subject))
    lasts = before.to_cycle < 0
    at = find(old, now)
    known = at >= 0
    returns = np.zeros(len(now), np.bool_)
    returns[known] = ~lasts[at[known]] & (time_s - before.end_s[at[known]] <= gap_s)
    new = ~(known & (returns | lasts[at])) if len(old) else np.ones(len(now), np.bool_)
    gone = lasts & (find(now, old) < 0)
    returned = before.take(at[returns])

    to_cycle, end_s = before.to_cycle.copy(), before.end_s.copy()
    to_cycle[gone], end_s[gone] = number - 1, before_s
    to_cycle[at[returns]], end_s[at[returns]] = -1, np.nan
    kept = (to_cycle < 0) | (time_s - end_s <= gap_s)
    ended = Events(before.key, before.subject, before.from_cycle, to_cycle, end_s)
    after, count = ended.take(kept), int(new.sum())
    if count:
        begun = Events(key[new], subject[new], np.full(count, number), np.full(count, -1), np.full(count, np.nan))
        order = np.argsort(np.append(old[kept], now[new]), kind="stable")
        after = Events(*(np.concatenate([getattr(after, c), getattr(begun, c)])[order] for c in vars(begun)))
    return after, Changes(number, time_s, ended.take(gone), returned, key[new], subject[new])


def write_events(
    connection: Connection,
    run_id: int,
    changes: Changes,
    picture: Picture,
    alarms: VesselAlarms,
    members: Ints,
    names: Sequence[str],
    tracks: Tracks,
    *,
    why: Why,
) -> int:
    """Write what a cycle changed. Returns: rows inserted.

    Args: picture: sorted by vessel; alarms: of the cycle; members: (L, 3) vessel, source, track, sorted; names: of the sources;
    tracks: of the cycle; why: flags are set.
    """
    of_run, ended, returned = {"run_id": run_id}, changes.ended, changes.returned
    if len(ended.key):
        update_rows(connection, EVENT, _named(ended), of_run, {"to_cycle": ended.to_cycle, "end_s": ended.end_s})
    rows = 0
    if len(returned.key):
        clear_columns(connection, EVENT, _named(returned), of_run, ("to_cycle", "end_s"))
        gaps = [run_id, *_named(returned).values(), changes.number, returned.to_cycle, returned.end_s]
        rows += insert(connection, EVENT_GAP, gaps)
    is_flag = np.isin(changes.begun % BITS, list(OF_FLAGS))
    if is_flag.any():
        vessel_id, bit = np.divmod(changes.begun[is_flag], BITS)
        row = find(picture.vessel_id, vessel_id)
        then = picture.position_deg[row], picture.velocity_m_s[row], picture.mmsi[row]
        said = _of_flags(row, bit, picture, why, changes.time_s)
        of_tracks = _evidence(row, bit, picture, members, names, tracks)
        said = [f"{reason}; {text}" if reason else text for reason, text in zip(said, of_tracks, strict=True)]
        rows += _insert(connection, run_id, changes, changes.begun[is_flag], changes.subjects[is_flag], then, said)
    if not is_flag.all():
        keys = changes.begun[~is_flag], changes.subjects[~is_flag]
        all_keys, begun = joint_keys((alarms.vessel_id * BITS + alarms.kind, alarms.subject), keys)
        raised = alarms.take(find(all_keys, begun))
        row = find(picture.vessel_id, raised.vessel_id)
        here = np.flatnonzero(row >= 0)
        of_vessels = [""] * len(row)
        for k, text in zip(
            here.tolist(), _evidence(row[here], raised.kind[here], picture, members, names, tracks), strict=True
        ):
            of_vessels[k] = f"; {text}"
        said = [of_alarm + of_vessel for of_alarm, of_vessel in zip(_of_alarms(raised, picture), of_vessels, strict=True)]
        then = raised.position_deg, raised.velocity_m_s, raised.mmsi
        rows += _insert(connection, run_id, changes, *keys, then, said)
    return rows


def read_events(connection: Connection, run_id: int, since_s: float) -> Events:
    """The events of a run that last or ended since an instant."""
    since = or_(E.to_cycle.is_(None), E.end_s >= since_s) if np.isfinite(since_s) else E.to_cycle.is_(None)
    query = select(E.vessel_id, E.kind, E.subject, E.from_cycle, E.to_cycle, E.end_s).where(E.run_id == run_id, since)
    vessel_id, kind, subject, from_cycle, to_cycle, end_s = fetch_arrays(connection, query)
    bits = {name: bit for bit, name in KINDS.items()}
    known = np.array([name in bits for name in kind], np.bool_)
    key = vessel_id[known] * BITS + np.array([bits[name] for name in kind[known]], np.int64)
    found = Events(key, *(column[known] for column in (subject, from_cycle, to_cycle, end_s)))
    found = found.take(np.lexsort((found.from_cycle, found.subject, found.key)))
    joint = joint_keys((found.key, found.subject))[0]
    newest = np.append(joint[1:] != joint[:-1], True)[: len(joint)]
    return found.take(newest)


def truncate_events(connection: Connection, run_id: int, number: int) -> None:
    """The events as they were after the cycle before this one. The rows of `event_gap` since this cycle are needed, and left."""
    connection.execute(delete(EVENT).where(E.run_id == run_id, E.from_cycle >= number))
    later = update(EVENT).where(E.run_id == run_id, E.to_cycle >= number - 1)
    connection.execute(later.values(to_cycle=None, end_s=None))
    g = EVENT_GAP.c
    of_event = g.vessel_id, g.kind, g.subject, g.from_cycle
    first = select(*of_event, func.min(g.last_cycle), func.min(g.last_s))
    first = first.where(g.run_id == run_id, g.cycle >= number).group_by(*of_event)
    gaps = [row for row in connection.execute(first) if row[4] < number - 1]
    if gaps:
        vessel, kind, subject, from_cycle, last_cycle, last_s = map(list, zip(*gaps, strict=True))
        keys: dict[str, Column] = {"vessel_id": vessel, "kind": kind, "subject": subject, "from_cycle": from_cycle}
        update_rows(connection, EVENT, keys, {"run_id": run_id}, {"to_cycle": last_cycle, "end_s": last_s})


def _keys(picture: Picture, alarms: VesselAlarms) -> tuple[Ints, Ints]:
    """Key and subject of each flag that is set and of each alarm, sorted."""
    rows = np.flatnonzero(picture.flags)
    bits = np.array(list(OF_FLAGS), np.int64)
    at, bit = np.nonzero((picture.flags[rows, None] >> bits) & 1)
    key, subject = picture.vessel_id[rows[at]] * BITS + bits[bit], np.zeros(len(at), np.int64)
    if len(alarms):
        key, subject = np.append(key, alarms.vessel_id * BITS + alarms.kind), np.append(subject, alarms.subject)
        order = np.lexsort((subject, key))
        key, subject = key[order], subject[order]
    return key, subject


def _insert(
    connection: Connection,
    run_id: int,
    changes: Changes,
    key: Ints,
    subject: Ints,
    then: tuple[Floats, Floats, Ints],
    said: list[str],
) -> int:
    """Insert events that have begun. Args: then: position, velocity and MMSI of each vessel; said: evidence."""
    vessel_id, bit = np.divmod(key, BITS)
    position_deg, velocity_m_s, mmsi = then
    speed_kn = np.hypot(*velocity_m_s.T) / KNOT_M_S
    of_event: list[Column] = [run_id, vessel_id, _kind(bit), subject, changes.number, None, changes.time_s, None]
    of_vessel: list[Any] = [*position_deg.T, speed_kn, NullableId(mmsi), said]
    return insert(connection, EVENT, [*of_event, *of_vessel])


def _named(events: Events) -> Mapping[str, Column]:
    vessel_id, bit = np.divmod(events.key, BITS)
    return {"vessel_id": vessel_id, "kind": _kind(bit), "subject": events.subject, "from_cycle": events.from_cycle}


def _kind(bit: Ints) -> Categorical:
    return Categorical(bit, [KINDS.get(k, "") for k in range(max(KINDS) + 1)])


def _of_flags(row: Ints, bit: Ints, picture: Picture, why: Why, time_s: float) -> list[str]:
    """Why the flag of each event is set, where a sensor is silent; else empty. Args: row: (B,) of the picture; bit: (B,)."""
    out = [""] * len(row)
    for flag in (Flag.DARK, Flag.AIS_WITHOUT_RADAR):
        of = np.flatnonzero(bit == flag.value.bit_length() - 1)
        for k, text in zip(of.tolist(), reasons(why.expected, flag, picture, row[of], time_s, why.ais_heard_s), strict=True):
            out[k] = text
    return out


def _evidence(row: Ints, bit: Ints, picture: Picture, members: Ints, names: Sequence[str], tracks: Tracks) -> list[str]:
    """One text for each event: the tracks of its vessel, how fast, how old and how far from the first they are, and other vessels.

    Args: row: (B,) of the picture; bit: (B,).
    """
    low, high = (np.searchsorted(members[:, 0], picture.vessel_id[row], side).tolist() for side in ("left", "right"))
    age_s = (picture.time_s[row] - picture.updated_s[row]).tolist()
    parts = [members[a:b, 2] for a, b in zip(low, high, strict=True)]
    found = np.flatnonzero(np.isin(tracks.track_id, np.concatenate([np.zeros(0, np.int64), *parts])))
    keys = zip(tracks.source[found].tolist(), tracks.track_id[found].tolist(), strict=True)
    at = dict(zip(keys, found.tolist(), strict=True))
    out = []
    for k, kind in enumerate(bit.tolist()):
        said = _of_tracks([(source, track) for _, source, track in members[low[k] : high[k]].tolist()], at, names, tracks)
        text = f"seen by {', '.join(said)}" if said else f"no track, last report {age_s[k]:.0f} s before"
        if KINDS[kind] == "mmsi_twice":
            text += _of_same_mmsi(int(row[k]), picture)
        if KINDS[kind] in OF_STATUS and picture.nav_status[row[k]] >= 0:
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


def _of_alarms(alarms: VesselAlarms, picture: Picture) -> list[str]:
    """One text for each alarm: its zone, the other vessel, and its figures."""
    speed_kn = np.hypot(*alarms.velocity_m_s.T) / KNOT_M_S
    other = find(picture.vessel_id, alarms.subject)
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
        elif kind == AlarmKind.ANCHOR_DRAG:
            said = f"{distance_m:.0f} m from where it lay for {interval_s / 60.0:.0f} min"
        elif kind == AlarmKind.LOST:
            said = f"no track for {interval_s:.0f} s, under way at {speed_kn[k]:.1f} kn before"
        else:
            said = f"zone {name}"
        out.append(said)
    return out
