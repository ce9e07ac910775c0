"""Alarms where a sensor is silent: nobody is lost by it, and there is one alarm of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from checkpoint_world import resumed_at_times
from test_alarm_rules import AREA, PERIOD_S, RULES, SITE, picture_of, sensors, spans

from coastwatch.alarms import (
    AlarmInput,
    AlarmRules,
    EventMemory,
    EvidenceContext,
    Zone,
    expected_sensors,
    next_events,
    numbered,
)
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
from coastwatch.geodesy import KNOT_M_S, offset_deg

pytestmark = pytest.mark.contract

WAIT = 5  # cycles from the last plot until the radar is silent


def hearing_of(cycle: int, first: int, last: int) -> SensorHearing:
    """The radar sends no plot from one cycle to another."""
    radars = Hearing.empty(R=1)
    if first + WAIT <= cycle < last:
        since = first - 1 if cycle == first + WAIT else cycle - 1
        heard = np.array([PERIOD_S * (first - 1)])
        radars = Hearing(
            heard, np.full(1, 3.0), np.full(1, 40.0), np.ones(1, bool), np.full(1, PERIOD_S * since), np.full(1, -np.inf)
        )
    none = Hearing.empty()
    return SensorHearing(radars, none, none, Hearing.empty(R=1))


def play(gone_at: int, first: int, last: int, cycles: int, back_at: int = 10_000) -> list[VesselAlarms]:
    """Vessel 1 is under way, and without a track from one cycle to another; the radar fails from `first` to `last`."""
    memory, out, where = RULES.init(), [], sensors()
    for cycle in range(cycles):
        time_s, away = PERIOD_S * cycle, gone_at <= cycle < back_at
        row = {"id": 1, "at": (10.0 * KNOT_M_S * time_s, 0.0), "kn": (10.0, 0.0), "flags": int(Flag.COASTING) if away else 0}
        rows: list[dict[str, Any]] = [] if away and cycle >= gone_at + 5 else [row]
        given = *picture_of(time_s, rows), time_s, where, ()
        memory, alarms = RULES.step(resumed_at_times(memory, cycle), AlarmInput(*given, hearing=hearing_of(cycle, first, last)))
        out.append(alarms)
    return out


def test_a_vessel_that_ends_with_its_radar_is_never_lost() -> None:
    found = play(gone_at=22, first=20, last=60, cycles=120)
    assert spans(found, AlarmKind.LOST) == {}
    assert spans(found, AlarmKind.RADAR_SILENT) == {(0, 1): [(25, 59)]}


def test_one_that_was_away_before_is_lost_when_the_radar_is_heard_again() -> None:
    """It was away for 9 s by the last plot: `lost_after_s` is over when 21 s more have passed, the silence not counted."""
    found = play(gone_at=17, first=20, last=60, cycles=120)
    ((first, _),) = spans(found, AlarmKind.LOST).pop((1, 0))
    assert first == 59 + 7, "seen last in cycle 16: 9 s of 30 were over in cycle 19"


def test_one_that_was_lost_before_stays_so() -> None:
    found = play(gone_at=5, first=20, last=60, cycles=90)
    assert spans(found, AlarmKind.LOST) == {(1, 0): [(14, 89)]}


def test_one_that_returns_and_vanishes_again_is_lost() -> None:
    found = play(gone_at=22, first=20, last=60, cycles=80, back_at=65)
    assert spans(found, AlarmKind.LOST) == {}
    memory, where = RULES.init(), sensors()
    for cycle in range(120):
        time_s = PERIOD_S * cycle
        away = 22 <= cycle < 65 or cycle >= 80
        row = {"id": 1, "at": (0.0, 0.0), "kn": (10.0, 0.0)}
        rows = [] if away and not 80 <= cycle < 82 else [{**row, "flags": int(Flag.COASTING) * away}]
        heard = hearing_of(cycle, 20, 60)
        memory, alarms = RULES.step(memory, AlarmInput(*picture_of(time_s, rows), time_s, where, hearing=heard))
        if AlarmKind.LOST in alarms.kind:
            break
    assert cycle == 79 + 10


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


NEVER = replace(failed(1, 0), heard_s=np.full(1, -np.inf), usual_s=np.full(1, np.nan), amount=np.zeros(1))
"""AIS that was never heard in a run that began at 970 s."""


@pytest.mark.parametrize(
    ("hearing", "kind", "subject", "said"),
    [
        (
            SensorHearing(failed(1), failed(2), failed(1), NEVER), AlarmKind.AIS_SILENT, 0,
            "AIS is silent: no AIS report for 30 s, and none since the start of the run; vessels in range of a, b: 2; no flag",
        ),
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
            "radar a is silent: no plot for 30 s, one every 3.0 s or oftener before; 40 plots, or spokes of video, a cycle then; "
            "vessels in "
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
        memory, alarms = RULES.step(memory, AlarmInput(picture, members, time_s, ALL_KINDS, hearing=now))
        expected = expected_sensors(ALL_KINDS, 1.0, 60.0, 60.0)
        none = np.zeros(0, np.int64)
        of = Tracks.empty(), Members.empty(), BearingTracks.empty(), BearingAssociations(none, none, np.zeros(0), np.zeros(0))
        evidence = EvidenceContext(*of, ("west", "vts", "ais"), *expected, np.zeros(0), now)
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
        memory, alarms = RULES.step(
            resumed_at_times(memory, cycle), AlarmInput(picture, members, time_s, ALL_KINDS, hearing=hearing)
        )
        lost |= bool((alarms.kind == AlarmKind.LOST).any())
    assert lost == is_lost


BACK = 80  # cycle in which the radar returns: it was away for less than `forget_s`
LINE_DEG = tuple(map(tuple, offset_deg(np.stack([SITE, SITE]), np.array([[1500.0, -2e3], [1500.0, 2e3]])).tolist()))
LINE = Zone(name="line", kind="line", points_deg=LINE_DEG, crossing="both")


def watched_over(
    kn: float, zone: Zone, gone_at: int, back_at: int, is_known: bool, rules: AlarmRules = RULES
) -> list[VesselAlarms]:
    """The vessel sails east without a track from one cycle to another; the radar fails in cycle 20. Args: is_known: that it does."""
    memory, out, where = rules.init(), [], sensors()
    for cycle in range(back_at + 20):
        time_s, away = PERIOD_S * cycle, gone_at <= cycle < back_at
        row = {"id": 1, "at": (kn * KNOT_M_S * time_s, 0.0), "kn": (kn, 0.0), "flags": int(Flag.COASTING) if away else 0}
        hearing = hearing_of(cycle, 20, back_at) if is_known else None
        given = *picture_of(time_s, [row]), time_s, where, numbered((zone,))
        memory, alarms = rules.step(resumed_at_times(memory, cycle), AlarmInput(*given, hearing=hearing))
        out.append(alarms)
    return out


@pytest.mark.parametrize("gone_at", [18, 20, 22])
def test_a_line_that_is_crossed_while_the_radar_is_silent_is_an_alarm_on_return(gone_at: int) -> None:
    """The line lies 1500 m east: 49 cycles at 20 kn."""
    found, without = (spans(watched_over(20.0, LINE, gone_at, BACK, known), AlarmKind.LINE_CROSSED) for known in (True, False))
    assert found == without
    assert found[1, 1][0][0] == BACK


@pytest.mark.parametrize("gone_at", [18, 22])
def test_a_vessel_is_forgotten_by_zones_though_the_radar_is_silent(gone_at: int) -> None:
    """It lies in the zone, and is away for longer than `forget_s`; its stay ends, as where nothing is known of the radar."""
    rules = RULES.model_copy(update={"forget_s": 120.0})
    port = AREA.model_copy(update={"dwell_s": 30.0})
    found, without = (
        spans(watched_over(0.0, port, gone_at, BACK, known, rules), AlarmKind.ZONE_DWELL)[1, 1] for known in (True, False)
    )
    assert found == without
    assert len(found) == 2


@pytest.mark.parametrize("is_known", [True, False])
def test_who_was_first_seen_in_a_zone_has_not_entered_it_by_time_without_a_track(is_known: bool) -> None:
    """It is tracked for 15 s in the zone, `first_seen_s` is 60 s, and the radar is silent for minutes."""
    rules, memory, where = RULES.model_copy(update={"first_seen_s": 60.0, "start_up_s": 0.0}), RULES.init(), sensors()
    for cycle in range(90):
        time_s, away = PERIOD_S * cycle, cycle >= 18
        rows = [{"id": 1, "at": (9e3, 0.0)}]
        if cycle >= 13:
            rows.append({"id": 2, "at": (0.0, 0.0), "flags": int(Flag.COASTING) if away else 0})
        given = *picture_of(time_s, rows), time_s, where, numbered((AREA,))
        memory, alarms = rules.step(memory, AlarmInput(*given, hearing=hearing_of(cycle, 20, 200) if is_known else None))
        assert AlarmKind.ZONE_ENTER not in alarms.kind
