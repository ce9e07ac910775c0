"""Alarms where a sensor is silent: nobody is lost by it, and there is one alarm of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from test_alarm_rules import PERIOD_S, RULES, SITE, picture_of, sensors, spans

from coastwatch.alarms import EventMemory, Evidence, expected_sensors, next_events
from coastwatch.batches import (
    AlarmKind,
    BearingAssociations,
    BearingTracks,
    Flag,
    Hearing,
    Members,
    SensorHearing,
    Sensors,
    Stations,
    Tracks,
    TrackSources,
    VesselAlarms,
)
from coastwatch.geodesy import KNOT_M_S
from coastwatch.server.checkpoint import load, save

WAIT = 5  # cycles from the last plot until the radar is silent


def hearing_of(cycle: int, first: int, last: int) -> SensorHearing:
    """The radar sends no plot from one cycle to another."""
    radars = Hearing.always(1)
    if first + WAIT <= cycle < last:
        since = first - 1 if cycle == first + WAIT else cycle - 1
        heard = np.array([PERIOD_S * (first - 1)])
        radars = Hearing(
            heard, np.full(1, 3.0), np.full(1, 40.0), np.ones(1, bool), np.full(1, PERIOD_S * since), np.full(1, -np.inf)
        )
    none = Hearing.always(0)
    return SensorHearing(radars, none, none, Hearing.always(1))


def play(gone_at: int, first: int, last: int, cycles: int, back_at: int = 10_000) -> list[VesselAlarms]:
    """Vessel 1 is under way, and without a track from one cycle to another; the radar fails from `first` to `last`."""
    memory, out, where = RULES.init(), [], sensors()
    for cycle in range(cycles):
        time_s, away = PERIOD_S * cycle, gone_at <= cycle < back_at
        row = {"id": 1, "at": (10.0 * KNOT_M_S * time_s, 0.0), "kn": (10.0, 0.0), "flags": int(Flag.COASTING) if away else 0}
        rows: list[dict[str, Any]] = [] if away and cycle >= gone_at + 5 else [row]
        given = *picture_of(time_s, rows), time_s, where, ()
        memory, alarms = RULES.step(load(save(memory)), *given, hearing=hearing_of(cycle, first, last))
        out.append(alarms)
    return out


def test_a_vessel_that_ends_with_its_radar_is_never_lost() -> None:
    found = play(gone_at=22, first=20, last=150, cycles=300)
    assert spans(found, AlarmKind.LOST) == {}
    assert spans(found, AlarmKind.RADAR_SILENT) == {(0, 1): [(25, 149)]}


def test_one_that_was_away_before_is_lost_when_the_radar_is_heard_again() -> None:
    """It was away for 9 s by the last plot: `lost_after_s` is over when 21 s more have passed, the silence not counted."""
    found = play(gone_at=17, first=20, last=150, cycles=300)
    ((first, _),) = spans(found, AlarmKind.LOST).pop((1, 0))
    assert first == 149 + 7, "seen last in cycle 16: 9 s of 30 were over in cycle 19"


def test_one_that_was_lost_before_stays_so() -> None:
    found = play(gone_at=5, first=20, last=150, cycles=200)
    assert spans(found, AlarmKind.LOST) == {(1, 0): [(14, 199)]}


def test_one_that_returns_and_vanishes_again_is_lost() -> None:
    found = play(gone_at=22, first=20, last=150, cycles=170, back_at=155)
    assert spans(found, AlarmKind.LOST) == {}
    memory, where = RULES.init(), sensors()
    for cycle in range(300):
        time_s = PERIOD_S * cycle
        away = 22 <= cycle < 155 or cycle >= 170
        row = {"id": 1, "at": (0.0, 0.0), "kn": (10.0, 0.0)}
        memory, alarms = RULES.step(
            memory, *picture_of(time_s, [] if away and not 170 <= cycle < 172 else [{**row, "flags": int(Flag.COASTING) * away}]),
            time_s, where, hearing=hearing_of(cycle, 20, 150),
        )  # fmt: skip
        if AlarmKind.LOST in alarms.kind:
            break
    assert cycle == 169 + 10


ALL_KINDS = Sensors(
    sensors().radars,
    Stations(np.array(["a", "b"]), np.stack([SITE, SITE]), np.array([20e3, 30e3])),
    sensors().sonars,
    ("west",),
    SITE[None],
    TrackSources(np.array(["vts"]), np.full((1, 2), np.nan), np.zeros(1), np.ones(1), np.ones(1), np.ones(1)),
)


def failed(count: int, *rows: int) -> Hearing:
    silent = np.isin(np.arange(count), rows)
    usual = np.full(count, 970.0), np.full(count, 3.0), np.full(count, 40.0)
    return Hearing(*usual, silent, np.where(silent, 970.0, np.inf), np.full(count, -np.inf))


@pytest.mark.parametrize(
    ("hearing", "kind", "subject", "said"),
    [
        (
            SensorHearing(failed(1), failed(2, 0, 1), failed(1), failed(1, 0)), AlarmKind.AIS_SILENT, 0,
            "AIS is silent: no AIS report for 30 s, one every 3.0 s or oftener before; 40 vessels on AIS then; vessels in "
            "range of a, b: 2; no flag",
        ),
        (
            SensorHearing(failed(1), failed(2, 1), failed(1), failed(1)), AlarmKind.AIS_SILENT, 2,
            "AIS station b is silent: no AIS report for 30 s, one every 3.0 s or oftener before; 40 vessels on AIS then; "
            "vessels in range of b: 2; no flag",
        ),
        (
            SensorHearing(failed(1, 0), failed(2), failed(1), failed(1)), AlarmKind.RADAR_SILENT, 1,
            "radar a is silent: no plot for 30 s, one every 3.0 s or oftener before; 40 plots a cycle then; vessels in "
            "range of a: 1; no flag",
        ),
        (
            SensorHearing(failed(1), failed(2), failed(1, 0), failed(1)), AlarmKind.SOURCE_SILENT, 1,
            "track source vts is silent: no track for 30 s, one every 3.0 s or oftener before; 40 tracks a cycle then; no flag",
        ),
    ],
)  # fmt: skip
def test_one_alarm_of_what_is_silent_lasts_though_it_is_of_no_vessel(
    hearing: SensorHearing, kind: AlarmKind, subject: int, said: str
) -> None:
    rows = [{"id": 7, "at": (0.0, 0.0)}, {"id": 8, "at": (24e3, 0.0)}]
    memory, events, seen = RULES.init(), EventMemory.none(), []
    for cycle in range(4):
        time_s = 1000.0 + PERIOD_S * cycle
        picture, members = picture_of(time_s, rows)
        now = hearing if cycle < 3 else replace(hearing, **{k: failed(len(v)) for k, v in vars(hearing).items()})
        memory, alarms = RULES.step(memory, picture, members, time_s, ALL_KINDS, hearing=now)
        expected = expected_sensors(ALL_KINDS, 1.0, 60.0, 60.0)
        none = np.zeros(0, np.int64)
        of = Tracks.empty(), Members.empty(), BearingTracks.empty(), BearingAssociations(none, none, np.zeros(0), np.zeros(0))
        evidence = Evidence(*of, ("west", "vts", "ais"), *expected, np.zeros(0), now)
        events, changes = next_events(events, picture, alarms, time_s, 60.0, evidence)
        seen.append(changes)
    begun = seen[0].begun
    assert (begun.vessel_id.tolist(), begun.kind.tolist(), begun.subject.tolist()) == ([0], [int(kind)], [subject])
    assert begun.evidence[0].startswith(said), begun.evidence[0]
    assert np.isfinite(begun.position_deg).all()
    assert begun.mmsi.tolist() == [-1]
    assert [len(changes) for changes in seen[1:3]] == [0, 0], "one alarm, that lasts"
    assert seen[3].ended.kind.tolist() == [int(kind)]


@pytest.mark.parametrize(("silent", "with_radar", "is_lost"), [(True, False, False), (True, True, True), (False, False, True)])
def test_what_only_a_silent_track_source_tracked_is_not_lost(silent: bool, with_radar: bool, is_lost: bool) -> None:
    """The vessel ends where a radar that is heard reaches. Its tracks were of the track source, number 1 of the sources."""
    memory, lost = RULES.init(), False
    for cycle in range(60):
        time_s, away = PERIOD_S * cycle, cycle >= 20
        rows = (
            [] if away and cycle >= 22 else [{"id": 1, "at": (0.0, 0.0), "kn": (10.0, 0.0), "flags": int(Flag.COASTING) * away}]
        )
        picture, _ = picture_of(time_s, rows)
        source = np.array([0, 1] if with_radar else [1])[: 2 * len(rows) * (not away)]
        members = Members(np.ones(len(source), np.int64), source + 100, source)
        of_source = failed(1)
        if silent and cycle >= 25:
            since = 19 if cycle == 25 else cycle - 1
            of_source = replace(failed(1, 0), stands_from_s=np.full(1, PERIOD_S * since))
        hearing = SensorHearing(failed(1), failed(2), of_source, failed(1))
        memory, alarms = RULES.step(load(save(memory)), picture, members, time_s, ALL_KINDS, hearing=hearing)
        lost |= bool((alarms.kind == AlarmKind.LOST).any())
    assert lost == is_lost
