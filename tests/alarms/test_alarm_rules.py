"""Alarms beside the flags: zones, lines, close approaches, anchors, lost vessels; hysteresis; resumed from a checkpoint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from pydantic import ValidationError

from coastwatch.alarms import AlarmInput, AlarmRules, Zone, close_approach, numbered
from coastwatch.alarms.close_approach import SPANS, Approaching, close_pairs
from coastwatch.alarms.zone_alarms import Shape
from coastwatch.batches import (
    COVER_AZIMUTHS,
    COVER_RANGES,
    AlarmKind,
    Flag,
    Members,
    NavStatus,
    Picture,
    RadarCover,
    Radars,
    Sensors,
    Sonars,
    Stations,
    VesselAlarms,
)
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M, offset_deg
from coastwatch.server.checkpoint import load, save

pytestmark = pytest.mark.contract

PERIOD_S = 3.0
SITE = np.array([-17.0, 179.98])  # Fiji: zones lie across the antimeridian
RULES = AlarmRules(
    open_s=3.0,
    close_s=9.0,
    cpa_nm=0.1,
    tcpa_min=6.0,
    cpa_open_s=3.0,
    cpa_known_s=0.0,
    lost_known_s=0.0,
    lost_after_s=30.0,
)


def sensors(range_m: float = 20e3) -> Sensors:
    one, two = np.array(["a"], "U32"), np.full(1, 10.0)
    radars = Radars(one, np.zeros(1, np.int64), SITE[None], np.array([range_m]), two, two, two / 1000.0)
    return Sensors(radars, Stations.empty(), Sonars.empty(), ("west",), SITE[None])


def picture_of(time_s: float, rows: list[dict[str, Any]]) -> tuple[Picture, Members]:
    """Vessels by id, metres east and north of the site, knots east and north, flags and status; each has a radar track."""
    n = len(rows)
    value = {k: np.array([row.get(k, d) for row in rows]) for k, d in (("id", 0), ("flags", 0), ("status", -1), ("mmsi", -1))}
    at = np.array([row["at"] for row in rows], float).reshape(n, 2)
    speed = np.array([row.get("kn", (0.0, 0.0)) for row in rows], float).reshape(n, 2) * KNOT_M_S
    covariance = np.tile(np.diag([25.0, 25.0, 0.1, 0.1]), (n, 1, 1))
    place = offset_deg(np.broadcast_to(SITE, (n, 2)), at)
    times = np.full(n, time_s), place, speed, covariance, np.zeros(n), np.full(n, time_s)
    columns = (value[name].astype(np.int64) for name in ("id", "mmsi", "flags", "id", "status"))
    ids, mmsi, flags, origin, status = columns
    picture = Picture(ids, *times, mmsi, flags, origin, status)
    tracked = [row for row in rows if not row.get("flags", 0) & Flag.COASTING]
    pairs = [(row["id"], track) for row in tracked for track in row.get("tracks", (row["id"] + 100,))]
    vessel, track = np.array(pairs, np.int64).reshape(-1, 2).T
    return picture, Members(vessel, track, np.zeros(len(track), np.int64))


def play(
    rules: AlarmRules, scene: Callable[[float], list[dict[str, Any]]], cycles: int, zones: tuple[Zone, ...] = (), **more: Any
) -> list[VesselAlarms]:
    """The alarms of each cycle. Now and then the memory goes through a checkpoint too; it is never written to."""
    memory, out, where = rules.init(), [], sensors(**more)
    for cycle in range(cycles):
        time_s = PERIOD_S * cycle
        given = *picture_of(time_s, scene(time_s)), time_s, where, numbered(zones)
        saved = save(memory) if cycle % 20 == 13 else b""
        after, alarms = rules.step(memory, AlarmInput(*given))
        if saved:
            assert save(memory) == saved
            again, same = rules.step(load(saved), AlarmInput(*given))
            assert save(again) == save(after)
            assert same.vessel_id.tolist() == alarms.vessel_id.tolist()
        memory = after
        out.append(alarms)
    return out


def spans(found: list[VesselAlarms], kind: AlarmKind) -> dict[tuple[int, int], list[tuple[int, int]]]:
    """First and last cycle of each stretch in which an alarm held, by vessel and subject."""
    out: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for cycle, alarms in enumerate(found):
        for vessel, what, subject in zip(alarms.vessel_id.tolist(), alarms.kind.tolist(), alarms.subject.tolist(), strict=True):
            if what == kind:
                seen = out.setdefault((vessel, subject), [])
                seen[-1:] = [(seen[-1][0], cycle)] if seen and seen[-1][1] == cycle - 1 else [*seen[-1:], (cycle, cycle)]
    return out


def square(half_m: float, east_m: float = 0.0) -> tuple[tuple[float, float], ...]:
    """The corners of a square about a place east of the site; a half of it lies beyond the antimeridian."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half_m + [east_m, 0.0]
    return tuple(map(tuple, offset_deg(np.broadcast_to(SITE, (4, 2)), corners).tolist()))


