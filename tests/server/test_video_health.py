"""The health of radars that send video: what is lost, stopped or doubled is said, and what is made of it is known."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from video_world import sensors

from coastwatch.batches import COVER_AZIMUTHS, COVER_RANGES, Extractions, RadarCover
from coastwatch.formats.video_state import VideoState
from coastwatch.operators.api.metrics import Metrics
from coastwatch.server.link import Link, RadarState
from coastwatch.server.troubles import Trouble, of_feeds
from coastwatch.server.video_health import PlotsOfVideo, VideoHealth
from coastwatch.store import VIDEO_VALUES

pytestmark = pytest.mark.contract

NOW_S = 1_750_000_000.0


def state(**fields) -> VideoState:
    heard = {"period_s": 2.4, "turns": 3, "spokes_a_turn": 1000, "spokes": 3000, "heard_s": NOW_S, "cell_m": 10.0, "cells": 100}
    return VideoState("north", 25, 1, **heard | fields)


def troubles(one: VideoState, before: VideoState | None = None, now_s: float = NOW_S) -> list[str]:
    radars = {"north": before or one}
    health = VideoHealth(radars)
    health.look(NOW_S - 50.0)
    radars["north"] = one
    health.look(NOW_S)
    return health.states(now_s)[0]["troubles"]


def test_healthy_video_has_no_trouble_and_what_is_not_known_is_none():
    assert troubles(state()) == []
    health = VideoHealth({"north": VideoState("north", 25, 1)})
    (found,) = health.states(NOW_S)
    assert (found["turn_s"], found["cell_m"], found["spokes_a_turn"], found["plots_a_turn"]) == (None,) * 4
    assert found["lost_share"] == 0.0


def test_video_that_stops_is_said_after_three_turns_and_ten_seconds():
    assert troubles(state(), now_s=NOW_S + 9.0) == []
    assert troubles(state(), now_s=NOW_S + 11.0) == ["its video has stopped: nothing has come for 11 s"]
    assert troubles(state(period_s=5.0), now_s=NOW_S + 14.0) == []


def test_lost_spokes_and_parts_of_the_last_minute_are_said():
    now = state(spokes=3000 + 900, spokes_lost=5 + 60, parts_lost=10)
    assert troubles(now, state(spokes_lost=5)) == ["70 of 970 spokes of the last minute were lost, or a part of them"]
    assert troubles(state(spokes_lost=400)) == []  # long ago
    assert troubles(state(spokes=3900, spokes_lost=8), state()) == []  # a few


def test_two_senders_and_a_clock_that_stands_are_said():
    doubled = state(senders=("10.0.0.1:8600", "10.0.0.2:8600"), second_s=NOW_S - 5.0)
    (said,) = troubles(doubled)
    assert said == "two senders have its SAC 25, SIC 1: 10.0.0.1:8600, which is used, and 10.0.0.2:8600, which is not"
    assert troubles(replace(doubled, second_s=NOW_S - 90.0)) == []
    assert troubles(state(clock_stuck=True)) == ["its time of day does not go on: the time of arrival is taken"]


def test_video_without_time_of_day_is_said_once_for_some_minutes():
    untimed = state(has_time_of_day=False, untimed_s=NOW_S - 5.0)
    assert troubles(untimed) == ["it sends no time of day: the time of arrival is taken"]
    assert troubles(replace(untimed, has_time_of_day=True)) == []  # it came back
    assert troubles(replace(untimed, untimed_s=NOW_S - 601.0)) == []
    assert not VideoHealth({"north": untimed}).states(NOW_S)[0]["time_of_day"]


def test_a_clock_ahead_and_azimuths_that_go_down_are_said():
    assert troubles(state(ahead_s=1.9)) == []
    assert troubles(state(ahead_s=40.0)) == [
        "its clock is 40 s ahead: its vessels lie where they were so long ago, beside their AIS"
    ]
    assert troubles(state(ahead_s=40.0, clock_stuck=True)) == ["its time of day does not go on: the time of arrival is taken"]
    (said,) = troubles(state(counter_clockwise=True))
    assert said.startswith("its azimuths go counter-clockwise")


def of_a_run(cycles: int, **fields) -> tuple[PlotsOfVideo, RadarState]:
    """What is made of so many cycles with video, and then of ten without, and the state of the radar."""
    plots, none = PlotsOfVideo(), Extractions.empty()
    for cycle in range(cycles + 10):
        found = Extractions(np.array([0]), np.array([8]), np.array([9.5])) if cycle < cycles else none
        given = SimpleNamespace(time_s=NOW_S + 3.0 * cycle, extractions=found, radar_cover=RadarCover.empty())
        plots.note(given, sensors())
        if cycle == cycles - 1:
            feed = Link().as_feed("x", radars=VideoHealth({"north": state(**fields)}).states(NOW_S))
            (before,) = plots.added_to([feed])[0]["radars"]
    return plots, before


def test_a_turn_or_a_range_that_is_not_that_of_the_scenario_is_said():
    one = sensors().radars
    range_m, turn_s = float(one.range_m[0]), float(one.period_s[0])
    as_stated = {"period_s": turn_s, "first_m": 0.0, "cell_m": range_m / 100.0}
    assert of_a_run(5, **as_stated)[1]["troubles"] == []
    (said,) = of_a_run(5, **as_stated | {"period_s": 2.0 * turn_s})[1]["troubles"]
    assert said == f"it turns in {2.0 * turn_s:.2f} s, the scenario says {turn_s:.2f} s: set rpm = {30.0 / turn_s:.1f}"
    (said,) = of_a_run(5, **as_stated | {"cell_m": range_m / 200.0})[1]["troubles"]
    assert said == f"its video reaches {range_m / 3704.0:.1f} nm, the scenario says range_nm = {range_m / 1852.0:.1f}"


def test_what_was_made_of_video_is_not_known_any_more_once_it_has_stopped():
    plots, before = of_a_run(5)
    assert (before["plots_a_turn"], before["threshold_db"]) == (pytest.approx(8 / 3.0 * 2.4, abs=0.05), 9.5)
    feed = Link().as_feed("x", radars=VideoHealth({"north": state()}).states(NOW_S))
    (after,) = plots.added_to([feed])[0]["radars"]
    assert (after["plots_a_turn"], after["threshold_db"]) == (None, None)


def test_troubles_of_radars_are_among_those_of_the_server():
    radars = VideoHealth({"north": state(clock_stuck=True)}).states(NOW_S)
    feed = {**Link().as_feed("a feed", radars=radars), "silent_s": 0.0}
    assert of_feeds([feed], NOW_S) == [Trouble("video", "north", None, radars[0]["troubles"][0], False)]


def test_troubles_of_a_radar_that_comes_over_two_feeds_name_the_feed():
    stopped = VideoHealth({"north": state()}).states(NOW_S + 20.0)
    feeds = [
        {**Link().as_feed(name, radars=radars), "silent_s": 0.0}
        for name, radars in (("left", stopped), ("right", VideoHealth({"north": state()}).states(NOW_S)))
    ]
    (said,) = of_feeds(feeds, NOW_S)
    assert said.text == "its video has stopped: nothing has come for 20 s (over left)"


def test_a_radar_of_two_feeds_has_metrics_of_each():
    feeds = [
        Link().as_feed(name, radars=VideoHealth({"north": state(spokes_lost=lost)}).states(NOW_S))
        for name, lost in (("left", 1), ("right", 2))
    ]
    metrics = Metrics()
    metrics.ask(lambda: (True, {}, feeds, []))
    lines = [line for line in metrics.text().decode().splitlines() if line.startswith("coastwatch_radar")]
    for lost, name in ((1, "left"), (2, "right")):
        assert f'coastwatch_radar_total{{count="spokes_lost",feed="{name}",radar="north"}} {lost}.0' in lines
    assert len({line.rpartition(" ")[0] for line in lines}) == len(lines)


def test_plots_a_turn_threshold_and_what_was_learnt_are_added():
    shape = (2, COVER_AZIMUTHS, COVER_RANGES)
    looks, detection, density = np.zeros(shape), np.full(shape, 0.5), np.full(shape, 1e-8)
    looks[0, 3, 2], detection[0, 3, 2] = 10.0, 0.9
    cover = RadarCover(
        range_m=np.full(2, 1e4), site_deg=np.zeros((2, 2)), turns=np.array([9.0, 0.0]), ais_detection=detection, ais_looks=looks,
        track_detection=detection, track_looks=looks, false_plots_per_m2=density,
    )  # fmt: skip
    plots = PlotsOfVideo()
    for cycle in range(31):
        found = Extractions(np.array([0]), np.array([8]), np.array([9.5]))
        plots.note(SimpleNamespace(time_s=NOW_S + 3.0 * cycle, extractions=found, radar_cover=cover), sensors())
    feed = Link().as_feed("x", radars=VideoHealth({"north": state(), "south": replace(state(), name="south")}).states(NOW_S))
    (north, south) = plots.added_to([feed])[0]["radars"]
    assert north["plots_a_turn"] == pytest.approx(8 / 3.0 * 2.4, abs=0.05)
    assert north["threshold_db"] == 9.5
    assert north["detection_probability"] == 0.9
    assert north["false_plots_a_turn"] == pytest.approx(math.pi * 1e8 * 1e-8, abs=0.01)
    assert south["plots_a_turn"] is None
    values = plots.stored([feed], sensors())
    assert values.shape == (len(sensors().radars), len(VIDEO_VALUES))
    of = dict(zip(VIDEO_VALUES, values[0], strict=True))
    assert all(of[name] == north[name] for name in VIDEO_VALUES)
    (without, *_) = plots.stored([], sensors())
    assert np.isnan(without[:5]).all()  # video of a file has no feed
    assert (without[5:] > 0.0).all()
    assert PlotsOfVideo().stored([], sensors()).shape == (0, len(VIDEO_VALUES))
