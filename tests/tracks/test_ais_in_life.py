"""AIS as it is in life: slow reporters, wrong speeds, stamps of receipt, vessels at anchor, odd numbers, stated accuracy."""

from dataclasses import replace

import numpy as np
import pytest
from ais_world import HOME, PERIOD_S, SENSORS, START_S, reports, run, sail

from coastwatch.batches import PositionAccuracy
from coastwatch.geodesy import KNOT_M_S, difference_m, offset_deg
from coastwatch.server.checkpoint import load, save
from coastwatch.tracks import AisInput
from coastwatch.tracks.ais.ais_filter import AisFilter

pytestmark = pytest.mark.contract

FERRY = 235000001


def step_all(method, every, cycles):
    """The outputs of so many cycles over these reports."""
    memory, outputs = method.init(), []
    for k in range(cycles):
        lo, hi = START_S + k * PERIOD_S, START_S + (k + 1) * PERIOD_S
        part = every.take((every.received_s > lo) & (every.received_s <= hi))
        memory, (tracks, alarms, _) = method.step(memory, AisInput(part, hi, SENSORS))
        outputs.append((tracks, alarms))
    return memory, outputs


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_vessel_that_reports_each_61_to_90_s_is_shown_without_holes(seed):
    rng = np.random.default_rng([seed, 11])
    times = START_S + 1.0 + np.cumsum(rng.uniform(61.0, 90.0, 20))
    first, outputs = int((times[0] - START_S) / PERIOD_S) + 1, []
    run(AisFilter(), sail(FERRY, times, speed_kn=14.0), int((times[-1] - START_S) / PERIOD_S), outputs=outputs)
    assert all(len(tracks) == 1 for tracks, _ in outputs[first:])
    assert len({int(tracks.track_id[0]) for tracks, _ in outputs[first:]}) == 1


def test_a_vessel_that_begins_to_report_slowly_is_shown_without_holes_after_two_gaps():
    quick, slow = np.arange(0.0, 60.0, 3.0), 60.0 + 75.0 * np.arange(1, 12)
    outputs = []
    run(AisFilter(), sail(FERRY, START_S + 1.0 + np.append(quick, slow)), 290, outputs=outputs)
    shown = np.array([len(tracks) for tracks, _ in outputs])
    assert (shown[int(211.0 / PERIOD_S) :] == 1).all()


def test_one_loss_of_reception_is_not_an_interval():
    times = np.concatenate([np.arange(0.0, 60.0, 3.0), 200.0 + np.arange(0.0, 30.0, 3.0)])
    outputs = []
    run(AisFilter(), sail(FERRY, START_S + 1.0 + times), 100, outputs=outputs)
    assert outputs[-1][1].interval_s.size == 0  # lost 50 s after its last report, as if nothing had been
    assert outputs[76][1].interval_s.tolist() == [10.0]


@pytest.mark.parametrize(("sog_kn", "speed_kn", "interval_s"), [(102.2, 12.0, 10.0), (102.2, 0.0, 180.0), (55.0, 0.3, 180.0)])
def test_one_report_of_an_absurd_speed_is_flagged_and_moves_nothing(sog_kn, speed_kn, interval_s):
    times = START_S + 1.0 + interval_s * np.arange(8)
    rows = sail(FERRY, times, speed_kn=speed_kn)
    rows[-1] = (*rows[-1][:5], sog_kn, 300.0)
    outputs = []
    memory, tracks, alarms = run(AisFilter(), rows, int((times[-1] - START_S) / PERIOD_S) + 9, outputs=outputs)
    assert alarms.impossible_speed.tolist() == [True]
    assert not outputs[-11][1].impossible_speed.any()
    assert np.hypot(*tracks.velocity_m_s[0]) < (speed_kn + 2.0) * KNOT_M_S
    way = np.array([np.sin(np.radians(40.0)), np.cos(np.radians(40.0))]) * speed_kn * KNOT_M_S
    assert np.hypot(*difference_m(tracks.position_deg[0], offset_deg(HOME, way * (tracks.time_s[0] - START_S)))) < 60.0
    assert memory.refused == {"doubtful velocity": 1}