AREA = Zone(name="port", kind="polygon", points_deg=square(3000.0), enter=True, leave=True, dwell_s=300.0, max_speed_kn=25.0)


def through(time_s: float) -> list[dict[str, Any]]:
    """Vessel 1 sails east through the square at 30 kn, 2 has been inside from the beginning, 3 sails outside."""
    east = -4000.0 + 30.0 * KNOT_M_S * time_s
    return [
        {"id": 1, "at": (east, 0.0), "kn": (30.0, 0.0)},
        {"id": 2, "at": (0.0, 500.0)},
        {"id": 3, "at": (east, 4000.0), "kn": (30.0, 0.0)},
    ]


def test_a_vessel_enters_speeds_in_and_leaves_a_zone_across_the_antimeridian() -> None:
    found = play(RULES, through, 220, (AREA,))
    speed = 30.0 * KNOT_M_S * PERIOD_S
    inside_from, inside_to = int(np.ceil(1000.0 / speed)), int(np.ceil((7000.0 + 50.0) / speed))
    stay = [(inside_from + 1, inside_to + 1)]  # open in the second cycle inside, ended in the third one outside by the margin
    assert spans(found, AlarmKind.ZONE_ENTER) == {(1, 1): stay}
    assert spans(found, AlarmKind.ZONE_SPEED)[1, 1][0][0] == inside_from + 1
    ((left, last),) = spans(found, AlarmKind.ZONE_LEAVE)[1, 1]
    assert (left, last) == (inside_to + 2, inside_to + 2 + int(RULES.moment_s / PERIOD_S) - 1)
    assert spans(found, AlarmKind.ZONE_DWELL) == {(1, 1): [(found_at(300.0, inside_from), inside_to + 1)], (2, 1): [(101, 219)]}
    assert found[stay[0][0]].name.tolist() == ["port", "port"]


def test_a_speed_within_its_own_noise_of_the_limit_raises_no_alarm_and_ends_none() -> None:
    """The noise is 0.6 kn here, as of each track of `picture_of`. The last vessel was faster for the first minute."""
    zone = Zone(name="slow", kind="polygon", points_deg=square(5000.0), min_speed_kn=5.0, max_speed_kn=10.0)
    at_kn = {1: 10.4, 2: 11.0, 3: 4.6, 4: 4.0}

    def scene(time_s: float) -> list[dict[str, Any]]:
        speeds = {**at_kn, 5: 11.0 if time_s < 60.0 else 10.4}
        return [{"id": k, "at": (0.5 * kn * time_s, 900.0 * k - 2700.0), "kn": (kn, 0.0)} for k, kn in speeds.items()]

    assert spans(play(RULES, scene, 60, (zone,)), AlarmKind.ZONE_SPEED) == {(k, 1): [(1, 59)] for k in (2, 4, 5)}


def found_at(dwell_s: float, since: int) -> int:
    return since + int(dwell_s / PERIOD_S) + 1


def test_a_vessel_that_swings_over_the_edge_or_is_unseen_for_a_while_enters_once() -> None:
    def scene(time_s: float) -> list[dict[str, Any]]:
        cycle = round(time_s / PERIOD_S)
        east = -3300.0 if cycle < 10 else -2980.0 if cycle < 12 else -3000.0 + 40.0 * (-1) ** cycle
        flags = int(Flag.COASTING) if 40 <= cycle < 50 else 0
        return [] if 50 <= cycle < 60 else [{"id": 1, "at": (east, 0.0), "flags": flags}]

    assert spans(play(RULES, scene, 90, (AREA,)), AlarmKind.ZONE_ENTER) == {(1, 1): [(11, 89)]}


