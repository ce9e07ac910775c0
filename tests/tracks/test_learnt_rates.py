"""What a radar detects is learnt: few false tracks in ten times the stated clutter, and tracks that live where half is missed."""

from __future__ import annotations

import numpy as np
import pytest
from radar_world import PERIOD_S, plots_of, run, two_radars, world

from coastwatch.batches import Plots
from coastwatch.tracks import TableTracker
from coastwatch.tracks.radar.life import ExistenceManagement
from coastwatch.tracks.radar.local_bursts import local_burst_per_m2
from coastwatch.tracks.radar.rates import LearntRates, RateSettings

pytestmark = pytest.mark.contract

STATED = ExistenceManagement(rates=RateSettings(learnt=False))
CLUTTER_PER_M2 = 5e-6
RANGE_NM, CYCLES, LONG = 3.0, 30, 45
ALONE_NM = 2.0  # at which no vessel is in the range of both radars


def tracker(learnt):
    return TableTracker(method="guided_vimmjipda", **({} if learnt else {"upkeep": STATED}))


def test_ten_times_the_clutter_is_learnt_and_makes_few_tracks():
    truth, sensors = world(100, 31), two_radars(range_nm=RANGE_NM)
    plots = plots_of(truth, sensors, PERIOD_S * CYCLES, 31, detection=0.9, clutter_per_m2=CLUTTER_PER_M2)
    (memory, learnt), (_, stated) = (run(tracker(one), plots, CYCLES, sensors) for one in (True, False))
    known = memory.rates.false_plots_per_m2(RateSettings(), sensors.radars, np.full(2, 1e-6))
    prior = 10.0 / (10.0 + memory.rates.turns)
    np.testing.assert_allclose(known, prior * 1e-6 + (1.0 - prior) * CLUTTER_PER_M2, rtol=0.1)
    false = [sum(int((tracks.origin < 0).sum()) for tracks in out[15:]) for out in (learnt, stated)]
    vessels = [np.mean([len(np.unique(t.origin[t.origin >= 0])) for t in out[15:]]) for out in (learnt, stated)]
    assert false[0] < 0.1 * false[1]
    assert vessels[0] > 0.9 * vessels[1]


def test_a_radar_that_misses_half_keeps_its_tracks():
    truth, sensors = world(200, 32), two_radars(range_nm=ALONE_NM)
    plots = plots_of(truth, sensors, PERIOD_S * CYCLES, 32, detection=0.5)
    (memory, learnt), (_, stated) = (run(tracker(one), plots, CYCLES, sensors) for one in (True, False))
    probability = memory.rates.detection(RateSettings(), np.full(2, 0.9), STATED.visible_share).probability
    assert np.all((probability > 0.5) & (probability < 0.8))  # from 0.9 towards 0.5 over 0.84, the share of visible vessels
    seen = [np.mean([len(tracks) for tracks in out[20:]]) for out in (learnt, stated)]
    assert seen[0] > 1.05 * seen[1]


@pytest.mark.parametrize("method", ["vimmjipda", "multi_hypothesis"])
def test_a_burst_of_clutter_makes_few_tracks_and_fades(method):
    truth, sensors, calm = world(100, 33), two_radars(range_nm=RANGE_NM), 5e-7
    steady = plots_of(truth, sensors, PERIOD_S * CYCLES, 33, detection=0.9, clutter_per_m2=calm)
    storm = plots_of(world(0, 1), sensors, PERIOD_S * CYCLES, 34, clutter_per_m2=25 * calm)
    in_burst = storm.take((storm.time_s > 20 * PERIOD_S) & (storm.time_s < 25 * PERIOD_S))
    every = Plots.join([steady, in_burst])
    every = every.take(np.argsort(every.time_s, kind="stable"))
    memory, out = run(TableTracker(method=method), every, CYCLES, sensors)
    false = [len(np.setdiff1d(tracks.track_id, out[19].track_id)) for tracks in out[20:]]
    assert max(false) <= 2  # without the density of the burst 32 and 55
    assert np.isin(out[19].track_id, out[-1].track_id).mean() > 0.9
    known = memory.rates.false_plots_per_m2(RateSettings(), sensors.radars, np.full(2, calm))
    assert np.all(memory.rates.burst_per_m2 < 25 * calm * np.exp(-2.0))
    assert np.all((known > calm) & (known < 6 * calm))


def test_a_squall_in_a_part_of_the_range_makes_few_tracks():
    """Fifteen plots a turn within 400 m are not many for a radar, and dozens of false vessels were dark."""
    truth, sensors, calm = world(40, 35), two_radars(range_nm=RANGE_NM), 5e-7
    steady = plots_of(truth, sensors, PERIOD_S * LONG, 35, detection=0.9, clutter_per_m2=calm)
    storm = plots_of(world(0, 1), sensors, PERIOD_S * LONG, 36, clutter_per_m2=3e-5)
    in_rain = np.hypot(*(storm.position_m - storm.site_m - [0.0, 2500.0]).T) < 400.0
    in_burst = storm.take(in_rain & (storm.sensor == 0) & (storm.time_s > 35 * PERIOD_S))
    every = Plots.join([steady, in_burst])
    every = every.take(np.argsort(every.time_s, kind="stable"))
    _, out = run(tracker(True), every, LONG, sensors)
    assert max(int((tracks.origin < 0).sum()) for tracks in out) <= 2  # without the density of the squall 5
    assert np.isin(out[34].track_id, out[-1].track_id).all()


def test_a_plot_far_beyond_the_range_is_no_matter_for_local_bursts():
    """The grid went out to it: one plot at 400 km of a radar of 500 m took seconds and gigabytes."""
    plots = np.random.default_rng(1).uniform(-60.0, 60.0, (40, 2))
    wild = np.vstack([plots, [[3e5, -3e5], [1e300, 0.0]]])
    burst = local_burst_per_m2(wild, np.ones(42), wild[40:], 500.0, 1e-6)
    assert (burst[:40] > 1e-4).all()
    assert burst[40:].tolist() == [0.0, 0.0]
    np.testing.assert_array_equal(burst[:40], local_burst_per_m2(plots, np.ones(40), wild[40:], 500.0, 1e-6))


def test_before_the_first_plot_the_stated_rates_hold_and_a_pause_is_no_turn():
    sensors, rules, stated = two_radars(), RateSettings(), np.array([0.9, 0.2])
    known = LearntRates.empty(R=2)
    np.testing.assert_array_equal(known.false_plots_per_m2(rules, sensors.radars, np.full(2, 3e-7)), 3e-7)
    np.testing.assert_allclose(known.detection(rules, stated, 1.0).probability, stated)
    np.testing.assert_allclose(known.detection(rules, stated, 1.0).miss, 1.0)
    for newest_s in (3.0, 6.0, 6000.0, 5990.0):
        known.turn(rules, 0, newest_s, 3.0)
    fade = np.exp(-1.0 / rules.memory_turns)
    assert known.turns[0] == pytest.approx(1.0 + fade + fade**2)
    assert known.newest_s[0] == 6000.0
    known.looks[:] = known.detections[:] = 1e6
    known.detections[0] = 0.0
    assert known.detection(rules, stated, 1.0).probability.tolist() == [rules.least_detection, stated[1]]