def test_a_first_report_of_an_absurd_speed_stays_where_it_is():
    row = [(*sail(FERRY, [START_S + 1.0])[0][:5], 102.2, 90.0)]
    _, tracks, alarms = run(AisFilter(), row, 12)
    assert np.hypot(*difference_m(tracks.position_deg[0], HOME)) < 60.0
    assert alarms.impossible_speed.tolist() == [True]


def test_a_fast_boat_that_speeds_up_is_believed():
    """From rest to 40 kn within 12 s, reports every 3 s."""
    time = 3.0 * np.arange(14)
    speed = np.clip(1.7 * (time - 9.0), 0.0, 40.0 * KNOT_M_S)
    way = np.cumsum(np.append(0.0, 0.5 * (speed[1:] + speed[:-1]) * 3.0))
    place = offset_deg(HOME, way[:, None] * np.array([1.0, 0.0]))
    rows = [
        (START_S + 1.0 + t, START_S + 1.0 + t, FERRY, *p, v / KNOT_M_S, 90.0)
        for t, p, v in zip(time, place, speed, strict=True)
    ]
    memory, tracks, alarms = run(AisFilter(), rows, 14)
    assert not alarms.impossible_speed.any()
    assert memory.refused == {}
    np.testing.assert_allclose(tracks.velocity_m_s[0], [40.0 * KNOT_M_S, 0.0], atol=1.0)


def jittered(speed_kn, sigma_s, seed, until_s=900.0, in_order=True):
    """Reports of a ferry, some seconds late or early: in the order of their fixes or not."""
    rng = np.random.default_rng([seed, 21])
    fix = START_S + 1.0 + np.arange(0.0, until_s, 4.0)
    rows = sail(FERRY, fix, speed_kn=speed_kn, seed=seed)
    stamp = fix + rng.normal(0.0, sigma_s, len(fix))
    stamp = np.sort(stamp) if in_order else stamp
    return [(s, s, *row[2:]) for s, row in zip(stamp, rows, strict=True)]


@pytest.mark.parametrize("in_order", [True, False])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_ferry_whose_stamps_jitter_by_seconds_is_one_vessel(seed, in_order):
    outputs = []
    run(AisFilter(), jittered(34.0, 4.0, seed, in_order=in_order), 300, outputs=outputs)
    assert all(len(tracks) == 1 for tracks, _ in outputs[5:])
    assert not any(alarms.twice.any() or alarms.impossible_speed.any() for _, alarms in outputs)


def test_the_jitter_of_each_feed_is_estimated_and_widens_the_track_along_its_way():
    rng = np.random.default_rng(5)
    parts = []
    for feed, sigma_s in enumerate((0.0, 3.0)):
        for k in range(6):
            fix = START_S + 1.0 + np.arange(0.0, 300.0, 5.0)
            rows = sail(235000001 + 10 * feed + k, fix, HOME + 0.1 * k + feed, speed_kn=20.0, course_deg=90.0, seed=k)
            made = reports(rows)
            late = np.maximum.accumulate(made.time_s + rng.normal(0.0, sigma_s, len(made)))
            parts.append(replace(made, time_s=late, received_s=late, feed=np.full(len(made), feed)))
    every = type(parts[0]).join(parts)
    every = every.take(np.argsort(every.received_s, kind="stable"))
    memory, outputs = step_all(AisFilter(), every, 99)
    exact_s, jitter_s = memory.clocks.summary().time_jitter_s.tolist()
    assert exact_s == 0.0
    assert 2.0 < jitter_s < 4.0
    tracks = outputs[-1][0]
    along, jittery = np.sqrt(tracks.covariance[:, 0, 0]), tracks.mmsi > 235000009
    assert along[jittery].min() > 1.3 * along[~jittery].max()


def test_two_ships_of_one_number_are_two_where_stamps_jitter():
    rows = jittered(20.0, 2.0, 4, until_s=200.0)
    rows += [(*row[:3], row[3] + 0.05, *row[4:]) for row in jittered(20.0, 2.0, 5, until_s=200.0)]
    _, tracks, alarms = run(AisFilter(), rows, 60)
    assert len(tracks) == 2
    assert alarms.twice.all()