def test_a_vessel_first_seen_inside_has_entered_but_not_at_the_start_nor_where_a_zone_is_new() -> None:
    """Vessels appear inside in cycles 10 (start of the run), 60, 70 (for 30 s) and 80; the last one is away from 120 to 239."""
    rules = RULES.model_copy(update={"start_up_s": 120.0, "forget_s": 90.0})
    times = {1: (10, 300), 2: (60, 300), 3: (70, 80), 4: (80, 120), 5: (0, 300)}
    outside = {5: (6000.0, 0.0)}

    def scene(time_s: float) -> list[dict[str, Any]]:
        cycle = round(time_s / PERIOD_S)
        here = [k for k, (first, end) in times.items() if first <= cycle < end or (k == 4 and cycle >= 240)]
        frozen = [k for k, (_, end) in times.items() if end < 300 and end <= cycle < end + 10]
        at = {k: outside.get(k, (100.0 * k, 0.0)) for k in (*here, *frozen)}
        return [{"id": k, "at": at[k], "flags": int(Flag.COASTING) * (k in frozen and k not in here)} for k in sorted(at)]

    stays_s = int(rules.first_seen_s / PERIOD_S)
    entered = spans(play(rules, scene, 300, (AREA,)), AlarmKind.ZONE_ENTER)
    ((first, last),) = entered.pop((4, 1))  # it returns to where it was seen last: no second alarm
    assert (first, last < 240) == (80 + stays_s, True)
    assert entered == {(2, 1): [(60 + stays_s, 299)]}

    memory, found = rules.init(), []
    for cycle in range(130):
        time_s, zones = PERIOD_S * cycle, numbered((AREA,) if cycle >= 65 else ())
        memory, alarms = rules.step(memory, AlarmInput(*picture_of(time_s, scene(time_s)), time_s, sensors(), zones))
        found.append(alarms)
    assert set(spans(found, AlarmKind.ZONE_ENTER)) == {(4, 1)}  # the zone is new in cycle 65: vessels 1 and 2 were there


def test_a_zone_that_is_drawn_elsewhere_is_entered_and_left_by_none_of_those_who_stay_where_they_are() -> None:
    """Vessels at rest: 1 in the old outline, 2 in the new one from cycle 50 to 99, 3 in both, 4 comes into the new one in cycle 70."""
    centres = [tuple(offset_deg(SITE, np.array([east, 0.0]))) for east in (0.0, 2500.0)]
    zones = [Zone(name="berth", kind="circle", centre_deg=at, radius_nm=1.0, enter=True, leave=True) for at in centres]

    def scene(time_s: float) -> list[dict[str, Any]]:
        at = {1: -1000.0, 2: 3500.0, 3: 1200.0, 4: 2500.0}
        came = {4: 9000.0} if time_s < 70 * PERIOD_S else {}
        return [{"id": k, "at": (came.get(k, east), 0.0)} for k, east in at.items()]

    for renamed in (False, True):
        other = zones[1] if not renamed else zones[0].model_copy(update={"name": "quay"})
        memory, found = RULES.init(), []
        for cycle in range(150):
            time_s, now = PERIOD_S * cycle, numbered((other if 50 <= cycle < 100 else zones[0],))
            memory, alarms = RULES.step(memory, AlarmInput(*picture_of(time_s, scene(time_s)), time_s, sensors(), now))
            memory = load(save(memory)) if cycle % 10 == 0 else memory
            found.append(alarms)
        entered, left = spans(found, AlarmKind.ZONE_ENTER), spans(found, AlarmKind.ZONE_LEAVE)
        assert set(entered) == (set() if renamed else {(4, 1)})
        assert left == {}
        stays = memory.zones.inside
        assert stays.vessel_id[stays.open].tolist() == [1, 3]
        assert stays.since_s[stays.vessel_id == 3].tolist() == [0.0]  # in both outlines


def test_two_zones_that_change_places_are_left_by_nobody() -> None:
    centres = [tuple(offset_deg(SITE, np.array([east, 0.0]))) for east in (0.0, 9000.0)]
    here, there = (
        Zone(name=f"at {k}", kind="circle", centre_deg=at, radius_nm=1.0, leave=True) for k, at in enumerate(centres)
    )
    memory, found = RULES.init(), []
    for cycle in range(80):
        time_s, now = PERIOD_S * cycle, numbered((there, here) if cycle >= 40 else (here, there))
        scene = [{"id": 1, "at": (0.0, 0.0)}, {"id": 2, "at": (9000.0, 0.0)}]
        memory, alarms = RULES.step(memory, AlarmInput(*picture_of(time_s, scene), time_s, sensors(), now))
        found.append(alarms)
    assert spans(found, AlarmKind.ZONE_LEAVE) == {}
    stays = memory.zones.inside
    assert list(zip(stays.vessel_id.tolist(), stays.subject.tolist(), strict=True)) == [(1, 2), (2, 1)]


def test_a_circle_is_as_large_as_it_says() -> None:
    shape = Shape(1, Zone(name="ring", kind="circle", centre_deg=(60.0, 179.9), radius_nm=30.0), 100.0)
    bearing = np.radians(np.arange(0.0, 360.0, 15.0))
    unit = np.stack([np.sin(bearing), np.cos(bearing)], 1)
    centre = np.broadcast_to(np.array([60.0, 179.9]), (len(unit), 2))
    for metres, wanted in ((-60.0, (True, True)), (60.0, (False, True)), (160.0, (False, False))):
        inside, near = shape.contains(offset_deg(centre, unit * (30.0 * NAUTICAL_MILE_M + metres) * 1.0))
        assert (inside.mean() > 0.5, near.mean() > 0.5) == wanted


