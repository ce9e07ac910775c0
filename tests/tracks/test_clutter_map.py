"""The clutter map equals a dictionary of cells, forgets and follows a radar that moves; each radar decides for one by its plots."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from radar_world import plots_of, run, two_radars, world

from coastwatch.batches import Plots, Radars
from coastwatch.geodesy import to_plane
from coastwatch.tracks import TableTracker
from coastwatch.tracks.radar import clutter
from coastwatch.tracks.radar.clutter import (
    ClutterMap,
    ClutterSettings,
    false_plots_per_m2,
    has_moved,
    learn,
    standing_echoes,
)

pytestmark = pytest.mark.oracle

PRIOR_PER_M2 = 1e-6
ROUNDING = 1e-12  # relative


def radar(range_m=500.0, sigma_m=3.0, azimuth_deg=1.0, count=1):
    some = np.full(count, 1.0)
    sizes = range_m * some, 2.0 * some, sigma_m * some, math.radians(azimuth_deg) * some
    return Radars(np.full(count, "radar", "U32"), np.zeros(count, np.int64), np.zeros((count, 2)), *sizes)


def empty_map(rule, radars):
    return clutter.empty_map(rule, radars, np.ones(len(radars), np.bool_))


def density(rule, known, places, number=0):
    return false_plots_per_m2(rule, known, number, np.atleast_2d(np.asarray(places, float)), PRIOR_PER_M2)


def feed(rule, known, turns, places, probability=1.0, first=0, number=0):
    """The map after the same plots in each of so many turns of 2 s."""
    places = np.atleast_2d(np.asarray(places, float))
    for k in range(first, first + turns):
        times = np.full(len(places), 2.0 * k)
        known = learn(rule, known, number, times, places, np.full(len(places), probability), 2.0)
    return known


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 30), st.sampled_from([1e9, 20.0]))
def test_it_equals_a_dictionary_of_cells(seed, turns, memory):
    rule = ClutterSettings(cell_m=8.0, memory_turns=memory)
    random = np.random.default_rng([seed])
    known, cells, weight = empty_map(rule, radar()), defaultdict(float), 0.0
    for k in range(turns):
        for key in cells:
            cells[key] *= math.exp(-1.0 / memory)
        weight = weight * math.exp(-1.0 / memory) - memory * math.expm1(-1.0 / memory)
        places = random.uniform(-30.0, 30.0, (int(random.integers(1, 12)), 2))
        probability = random.uniform(0.0, 1.0, len(places))
        for place, p in zip(np.floor(places / 8.0).astype(int).tolist(), probability.tolist(), strict=True):
            cells[tuple(place)] += p
        known = learn(rule, known, 0, np.full(len(places), 2.0 * k), places, probability, 2.0)
    asked = random.uniform(-40.0, 40.0, (20, 2))
    found = [cells.get(tuple(cell), 0.0) / 64.0 for cell in np.floor(asked / 8.0).astype(int).tolist()]
    wanted = (10.0 * PRIOR_PER_M2 + np.array(found)) / (10.0 + weight)
    np.testing.assert_allclose(density(rule, known, asked), wanted, rtol=1e-9)


def test_standing_echoes_are_listed_with_place_extent_and_plots_a_turn():
    """A pile, a quay of five cells and false plots here and there; nothing before the prior is outweighed."""
    rule, origin = ClutterSettings(cell_m=8.0, prior_turns=10.0), np.array([54.5, -179.999])
    pile, quay = [[-196.0, -100.0]], [[100.0 + 8.0 * k, 52.0] for k in range(5)]
    known, random = empty_map(rule, radar(count=2)), np.random.default_rng([7])
    for k in range(40):
        seen = [*pile, *(place for place in quay if random.random() < 0.6), *random.uniform(-400.0, 400.0, (5, 2)).tolist()]
        known = feed(rule, known, 1, seen, first=k, number=1)
        if k == 8:
            assert len(standing_echoes(rule, known, radar(count=2), origin)) == 0
    found = standing_echoes(rule, known, radar(count=2), origin)
    np.testing.assert_allclose(to_plane(found.position_deg, origin)[0], pile[0], atol=1e-3)
    np.testing.assert_allclose(to_plane(found.position_deg, origin)[1], [116.0, 52.0], atol=4.0)
    assert found.extent_m.tolist() == [8.0, 40.0]
    assert found.plots_per_turn[0] == pytest.approx(1.0, abs=0.05)
    assert found.plots_per_turn[1] == pytest.approx(3.0, abs=0.6)
    assert found.radar.tolist() == [1, 1]
    assert len(standing_echoes(ClutterSettings(), ClutterMap.empty(), radar(), origin)) == 0


def test_before_the_first_plot_it_is_the_prior():
    rule = ClutterSettings()
    np.testing.assert_allclose(
        density(rule, empty_map(rule, radar()), [[3.0, 4.0], [-450.0, 90.0]]), PRIOR_PER_M2, rtol=ROUNDING
    )


def test_radars_have_maps_of_their_own():
    rule = ClutterSettings(cell_m=8.0)
    known = feed(rule, empty_map(rule, radar(count=3)), 10, [[20.0, 20.0]], number=1)
    assert density(rule, known, [[20.0, 20.0]], 1)[0] > 100 * PRIOR_PER_M2
    for other in (0, 2):
        np.testing.assert_allclose(density(rule, known, [[20.0, 20.0]], other), PRIOR_PER_M2, rtol=ROUNDING)
    forgotten = known.without_radars(np.array([False, True, False]))
    np.testing.assert_allclose(density(rule, forgotten, [[20.0, 20.0]], 1), PRIOR_PER_M2, rtol=ROUNDING)


def test_a_cell_that_the_radar_left_behind_is_taken_over():
    rule = ClutterSettings(cell_m=8.0)
    known = feed(rule, empty_map(rule, radar()), 10, [[4.0, 4.0]])
    period_m = 8.0 * known.side[0]
    far = [[4.0 + period_m, 4.0]]
    assert density(rule, known, far)[0] < PRIOR_PER_M2
    known = feed(rule, known, 10, far, first=10)
    assert density(rule, known, far)[0] > 100 * PRIOR_PER_M2
    assert density(rule, known, [[4.0, 4.0]])[0] < PRIOR_PER_M2


def test_a_pause_is_no_turn_and_a_late_plot_turns_nothing_back():
    rule = ClutterSettings()
    known = feed(rule, empty_map(rule, radar()), 5, [[4.0, 4.0]])
    assert known.turns[0] == pytest.approx(5.0)
    known = feed(rule, known, 1, [[4.0, 4.0]], first=5000)
    assert known.turns[0] == pytest.approx(6.0)
    known = feed(rule, known, 1, [[4.0, 4.0]], first=4999)
    assert known.turns[0] == pytest.approx(6.0)
    assert known.newest_s[0] == 10_000.0


@pytest.mark.parametrize(("range_nm", "azimuth_deg"), [(0.3, 1.0), (24.0, 0.3), (96.0, 0.02)])
def test_cells_follow_the_resolution_and_memory_is_bounded(range_nm, azimuth_deg):
    range_m = 1852.0 * range_nm
    known = empty_map(ClutterSettings(), radar(range_m, 3.0, azimuth_deg))
    assert known.cell_m[0] >= math.radians(azimuth_deg) * range_m
    assert known.side[0] * known.cell_m[0] >= 2.0 * range_m
    assert known.side[0] <= 640


def test_a_damaged_window_is_refused():
    known = empty_map(ClutterSettings(), radar(count=2))
    known.check_rows()
    known.first[1] += 1
    with pytest.raises(ValueError, match="first"):
        known.check_rows()


def test_moved_is_more_than_the_distance_and_more_than_noise():
    rule = ClutterSettings(moved_m=25.0)
    to = np.array([[24.0, 0.0], [26.0, 0.0], [26.0, 0.0], [400.0, 0.0]])
    moved = has_moved(rule, np.zeros((4, 2)), to, np.array([1.0, 1.0, 100.0, 100.0**2]))
    assert moved.tolist() == [False, True, False, True]


def echoes_of(example, places, seen, random):
    """Plots of one radar with a noise of 5 m. Args: places: (E, 2); seen: (T, E) in which turns of 4 s each echo is seen."""
    turn, echo = np.nonzero(seen)
    noise = random.normal(0.0, 5.0, (len(turn), 2))
    return replace(
        example.take(np.zeros(len(turn), np.int64)),
        time_s=0.5 + 4.0 * turn,
        position_m=places[echo] + noise,
        covariance=np.tile(25.0 * np.eye(2), (len(turn), 1, 1)),
        sensor=np.zeros(len(turn), np.int64),
        origin=np.full(len(turn), -1),
    )


@pytest.mark.parametrize("quay", [True, False])
def test_a_radar_learns_a_map_where_its_plots_of_no_track_return(quay):
    """Echoes of a quay, a fifth of them in each turn, or as many plots at random; vessels under way and at anchor stay."""
    random, turns = np.random.default_rng([31]), 50
    sensors = two_radars(range_nm=3.0)
    vessels = plots_of(world(60, 9), sensors, 4.0 * turns, 9)
    seen = random.random((turns, 10)) < 0.9
    anchored = echoes_of(vessels, random.uniform(-1500.0, 1500.0, (10, 2)), seen, random)
    places = random.uniform([-1000.0, 300.0], [-400.0, 500.0], (150, 2))
    false = echoes_of(vessels, places, random.random((turns, len(places))) < 0.2, random)
    if not quay:
        false = replace(false, position_m=random.uniform(-2000.0, 2000.0, (len(false), 2)))
    plots = Plots.join([vessels, replace(anchored, origin=1000 + np.nonzero(seen)[1]), false])
    shown = {}
    for learnt in ("by_radar", False):
        tracker = TableTracker(method="guided_vimmjipda", clutter=ClutterSettings(learnt=learnt))
        memory, tracks = run(tracker, plots, 4 * turns // 3, sensors)
        origin = [np.unique(one.origin[one.origin >= 0]) for one in tracks[30:]]
        false_tracks = sum(int((one.origin < 0).sum()) for one in tracks[30:])
        shown[learnt] = np.array([false_tracks, sum(map(len, origin)), sum(int((one >= 1000).sum()) for one in origin)])
        if learnt:
            assert [memory.clutter.has(radar) for radar in (0, 1)] == [quay, False]
    assert np.all(shown["by_radar"][1:] >= 0.98 * shown[False][1:])
    assert np.array_equal(*shown.values()) or quay
    assert shown["by_radar"][0] < 0.7 * shown[False][0] or not quay


def test_a_radar_that_decides_later_leaves_the_maps_of_others_as_they_are():
    rule, three = ClutterSettings(cell_m=8.0), radar(count=3)
    known = feed(rule, ClutterMap.empty().with_radar(rule, three, 1), 10, [[20.0, 20.0]], number=1)
    before, turns = density(rule, known, [[20.0, 20.0], [60.0, 0.0]], 1), known.turns[1]
    for other in (2, 0):
        known = known.with_radar(rule, three, other)
        known.check_rows()
        assert known.turns[[other, 1]].tolist() == [0.0, turns]
        np.testing.assert_array_equal(density(rule, known, [[20.0, 20.0], [60.0, 0.0]], 1), before)
        np.testing.assert_allclose(density(rule, known, [[20.0, 20.0]], other), PRIOR_PER_M2, rtol=ROUNDING)