@pytest.mark.parametrize(
    ("status", "speed_kn", "expected_s", "moves"), [(1, 1.4, 180.0, False), (5, 12.0, 10.0, True), (0, 1.4, 10.0, True)]
)
def test_a_vessel_at_anchor_is_expected_each_three_minutes_and_not_moved(status, speed_kn, expected_s, moves):
    rows = sail(FERRY, START_S + 1.0 + np.arange(0.0, 30.0, 10.0), speed_kn=speed_kn)
    made = reports(rows)
    _, outputs = step_all(AisFilter(), replace(made, nav_status=np.full(len(made), status)), 20)
    tracks, alarms = outputs[-1]
    assert alarms.nav_status.tolist() == [status]
    assert alarms.interval_s.tolist() == [expected_s]
    way = np.hypot(*difference_m(tracks.position_deg[0], outputs[8][0].position_deg[0]))
    assert (way > 20.0) == moves


def test_a_distress_device_is_waited_for():
    rows = sail(972123456, START_S + 1.0 + np.arange(0.0, 12.0, 2.0), speed_kn=1.5)
    _, tracks, alarms = run(AisFilter(), rows, 100)
    assert alarms.interval_s.tolist() == [180.0]
    assert tracks.mmsi.tolist() == [972123456]


def test_odd_numbers_have_tracks():
    rows = [row for mmsi in (0, 7, 999999999, 2**30 - 1) for row in sail(mmsi, [START_S + 1.0], HOME + mmsi * 1e-9)]
    _, tracks, _ = run(AisFilter(), rows, 1)
    assert tracks.mmsi.tolist() == [0, 7, 999999999, 2**30 - 1]


def test_a_report_is_as_accurate_as_it_says():
    made = reports([row for k in range(6) for row in sail(FERRY + k, [START_S + 1.0], HOME + 0.1 * k)])
    own = np.full((6, 2, 2), np.nan)
    own[4], own[5] = np.array([[400.0, 30.0], [30.0, 25.0]]), 2500.0 * np.eye(2)
    said = [-1, PositionAccuracy.HIGH, PositionAccuracy.UNAIDED, PositionAccuracy.LOW, -1, PositionAccuracy.HIGH]
    made = replace(made, accuracy=np.array(said, np.int64), covariance=own)
    _, outputs = step_all(AisFilter(), made, 1)
    given = outputs[0][0].report_covariance
    np.testing.assert_allclose(np.sqrt(given[:4, 0, 0]), [3.33, 3.33, 5.0, 10.0], atol=0.01)
    np.testing.assert_array_equal(given[4:], own[4:])
    assert (np.diff(outputs[0][0].covariance[[1, 2, 3, 5], 0, 0]) > 0.0).all()


def test_an_accurate_report_weighs_more():
    rows = sail(FERRY, START_S + 1.0 + np.arange(0.0, 60.0, 3.0), sigma_m=0.1)
    made = reports(rows)
    place = made.position_deg.copy()
    place[-1] = offset_deg(place[-1], np.array([-80.0, 95.0]))  # across its course
    ends = []
    for sigma_m in (3.0, 60.0):
        own = np.full((len(made), 2, 2), np.nan)
        own[-1] = sigma_m**2 * np.eye(2)
        _, outputs = step_all(AisFilter(), replace(made, position_deg=place, covariance=own), 20)
        ends.append(outputs[-1][0].position_deg[0])
    _, outputs = step_all(AisFilter(), made, 20)
    moved = [np.hypot(*difference_m(end, outputs[-1][0].position_deg[0])) for end in ends]
    assert moved[0] > 10.0 * moved[1]