def test_inside_is_what_a_plain_loop_says() -> None:
    rng = np.random.default_rng([19, 4])
    points = offset_deg(np.broadcast_to(SITE, (9, 2)), rng.uniform(-5e3, 5e3, (9, 2)))
    middle = points.mean(0)
    turned = points[
        np.argsort(np.arctan2(points[:, 0] - middle[0], np.mod(points[:, 1], 360.0) - np.mod(points[:, 1], 360.0).mean()))
    ]
    zone = Zone(name="odd", kind="polygon", points_deg=tuple(map(tuple, turned.tolist())))
    vessels = offset_deg(np.broadcast_to(SITE, (400, 2)), rng.uniform(-6e3, 6e3, (400, 2)))
    inside, _ = Shape(1, zone, 0.0).contains(vessels)
    y, x = np.log(np.tan(np.pi / 4 + np.radians(turned[:, 0]) / 2)), np.mod(turned[:, 1], 360.0)
    expected = []
    for latitude, longitude in vessels:
        v, u, odd = np.log(np.tan(np.pi / 4 + np.radians(latitude) / 2)), longitude % 360.0, False
        for a in range(len(x)):
            b = (a + 1) % len(x)
            if (y[a] > v) != (y[b] > v) and u < x[a] + (v - y[a]) * (x[b] - x[a]) / (y[b] - y[a]):
                odd = not odd
        expected.append(odd)
    assert inside.tolist() == expected
    assert 50 < inside.sum() < 350


@pytest.mark.parametrize(("crossing", "vessels"), [("both", {1, 2}), ("to_right", {1}), ("to_left", {2})])
def test_a_line_is_crossed_in_the_direction_that_counts(crossing: Any, vessels: set[int]) -> None:
    line = Zone(name="bar", kind="line", points_deg=((-17.02, -179.99), (-16.98, -179.99)), crossing=crossing)  # to the north

    def scene(time_s: float) -> list[dict[str, Any]]:
        way = 20.0 * KNOT_M_S * time_s
        return [
            {"id": 1, "at": (2700.0 + way, 0.0), "kn": (20.0, 0.0)},
            {"id": 2, "at": (3700.0 - way, 300.0), "kn": (-20.0, 0.0)},
            {"id": 3, "at": (2700.0 + way, 3000.0), "kn": (20.0, 0.0)},  # beyond its end
            {"id": 4, "at": (3190.0 + 20.0 * np.sin(time_s), -300.0)},  # swings over it
        ]

    found = spans(play(RULES, scene, 40, (line,)), AlarmKind.LINE_CROSSED)
    assert {vessel for vessel, _ in found} == vessels
    assert all(len(times) == 1 for times in found.values())


def test_what_rests_beside_a_line_does_not_cross_it_by_the_noise_of_its_position() -> None:
    """A boat that radars alone see, 20 m beside it, whose position errs by 20 m per axis for a minute at a time; and one under way."""
    points = offset_deg(np.tile(SITE, (2, 1)), np.array([[0.0, -3000.0], [0.0, 3000.0]]))
    line = Zone(name="bar", kind="line", points_deg=tuple(map(tuple, points.tolist())), crossing="both")
    rng, error = np.random.default_rng(3), np.zeros((2, 2))
    memory, last, begun = RULES.init(), set(), list[int]()
    for cycle in range(800):
        time_s, keep = PERIOD_S * cycle, np.exp(-PERIOD_S / 60.0)
        error = keep * error + np.sqrt(1.0 - keep**2) * rng.normal(0.0, 20.0, (2, 2))
        at = error + np.array([[-20.0, 0.0], [10.0 * KNOT_M_S * (time_s - 1200.0), 500.0]])
        rows = [{"id": 1, "at": tuple(at[0]), "kn": (0.0, 0.0)}, {"id": 2, "at": tuple(at[1]), "kn": (10.0, 0.0)}]
        picture, members = picture_of(time_s, rows)
        picture = replace(picture, covariance=np.tile(np.diag([400.0, 400.0, 0.01, 0.01]), (2, 1, 1)))
        memory, alarms = RULES.step(memory, AlarmInput(picture, members, time_s, sensors(), numbered((line,))))
        now = set(alarms.vessel_id[alarms.kind == AlarmKind.LINE_CROSSED].tolist())
        begun, last = [*begun, *(now - last)], now
    assert begun == [2]


