"""Tracks with a probability of existence: one vessel is one track; existence by hand; radars of different detection."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from joint_update_textbook import ThreeStates
from pydantic import ValidationError
from radar_world import ORIGIN_DEG, PERIOD_S, cut, every_tracker, plots_of, run, two_radars, world

from coastwatch.batches import Plots
from coastwatch.geodesy import to_plane
from coastwatch.scenario import ScenarioError, load_scenario
from coastwatch.server.checkpoint import load, save
from coastwatch.tracks import RegionInput, TableTracker
from coastwatch.tracks.radar.life import Detection, ExistenceManagement
from coastwatch.tracks.radar.rates import RateSettings

pytestmark = pytest.mark.contract

METHODS = [m for m in every_tracker() if m.association.method in ("jipda", "multi_hypothesis") and m.messages.method == "none"]
OWN_M = 150.0  # a track farther from its vessel is another's
ALWAYS_VISIBLE = ExistenceManagement(hides=False)


def same_tracks(one, other):
    return np.array_equal(one.track_id, other.track_id) and np.array_equal(one.covariance, other.covariance)


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.method)
def test_clutter_and_misses(method):
    """Pd 0.9 and 5e-7 false plots a square metre and turn: few false tracks, no vessel has two, tracks stay with their vessel."""
    truth, sensors = world(200, 8), two_radars()
    plots = plots_of(truth, sensors, 120.0, 8, detection=0.9, clutter_per_m2=5e-7)
    _, out = run(method, plots, 40)
    false, true, changed, owner = 0, 0, 0, {}
    for cycle, tracks in enumerate(out[10:], 10):
        where, _ = truth.at(np.maximum(tracks.origin, 0), np.full(len(tracks), PERIOD_S * (cycle + 1)))
        own = (tracks.origin >= 0) & (np.hypot(*(to_plane(tracks.position_deg, ORIGIN_DEG) - where).T) < OWN_M)
        _, count = np.unique(tracks.origin[own], return_counts=True)
        true, false = true + len(count), false + len(tracks) - len(count)
        for track, origin in zip(tracks.track_id[own].tolist(), tracks.origin[own].tolist(), strict=True):
            changed += owner.setdefault(track, origin) != origin
            owner[track] = origin
    assert false < 0.02 * true
    assert changed <= 2
    assert true > 0.97 * 30 * 105  # 105 vessels are in cover


def alone(range_m=8000.0):
    """One radar, and a vessel at rest that gives a plot of it each turn."""
    sensors = two_radars()
    sensors = replace(sensors, radars=sensors.radars.take(slice(1, 2)))
    truth = world(1, 21, kick_m_s=0.0)
    site = to_plane(sensors.radars.site_deg[0], ORIGIN_DEG)
    truth = replace(truth, start_m=site + np.array([[range_m, 0.0]]), velocity_m_s=np.zeros((1, 2)))
    return sensors, plots_of(truth, sensors, 120.0, 21)


def test_existence_of_a_lone_vessel_is_the_chain_by_hand():
    """Two detections in three looks: birth from one plot, a miss, then a plot of the likelihood that the filter gives it."""
    sensors, plots = alone()
    beacon = replace(plots.take(slice(0, 1)), position_m=plots.position_m[:1] + 3000.0)  # keeps the radar turning
    rules = ExistenceManagement(begin_existence=1e-4, delete_existence=1e-9, rates=RateSettings(learnt=False))
    method, memory = TableTracker(method="vimmjipda", upkeep=rules), TableTracker(method="vimmjipda").init()
    detection, density = rules.detection.detection_probability, rules.detection.false_plots_per_m2
    unborn = rules.new_vessels_per_m2 * rules.new_visibility * detection
    by_hand = ThreeStates(unborn / (density + unborn), 1.0, *rules.chain)
    kept = plots.take(np.array([0, 2]))
    every = Plots.join([kept, *(replace(beacon, time_s=plots.time_s[k : k + 1]) for k in range(3))])
    for cycle in range(3):
        memory, *_ = method.step(memory, RegionInput.of_plots(cut(every, cycle), PERIOD_S * (cycle + 1), sensors))
        if cycle == 0:
            found = memory.table.live[memory.table.origins[memory.table.live, 0] == plots.origin[0]]
            slot = int(found[np.argmin(np.abs(memory.table.combined_mean[found, 0] - kept.position_m[0, 0]))])
            assert memory.table.existence[slot] == pytest.approx(by_hand.existence)
    # the radar's second turn gave no plot; its third a plot, with the likelihood of the combined estimate at birth
    wait_s = float(kept.time_s[1] - kept.time_s[0])
    by_hand.wait(PERIOD_S)
    by_hand.miss(detection)
    by_hand.wait(wait_s - PERIOD_S)
    speed = (TableTracker(method="vimmjipda").motion.start_speed_kn * 1852.0 / 3600.0) ** 2
    spread = kept.covariance[0] + kept.covariance[1] + speed * wait_s**2 * np.eye(2)
    off = kept.position_m[1] - kept.position_m[0]
    likelihood = np.exp(-0.5 * off @ np.linalg.solve(spread, off)) / (2.0 * np.pi * np.sqrt(np.linalg.det(spread)))
    by_hand.look(detection, likelihood / (density + unborn))
    assert memory.table.existence[slot] == pytest.approx(by_hand.existence, rel=0.02)  # the models add a little noise
    assert memory.table.visibility[slot] == pytest.approx(by_hand.visibility, rel=0.02)


def test_a_hidden_vessel_is_kept_longer_where_visibility_is_modelled():
    sensors, plots = alone()
    others = replace(plots, position_m=plots.position_m + 5000.0)  # so that the radar is known to turn
    silent = Plots.join([plots.take(plots.time_s < 60.0), others])
    silent = silent.take(np.argsort(silent.time_s, kind="stable"))
    shown = []
    for upkeep in (ExistenceManagement(delete_misses=50), ALWAYS_VISIBLE.model_copy(update={"delete_misses": 50})):
        _, out = run(TableTracker(method="vimmjipda", upkeep=upkeep), silent, 40, sensors)
        shown.append(sum(len(tracks) == 2 for tracks in out[20:]))
    assert shown[0] > shown[1] >= 1


def test_each_radar_has_its_own_detection_and_clutter():
    """A radar that is said to miss nothing ends a lost track sooner than one that is said to miss half."""
    sensors, plots = alone()
    others = replace(plots, position_m=plots.position_m + 5000.0)
    silent = Plots.join([plots.take(plots.time_s < 60.0), others])
    silent = silent.take(np.argsort(silent.time_s, kind="stable"))
    shown = []
    for probability in (0.5, 0.99):
        one = Detection(detection_probability=probability, false_plots_per_m2=1e-6)
        upkeep = ExistenceManagement(by_radar={"south": one}, hides=False, delete_misses=50)
        _, out = run(TableTracker(method="vimmjipda", upkeep=upkeep), silent, 40, sensors)
        shown.append(sum(len(tracks) == 2 for tracks in out[20:]))
    assert shown[0] > shown[1]


def test_a_radar_of_another_name_is_refused():
    settings = {"tracks.method": "vimmjipda", "tracks.upkeep.by_radar.nowhere.detection_probability": "0.8"}
    with pytest.raises(ScenarioError, match=r"tracks\.upkeep\.by_radar: got radar 'nowhere', needed one of \['.*'\]"):
        load_scenario("context-driven-100", settings)
    with pytest.raises(ValidationError, match="detection_probability"):
        Detection(detection_probability=1.0)


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.method)
def test_order_of_plots_is_of_no_matter_and_late_ones_count(method):
    truth, sensors = world(60, 15), two_radars()
    plots = plots_of(truth, sensors, 60.0, 15)
    memory, _ = run(method, plots, 10)
    again, now = load(save(memory)), cut(plots, 10)
    shuffled = now.take(np.random.default_rng([15, 1]).permutation(len(now)))
    one, other = (
        method.step(m, RegionInput.of_plots(p, 33.0, sensors))[1].tracks for m, p in ((memory, now), (again, shuffled))
    )
    assert same_tracks(one, other)
    received = plots.time_s + np.where(plots.sensor == 0, 2.0, 0.0)
    late = method.init()
    for cycle in range(20):
        there = (received > PERIOD_S * cycle) & (received <= PERIOD_S * (cycle + 1))
        late, (tracks, *_) = method.step(late, RegionInput.of_plots(plots.take(there), PERIOD_S * (cycle + 1), sensors))
    _, prompt = run(method, plots, 20)
    vessels, count = np.unique(tracks.origin, return_counts=True)
    assert (count == 1).all()
    assert np.isin(prompt[-1].origin, vessels).mean() >= 0.95


def test_tracks_say_with_what_probability_they_exist():
    """Of a track that lost its vessel the probability falls; other trackers say nothing."""
    plots = plots_of(world(30, 12), two_radars(), 40.0, 12)
    hidden = plots.take(plots.time_s < 30.0)
    _, out = run(
        TableTracker(method="vimmjipda"), Plots.join([hidden, plots.take((plots.time_s > 30.0) & (plots.origin < 15))]), 13
    )
    lost = out[-1].origin >= 15
    assert (out[-1].existence[~lost] > 0.99).all()
    assert (out[-1].existence[lost] < out[9].existence.min()).all()
    assert lost.any()
    _, others = run(TableTracker(method="sided_imm"), plots, 5)
    assert np.isnan(others[-1].existence).all()
