"""Size and axis of ships by their echoes, and pieces of one hull that are one plot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from radar_world import ORIGIN_DEG, two_radars

from coastwatch.batches import Messages, Plots
from coastwatch.geodesy import difference_m, from_plane, to_plane, wrap_deg
from coastwatch.server.checkpoint import load, save
from coastwatch.tracks import RegionInput, TableTracker
from coastwatch.tracks.radar.extent import Hulls, averaged, axes, echoes_of, joined

pytestmark = pytest.mark.contract

PERIOD_S = 2.4


def moments(length, width, axis_deg):
    """Second moments of a rectangle, m2: east, east and north, north."""
    a = np.radians(axis_deg)
    ahead, across = np.array([np.sin(a), np.cos(a)]), np.array([np.cos(a), -np.sin(a)])
    whole = (length**2 * np.outer(ahead, ahead) + width**2 * np.outer(across, across)) / 12.0
    return np.array([whole[0, 0], whole[0, 1], whole[1, 1]])


def plots(time_s, position_m, extent, weight, sensor=0):
    count = len(time_s)
    return Plots(
        sensor=np.full(count, sensor),
        region=np.zeros(count, np.int64),
        time_s=np.array(time_s, float),
        position_m=np.array(position_m, float).reshape(-1, 2),
        covariance=np.tile(np.eye(2) * 36.0, (count, 1, 1)),
        site_m=np.zeros((count, 2)),
        range_m=np.hypot(*np.array(position_m, float).reshape(-1, 2).T),
        azimuth_rad=np.arctan2(*np.array(position_m, float).reshape(-1, 2).T),
        origin=np.zeros(count, np.int64),
        extent=np.array(extent, float).reshape(-1, 3),
        weight=np.array(weight, float),
    )


def hulls(*ships):
    """Hulls at rest at time 0. Args: ships: east, north, length, width, axis in degrees, time of the newest plot."""
    state = np.array([[e, n, 0.0, 0.0] for e, n, *_ in ships])
    extent = np.array([moments(length, width, axis) for _, _, length, width, axis, _ in ships])
    return Hulls(np.zeros(len(ships)), state, extent, np.array([[newest] for *_, newest in ships]), np.full(len(ships), 10))


@pytest.mark.parametrize("axis", [0.0, 37.0, 90.0, 141.0])
def test_a_rectangle_has_its_length_width_and_axis(axis):
    length, width, angle = axes(moments(300.0, 42.0, axis)[None])
    assert length[0] == pytest.approx(300.0)
    assert width[0] == pytest.approx(42.0)
    assert abs(wrap_deg(2.0 * (np.degrees(angle[0]) - axis))) < 1e-6


def test_the_axis_follows_the_course_and_a_ship_at_rest_has_no_bow():
    extent = np.tile(moments(300.0, 42.0, 30.0), (4, 1))
    velocity = np.array([[3.0, 3.0], [-3.0, -3.0], [-0.3, -0.3], [3.0, 3.0]])
    found = echoes_of(extent, np.array([50.0, 50.0, 50.0, 310.0]), velocity)
    np.testing.assert_allclose(found.axis_deg, [30.0, 210.0, 30.0, np.nan])
    np.testing.assert_allclose(found.length_m, [300.0, 300.0, 300.0, np.nan])
    noise = echoes_of(np.array([[-400.0, 0.0, 9000.0], [np.nan] * 3]), np.full(2, 20.0), np.zeros((2, 2)))
    assert np.isnan(noise.width_m).all()
    assert noise.length_m[0] == pytest.approx(np.sqrt(12.0 * 9000.0))
    assert np.isnan(noise.length_m[1])


def test_the_newest_moment_counts_a_tenth_at_least():
    extent, count = np.full((3, 3), 1e9), np.zeros(3, np.int64)
    for k in range(12):
        averaged(extent, count, np.array([1, 2]), np.array([[float(k), 0.0, 1.0], [np.nan] * 3]))
    assert count.tolist() == [0, 10, 0]
    want = 4.5 + 0.1 * (10 - 4.5)
    want += 0.1 * (11 - want)
    assert extent[1, 0] == pytest.approx(want)
    assert extent[2, 0] == 1e9


def test_pieces_of_a_hull_are_one_plot_with_the_moments_of_the_whole():
    """Two halves of a ship of 300 m are the ship; a boat beside it, and the same places in the next look, are plots of their own."""
    half = moments(150.0, 42.0, 90.0)
    boat = [0.0, 120.0]
    given = plots(
        [1.0, 1.1, 1.2, 3.4],
        [[-75.0, 1000.0], [75.0, 1000.0], [boat[0], 1000.0 + boat[1]], [75.0, 1000.0]],
        [half, half, moments(10.0, 4.0, 0.0), half],
        [10.0, 10.0, 5.0, 10.0],
    )
    found, _ = joined(given, hulls((0.0, 1000.0, 300.0, 42.0, 90.0, -1.4)), np.array([PERIOD_S]))
    assert len(found) == 3
    np.testing.assert_allclose(found.position_m, [[0.0, 1000.0], [0.0, 1120.0], [0.0, 1000.0]], atol=1e-9)
    np.testing.assert_allclose(found.extent[0], moments(300.0, 42.0, 90.0), atol=1e-6)
    assert found.weight.tolist() == [20.0, 5.0, 10.0]
    assert found.time_s[0] == pytest.approx(1.05)
    assert found.covariance[0, 0, 0] == pytest.approx(36.0 + 0.1 * 75.0**2)


@pytest.mark.parametrize(
    ("length", "off", "moved", "hidden"),
    [(120.0, -60.0, 0.0, 90.0), (120.0, -130.0, -40.0, 90.0), (300.0, 30.0, 30.0, 0.0), (60.0, 60.0, 60.0, 0.0)],
)
def test_a_part_of_a_hull_leaves_it_where_it_was_as_far_as_the_part_is_inside(length, off, moved, hidden):
    """As where a nearer ship hides the other end. What is a fifth of the hull may be a boat and stays."""
    hull = hulls((0.0, 1000.0, 300.0, 42.0, 90.0, -1.4))
    found, _ = joined(plots([0.0], [[off, 1000.0]], [moments(length, 42.0, 90.0)], [9.0]), hull, np.array([PERIOD_S]))
    np.testing.assert_allclose(found.position_m, [[moved, 1000.0]], atol=1e-9)
    at = found.range_m * np.array([np.sin(found.azimuth_rad), np.cos(found.azimuth_rad)])
    np.testing.assert_allclose(at.T, found.position_m, atol=1e-9)
    np.testing.assert_allclose(found.covariance[0], np.diag([36.0 + hidden**2 / 3.0, 36.0]), atol=1e-6)
    kept = 0.75 if hidden else 0.0
    want = kept * moments(300.0, 42.0, 90.0) + (1.0 - kept) * moments(length, 42.0, 90.0)
    np.testing.assert_allclose(found.extent[0], want, atol=1e-6)


def test_both_ends_of_a_hull_give_its_middle_whatever_their_strength():
    hull = hulls((10.0, 1000.0, 300.0, 42.0, 90.0, -1.4))
    ends = plots(
        [0.0, 0.0],
        [[-100.0, 1000.0], [140.0, 1000.0]],
        [moments(100.0, 42.0, 90.0), moments(20.0, 42.0, 90.0)],
        [10.0, 1.0],
    )
    found, _ = joined(ends, hull, np.array([PERIOD_S]))
    np.testing.assert_allclose(found.position_m, [[0.0, 1000.0]], atol=1e-6)


@pytest.mark.parametrize("method", ["sided_imm", "guided_vimmjipda", "multi_hypothesis"])
def test_a_ship_hidden_in_part_for_a_minute_keeps_its_track_place_and_length(method):
    """300 m at 5 m/s; for 20 turns of 4 s the foremost 120 m are seen alone, which lie 90 m before the middle."""
    tracker, sensors, ids = TableTracker(method=method), two_radars(), set()
    sensors = replace(sensors, radars=replace(sensors.radars, beam_rad=np.full(2, np.radians(1.0))))
    memory, period_s, rng = tracker.init(), float(sensors.radars.period_s[0]), np.random.default_rng(7)
    for turn in range(40):
        now_s, hidden = 1.7e9 + turn * period_s, 15 <= turn < 35
        middle = np.array([1500.0 + 5.0 * turn * period_s, 1500.0])
        seen = middle + np.array([90.0 * hidden, 0.0]) + rng.normal(0.0, 4.0, 2)
        given = plots([now_s], [seen], [moments(120.0 if hidden else 300.0, 42.0, 90.0)], [20.0])
        memory, out = tracker.step(memory, RegionInput.of_plots(given, now_s, sensors))
        if turn >= 12:
            off_m = to_plane(out.tracks.position_deg, ORIGIN_DEG) - middle
            assert len(off_m) == 1
            assert np.abs(off_m).max() < 15.0  # 4 m of noise, and half of the hidden length at first
            assert out.tracks.echo_length_m[0] > 240.0
            ids |= set(out.tracks.track_id.tolist())
    assert len(ids) == 1


@pytest.mark.parametrize("speed_m_s", [0.0, 5.0])
@pytest.mark.parametrize("method", ["sided_imm", "guided_vimmjipda"])
def test_a_ship_that_comes_into_sight_end_by_end_has_its_own_speed_and_not_that_of_its_echo(method, speed_m_s):
    """300 m; of its stern 60 m are seen for 12 turns of 4 s, then 12 m more in each. Their middle goes 3 m/s along the hull."""
    tracker, sensors = TableTracker(method=method), two_radars()
    sensors = replace(sensors, radars=replace(sensors.radars, beam_rad=np.full(2, np.radians(1.0))))
    memory, period_s, rng = tracker.init(), float(sensors.radars.period_s[0]), np.random.default_rng(7)
    errors_m_s, squares = list[float](), list[float]()
    for turn in range(40):
        now_s = 1.7e9 + turn * period_s
        seen_m = np.clip(60.0 + 24.0 * (turn - 11), 60.0, 300.0)
        middle = np.array([1500.0 + speed_m_s * turn * period_s, 1500.0])
        at = middle + np.array([0.5 * (seen_m - 300.0), 0.0]) + rng.normal(0.0, 4.0, 2)
        given = plots([now_s], [at], [moments(seen_m, 42.0, 90.0)], [20.0])
        memory, out = tracker.step(memory, RegionInput.of_plots(given, now_s, sensors))
        if turn >= 12:
            assert len(out.tracks) == 1
            error = out.tracks.velocity_m_s[0] - [speed_m_s, 0.0]
            errors_m_s.append(float(np.hypot(*error)))
            squares.append(float(error @ np.linalg.solve(out.tracks.covariance[0, 2:, 2:], error)))
    assert max(errors_m_s) < 1.0, errors_m_s  # half of a knot more than the noise; 3 m/s where the echo is believed
    assert np.mean(squares) < 4.0  # 2 is right
    off_m = to_plane(out.tracks.position_deg, ORIGIN_DEG)[0] - middle
    assert np.abs(off_m).max() < 25.0


def test_a_piece_of_a_look_that_gave_a_plot_before_is_left_out():
    given = plots([0.4], [[75.0, 1000.0]], [moments(150.0, 42.0, 90.0)], [10.0])
    ship = 0.0, 1000.0, 300.0, 42.0, 90.0
    assert len(joined(given, hulls((*ship, 0.0)), np.array([PERIOD_S]))[0]) == 0
    assert len(joined(given, hulls((*ship, -2.0)), np.array([PERIOD_S]))[0]) == 1


def test_of_several_hulls_around_it_the_longest_has_a_piece_and_nothing_is_joined_without_extents():
    one, other = (0.0, 1000.0, 300.0, 42.0, 90.0, -9.0), (100.0, 1000.0, 100.0, 42.0, 90.0, -9.0)
    given = plots([1.0, 1.1], [[-80.0, 1000.0], [100.0, 1000.0]], [moments(135.0, 30.0, 90.0)] * 2, [1.0, 3.0])
    found, _ = joined(given, hulls(other, one), np.array([PERIOD_S]))
    np.testing.assert_allclose(found.position_m, [[10.0, 1000.0]])
    unknown = plots([1.0, 1.1], [[-80.0, 1000.0], [100.0, 1000.0]], np.full((2, 3), np.nan), [1.0, 3.0])
    assert len(joined(unknown, hulls(other, one), np.array([PERIOD_S]))[0]) == 2


@pytest.mark.parametrize("method", ["sided_imm", "vimmjipda", "guided_vimmjipda", "multi_hypothesis"])
def test_a_tracker_reports_the_size_of_a_ship_in_pieces_as_one_track_and_resumes(method):
    """From the tenth turn on the ship comes in two halves, in both methods of life."""
    tracker, sensors = TableTracker(method=method), two_radars()
    sensors = replace(sensors, radars=replace(sensors.radars, beam_rad=np.full(2, np.radians(1.0))))
    memory, period_s = tracker.init(), float(sensors.radars.period_s[0])
    for turn in range(16):
        now_s = 1.7e9 + turn * period_s
        middle = np.array([1500.0 + 5.0 * turn * period_s, 1500.0])
        off = [[0.0, 0.0]] if turn < 10 else [[-75.0, 0.0], [75.0, 0.0]]
        shape = moments(300.0 / len(off), 42.0, 90.0)
        given = plots(
            np.full(len(off), now_s) + np.arange(len(off)) * 1e-3,
            middle + np.array(off),
            [shape] * len(off),
            [5.0] * len(off),
        )
        memory = load(save(memory)) if turn == 12 else memory
        memory, found = tracker.step(memory, RegionInput.of_plots(given, now_s + 0.1, sensors))
    assert len(found.tracks) == 1
    assert found.tracks.echo_length_m[0] == pytest.approx(300.0, abs=1.0)
    assert found.tracks.echo_width_m[0] == pytest.approx(42.0, abs=1.0)
    assert found.tracks.echo_axis_deg[0] == pytest.approx(90.0, abs=0.5)


def followed(method, speed, end=0, silent_from=24, other_mmsi=None):
    """The tracks of each of 24 turns of a ship in two halves, and where its middle is; AIS is at one of them for ten turns.

    Args: end: 0: its aft half, 1: the other; silent_from: the turn from which on it sends no AIS; other_mmsi: that of the other half.
    """
    tracker, sensors = TableTracker(method=method), two_radars()
    sensors = replace(sensors, radars=replace(sensors.radars, beam_rad=np.full(2, np.radians(1.0))))
    memory, period_s, out = tracker.init(), float(sensors.radars.period_s[0]), []
    for turn in range(24):
        now_s = 1.7e9 + turn * period_s
        middle = np.array([[1500.0 + speed * turn * period_s, 1500.0]])
        ends = middle + np.array([[-75.0, 0.0], [75.0, 0.0]])
        given = plots([now_s, now_s + 1e-3], ends, [moments(150.0, 42.0, 90.0)] * 2, [5.0, 5.0])
        ais_m = ends[end : end + 1] if turn < 10 else middle
        heard = Messages(np.full(1, now_s + 0.05), ais_m, 25.0 * np.eye(2)[None], np.full(1, 1000), np.zeros(1, np.int64))
        heard = heard.take(slice(0, 1 if turn < silent_from else 0))
        if other_mmsi is not None:
            heard = Messages.join([heard, replace(heard, mmsi=np.full(1, other_mmsi))])
            heard = replace(heard, position_m=ends)
        of_cycle = RegionInput.of_plots(given, now_s + 0.1, sensors)._replace(messages=heard)
        memory, found = tracker.step(memory, of_cycle)
        out.append((found.tracks, from_plane(middle, sensors.region_origin_deg[0])))
    return out


@pytest.mark.parametrize("method", ["sided_imm", "vimmjipda", "guided_vimmjipda"])
def test_a_ship_under_way_that_began_as_two_tracks_is_one_in_its_middle_and_ships_at_rest_stay_two(method):
    out = followed(method, 5.0)
    whole = out[-1][0]
    assert len(whole) == 1
    assert whole.echo_length_m[0] == pytest.approx(300.0, abs=3.0)
    began = next(k for k, (tracks, _) in enumerate(out) if len(tracks) == 2)
    errors = [np.hypot(*difference_m(tracks.position_deg, at)[0]) for tracks, at in out[began:] if len(tracks) == 1]
    assert max(errors) < 20.0
    assert whole.held_mmsi.tolist() == [1000 if method == "guided_vimmjipda" else -1]
    assert len(followed(method, 0.0)[-1][0]) == 2


@pytest.mark.parametrize("end", [0, 1])
def test_a_ship_that_began_as_two_tracks_keeps_the_mmsi_of_either(end):
    """Its AIS is heard at one end until the two are one, and not again."""
    out = followed("guided_vimmjipda", 5.0, end)
    begins = next(k for k, (tracks, _) in enumerate(out) if len(tracks) == 2)
    joined = next(k for k in range(begins, 24) if len(out[k][0]) == 1)
    after = followed("guided_vimmjipda", 5.0, end, joined + 1)[joined + 1][0]
    assert after.held_mmsi.tolist() == [1000]


def test_two_ships_in_line_that_send_are_two_whatever_their_echoes():
    """A tug is close ahead of its tow, at one speed: both send."""
    assert [len(tracks) for tracks, _ in followed("guided_vimmjipda", 5.0, other_mmsi=2000)[8:]] == [2] * 16
    assert len(followed("guided_vimmjipda", 5.0)[-1][0]) == 1


def test_pieces_longer_together_than_the_longest_ship_stay_apart_and_no_size_is_given_of_longer_echoes():
    """A hull of 400 m has boats at both ends: as one they would be 690 m long, and the mean of the track would take in still more."""
    boat = moments(20.0, 6.0, 90.0)
    given = plots([1.0, 1.1], [[-200.0, 1000.0], [200.0, 1000.0]], [boat, boat], [10.0, 10.0])
    found, _ = joined(given, hulls((0.0, 1000.0, 400.0, 42.0, 90.0, -1.4)), np.array([PERIOD_S]))
    np.testing.assert_array_equal(found.position_m, given.position_m)
    extent = np.array([moments(450.0, 42.0, 90.0), moments(500.0, 42.0, 90.0)])
    size = echoes_of(extent, np.full(2, 50.0), np.full((2, 2), 3.0))
    np.testing.assert_allclose(size.length_m, [450.0, np.nan])
    assert np.isnan([size.width_m[1], size.axis_deg[1]]).all()


def test_an_echo_longer_than_any_ship_takes_in_no_other_echo():
    """A breakwater of 800 m that is a track: a boat beside it stays a plot of its own."""
    tracker, sensors = TableTracker(method="sided_imm"), two_radars()
    sensors = replace(sensors, radars=replace(sensors.radars, beam_rad=np.full(2, np.radians(1.0))))
    memory, period_s = tracker.init(), float(sensors.radars.period_s[0])
    for turn in range(16):
        now_s = 1.7e9 + turn * period_s
        at = [[1500.0, 1500.0], [1800.0, 1510.0]]
        given = plots([now_s, now_s + 1e-3], at, [moments(800.0, 30.0, 90.0), moments(20.0, 6.0, 90.0)], [9.0, 1.0])
        memory, found = tracker.step(memory, RegionInput.of_plots(given, now_s + 0.1, sensors))
    assert len(found.tracks) == 2