def test_zones_that_make_no_sense_are_refused_with_their_key() -> None:
    base: dict[str, Any] = {"name": "x", "kind": "polygon"}
    bow_tie = ((0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0))
    wrong: tuple[tuple[dict[str, Any], str], ...] = (
        ({"points_deg": ((0.0, 0.0), (1.0, 1.0))}, "needed 3 or more points_deg"),
        ({"points_deg": bow_tie}, "edges cross"),
        ({"kind": "circle", "points_deg": bow_tie}, "needed centre_deg and radius_nm"),
        ({"kind": "line", "points_deg": bow_tie, "enter": True}, "needed crossing only"),
        ({"points_deg": square(10.0), "crossing": "both"}, "needed a line"),
        ({"points_deg": square(10.0), "min_speed_kn": 5.0, "max_speed_kn": 4.0}, "needed less than max_speed_kn"),
        ({"points_deg": ((0.0, -100.0), (1.0, 0.0), (2.0, 100.0))}, "wider than 170"),
    )
    for more, said in wrong:
        with pytest.raises(ValidationError, match=said):
            Zone.model_validate({**base, **more})


def approaches(picture: Picture, rules: AlarmRules) -> set[tuple[int, int]]:
    """Pairs within the limits, one pair after the other."""
    limit_m, within_s = rules.cpa_nm * NAUTICAL_MILE_M, rules.tcpa_min * 60.0
    metres = (picture.position_deg - SITE) * [110_648.0, 106_490.0]  # a degree at 17 S
    out, speed = set(), np.hypot(*picture.velocity_m_s.T) / KNOT_M_S
    for a in range(len(picture)):
        for b in range(a + 1, len(picture)):
            away, relative = (metres[b] - metres[a])[::-1], picture.velocity_m_s[b] - picture.velocity_m_s[a]
            time_s = -(away @ relative) / (relative @ relative)
            distance_m = np.hypot(*(away + relative * time_s))
            slow = min(speed[a], speed[b]) < rules.cpa_under_way_kn or np.hypot(*relative) < rules.cpa_relative_kn * KNOT_M_S
            if not slow and 0.0 <= time_s <= within_s and distance_m <= limit_m:
                out.add((a, b))
    return out


def test_all_close_pairs_are_found_and_no_others() -> None:
    rng = np.random.default_rng([19, 5])
    speeds = rng.choice([2.0, 8.0, 15.0, 45.0], 300)
    course = rng.uniform(0.0, 2 * np.pi, 300)
    rows = [
        {"id": k + 1, "at": tuple(rng.uniform(-5e3, 1.5e3, 2)), "kn": (s * np.sin(c), s * np.cos(c))}
        for k, (s, c) in enumerate(zip(speeds, course, strict=True))
    ]
    picture, _ = picture_of(100.0, rows)
    followed = Approaching.none()
    for _ in range(SPANS):
        followed, found = close_pairs(RULES, followed, picture, 100.0)
    wanted = approaches(picture, RULES)
    within = (found.cpa_m <= RULES.cpa_nm * NAUTICAL_MILE_M) & (found.tcpa_s <= RULES.tcpa_min * 60.0)
    pairs = set(zip(found.first[within].tolist(), found.second[within].tolist(), strict=True))
    assert len(wanted) > 100
    assert len(pairs ^ wanted) <= 0.01 * len(wanted)  # the loop's plane is flat


def fleet(count: int, width_m: float, seed: int) -> Picture:
    rng = np.random.default_rng([seed, 6])
    course, speeds = rng.uniform(0.0, 2 * np.pi, count), rng.choice([5.0, 8.0, 15.0, 45.0], count)
    rows = [
        {"id": k + 1, "at": tuple(rng.uniform(0.0, width_m, 2)), "kn": (s * np.sin(c), s * np.cos(c))}
        for k, (s, c) in enumerate(zip(speeds, course, strict=True))
    ]
    return picture_of(100.0, rows)[0]


def test_in_a_crowd_the_nearest_are_compared_and_the_most_urgent_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    picture = fleet(400, 2000.0, 1)
    monkeypatch.setattr(close_approach, "MOST_NEAR", len(picture))
    monkeypatch.setattr(close_approach, "MOST_FOLLOWED", len(picture))
    every, all_pairs = close_pairs(RULES, Approaching.none(), picture, 100.0)
    assert every.left_out == 0
    monkeypatch.setattr(close_approach, "MOST_NEAR", 60)
    monkeypatch.setattr(close_approach, "MOST_FOLLOWED", 5)
    followed, found = close_pairs(RULES, Approaching.none(), picture, 100.0)
    pairs, wanted = set(zip(found.first, found.second, strict=True)), set(zip(all_pairs.first, all_pairs.second, strict=True))
    assert pairs < wanted
    assert followed.left_out >= len(wanted) - len(pairs) > 1000
    assert len(pairs) <= 5 * len(picture)
    assert len(np.union1d(found.first, found.second)) > 0.9 * len(np.union1d(all_pairs.first, all_pairs.second))
    _, same = close_pairs(RULES, followed, picture, 100.0)
    assert len(same.first) <= 5 * len(picture)  # in the next cycle too, beside those that are followed