def test_a_feed_that_is_always_late_keeps_its_vessels_and_loses_those_that_fall_silent():
    """An aggregator that gives each report 90 s after its fix: patience under way is 50 s. A vessel is lost 50 s after its last one."""
    times, late_s = START_S + np.arange(1.0, 400.0, 10.0), np.full(40, 90.0)
    rows = [r for i in range(5) for r in sail(235000001 + i, times + 0.7 * i, HOME + np.array([0.02 * i, 0.0]), delay=late_s)]
    outputs = []
    memory, *_ = run(AisFilter(), rows, 160, outputs=outputs)
    assert memory.refused == {}
    assert {len(tracks) for tracks, _ in outputs[50:160]} == {5}
    half, *_ = run(AisFilter(), rows, 80)
    memory, last, _ = run(AisFilter(), rows, 110, load(save(half)), first=80)
    assert len(last) == 0  # 570 s: the last report, of 391 s, came at 481 s
    assert len(memory.delays) == 5
    memory, *_ = run(AisFilter(), rows, 1160, memory, first=190)
    assert len(memory.delays) == 0  # they are forgotten


def test_one_report_in_time_ends_the_patience_with_a_late_feed():
    times = START_S + np.arange(1.0, 200.0, 10.0)
    rows = sail(235000001, times, delay=[*np.full(19, 90.0), 0.5])
    outputs = []
    run(AisFilter(), rows, 100, outputs=outputs)
    shown = [len(tracks) for tracks, _ in outputs]
    assert shown[66] == 1
    assert shown[84] == 0  # 255 s: 64 s after the last one, of 191 s; late ones that are older came meanwhile


def at_rest(place_m, every_s, until_s, first_s=5.0):
    """Rows of a ship that says that it lies still. Args: place_m: its place in m east at a time."""
    times = np.arange(first_s, until_s, every_s)
    rng = np.random.default_rng(1)
    at = [offset_deg(HOME, np.array([place_m(t), 0.0]) + rng.normal(0.0, 2.0, 2)) for t in times]
    return [(START_S + t, START_S + t + 0.5, FERRY, *p, 0.0, 360.0) for t, p in zip(times, at, strict=True)]


@pytest.mark.parametrize("apart_m", [500.0, 2500.0])
def test_two_moored_ships_with_one_mmsi_are_two_and_do_not_go_to_and_fro(apart_m):
    """Each sends each three minutes: a ship could sail from one to the other meanwhile, but would not say that it lies still."""
    rows = at_rest(lambda t: 0.0, 180.0, 1800.0) + at_rest(lambda t: apart_m, 180.0, 1800.0, 95.0)
    outputs = []
    memory, *_ = run(AisFilter(), rows, 590, outputs=outputs)
    last = outputs[200:]
    assert {len(tracks) for tracks, _ in last} == {2}
    assert all(alarms.twice.all() and not alarms.impossible_speed.any() for _, alarms in last)
    east = np.array([difference_m(tracks.position_deg, HOME[None])[:, 0] for tracks, _ in last])
    assert np.abs(np.sort(east, axis=1) - [0.0, apart_m]).max() < 20.0
    assert memory.refused == {"impossible speed": 1}


@pytest.mark.parametrize("speed_m_s", [1.5, 5.1])
def test_one_ship_that_moves_between_two_reports_at_rest_keeps_its_track(speed_m_s):
    """One is shifted along the quay for three minutes; the other's transponder always says that it lies still."""
    shifted = at_rest(lambda t: 400.0 * np.clip((t - 700.0) / 60.0, 0.0, 1.0), 180.0, 1800.0)
    wrong = at_rest(lambda t: speed_m_s * t, 180.0, 1800.0)
    for rows, off_m in ((shifted, 20.0), (wrong, 400.0 * speed_m_s)):
        outputs = []
        run(AisFilter(), rows, 590, outputs=outputs)
        shown = outputs[20:]
        assert {tuple(tracks.track_id.tolist()) for tracks, _ in shown} == {tuple(outputs[20][0].track_id.tolist())}
        assert not any(alarms.twice.any() or alarms.impossible_speed.any() for _, alarms in shown)
        last, _ = shown[-1]
        newest = np.array(rows[-1][3:5])
        assert np.hypot(*difference_m(last.position_deg, newest[None])[0]) < off_m
