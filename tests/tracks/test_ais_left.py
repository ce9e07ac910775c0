"""Tracks leave AIS messages that contradict their plots, whatever their association; none that messages alone keep is reported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from radar_world import PERIOD_S, cut, plots_of, two_radars, world
from test_ais_guides_plots import CYCLES, errors_m, messages_of, run

from coastwatch.batches import Plots, Radars
from coastwatch.server.checkpoint import load, save
from coastwatch.tracks import RegionInput, TableTracker

pytestmark = pytest.mark.contract

METHODS = (
    "guided_vimmjipda",
    "vimmjipda_sequential",
    "vimmjipda_precise_batch",
    "vimmjipda_noisy_batch",
    "multi_hypothesis",
    "sided_multi_hypothesis",
)
PLOT_SIGMA_M = 45.0
MMSI = 219_003_000  # of vessel 0


@pytest.fixture(scope="module")
def drifting():
    """Two vessels. The AIS of vessel 0 drifts away by 5 m/s from the 24th second on: truth, plots, messages."""
    truth = world(2, 31, kick_m_s=0.0, side_nm=1.0)
    plots = plots_of(truth, two_radars(), PERIOD_S * 2 * CYCLES, 31)
    messages = messages_of(truth, np.arange(2), every_s=3.0, cycles=2 * CYCLES)
    off = np.where((messages.origin == 0) & (messages.time_s > 24.0), 5.0 * (messages.time_s - 24.0), 0.0)
    return (
        truth,
        plots,
        replace(messages, mmsi=MMSI + messages.origin, position_m=messages.position_m + off[:, None] * [1.0, 0.0]),
    )


@pytest.mark.parametrize("method", METHODS)
def test_an_ais_that_drifts_away_is_left_and_the_track_goes_on_by_its_plots(method, drifting):
    truth, plots, messages = drifting
    memory, out = None, []
    for cycle in range(2 * CYCLES):  # it goes on from a checkpoint of each
        memory, tracks = run(TableTracker(method=method), plots, messages, memory, range(cycle, cycle + 1))
        memory, out = load(save(memory)), [*out, *tracks]
    before, after = (out[at].take(out[at].origin == 0) for at in (6, -1))
    assert (before.held_mmsi.tolist(), after.held_mmsi.tolist()) == ([MMSI], [-1])
    assert before.track_id.tolist() == after.track_id.tolist()
    assert out[-1].held_mmsi[out[-1].origin == 1].tolist() == [MMSI + 1]
    assert max(errors_m(tracks, truth).max() for tracks in out[6:]) < 3.0 * PLOT_SIGMA_M  # the AIS is 600 m off at the end


@pytest.mark.parametrize("method", ["guided_vimmjipda", "multi_hypothesis"])
def test_a_slow_radar_that_does_not_see_the_vessel_does_not_delay_that_its_ais_is_left(method, drifting):
    """A third radar of the region turns once in 30 s, and has the vessel outside its range."""
    _, plots, messages = drifting
    two = two_radars()
    slow = replace(
        two.radars.take(np.array([0])), name=np.array(["slow"]), period_s=np.array([30.0]), range_m=np.array([100.0])
    )
    three = replace(two, radars=Radars.join([two.radars, slow]))
    tracker, left_in = TableTracker(method=method), []
    for sensors in (two, three):
        memory, first = tracker.init(), None
        for cycle in range(2 * CYCLES):
            end_s = PERIOD_S * (cycle + 1)
            now = messages.take((messages.time_s > end_s - PERIOD_S) & (messages.time_s <= end_s))
            given = RegionInput.of_plots(cut(plots, cycle), end_s, sensors)
            memory, _ = tracker.step(memory, given._replace(messages=now))
            if first is None and (memory.plots_alone.left_mmsi[memory.table.live] == MMSI).any():
                first = cycle
        left_in.append(first)
    assert left_in[0] is not None
    assert left_in[0] == left_in[1]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("shadow_s", [0.0, 80.0])
def test_a_vessel_that_turns_keeps_its_messages_also_in_radar_shadow(method, shadow_s):
    """Ten vessels turn by 90 degrees in a minute: a filter of plots alone lags behind, and in the shadow says where they were going."""
    truth = world(10, 2, kick_m_s=0.0, side_nm=5.0, span_s=PERIOD_S * 80)
    begin_s, angle = 70.0 + 4.0 * np.arange(10), np.radians(1.5 * 2.0 * np.arange(31))
    direction = truth.velocity_m_s / np.hypot(*truth.velocity_m_s.T)[:, None]
    across = direction @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    ways = 6.0 * (np.cos(angle)[:, None, None] * direction + np.sin(angle)[:, None, None] * across)
    kick_s = begin_s[:, None] + 2.0 * np.arange(30)
    turning = replace(truth, velocity_m_s=ways[0], kick_s=kick_s, kick_m_s=np.stack(np.diff(ways, axis=0), axis=1))
    plots = plots_of(turning, two_radars(), PERIOD_S * 80, 2)
    since_s = plots.time_s - begin_s[plots.origin] + 5.0
    plots = plots.take((since_s < 0.0) | (since_s > shadow_s))
    messages = messages_of(turning, np.arange(10), every_s=6.0, cycles=80)
    messages = replace(messages, mmsi=MMSI + messages.origin)
    memory, out = run(TableTracker(method=method), plots, messages, cycles=range(80))
    assert (memory.plots_alone.left_mmsi[memory.table.live] < 0).all()
    last = out[-1]
    assert len(last) >= 6  # some have left the range of both radars
    assert last.held_mmsi.tolist() == (MMSI + last.origin).tolist()


@pytest.mark.parametrize("method", ["vimmjipda_sequential", "multi_hypothesis"])
def test_messages_that_are_always_trusted_draw_the_track_away(method, drifting):
    """As the papers have it."""
    truth, plots, messages = drifting
    tracker = TableTracker(method=method, messages={"trust": "always"})
    _, out = run(tracker, plots, messages, cycles=range(2 * CYCLES))
    assert max(errors_m(tracks.take(tracks.held_mmsi == MMSI), truth).max(initial=0.0) for tracks in out) > 500.0


@pytest.mark.parametrize("method", METHODS)
def test_a_vessel_that_no_radar_sees_is_not_reported(method):
    truth = world(1, 33, kick_m_s=0.0, side_nm=1.0)
    messages = messages_of(truth, np.arange(1), every_s=3.0)
    _, out = run(TableTracker(method=method), Plots.empty(), messages)
    assert [len(tracks) for tracks in out] == [0] * CYCLES


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("first", [False, True])
def test_one_plot_does_not_show_a_vessel_that_messages_keep_and_three_do(method, first):
    """One false plot will once be near an AIS that states a wrong position. Args: first: it comes before the messages."""
    truth = world(1, 33, kick_m_s=0.0, side_nm=1.0)
    messages = messages_of(truth, np.arange(1), every_s=3.0)
    plots = plots_of(truth, two_radars(), PERIOD_S * CYCLES, 33)
    one = np.flatnonzero(plots.time_s > 31.0)[:1]
    if first:
        messages = messages.take(messages.time_s > plots.time_s[one])
    _, out = run(TableTracker(method=method), plots.take(one), messages)
    assert [len(tracks) for tracks in out] == [0] * CYCLES
    _, out = run(TableTracker(method=method), plots.take(one + np.arange(3)), messages)
    assert 1 in [len(tracks) for tracks in out]


@pytest.mark.parametrize("method", METHODS)
def test_a_track_goes_on_under_its_number_when_radars_see_its_vessel_again(method):
    """Vessel 0 is in radar shadow for 45 s and sends each 3 s: its AIS track stands for it meanwhile."""
    truth = world(2, 35, kick_m_s=0.0, side_nm=1.0)
    plots = plots_of(truth, two_radars(), PERIOD_S * 2 * CYCLES, 35)
    hidden = (plots.origin == 0) & (plots.time_s > 24.0) & (plots.time_s < 69.0)
    messages = messages_of(truth, np.arange(2), every_s=3.0, cycles=2 * CYCLES)
    _, out = run(TableTracker(method=method), plots.take(~hidden), messages, cycles=range(2 * CYCLES))
    of = [tracks.track_id[tracks.origin == 0].tolist() for tracks in out]
    assert [] in of[18:23]
    assert of[7] == of[-1]


def test_what_tracks_do_without_messages_is_theirs_alone():
    """A tracker of plots alone keeps no second filter, and particles take every message."""
    for method, kept in (("vimmjipda", 0), ("bp_particles", 0), ("multi_hypothesis", 3)):
        tracker = TableTracker(method=method)
        memory, _ = run(tracker, plots_of(world(2, 31), two_radars(), 9.0, 31), messages_of(world(2, 31), [0]), cycles=range(3))
        assert memory.plots_alone.models == kept
        assert tracker.tests_messages == (kept > 0)