@given(st.integers(0, 10**6), st.integers(0, 120))
def test_the_most_urgent_pairs_of_each_vessel_are_followed(seed: int, count: int) -> None:
    rng = np.random.default_rng([seed, 7])
    code = np.unique(rng.integers(0, 12 * 12, count))
    first, second = code[code // 12 < code % 12] // 12, code[code // 12 < code % 12] % 12
    tcpa_s, none = rng.integers(0, 9, len(first)).astype(float), np.zeros(len(first))
    weak = rng.random(len(first)) < 0.5
    got = close_approach._most_urgent(close_approach.Pairs(first, second, none, tcpa_s, none), weak, 3, 12)
    wanted = np.zeros(len(first), np.bool_)
    for vessel in range(12):
        own = [k for k in range(len(first)) if vessel in (first[k], second[k])]
        wanted[sorted(own, key=lambda k: (weak[k], tcpa_s[k], k))[:3]] = True
    assert np.array_equal(got, wanted)


def among_passers(
    time_s: float, passers: int, aside_m: float, from_s: float = 0.0, meet_s: float = 150.0
) -> list[dict[str, Any]]:
    """Vessels 1 and 2 collide; from a time on each meets so many others sooner, which pass at this distance."""
    way, off, space = 10.0 * KNOT_M_S * time_s, 10.0 * KNOT_M_S * meet_s, 1200.0 / max(passers, 1)
    out = [{"id": 1, "at": (way - off, 0.0), "kn": (10.0, 0.0)}, {"id": 2, "at": (off - way, 0.0), "kn": (-10.0, 0.0)}]
    then = 20.0 * KNOT_M_S * from_s
    for k in range(passers if time_s >= from_s else 0):
        ahead = then + 200.0 + space * k
        out.append({"id": 10 + k, "at": (ahead - off - way, aside_m), "kn": (-10.0, 0.0)})
        out.append({"id": 100 + k, "at": (off - ahead + way, -aside_m), "kn": (10.0, 0.0)})
    return sorted(out, key=lambda row: row["id"])


@pytest.mark.parametrize("passers", [0, 1, 16, 40])
def test_a_collision_is_followed_though_others_pass_sooner_beyond_the_limit(passers: int) -> None:
    rules = RULES.model_copy(update={"cpa_nm": 0.05})
    limit_m = 0.05 * NAUTICAL_MILE_M
    aside_m = 1.19 * limit_m
    assert limit_m < aside_m < rules.cpa_hold_factor * limit_m
    picture, _ = picture_of(100.0, among_passers(0.0, passers, aside_m))
    followed = Approaching.none()
    for _ in range(SPANS):
        followed, _ = close_pairs(rules, followed, picture, 100.0)
    assert (1, 2) in set(zip(followed.first_id.tolist(), followed.second_id.tolist(), strict=True))
    found = play(rules, lambda time_s: among_passers(time_s, passers, aside_m), 40)
    assert (1, 2) in spans(found, AlarmKind.CLOSE_APPROACH)


def test_an_open_alarm_goes_on_when_many_others_will_pass_sooner() -> None:
    rules = RULES.model_copy(update={"cpa_nm": 0.05})
    passers, from_s, meet_s = close_approach.MOST_FOLLOWED + 4, 30.0, 150.0
    found = play(rules, lambda time_s: among_passers(time_s, passers, 30.0, from_s, meet_s), int(meet_s / PERIOD_S))
    of_pairs = spans(found, AlarmKind.CLOSE_APPROACH)
    assert of_pairs[1, 2] == [(of_pairs[1, 2][0][0], int(meet_s / PERIOD_S) - 1)]
    assert of_pairs[1, 2][0][0] < from_s / PERIOD_S
    assert {(1, 10), (2, 100)} <= of_pairs.keys()  # the most urgent are followed beside it


def test_of_open_alarms_of_a_vessel_so_many_are_followed_beside_the_most_urgent(monkeypatch: pytest.MonkeyPatch) -> None:
    picture = fleet(200, 1500.0, 2)
    every, all_pairs = close_pairs(RULES, Approaching.none(), picture, 100.0)
    monkeypatch.setattr(close_approach, "MOST_FOLLOWED", 3)
    monkeypatch.setattr(close_approach, "MOST_OPEN", 5)
    _, few = close_pairs(RULES, every, picture, 100.0)
    _, with_open = close_pairs(RULES, every, picture, 100.0, (every.first_id, every.second_id))
    pairs = [set(zip(p.first.tolist(), p.second.tolist(), strict=True)) for p in (few, with_open, all_pairs)]
    assert pairs[0] < pairs[1] < pairs[2]
    assert len(pairs[0]) <= 3 * len(picture)
    assert len(pairs[1]) <= (3 + 5) * len(picture)
    late = set(list(zip(every.first_id.tolist(), every.second_id.tolist(), strict=True))[:: len(every.first_id) // 40])
    _, with_late = close_pairs(RULES, every, picture, 100.0, tuple(np.array(sorted(late)).T))
    ids = picture.vessel_id
    kept = set(zip(ids[with_late.first].tolist(), ids[with_late.second].tolist(), strict=True))
    assert max(np.unique(np.array(sorted(late)), return_counts=True)[1]) <= 5
    assert late <= kept  # no vessel has more


def test_a_head_on_pair_alarms_once_until_it_has_passed_and_company_or_moored_vessels_do_not() -> None:
    def scene(time_s: float) -> list[dict[str, Any]]:
        way = 10.0 * KNOT_M_S * time_s
        return [
            {"id": 1, "at": (-3000.0 + way, 0.0), "kn": (10.0, 0.0)},
            {"id": 2, "at": (3000.0 - way, 100.0), "kn": (-10.0, 0.0)},
            {"id": 3, "at": (-3000.0 + way, 2000.0), "kn": (10.0, 0.0)},
            {"id": 4, "at": (-2950.0 + way, 2000.0), "kn": (10.5, 0.0)},  # in company with 3
            {"id": 5, "at": (0.0, 2050.0), "flags": int(Flag.STATIONARY), "mmsi": 710_000_005},
            {"id": 6, "at": (30.0, 2050.0), "status": int(NavStatus.MOORED), "mmsi": 710_000_006},
        ]

    meet_s, soon_s = 6000.0 / (20.0 * KNOT_M_S), RULES.tcpa_min * 60.0
    first = int(np.ceil((meet_s - soon_s) / PERIOD_S)) + 1  # or one cycle later: the far span is searched in every second one
    found = play(RULES, scene, 210)
    assert spans(found, AlarmKind.CLOSE_APPROACH) == {(1, 2): [(first, int(meet_s / PERIOD_S) + 2)]}
    assert found[first].distance_m[0] == pytest.approx(100.0, abs=0.5)
    assert found[first].interval_s[0] == pytest.approx(meet_s - first * PERIOD_S, abs=0.5)
    at_rest = play(RULES.model_copy(update={"cpa_at_rest": True}), scene, 120)
    assert set(spans(at_rest, AlarmKind.CLOSE_APPROACH)) == {(1, 2), (3, 5), (3, 6), (4, 5), (4, 6)}


def test_an_anchored_vessel_that_drifts_out_of_its_circle_drags_and_one_that_weighs_anchor_does_not() -> None:
    def scene(time_s: float) -> list[dict[str, Any]]:
        drift = max(time_s - 900.0, 0.0)
        swing = [100.0 * np.sin(time_s / 200.0), 100.0 * np.cos(time_s / 200.0)]
        anchored = int(NavStatus.AT_ANCHOR)
        return [
            {"id": 1, "at": (swing[0] + 0.8 * drift, swing[1]), "kn": (1.5, 0.0), "status": anchored},
            {"id": 2, "at": (5000.0 + swing[0], swing[1]), "kn": (0.5, 0.0), "status": anchored},
            {"id": 3, "at": (-5000.0 + 5.0 * drift, 0.0), "kn": (9.7 * (drift > 0.0), 0.0), "status": anchored},
        ]

    rules = RULES.model_copy(update={"cpa_nm": 0.0})
    ((first, last),) = spans(play(rules, scene, 600), AlarmKind.ANCHOR_DRAG).pop((1, 0))
    assert 200.0 / 0.8 <= first * PERIOD_S - 900.0 <= 550.0 / 0.8
    assert last == 599


def test_a_ship_that_turns_with_the_tide_on_the_circle_of_the_setting_does_not_drag() -> None:
    """It comes to rest on the rim, so the far side is two radii off; after it has swung, a drag of a radius is noticed."""
    rules = RULES.model_copy(update={"cpa_nm": 0.0, "swing_m": 200.0, "settle_s": 300.0})
    radii_m = {1: 120.0, 2: 200.0, 3: 260.0}

    def scene(time_s: float) -> list[dict[str, Any]]:
        angle, drift_m = np.pi * np.clip((time_s - 600.0) / 600.0, 0.0, 1.0), 0.8 * max(time_s - 1500.0, 0.0)
        rows = []
        for vessel, radius_m in radii_m.items():
            speed = radius_m * np.pi / 600.0 if 600.0 < time_s < 1200.0 else 0.8 * (drift_m > 0.0)
            at = (5000.0 * vessel + radius_m * np.sin(angle), radius_m * np.cos(angle) - drift_m)
            kn = (speed / KNOT_M_S * np.cos(angle), -speed / KNOT_M_S * np.sin(angle))
            rows.append({"id": vessel, "at": at, "kn": kn, "status": int(NavStatus.AT_ANCHOR)})
        return rows

    found = spans(play(rules, scene, 750), AlarmKind.ANCHOR_DRAG)
    begins_s = {vessel: PERIOD_S * found[vessel, 0][0][0] for vessel in radii_m}
    assert begins_s[3] < 1500.0 < min(begins_s[1], begins_s[2])
    assert 0.8 * (begins_s[2] - 1500.0) < 150.0


def test_a_vessel_under_way_that_vanishes_within_cover_is_lost_until_it_returns() -> None:
    def scene(time_s: float) -> list[dict[str, Any]]:
        cycle, way = round(time_s / PERIOD_S), 10.0 * KNOT_M_S * time_s
        flags = int(Flag.COASTING) if cycle >= 20 else 0
        rows = [
            {"id": 1, "at": (way, 0.0), "kn": (10.0, 0.0), "flags": flags},
            {"id": 2, "at": (0.0, 300.0), "flags": flags},  # not under way
            {"id": 3, "at": (17_800.0 + way, 0.0), "kn": (10.0, 0.0), "flags": flags},  # about to leave the cover
        ]
        never_coasting = [
            {"id": 4, "at": (way, 900.0), "kn": (10.0, 0.0)},
            {
                "id": 5,
                "at": (way, 950.0),
                "kn": (10.0, 0.0),
                "tracks": (104, 105) if cycle >= 20 else (105,),
            },  # takes that of 4
            {"id": 6, "at": (way, 5000.0), "kn": (10.0, 0.0)},  # its track ends, as one of AIS alone does
        ]
        there = never_coasting[0 if cycle < 20 else 1 : 3 if cycle < 25 else 2]
        back = [{**rows[0], "flags": 0}, never_coasting[1]] if cycle >= 60 else [never_coasting[1]]
        return rows + there if cycle < 30 else back

    found = play(RULES, scene, 70)
    assert spans(found, AlarmKind.LOST) == {(1, 0): [(30, 59)], (6, 0): [(34, 69)]}
    assert found[30].interval_s.tolist() == [33.0]


@pytest.mark.parametrize(("detection", "looks", "is_lost"), [(0.2, 30.0, False), (0.6, 30.0, True), (0.2, 10.0, True)])
def test_a_vessel_is_lost_only_where_radars_have_learnt_to_see_it(detection: float, looks: float, is_lost: bool) -> None:
    """Of the radar only the eastern half is known, where vessel 1 vanishes; vessel 2 vanishes in the west."""
    east = np.broadcast_to((np.arange(COVER_AZIMUTHS) < COVER_AZIMUTHS // 2)[None, :, None], (1, COVER_AZIMUTHS, COVER_RANGES))
    none = np.zeros(east.shape)
    known = np.where(east, detection, 0.1), np.where(east, looks, 0.0)
    cover = RadarCover(np.array([20e3]), SITE[None], np.ones(1), *known, none, none, none)

    def scene(time_s: float) -> list[dict[str, Any]]:
        way, flags = 2000.0 + 10.0 * KNOT_M_S * time_s, int(Flag.COASTING) if time_s >= 60.0 else 0
        rows = [{"id": 1, "at": (way, 0.0), "kn": (10.0, 0.0)}, {"id": 2, "at": (-way, 0.0), "kn": (-10.0, 0.0)}]
        return [{**row, "flags": flags} for row in rows] if time_s < 90.0 else []

    memory, found = RULES.init(), []
    for time_s in np.arange(0.0, 120.0, PERIOD_S).tolist():
        memory, alarms = RULES.step(memory, AlarmInput(*picture_of(time_s, scene(time_s)), time_s, sensors(), (), cover))
        found.append(alarms)
    assert set(spans(found, AlarmKind.LOST)) == ({(1, 0), (2, 0)} if is_lost else {(2, 0)})


def test_no_vessels_and_no_zones_are_no_trouble() -> None:
    assert [len(alarms) for alarms in play(RULES, lambda _: [], 3, (AREA,))] == [0, 0, 0]
