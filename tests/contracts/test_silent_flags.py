"""Flags where a sensor is silent: their clocks stand, and go on from where they stood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from test_picture import AIS, PERIOD_S, RADAR, alarms, cycle_of, flagged, sensors

from coastwatch.batches import AisDetection, Flag, Hearing, SensorHearing
from coastwatch.picture import Identity
from coastwatch.server.checkpoint import load, save


def hearing_of(cycle: int, kind: str, first: int, last: int, seen_after: int = 10) -> SensorHearing:
    """All sensors of a kind send nothing from a cycle to another; they are silent once they sent nothing for some cycles."""

    def of(count: int, fails: bool) -> Hearing:
        out = Hearing.always(count)
        if fails and cycle >= last:
            out = replace(out, returned_s=np.full(count, PERIOD_S * last))
        if not fails or not first + seen_after <= cycle < last:
            return out
        since = first - 1 if cycle == first + seen_after else cycle - 1
        return Hearing(out.heard_s, out.usual_s, out.amount, ~out.silent, np.full(count, PERIOD_S * since), out.returned_s)

    return SensorHearing(of(2, kind == "radar"), of(1, kind == "ais"), of(0, False), of(1, kind == "ais"))


def play(script: Sequence[Any], kind: str, first: int, last: int, **more: Any) -> list[Any]:
    """The pictures of a script with a failure; the memory goes through a checkpoint in each cycle."""
    method, out = Identity(), []
    memory = method.init()
    for cycle, rows in enumerate(script):
        tracks, associations, fused = cycle_of(cycle, rows)
        given = tracks, associations, fused, alarms(tracks), PERIOD_S * cycle, sensors()
        hearing = hearing_of(cycle, kind, first, last)
        memory, picture, members = method.step(load(save(memory)), *given, hearing=hearing, **more)
        out.append((picture, members))
    return out


def test_nobody_becomes_dark_while_ais_is_silent_nor_before_a_moored_vessel_has_sent_again() -> None:
    """AIS fails in cycle 5, for 100 cycles of 3 s. The AIS track ends at once, and the vessel never sends again."""
    out = flagged(play([[RADAR, AIS]] * 5 + [[RADAR]] * 195, "ais", 5, 105), Flag.DARK)
    assert out.index(True) == 105 + 80, "180 s in which any vessel sends, and `dark_after_s`, after AIS is heard again"
    assert all(out[185:])


def test_a_vessel_that_sends_again_within_three_minutes_is_never_dark() -> None:
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
        memory, picture, _ = method.step(memory, *given, hearing=hearing, detection=detection)
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
        one = Hearing.join([hearing.radars.take(np.array([0])), Hearing.always(1)])
        given = tracks, associations, fused, alarms(tracks), PERIOD_S * cycle, sensors()
        memory, picture, _ = method.step(memory, *given, hearing=replace(hearing, radars=one))
        up.append(bool((picture.flags & Flag.AIS_WITHOUT_RADAR).any()))
    assert up.index(True) == 25


def test_a_sensor_that_was_never_heard_covers_nothing() -> None:
    method = Identity()
    unheard = Hearing(*(a - np.inf if name == "heard_s" else a for name, a in vars(Hearing.always(1)).items()))
    for rows, hearing, flag in (
        ([RADAR], SensorHearing(Hearing.always(2), unheard, Hearing.empty(), unheard), Flag.DARK),
        ([AIS], SensorHearing(Hearing.join([unheard] * 2), unheard, Hearing.empty(), unheard), Flag.AIS_WITHOUT_RADAR),
    ):
        memory, up = method.init(), []
        for cycle in range(60):
            tracks, associations, fused = cycle_of(cycle, rows)
            given = tracks, associations, fused, alarms(tracks), PERIOD_S * cycle, sensors()
            memory, picture, _ = method.step(memory, *given, hearing=hearing)
            up.append(bool((picture.flags & flag).any()))
        assert not any(up)
