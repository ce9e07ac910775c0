"""Multi-hypothesis tracks: existence by Bayes' rule, bounds of memory, no plot twice, what a memory goes on with, refusals."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError
from radar_world import ORIGIN_DEG, PERIOD_S, World, cut, plots_of, run, two_radars, world

from coastwatch.batches import Plots, Unproven
from coastwatch.geodesy import to_plane
from coastwatch.kernels.tracks import hypothesis_trees, tree_rows
from coastwatch.scenario import ScenarioError, load_scenario
from coastwatch.server.checkpoint import load, save
from coastwatch.tracks import RegionInput, TableTracker
from coastwatch.tracks.radar.leaves import Forest, Leaves
from coastwatch.tracks.radar.multi_hypothesis import MultiHypothesis
from coastwatch.tracks.radar.multi_hypothesis.choice import choose_and_prune
from coastwatch.tracks.radar.table import RadarMemory, Status

pytestmark = pytest.mark.contract

METHODS = "multi_hypothesis", "sided_multi_hypothesis"


@pytest.fixture(scope="module")
def dense():
    """Forty vessels in 2 NM, so that they have leaves in common, with misses and clutter."""
    return plots_of(world(40, 5, side_nm=2.0), two_radars(), 40.0, 5, detection=0.8, clutter_per_m2=2e-6)


def test_the_second_plot_gives_the_existence_of_jipda():
    """With one leaf before it, the sum over its children is what JIPDA has: the same Bayes' rule."""
    sensors = two_radars()
    sensors = replace(sensors, radars=sensors.radars.take(slice(1, 2)))
    site = to_plane(sensors.radars.site_deg[0], ORIGIN_DEG)
    truth = replace(world(1, 21, kick_m_s=0.0), start_m=site + np.array([[8000.0, 0.0]]), velocity_m_s=np.zeros((1, 2)))
    plots = plots_of(truth, sensors, 120.0, 21)
    found = []
    for method in ("vimmjipda", "multi_hypothesis"):
        memory, _ = run(TableTracker(method=method, upkeep={"rates": {"learnt": False}}), plots, 2, sensors)
        found.append(float(memory.table.existence[memory.table.live[0]]))
    assert 0.1 < found[0] < 0.999
    assert found[1] == pytest.approx(found[0], rel=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_memory_is_bounded_and_chosen_leaves_share_no_plot(method, dense):
    tracker = TableTracker(method=method, association=MultiHypothesis(leaves=6, window=2))
    memory = None
    for cycle in range(0, 12, 3):
        memory, _ = run(tracker, dense, 3, memory=memory, first=cycle)
        leaves, table = memory.forest.leaves, memory.table
        slot, first, count = np.unique(leaves.slot, return_index=True, return_counts=True)
        assert count.max() <= 6
        assert np.isfinite(leaves.cost).all()
        assert np.isin(table.live, slot).all()
        confirmed = first[(table.existence[slot] > 0.9) & np.isin(slot, table.live)]
        newest = leaves.plot[confirmed].ravel()
        newest = newest[newest >= 0]
        assert len(np.unique(newest)) == len(newest)
    assert len(leaves) > len(slot)


def test_children_that_are_left_out_before_they_grow_would_not_have_stayed(dense, monkeypatch):
    stated = {"rates": {"learnt": False}}
    tracker = TableTracker(method="multi_hypothesis", association=MultiHypothesis(leaves=6), upkeep=stated)
    memory, out = run(tracker, dense, 8)
    monkeypatch.setattr(hypothesis_trees, "promising", lambda leaves, first, plot, *_: np.ones(len(plot), np.bool_))
    every, whole = run(tracker, dense, 8)
    assert np.array_equal(memory.forest.leaves.plot, every.forest.leaves.plot)
    assert np.array_equal(out[-1].covariance, whole[-1].covariance)


def test_the_choice_of_trees_that_share_nothing_with_a_look_stands(monkeypatch):
    """A look chooses among the trees that bear on it: all trees together give the same leaves, where similar ones stay.

    Not where a choice is not proven best: another one may be found when it is made again.
    """
    monkeypatch.setattr(hypothesis_trees, "drop_similar", lambda *_: None)
    tracker, plots = TableTracker(method="multi_hypothesis"), plots_of(world(40, 5), two_radars(), 40.0, 5, detection=0.8)
    memory, out = run(tracker, plots, 8)
    monkeypatch.setattr(tree_rows, "linked_trees", lambda leaves, trees, *_: trees.leaves > 0)
    every, whole = run(tracker, plots, 8)
    assert len(memory.forest.leaves) > len(memory.table.live)
    assert np.array_equal(memory.forest.leaves.plot, every.forest.leaves.plot)
    np.testing.assert_allclose(out[-1].covariance, whole[-1].covariance, rtol=1e-9, atol=1e-9)


def test_a_track_that_the_choice_calls_no_vessel_has_no_plot_for_good():
    """A tentative track begun by plot 7 leaves its window. The neighbour that has plot 7 keeps both ways to go on."""
    leaves = replace(
        Leaves.empty(L=3, W=3, R=1, J=1),
        slot=np.array([0, 0, 1]),
        cost=np.array([-5.0, -4.8, 3.0]),
        existence=np.full(3, 0.5),
        mmsi=np.full(3, -1),
        plot=np.array([[3, 7, 8], [3, 7, -1], [7, -1, 9]]),
    )
    forest = replace(
        Forest.empty(W=3, R=1, J=1), null_cost=np.array([50.0, 0.0]), nulled=np.zeros(2, np.int64), until_s=np.zeros(2)
    )
    looked, status = np.ones(2, np.bool_), np.array([Status.CONFIRMED, Status.TENTATIVE])
    pruned = choose_and_prune(MultiHypothesis(window=2)._pruning, forest, leaves, looked, status)
    assert pruned.leaves.plot[pruned.leaves.slot == 0].tolist() == [[3, 7, 8], [3, 7, -1]]
    leaves.cost[2], forest.null_cost[:] = -40.0, 0.0  # now it is the likelier vessel, and has its plot
    pruned = choose_and_prune(MultiHypothesis(window=2)._pruning, forest, leaves, looked, status)
    assert (pruned.leaves.slot == 0).sum() == 1


def unproven_choices(plots: Plots, cycles: int) -> list[Unproven]:
    """Of each cycle."""
    tracker, sensors, out = TableTracker(method="multi_hypothesis"), two_radars(), []
    memory = tracker.init()
    for cycle in range(cycles):
        given = RegionInput.of_plots(cut(plots, cycle), PERIOD_S * (cycle + 1), sensors)
        memory, found = tracker.step(memory, given)
        assert memory.forest.unproven == Unproven()  # else the next cycle would count it again
        out.append(found.unproven)
    return out


def test_choices_beyond_the_limit_of_nodes_are_counted():
    """Sixty vessels in half a mile, with clutter."""
    plots = plots_of(world(60, 5, side_nm=0.5), two_radars(), 24.0, 5, detection=0.8, clutter_per_m2=2e-6)
    found = unproven_choices(plots, 8)
    assert max(one.count for one in found) >= 1
    assert all((one.excess > 0.0) == (one.count > 0) and one.excess < 1000.0 for one in found)


def test_on_an_ordinary_sea_all_choices_are_proven(dense):
    assert unproven_choices(dense, 8) == [Unproven()] * 8


def check_leaves(memory: RadarMemory) -> None:
    """No tree has more leaves than the default allows, and all are numbers."""
    leaves = memory.forest.leaves
    assert np.bincount(leaves.slot).max() <= MultiHypothesis().leaves
    assert all(np.isfinite(column).all() for column in (leaves.cost, leaves.existence, *leaves.filters, *leaves.estimates))


@pytest.mark.parametrize(("count", "half_m"), [(10_000, 8000.0), (2000, 1500.0)])
def test_ten_thousand_plots_in_one_turn_leave_the_tracks(dense, count, half_m):
    """Over the whole area, and fewer so close that a gate holds dozens. The turns after it go on."""
    tracker, rng = TableTracker(method="multi_hypothesis"), np.random.default_rng([5, 6])
    memory, out = run(tracker, dense, 6)
    now = cut(dense, 6)
    many = now.take(rng.integers(0, len(now), count))
    place, time_s = rng.uniform(-half_m, half_m, (len(many), 2)), rng.uniform(6 * PERIOD_S + 0.1, 7 * PERIOD_S, len(many))
    many = replace(many, position_m=place, time_s=time_s, origin=np.full(len(many), -1))
    given = RegionInput.of_plots(Plots.join([now, many]), 7 * PERIOD_S, two_radars())
    memory, found = tracker.step(memory, given)
    check_leaves(memory)
    assert found.dropped == 0
    memory, after = run(tracker, dense, 2, memory=memory, first=7)
    check_leaves(memory)
    assert np.isfinite(after[-1].position_deg).all()
    assert np.isin(out[-1].track_id, after[-1].track_id).mean() > 0.8


@pytest.mark.parametrize(
    "covariance", [np.zeros((2, 2)), [[100.0, 0.0], [0.0, 0.0]], [[100.0, 200.0], [200.0, 100.0]]], ids=str
)
def test_plots_of_a_singular_covariance_leave_the_tracks(dense, covariance):
    tracker = TableTracker(method="multi_hypothesis")
    memory, out = run(tracker, dense, 6)
    now = cut(dense, 6)
    now.covariance[::3] = covariance
    memory, _ = tracker.step(memory, RegionInput.of_plots(now, 7 * PERIOD_S, two_radars()))
    check_leaves(memory)
    memory, after = run(tracker, dense, 2, memory=memory, first=7)
    check_leaves(memory)
    assert np.isfinite(after[-1].covariance).all()
    assert np.isin(out[-1].track_id, after[-1].track_id).mean() > 0.8


def abreast(place: np.ndarray, seed: int) -> World:
    """Ships at these places of the plane (V, 2) that sail north at 5 m/s."""
    one, count = world(1, seed), len(place)
    return replace(
        one,
        start_m=place,
        velocity_m_s=np.tile([0.0, 5.0], (count, 1)),
        rate_rad_s=np.zeros(count),
        kick_s=np.repeat(one.kick_s, count, axis=0),
        kick_m_s=np.zeros((count, one.kick_m_s.shape[1], 2)),
    )


def test_ships_abreast_stay_two():
    """Two ships 60 m apart on one course, seen by both radars from 4 km: two tracks throughout."""
    place = to_plane(two_radars().radars.site_deg[0], ORIGIN_DEG) + np.array([[4000.0, -500.0], [4060.0, -500.0]])
    _, out = run(TableTracker(method="multi_hypothesis"), plots_of(abreast(place, 18), two_radars(), 120.0, 18), 40)
    assert [len(tracks) for tracks in out[12:]] == [2] * 28


def test_ships_closer_than_the_noise_keep_their_tracks():
    """Five ships in a row, 40 m apart, at 9 km, where a plot errs by 47 m across the beam. Hardly a track of them ends in 180 s.

    Where each tree kept the leaves that cost it least, these all shared plots with those of other trees: 28 tracks ended.
    """
    place, ended = np.array([-1000.0, -1500.0]) + np.outer(np.arange(5), [0.0, 40.0]), 0
    for seed in (1, 2):
        plots = plots_of(abreast(place, seed), two_radars(), 240.0, seed, detection=0.9, clutter_per_m2=5e-7)
        _, out = run(TableTracker(method="multi_hypothesis"), plots, 80)
        shown = [set(tracks.track_id.tolist()) for tracks in out[20:]]
        ended += sum(len(before - now) for before, now in itertools.pairwise(shown))
    assert ended <= 2


def test_tracks_of_another_method_go_on_with_their_ids(dense):
    memory, before = run(TableTracker(method="vimmjipda"), dense, 8)
    _, after = run(TableTracker(method="multi_hypothesis"), dense, 2, memory=memory, first=8)
    assert len(before[-1]) > 20
    assert np.isin(before[-1].track_id, after[-1].track_id).mean() > 0.8


def test_a_memory_of_another_window_is_refused(dense):
    memory, _ = run(TableTracker(method="multi_hypothesis"), dense, 3)
    other = TableTracker(method="multi_hypothesis", association=MultiHypothesis(window=5))
    with pytest.raises(ValueError, match=r"memory of radar tracks: got a window of 3, needed 5"):
        run(other, dense, 1, memory=memory, first=3)


@pytest.mark.parametrize(("column", "number"), [("slot", 10**6), ("step", -2), ("plot", 10**6), ("plot", -2)])
def test_leaves_of_no_slot_step_or_plot_are_refused(dense, column, number):
    memory, _ = run(TableTracker(method="multi_hypothesis"), dense, 3)
    getattr(memory.forest.leaves, column).flat[-1] = number
    with pytest.raises(ValueError, match=rf"it is damaged: Leaves\.{column}: got .*{number}.*, needed -?\d+ to \d+$"):
        load(save(memory))


def test_bad_settings_are_refused_with_their_path():
    chosen = {"tracks.method": "multi_hypothesis", "tracks.association.window": "0"}
    with pytest.raises(ScenarioError, match=r"tracks\.association"):
        load_scenario("context-driven-100", chosen)
    with pytest.raises(
        ValidationError, match=r"messages\.method: got 'noisy_batch', needed 'sequential' or 'guiding' or 'none'"
    ):
        TableTracker(method="multi_hypothesis", messages={"method": "noisy_batch"})
    with pytest.raises(ValidationError, match=r"bank\.method: got 'particles', needed 'compiled'"):
        TableTracker(method="multi_hypothesis", bank={"method": "particles"})


def test_a_lost_track_ends_and_its_id_is_not_used_again():
    plots = plots_of(world(30, 12), two_radars(), 120.0, 12)
    silent = plots.take((plots.time_s < 30.0) | (plots.time_s > 75.0))
    _, out = run(TableTracker(method="multi_hypothesis"), silent, 40)
    assert len(out[9]) > 10
    assert len(out[int(72.0 / PERIOD_S) - 1]) == 0
    assert out[35].track_id.min() > out[9].track_id.max()
