"""Flags where a sensor is silent: their clocks stand, and go on from where they stood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from checkpoint_world import resumed_at_times
from test_picture import AIS, PERIOD_S, RADAR, SITE, alarms, cycle_of, flagged, sensors
from test_silence import Came, ais_tracks, reports_of

from coastwatch.batches import AisDetection, Flag, Hearing, SensorHearing, Sensors, Stations
from coastwatch.cover import SilenceInput, UsualPauses
from coastwatch.geodesy import offset_deg
from coastwatch.picture import Identity, PictureInput

pytestmark = pytest.mark.contract


def hearing_of(cycle: int, kind: str, first: int, last: int, seen_after: int = 10) -> SensorHearing:
    """All sensors of a kind send nothing from a cycle to another; they are silent once they sent nothing for some cycles."""

    def of(count: int, fails: bool) -> Hearing:
        out = Hearing.empty(R=count)
        if fails and cycle >= last:
            out = replace(out, returned_s=np.full(count, PERIOD_S * last))
        if not fails or not first + seen_after <= cycle < last:
            return out
        since = first - 1 if cycle == first + seen_after else cycle - 1
        return Hearing(out.heard_s, out.usual_s, out.amount, ~out.silent, np.full(count, PERIOD_S * since), out.returned_s)

    return SensorHearing(of(2, kind == "radar"), of(1, kind == "ais"), of(0, False), of(1, kind == "ais"))


def play(script: Sequence[Any], kind: str, first: int, last: int, **more: Any) -> list[Any]:
    """The pictures of a script with a failure; the memory goes through a checkpoint now and then."""
    method, out = Identity(), []
    memory = method.init()
    for cycle, rows in enumerate(script):
        tracks, associations, fused = cycle_of(cycle, rows)
        given = tracks, associations, fused, alarms(tracks), PERIOD_S * cycle, sensors()
        hearing = hearing_of(cycle, kind, first, last)
        memory, (picture, members) = method.step(resumed_at_times(memory, cycle), PictureInput(*given, hearing=hearing, **more))
        out.append((picture, members))
    return out


@pytest.mark.parametrize(("speed_m_s", "waits"), [(4.0, 10), (1.2, 60), (0.4, 60)])
def test_nobody_becomes_dark_while_ais_is_silent_nor_before_a_vessel_of_its_speed_has_sent_again(
    speed_m_s: float, waits: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """AIS fails in cycle 5, for 100 cycles of 3 s. The AIS track ends at once, and the vessel never sends again.

    Under way class B sends each 30 s. At 1.2 m/s, 2.3 kn, the vessel may be slower than 2 kn by the noise of its speed.
    """
    monkeypatch.setattr("test_picture.EAST_M_S", speed_m_s)
    out = flagged(play([[RADAR, AIS]] * 5 + [[RADAR]] * 195, "ais", 5, 105), Flag.DARK)
    assert out.index(True) == 105 + waits + 20, "the longest interval, and `dark_after_s`, after AIS is heard again"
    assert all(out[out.index(True) :])


def test_a_slow_vessel_that_was_silent_before_the_failure_has_its_interval_after_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """It had sent nothing for 45 s when AIS failed: its report of each 180 s may have been lost with the others."""
    monkeypatch.setattr("test_picture.EAST_M_S", 0.8)
    out = flagged(play([[RADAR, AIS]] * 24 + [[RADAR]] * 200, "ais", 30, 130), Flag.DARK)
    assert out.index(True) == 130 + 60 + 20


@pytest.mark.parametrize(("heard", "first"), [(5, 130 + 1), (2, 12 + 20)])
def test_what_is_silent_since_the_newest_report_makes_nobody_dark_before_it_is_known_to_fail(heard: int, first: int) -> None:
    """The vessel sends until cycle 11, the others until cycle 30. AIS is silent 30 s later, and heard again in cycle 130.

    Of its 20 cycles 18 are over by the newest report. One of two vessels that stop sending is dark at once.
    """
    method, pauses, up = Identity(), UsualPauses(), []
    memory, habits = method.init(), pauses.init()
    for cycle in range(160):
        came = Came(ais=() if 30 < cycle < 130 else (1e3,) * heard, plots=(0, 0, 0, 1, 1, 1))
        given = SilenceInput(reports_of(came, PERIOD_S * cycle), ais_tracks((1e3,) * heard), PERIOD_S * cycle, sensors())
        habits, hearing = pauses.step(habits, given)
        tracks, associations, fused = cycle_of(cycle, [RADAR, AIS] if cycle < 12 else [RADAR])
        now = tracks, associations, fused, alarms(tracks), PERIOD_S * cycle, sensors()
        memory, (picture, _) = method.step(memory, PictureInput(*now, hearing=hearing))
        up.append(bool((picture.flags & Flag.DARK).any()))
    assert up.index(True) == first


def test_a_vessel_that_sends_again_within_three_minutes_is_never_dark(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("test_picture.EAST_M_S", 0.4)
    script = [[RADAR, AIS]] * 5 + [[RADAR]] * 155 + [[RADAR, AIS]] * 40
    assert not any(flagged(play(script, "ais", 5, 105), Flag.DARK))


def test_the_time_without_ais_stands_and_goes_on() -> None:
    """The last report is of cycle 29, AIS is silent from cycle 40 to 110. One vessel was dark before, another had 45 s left."""
    dark_before = flagged(play([[RADAR, AIS]] * 8 + [[RADAR]] * 170, "ais", 30, 110), Flag.DARK)
    assert dark_before.index(True) == 28
    assert all(dark_before[28:])
    out = flagged(play([[RADAR, AIS]] * 24 + [[RADAR]] * 160, "ais", 30, 110), Flag.DARK)
    assert out.index(True) == 109 + 15


def test_a_radar_that_is_silent_makes_no_vessel_ais_without_radar() -> None:
    script = [[RADAR, AIS]] * 5 + [[AIS]] * 95
    assert not any(flagged(play(script, "radar", 5, 100), Flag.AIS_WITHOUT_RADAR))
    after = flagged(play(script + [[AIS]] * 40, "radar", 5, 100), Flag.AIS_WITHOUT_RADAR)
    assert after.index(True) == 100 + 20, "`unseen_after_s` after the radar is heard again"


def test_the_time_without_radar_goes_on_though_nothing_is_known_of_detection() -> None:
    """Unseen for 30 s before the failure, in which the cover says nothing of the vessel; flagged 30 s after it."""
    before = AisDetection(np.array([3]), np.array([0.9]))
    method, out = Identity(), []
    memory = method.init()
    for cycle in range(160):
        tracks, associations, fused = cycle_of(cycle, [AIS])
        hearing = hearing_of(cycle, "radar", 10, 120)
        detection = AisDetection.empty() if hearing.radars.silent.any() else before
        given = tracks, associations, fused, alarms(tracks), PERIOD_S * cycle, sensors()
        memory, (picture, _) = method.step(memory, PictureInput(*given, hearing=hearing, detection=detection))
        out.append(bool((picture.flags & Flag.AIS_WITHOUT_RADAR).any()))
    assert out.index(True) - 119 in (10, 11, 12)
    assert not any(out[:120])


@pytest.mark.parametrize("kind", ["ais", "radar"])
def test_a_split_while_a_sensor_is_silent_contradicts_nothing(kind: str) -> None:
    away = (3, 2, 1, 600.0, 235000001, 5)
    script = [[RADAR, AIS]] * 25 + [[RADAR, away]] * 30
    out = flagged(play(script, kind, 12, 50), Flag.AIS_CONTRADICTED)
    assert not any(out[:50])
    assert out[-1], "it goes on when the sensor is heard"


def test_only_where_no_other_sensor_is_heard() -> None:
    """Of two radars that reach the vessel one is silent: the other one should see it."""
    method, up = Identity(), []
    memory = method.init()
    for cycle, rows in enumerate([[RADAR, AIS]] * 5 + [[AIS]] * 40):
        tracks, associations, fused = cycle_of(cycle, rows)
        hearing = hearing_of(cycle, "radar", 5, 100)
        one = Hearing.join([hearing.radars.take(np.array([0])), Hearing.empty(R=1)])
        given = tracks, associations, fused, alarms(tracks), PERIOD_S * cycle, sensors()
        memory, (picture, _) = method.step(memory, PictureInput(*given, hearing=replace(hearing, radars=one)))
        up.append(bool((picture.flags & Flag.AIS_WITHOUT_RADAR).any()))
    assert up.index(True) == 25


def test_a_sensor_that_was_never_heard_covers_nothing() -> None:
    method = Identity()
    unheard = Hearing(*(a - np.inf if name == "heard_s" else a for name, a in vars(Hearing.empty(R=1)).items()))
    for rows, hearing, flag in (
        ([RADAR], SensorHearing(Hearing.empty(R=2), unheard, Hearing.empty(), unheard), Flag.DARK),
        ([AIS], SensorHearing(Hearing.join([unheard] * 2), unheard, Hearing.empty(), unheard), Flag.AIS_WITHOUT_RADAR),
    ):
        memory, up = method.init(), []
        for cycle in range(60):
            tracks, associations, fused = cycle_of(cycle, rows)
            given = tracks, associations, fused, alarms(tracks), PERIOD_S * cycle, sensors()
            memory, (picture, _) = method.step(memory, PictureInput(*given, hearing=hearing))
            up.append(bool((picture.flags & flag).any()))
        assert not any(up)


def play_lagging(script: Sequence[Any], first: int, last: int) -> list[Any]:
    """As `play`: both radars send no plot from a cycle to another, and detection is that of the cycle before, as in the pipeline."""
    method, pauses, out = Identity(), UsualPauses(), []
    memory, habits, detection = method.init(), pauses.init(), AisDetection.empty()
    for cycle, rows in enumerate(script):
        time_s = PERIOD_S * cycle
        came = Came(plots=() if first <= cycle < last else (0, 0, 0, 1, 1, 1))
        habits, hearing = pauses.step(habits, SilenceInput(reports_of(came, time_s), ais_tracks(()), time_s, sensors()))
        tracks, associations, fused = cycle_of(cycle, rows)
        given = tracks, associations, fused, alarms(tracks), time_s, sensors()
        memory, (picture, members) = method.step(
            resumed_at_times(memory, cycle), PictureInput(*given, hearing=hearing, detection=detection)
        )
        detection = AisDetection(np.array([3]), np.array([0.0 if hearing.radars.silent.all() else 0.9]))
        out.append((picture, members))
    assert hearing.radars.returned_s.tolist() == [PERIOD_S * last] * 2
    return out


def test_a_vessel_without_radar_stays_so_when_the_radar_returns() -> None:
    """The radars are silent from cycle 55 to 120; their detection of vessels is known again a cycle after they return."""
    out = flagged(play_lagging([[RADAR, AIS]] * 5 + [[AIS]] * 155, 50, 120), Flag.AIS_WITHOUT_RADAR)
    assert out.index(True) == 5 + 20
    assert all(out[25:])


def test_the_time_without_radar_goes_on_when_the_radar_returns() -> None:
    """Unseen for 13 cycles of 20 by the last plot. The cycle in which the radars return counts no time."""
    out = flagged(play_lagging([[RADAR, AIS]] * 37 + [[AIS]] * 103, 50, 120), Flag.AIS_WITHOUT_RADAR)
    assert out.index(True) in (120 + 7, 120 + 8)


def test_a_split_pair_stays_contradicted_when_the_radar_returns() -> None:
    away = (3, 2, 1, 600.0, 235000001, 5)
    out = flagged(play_lagging([[RADAR, AIS]] * 25 + [[RADAR, away]] * 70, 50, 80), Flag.AIS_CONTRADICTED)
    assert out.index(True) < 50
    assert all(out[out.index(True) :])


def two_stations(east_m: float) -> Sensors:
    """One station at the site, and one so far east of it; each reaches 50 km."""
    sites = offset_deg(np.stack([SITE, SITE]), np.array([[0.0, 0.0], [east_m, 0.0]]))
    return replace(sensors(), stations=Stations(np.array(["a", "b"]), sites, np.full(2, 50e3)))


@pytest.mark.parametrize(
    ("east_m", "returns", "first"),
    [
        (550e3, (1,), 5 + 20),  # it does not reach the vessel
        (10e3, (1,), 5 + 20),  # another one reached the vessel meanwhile
        (10e3, (0, 1), 4 + 30),  # both return in cycle 4
        (550e3, (0,), 4 + 30),
    ],
)
def test_only_where_no_other_station_was_heard_does_one_that_returns_put_off_dark(
    east_m: float, returns: tuple[int, ...], first: int
) -> None:
    """The vessel sends until cycle 4, in which stations are heard again."""
    method, up = Identity(), []
    memory = method.init()
    returned_s = np.where(np.isin([0, 1], returns), PERIOD_S * 4, -np.inf)
    for cycle, rows in enumerate([[RADAR, AIS]] * 5 + [[RADAR]] * 100):
        tracks, associations, fused = cycle_of(cycle, rows)
        stations = replace(Hearing.empty(R=2), returned_s=returned_s)
        hearing = SensorHearing(Hearing.empty(R=2), stations, Hearing.empty(), Hearing.empty(R=1))
        given = tracks, associations, fused, alarms(tracks), PERIOD_S * cycle, two_stations(east_m)
        memory, (picture, _) = method.step(memory, PictureInput(*given, hearing=hearing))
        up.append(bool((picture.flags & Flag.DARK).any()))
    assert up.index(True) == first


def test_a_station_far_away_that_flaps_puts_off_nobody() -> None:
    """It is heard again each fifth cycle."""
    method, up = Identity(), []
    memory = method.init()
    for cycle, rows in enumerate([[RADAR, AIS]] * 5 + [[RADAR]] * 40):
        tracks, associations, fused = cycle_of(cycle, rows)
        stations = replace(Hearing.empty(R=2), returned_s=np.array([-np.inf, PERIOD_S * (cycle - cycle % 5)]))
        hearing = SensorHearing(Hearing.empty(R=2), stations, Hearing.empty(), Hearing.empty(R=1))
        given = tracks, associations, fused, alarms(tracks), PERIOD_S * cycle, two_stations(550e3)
        memory, (picture, _) = method.step(memory, PictureInput(*given, hearing=hearing))
        up.append(bool((picture.flags & Flag.DARK).any()))
    assert up.index(True) == 25
