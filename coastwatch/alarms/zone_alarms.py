"""Alarms of zones and lines: who has come in, left, stays too long, has a wrong speed, or has crossed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from coastwatch.alarms.lasting import KINDS, Holding, Lasting, extend
from coastwatch.alarms.raised import Raised
from coastwatch.alarms.settings import AlarmSettings
from coastwatch.alarms.watched import Seen
from coastwatch.alarms.zones import ByLatitude, Shape
from coastwatch.batches import AlarmKind, Bools, Floats, Ints, joint_keys
from coastwatch.kernels.tables.lookup import find

INSIDE = 0
"""Kind of the condition that a vessel is inside a zone; no alarm has it."""


@dataclass(frozen=True, eq=False)
class Moments:
    """Alarms of an instant, which last for `moment_s`. Rows sorted by key and subject, each pair once."""

    key: Ints
    subject: Ints
    until_s: Floats
    to_right: Floats

    @classmethod
    def none(cls) -> Moments:
        number, time = np.zeros(0, np.int64), np.zeros(0)
        return cls(number, number, time, time)


@dataclass(frozen=True, eq=False)
class ZoneMemory:
    """What alarms of zones need of the last cycle."""

    inside: Lasting  # subject: number of the zone; mark: the vessel was outside before, or was not seen before
    speeding: Lasting
    moments: Moments
    zones: Ints  # numbers of the zones, ascending
    began_s: float = np.nan  # first cycle of the run

    @classmethod
    def none(cls) -> ZoneMemory:
        number = np.zeros(0, np.int64)
        return cls(Lasting.none(), Lasting.none(), Moments.none(), number)


def zone_alarms(
    settings: AlarmSettings, memory: ZoneMemory, seen: Seen, zones: Sequence[Shape], time_s: float
) -> tuple[ZoneMemory, list[Raised]]:
    """The alarms of zones and lines that hold in a cycle."""
    if np.isnan(memory.began_s):
        memory = replace(memory, began_s=float(time_s))
    if not zones and not len(memory.zones):
        return memory, []
    positions = ByLatitude(seen.picture.position_deg)
    now, speeds = _inside(settings, memory, seen, positions, [shape for shape in zones if shape.is_area], time_s)
    limits = settings.open_s, settings.close_s, time_s
    inside, left = extend(memory.inside, now, seen.frozen, *limits)
    speeding, _ = extend(memory.speeding, speeds, seen.frozen, *limits)
    by_number = {shape.number: shape for shape in zones}
    of_zone = np.array([number in by_number for number in inside.subject.tolist()], np.bool_)
    inside = inside.take(of_zone)  # a zone that was deleted has no vessels
    moments = _moments(settings, memory.moments, seen, positions, left, by_number, time_s)

    stays = inside.take(inside.open)
    out = []
    lasted_s = time_s - stays.since_s
    entering, dwell_s = _of_zones(by_number, stays.subject)
    entered = entering & _has_entered(settings, stays, seen)
    for kind, rows in ((AlarmKind.ZONE_ENTER, entered), (AlarmKind.ZONE_DWELL, lasted_s > dwell_s)):
        out.append(Raised.of(kind, stays.vessel_id[rows], stays.subject[rows], interval_s=lasted_s[rows]))
    rows = speeding.open & np.isin(speeding.subject, list(by_number))
    out.append(Raised.of(AlarmKind.ZONE_SPEED, speeding.vessel_id[rows], speeding.subject[rows]))
    for kind in (AlarmKind.ZONE_LEAVE, AlarmKind.LINE_CROSSED):
        rows = moments.key % KINDS == kind
        out.append(Raised.of(kind, moments.key[rows] // KINDS, moments.subject[rows], to_right=moments.to_right[rows]))
    return ZoneMemory(inside, speeding, moments, np.array(sorted(by_number), np.int64), memory.began_s), out


def _has_entered(settings: AlarmSettings, stays: Lasting, seen: Seen) -> Bools:
    """Whether each stay is of a vessel that came from outside, or was first seen inside and tracked there for `first_seen_s`. (D,)"""
    at = find(seen.watched.vessel_id, stays.vessel_id)
    came_s, placed_s = (np.append(column, -np.inf)[at] for column in (seen.watched.came_s, seen.watched.placed_s))
    return stays.mark & ((came_s < stays.since_s) | (placed_s - stays.since_s >= settings.first_seen_s))


def _of_zones(by_number: dict[int, Shape], number: Ints) -> tuple[Bools, Floats]:
    """Whether entering each zone is an alarm, and the longest stay in it, inf: any. Args: number: (D,) of known zones."""
    known, index = np.unique(number, return_inverse=True)
    zones = [by_number[k].zone for k in known.tolist()]
    enter = np.array([zone.enter for zone in zones], np.bool_)
    dwell_s = np.array([np.inf if zone.dwell_s is None else zone.dwell_s for zone in zones], np.float64)
    return enter[index], dwell_s[index]


def _inside(
    settings: AlarmSettings, memory: ZoneMemory, seen: Seen, positions: ByLatitude, areas: Sequence[Shape], time_s: float
) -> tuple[Holding, Holding]:
    """Who is inside which area, and who has a wrong speed there, as conditions of this cycle.

    A vessel was outside before if it was watched before it came in, and the zone too. One that was not watched before counts too, but
    for the start of the run, and but for one that was seen last in the zone.
    """
    vessel_id, came_s = seen.picture.vessel_id, seen.watched.came_s[seen.rows]
    speed_m_s = seen.watched.speed_m_s[seen.rows]
    inside, speeds = [], []
    for shape in areas:
        rows = positions.near(shape)
        within, near = shape.contains(positions.position_deg[rows])
        rows, within = rows[near], within[near]
        mark = np.full(len(rows), np.isin(shape.number, memory.zones).item())
        first = np.flatnonzero(came_s[rows] == time_s)
        was_inside, _ = shape.contains(seen.before_deg[rows[first]])
        mark[first] &= ~was_inside & (time_s - memory.began_s >= settings.start_up_s)
        number = np.full(len(rows), shape.number)
        inside.append(Holding(vessel_id[rows] * KINDS + INSIDE, number, within, mark))
        lasts = shape.breaks_speed(speed_m_s[rows], -settings.zone_speed_margin_kn)
        wrong = within & shape.breaks_speed(speed_m_s[rows], 0.0)
        key = vessel_id[rows] * KINDS + AlarmKind.ZONE_SPEED
        speeds.append(Holding(key[lasts], number[lasts], wrong[lasts], mark[lasts]))
    return _sorted(inside), _sorted(speeds)


def _sorted(parts: Sequence[Holding]) -> Holding:
    number = np.zeros(0, np.int64)
    every = [Holding(number, number, number > 0, number > 0), *parts]
    joined = Holding(*(np.concatenate([getattr(part, name) for part in every]) for name in vars(every[0])))
    order = np.lexsort((joined.subject, joined.key))
    return Holding(*(getattr(joined, name)[order] for name in vars(joined)))


def _moments(
    settings: AlarmSettings,
    before: Moments,
    seen: Seen,
    positions: ByLatitude,
    left: Lasting,
    by_number: dict[int, Shape],
    time_s: float,
) -> Moments:
    """Alarms for leaving and crossing: the new ones, and those that are not over. Args: left: stays that have ended."""
    gone = find(seen.picture.vessel_id, left.vessel_id) < 0  # it has not left, it is not seen any more
    rows = [k for k in np.flatnonzero(~gone).tolist() if _alarms_leaving(by_number, int(left.subject[k]))]
    key = [left.vessel_id[rows] * KINDS + AlarmKind.ZONE_LEAVE]
    subject, to_right = [left.subject[rows]], [np.full(len(rows), np.nan)]
    for shape in by_number.values():
        wanted = {"both": (-1, 1), "to_left": (-1,), "to_right": (1,)}.get(shape.zone.crossing)
        if wanted is None:
            continue
        moved = np.flatnonzero(seen.moved)
        near = moved[_may_cross(shape, seen.way_from_deg[moved], positions.position_deg[moved])]
        sides = np.sign(shape.crossings(seen.way_from_deg[near], positions.position_deg[near]))
        rows_now = np.isin(sides, wanted)
        key.append(seen.picture.vessel_id[near[rows_now]] * KINDS + AlarmKind.LINE_CROSSED)
        subject.append(np.full(int(rows_now.sum()), shape.number))
        to_right.append(sides[rows_now].astype(np.float64))
    lasting = (before.until_s > time_s) & np.isin(before.subject, list(by_number))
    new = np.concatenate(key), np.concatenate(subject), np.concatenate(to_right)
    keys = np.append(new[0], before.key[lasting]), np.append(new[1], before.subject[lasting])
    until_s = np.append(np.full(len(new[0]), time_s + settings.moment_s), before.until_s[lasting])
    sides_of = np.append(new[2], before.to_right[lasting])
    joint = joint_keys(keys)[0]
    _, first = np.unique(joint, return_index=True)  # a new one is before an old one
    return Moments(keys[0][first], keys[1][first], until_s[first], sides_of[first])


def _alarms_leaving(by_number: dict[int, Shape], number: int) -> bool:
    return number in by_number and by_number[number].zone.leave


def _may_cross(shape: Shape, from_deg: Floats, to_deg: Floats) -> Bools:
    """Which ways begin or end in the box about a line, `LINE_REACH_M` wider than the line. (K,)"""
    south, north, half = shape.box_deg
    out = np.zeros(len(from_deg), np.bool_)
    for place in (from_deg, to_deg):
        away_deg = np.abs((place[:, 1] - shape.middle_deg[1] + 180.0) % 360.0 - 180.0)
        out |= (place[:, 0] >= south) & (place[:, 0] <= north) & (away_deg <= half)
    return out
