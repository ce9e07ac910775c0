"""Bearing tracks: windows, wrapped angles, least squares, tracks of our own where a sensor numbers nothing."""

from __future__ import annotations

from dataclasses import replace

import bearing_world as bw
import numpy as np
import pytest
from hypothesis import given, strategies as st
from pydantic import ValidationError

from coastwatch import kernels
from coastwatch.batches import ID_STRIDE, BearingReports, Floats, Reports, Sensors
from coastwatch.batches.limits import CONTACTS, reports_within
from coastwatch.geodesy import wrap_deg, wrap_rad
from coastwatch.server.checkpoint import load, save
from coastwatch.tracks import BearingInput
from coastwatch.tracks.bearing import BearingWindow
from coastwatch.tracks.bearing.looks import (
    MOST_GATED,
    MOST_LOOKS,
    MOST_NUMBERED,
    MOST_OWN,
    MOST_SHARES,
    SHARE_S,
    _evenly,
    few,
    looks_of,
    near_in_bearing,
    rounds,
)

pytestmark = pytest.mark.contract

ROUNDING = 1e-9
START = bw.START_S


def say(sensor: Floats, time_s: Floats, bearing_deg: Floats, contact: Floats, site_deg: Floats | None = None) -> BearingReports:
    n = len(np.atleast_1d(bearing_deg))
    whole = [np.broadcast_to(np.asarray(a, np.int64), n).copy() for a in (sensor, contact)]
    stamp = np.broadcast_to(np.asarray(time_s, float), n).copy() + START
    site = np.broadcast_to(bw.ORIGIN_DEG if site_deg is None else site_deg, (n, 2)).copy()
    return BearingReports(
        whole[0],
        stamp,
        stamp,
        np.atleast_1d(np.asarray(bearing_deg, float)),
        whole[1],
        site,
        whole[1] * 0 - 1,
        whole[1] * 0 + 5,
    )


def two_sensors() -> Sensors:
    return bw.sensors_of(np.array([[0.0, 0.0], [9000.0, 0.0]]), 7000.0, (0.0, 360.0))


def play(method: BearingWindow, cycles: list[BearingReports], sensors: Sensors, period_s: float = 3.0):
    memory, tracks = method.init(), None
    for k, reports in enumerate(cycles):
        memory, tracks = method.step(memory, BearingInput(reports, START + period_s * (k + 1), sensors))
    return memory, tracks


def test_a_line_across_the_wrap_is_recovered() -> None:
    sensors = two_sensors()
    rate = 0.2
    cycles = [say(1, 3.0 * (k + 1), (176.0 + rate * 3.0 * (k + 1)) % 360.0, 8) for k in range(15)]
    _, tracks = play(BearingWindow(rate_sigma_deg_s=1e3), cycles, sensors)
    assert np.degrees(tracks.rate_rad_s) == pytest.approx([rate], abs=1e-4)  # the wide prior draws it to 0 by this little
    assert wrap_deg(np.degrees(tracks.bearing_rad) - (176.0 + rate * 45.0)) == pytest.approx([0.0], abs=1e-3)
    assert tracks.source.tolist() == [sensors.sonar_source(1)]
    assert tracks.track_id.tolist() == [sensors.sonar_source(1) * ID_STRIDE]
    shown = np.isfinite(tracks.window_time_s[0])
    assert shown.sum() == 15
    assert shown[-15:].all()
    assert (np.diff(tracks.window_time_s[0][shown]) > 0.0).all()
    assert (np.abs(tracks.window_bearing_rad[0][shown]) <= np.pi).all()
    assert tracks.origin.tolist() == [5]


def test_covariance_is_that_of_least_squares() -> None:
    rng = np.random.default_rng([1, 1])
    sensors = two_sensors()
    n = 600
    contacts = np.arange(n)
    cycles = [say(0, 3.0 * (k + 1), rng.normal(100.0, 1.0, n), contacts) for k in range(10)]
    _, tracks = play(BearingWindow(), cycles, sensors)
    error = np.column_stack([tracks.bearing_rad - np.radians(100.0), tracks.rate_rad_s])
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(tracks.covariance), error).sum()
    assert 1200 - 5 * 49 < nees < 1200 + 5 * 49  # chi-square of 2 n degrees of freedom, 5 sigma
    alone = play(BearingWindow(), [say(0, 1.0, 10.0, 1)], sensors)[1]
    assert alone.rate_rad_s.tolist() == [0.0]
    assert np.sqrt(alone.covariance[0, 1, 1]) == pytest.approx(np.radians(0.5))


def test_memory_is_not_written_and_resumes_bit_for_bit() -> None:
    rng = np.random.default_rng([1, 2])
    sensors, method = two_sensors(), BearingWindow(length=5, window_s=15.0)
    memory = method.init()
    for k in range(12):
        n = int(rng.integers(0, 9))
        contact = rng.permutation(np.arange(-3, 6))[:n]
        reports = say(
            rng.integers(0, 2, n), 3.0 * k + rng.uniform(0.1, 3.0, n), rng.uniform(0.0, 360.0, n), np.maximum(contact, -1)
        )
        before = save(memory)
        answer = method.step(memory, BearingInput(reports, START + 3.0 * (k + 1), sensors))
        assert save(memory) == before
        shuffled = reports.take(rng.permutation(n))
        again = method.step(load(before), BearingInput(shuffled, START + 3.0 * (k + 1), sensors))
        for a, b in zip(answer, again, strict=True):
            for name in vars(a):
                np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
        memory = answer[0]


def test_silence_ends_a_contact_and_its_number_begins_anew() -> None:
    sensors, method = two_sensors(), BearingWindow(drop_after_s=30.0)
    memory, first = method.step(method.init(), BearingInput(say(0, 1.0, 10.0, 3), START + 3.0, sensors))
    memory, tracks = method.step(memory, BearingInput(say(0, [], [], []), START + 32.0, sensors))
    assert len(tracks) == 0
    _, second = method.step(memory, BearingInput(say(0, 33.0, 10.0, 3), START + 35.0, sensors))
    assert second.track_id[0] == first.track_id[0] + 1
    long_cycle = say(0, [1.0, 40.0, 42.0], [10.0, 10.0, 10.0], 3)  # both within one cycle of a minute
    _, tracks = method.step(method.init(), BearingInput(long_cycle, START + 60.0, sensors))
    assert tracks.track_id.tolist() == second.track_id.tolist()
    assert tracks.started_s.tolist() == [START + 40.0]


def test_late_double_and_broken_reports_change_nothing() -> None:
    sensors, method = two_sensors(), BearingWindow()
    memory, tracks = method.step(method.init(), BearingInput(say(0, [1.0, 2.9], [10.0, 12.0], 3), START + 3.0, sensors))
    bad = say(0, [2.0, 2.9, 4.0, np.nan], [50.0, 60.0, np.nan, 70.0], 3)
    memory, after = method.step(memory, BearingInput(bad, START + 3.0, sensors))
    assert np.isnan(after.measured_s).all()
    for name in vars(tracks):
        if not name.startswith("measured"):
            np.testing.assert_array_equal(getattr(after, name), getattr(tracks, name))


@pytest.mark.parametrize("contact", [3, -1])
@pytest.mark.parametrize("stamp_s", [86_400.0, 20.5])
def test_a_bearing_from_the_future_is_dropped_and_counted(contact: int, stamp_s: float) -> None:
    sensors, method = two_sensors(), BearingWindow(ahead_s=5.0)
    right = [say(0, 3.0 * (k + 1), 10.0, contact) for k in range(8)]
    want, tracks = play(method, right, sensors)
    wrong = say(0, stamp_s, [10.0, 70.0], [contact, 4 if contact >= 0 else -1])
    memory, after = play(method, [*right[:4], BearingReports.join([right[4], wrong]), *right[5:]], sensors)
    for name in vars(tracks):
        np.testing.assert_array_equal(getattr(after, name), getattr(tracks, name))
    assert (want.dropped, memory.dropped) == (0, 2)
    assert load(save(memory)).dropped == 2


def test_a_bearing_ahead_within_the_limit_is_used_and_one_that_is_not_finite_is_counted() -> None:
    reports = say(0, [8.0, 3.0, np.nan, np.inf], [10.0, np.nan, 10.0, 10.0], [1, 2, 3, 4])
    memory, tracks = play(BearingWindow(ahead_s=5.0), [reports], two_sensors())
    assert tracks.updated_s.tolist() == [START + 8.0]
    assert memory.dropped == 3


def used_of(reports: BearingReports) -> np.ndarray:
    """Which reports are used, of sensors that hear a vessel again after a second or more."""
    return few(reports, looks_of(reports, np.full(3, 0.1), np.full(3, 1.0)))


def steady(wild: dict[int, float], count: int = 20, contact: int = 3) -> list[BearingReports]:
    """A bearing each 3 s of a contact at 10 deg, but for those of some cycles."""
    return [say(0, 3.0 * (k + 1), wild.get(k, 10.0), contact) for k in range(count)]


@pytest.mark.parametrize("wild_deg", [30.0, 100.0, 190.0])
def test_one_bearing_far_from_the_others_of_its_contact_is_not_used_and_counted(wild_deg: float) -> None:
    """It cost the contact its vessel for five minutes."""
    want, _ = play(BearingWindow(), steady({}), two_sensors())
    memory, tracks = play(BearingWindow(), steady({12: wild_deg, 15: wild_deg + 60.0}), two_sensors())
    assert (memory.far_off, want.far_off) == (2, 0)
    assert memory.track_id.tolist() == want.track_id.tolist()
    assert np.degrees(tracks.bearing_rad) == pytest.approx([10.0])
    assert load(save(memory)).far_off == 2


def test_two_bearings_in_a_row_that_agree_are_another_vessel_under_the_number() -> None:
    memory, tracks = play(BearingWindow(), steady(dict.fromkeys(range(12, 20), 100.0)), two_sensors())
    assert np.degrees(tracks.bearing_rad) == pytest.approx([100.0])
    assert tracks.started_s.tolist() == [START + 3.0 * 14]
    assert memory.hits.tolist() == [7]


def test_two_vessels_under_one_number_are_not_averaged() -> None:
    both = [say(0, [3.0 * (k + 1) - 0.01, 3.0 * (k + 1)], [40.0, 130.0], 1) for k in range(20)]
    memory, tracks = play(BearingWindow(), both, two_sensors())
    assert np.degrees(tracks.bearing_rad) == pytest.approx([40.0])
    assert memory.far_off == 20


@pytest.mark.parametrize("true_deg", [1.0, 2.0, 4.0])
def test_noise_beyond_the_stated_one_is_learned(true_deg: float) -> None:
    """Stated is one degree."""
    rng, count = np.random.default_rng([7, int(true_deg)]), 200
    contacts = np.arange(6)
    said = [say(0, np.full(6, 3.0 * (k + 1)), 60.0 * contacts + true_deg * rng.normal(size=6), contacts) for k in range(count)]
    memory, tracks = play(BearingWindow(), said, two_sensors())
    assert np.sqrt(memory.noise[0]) == pytest.approx(true_deg, rel=0.25)
    stated = two_sensors().sonars.bearing_sigma_rad[0]
    used = np.sqrt(tracks.window_variance[:, -1]) / stated
    assert used == pytest.approx(np.full(6, np.sqrt(memory.noise[0]) if true_deg > 1.0 else 1.0), rel=0.02)


def test_a_contact_number_that_is_too_large_is_left_out_and_counted_and_ends_no_run() -> None:
    sent = Reports(bearing=say(0, [3.0, 3.0], [10.0, 20.0], [7, CONTACTS]))
    kept, found = reports_within(sent)
    assert kept.bearing.contact.tolist() == [7]
    assert found == {"bearing: contact number": 1}


def test_a_slow_sensor_keeps_its_contacts_for_some_intervals() -> None:
    slow = two_sensors()
    slow = replace(slow, sonars=replace(slow.sonars, interval_s=np.array([60.0, 3.0])))
    slowly = [say(0, 60.0 * (k // 20 + 1), 10.0, 3) if k % 20 == 19 else say(0, [], [], []) for k in range(100)]
    for sensors, begun in ((slow, 1), (two_sensors(), 5)):
        memory, _ = play(BearingWindow(), slowly, sensors)
        assert memory.counter.tolist() == [begun, 0]


@pytest.mark.parametrize("spread_s", [0.0, 0.02, 2.9])
@pytest.mark.parametrize("cycle_s", [1.0, 3.0])
def test_bearings_with_times_of_their_own_are_tracked_as_those_of_one_time(spread_s: float, cycle_s: float) -> None:
    """A direction finder that turns in 3 s, or lines that arrive one after the other, gave no track at all."""
    rng, true = np.random.default_rng([11, int(100 * spread_s)]), np.array([5.0, 12.0, 80.0, 84.0, 150.0, 200.0, 260.0, 340.0])
    times, bearings = [], []
    for turn in range(20):
        heard = np.flatnonzero(rng.random(8) < 0.95)
        times.append(3.0 * turn + 0.05 + spread_s * true[heard] / 360.0)
        bearings.append(true[heard] + rng.normal(0.0, 1.0, len(heard)))
    time_s, bearing_deg = np.concatenate(times), np.concatenate(bearings)
    cycles = np.floor(time_s / cycle_s).astype(int)
    said = [say(0, time_s[cycles == k], bearing_deg[cycles == k] % 360.0, -1) for k in range(int(60.0 / cycle_s))]
    memory, tracks = play(BearingWindow(), said, two_sensors(), cycle_s)
    found = np.sort(np.degrees(tracks.bearing_rad) % 360.0)
    assert len(found) == 8
    assert np.abs(found - true).max() < 3.0
    assert memory.hits.min() > 12
    assert (memory.turn_s[0] == pytest.approx(3.0, abs=0.3)) if spread_s else memory.turn_s[0] == 0.0


def test_a_fast_camera_that_sees_one_vessel_has_one_track() -> None:
    rng = np.random.default_rng([12, 1])
    said = [say(0, 1.0 * k + np.arange(0.05, 1.0, 0.1), 45.0 + rng.normal(0.0, 1.0, 10), -1) for k in range(20)]
    memory, tracks = play(BearingWindow(), said, two_sensors(), 1.0)
    assert (len(tracks), len(memory.track_id)) == (1, 1)
    assert memory.hits[0] == 200


@given(st.integers(0, 10**6), st.integers(0, 60))
def test_looks_are_what_their_rule_says(seed, count):
    rng = np.random.default_rng(seed)
    sensor = np.sort(rng.integers(0, 3, count))
    time_s = np.round(rng.uniform(0.0, 10.0, count), 1)
    order = np.lexsort((time_s, sensor))
    sensor, time_s, bearing = sensor[order], time_s[order], rng.uniform(-np.pi, np.pi, count)
    half, longest = np.array([0.05, 0.2, 1.0]), np.array([2.0, 4.0, 8.0])
    got = kernels.bearings.looks.looks_of(sensor, time_s, bearing, half, longest)
    for k in range(3):
        rows, look, begun_s, inside = np.flatnonzero(sensor == k), -1, -np.inf, list[float]()
        for when in np.unique(time_s[rows]):
            same = rows[time_s[rows] == when]
            cells = {int(np.floor(b * 720 / (2 * np.pi))) for b in bearing[same]}
            near = any(
                (c - i) % 720 <= r or (i - c) % 720 <= r
                for c in cells
                for i in inside
                for r in [np.ceil(half[k] * 720 / 2 / np.pi)]
            )
            if len(same) > 1 or not inside or near or when - begun_s >= longest[k]:
                look, begun_s, inside = look + 1, when, []
            inside = [] if len(same) > 1 else [*inside, *cells]
            assert (got[same] == look).all()


def test_fast_reports_share_slots_and_lose_no_precision() -> None:
    rng = np.random.default_rng([1, 3])
    sensors = two_sensors()
    method = BearingWindow(window_s=60.0, length=20, rate_length=20)
    times = np.arange(1, 480) / 8.0
    cycles = [say(0, t[: len(t)], 90.0 + rng.normal(0.0, 1.0, len(t)), 4) for t in np.array_split(times, 60)]
    memory, tracks = play(method, cycles, sensors, 1.0)
    assert np.isfinite(tracks.window_time_s[0]).sum() == 20
    assert tracks.window_time_s[0, -1] - tracks.window_time_s[0, 0] > 40.0
    sigma = np.sqrt(tracks.covariance[0, 0, 0])
    assert sigma < np.radians(0.15)  # 1 deg through some 350 reports: 2 / sqrt(350) = 0.11 deg at the end of the line
    assert abs(tracks.bearing_rad[0] - np.radians(90.0)) < 5.0 * sigma
    assert memory.weight[0].sum() > 300


def test_slots_of_a_moving_platform_across_the_antimeridian() -> None:
    sensors = two_sensors()
    sites = np.array([[0.0, 179.9999], [0.0, -179.9999]])
    reports = say(0, [1.0, 1.5], [10.0, 20.0], 3, sites)
    _, tracks = play(BearingWindow(), [reports], sensors)
    assert abs(abs(tracks.site_deg[0, 1]) - 180.0) < ROUNDING
    assert np.degrees(tracks.window_bearing_rad[0, -1]) == pytest.approx(15.0)


def test_own_tracks_keep_two_ships_apart_through_clutter_and_gaps() -> None:
    rng = np.random.default_rng([1, 4])
    sensors = bw.sensors_of(np.zeros((1, 2)), 2000.0, (0.0, 360.0), noise_deg=0.5)
    method = BearingWindow(window_s=10.0, length=40, drop_after_s=3.0)
    cycles = []
    for second in range(40):
        parts = []
        for t in second + np.arange(1, 9) / 8.0:
            truth = np.array([178.0 + 0.3 * t, 20.0 - 0.5 * t])
            seen = (truth + rng.normal(0.0, 0.5, 2))[rng.uniform(size=2) < 0.8]
            seen = np.concatenate([seen, rng.uniform(0.0, 360.0, 2)])
            parts.append(say(0, t, seen % 360.0, -1))
        cycles.append(BearingReports.join(parts))
    memory, ids = method.init(), []
    for second, reports in enumerate(cycles):
        memory, tracks = method.step(memory, BearingInput(reports, START + second + 1.0, sensors))
        if second >= 2:
            truth = np.array([178.0 + 0.3 * (second + 1), 20.0 - 0.5 * (second + 1)])
            off = np.abs(wrap_deg(np.degrees(tracks.bearing_rad)[:, None] - truth))
            assert (off.min(0) < 2.5).all()
            long_lived = tracks.started_s < START + 1.0
            ids.append(set(tracks.track_id[long_lived].tolist()))
    assert len(ids[-1]) == 2
    assert all(ids[-1] <= earlier for earlier in ids)


def test_own_tracks_need_their_hits_and_end_on_misses() -> None:
    sensors = two_sensors()
    method = BearingWindow(start_hits=3, start_looks=5, end_misses=4)
    steady = [say(0, 3.0 * k + 1.0, [40.0, 200.0], -1) for k in range(3)]
    assert len(play(method, steady[:2], sensors)[1]) == 0
    assert len(play(method, steady, sensors)[1]) == 2
    blind_one = [say(0, 3.0 * k + 1.0, [200.0], -1) for k in range(3, 7)]
    assert len(play(method, steady + blind_one[:3], sensors)[1]) == 2
    assert len(play(method, steady + blind_one, sensors)[1]) == 1
    flicker = [say(0, 3.0 * k + 1.0, [40.0] if k in (0, 4) else [200.0], -1) for k in range(8)]
    assert len(play(method, flicker, sensors)[1]) == 1


def test_nothing_at_all() -> None:
    none = bw.sensors_of(np.zeros((0, 2)), 1000.0, (0.0, 360.0))
    for sensors in (none, two_sensors()):
        _, tracks = play(BearingWindow(), [say(0, [], [], [])] * 3, sensors)
        assert len(tracks) == 0
        assert tracks.window_time_s.shape == (0, 100)


def test_wrong_input_is_named() -> None:
    with pytest.raises(ValueError, match=r"BearingReports\.sensor: got 2, needed 0 to 1"):
        play(BearingWindow(), [say(2, 1.0, 10.0, 3)], two_sensors())
    with pytest.raises(ValueError, match=r"BearingReports\.sensor: got -1, needed 0 to 1"):
        play(BearingWindow(), [say(-1, 1.0, 10.0, 3)], two_sensors())
    with pytest.raises(ValueError, match=r"BearingReports\.contact"):
        play(BearingWindow(), [say(0, 1.0, 10.0, 2**40)], two_sensors())
    with pytest.raises(ValidationError, match="length"):
        BearingWindow(length=1)


def test_classes_are_counted_by_contact() -> None:
    cycles = []
    for k, classes in enumerate(([2, -1], [2, 5], [0, -1])):
        reports = say(0, 3.0 * (k + 1), np.array([10.0, 90.0]), np.array([7, 8]))
        cycles.append(replace(reports, signature=np.array(classes)))
    _, tracks = play(BearingWindow(), cycles, two_sensors())
    assert tracks.signatures.tolist() == [[1, 0, 2, 0, 0, 0, 0], [0, 0, 0, 0, 0, 1, 0]]


def test_a_bearing_with_a_standard_deviation_of_its_own_counts_by_it() -> None:
    sensors = two_sensors()
    specified = float(np.degrees(sensors.sonars.bearing_sigma_rad[0]))
    first, second = say(0, 0.5, 40.0, 7), say(0, 1.0, 43.0, 7)  # one slot: its mean is weighted
    sure, unsure = (replace(r, bearing_sigma_deg=np.array([s * specified])) for r, s in ((first, 0.5), (second, 2.0)))
    (_, plain), (_, own) = (play(BearingWindow(), [BearingReports.join(r)], sensors) for r in ([first, second], [sure, unsure]))
    mean = [float(np.degrees(t.window_bearing_rad[0, -1])) for t in (plain, own)]
    np.testing.assert_allclose(mean, [41.5, 40.0 + 3.0 * 0.25 / (4.0 + 0.25)], atol=1e-9)
    variances = [t.window_variance[0, -1] / sensors.sonars.bearing_sigma_rad[0] ** 2 for t in (plain, own)]
    np.testing.assert_allclose(variances, [1.0, (4.0 + 0.25) / (4.0**2 + 0.25**2)])  # one over the weighted mean of the weights
    alone = [play(BearingWindow(), [r], sensors)[1].covariance[0, 0, 0] for r in (first, sure)]
    assert alone[1] < alone[0]
    numberless = [replace(say(0, 3.0 * k, 40.0, -1), bearing_sigma_deg=np.array([0.5 * specified])) for k in range(1, 5)]
    assert len(play(BearingWindow(), numberless, sensors)[1]) == 1


def test_the_bearings_of_a_cycle_are_one_measurement_that_counts_by_its_share_of_a_slot() -> None:
    """A slot has 3 s. Eight bearings in a second of it are a third of one bearing, however many they are."""
    sensors = two_sensors()
    times = np.arange(0.125, 1.01, 0.125)
    cycles = [say(0, times + k, 359.0 + 2.0 * times, 4) for k in range(2)]
    cycles[1] = say(0, times + 1.0, 3.0 + 4.0 * times, 4)
    _, tracks = play(BearingWindow(), cycles, sensors, 1.0)
    sigma_rad = sensors.sonars.bearing_sigma_rad[0]
    assert tracks.measured_s - START == pytest.approx([1.0 + times.mean()], abs=1e-6)
    assert np.degrees(tracks.measured_rad) == pytest.approx([3.0 + 4.0 * times.mean()])
    assert tracks.measured_variance == pytest.approx([3.0 * sigma_rad**2])
    np.testing.assert_array_equal(tracks.measured_site_deg, bw.ORIGIN_DEG[None])
    _, tracks = play(BearingWindow(), cycles[:1], sensors, 1.0)
    assert tracks.measured_variance[0] < sigma_rad**2  # the first bearing of all counts whole
    first = 1.0 / (1.0 + times[1:].size * 0.125 / 3.0)
    weights = np.append(first, np.full(7, first * 0.125 / 3.0))
    assert np.degrees(tracks.measured_rad) == pytest.approx([wrap_deg((weights * (359.0 + 2.0 * times)).sum())])


def test_a_track_without_a_bearing_in_the_cycle_has_no_measurement() -> None:
    sensors = two_sensors()
    _, tracks = play(BearingWindow(), [say(0, 3.0, 10.0, 4), say(0, [], [], [])], sensors)
    for column in (tracks.measured_s, tracks.measured_rad, tracks.measured_variance, tracks.measured_site_deg):
        assert np.isnan(column).all()
    assert len(tracks) == 1


@given(st.integers(0, 10**6), st.integers(0, 30), st.integers(0, 100), st.sampled_from([0.01, 0.5, 4.0]))
def test_pairs_near_in_bearing_are_those_of_brute_force_or_the_nearest_of_them(seed, tracks, count, wide):
    rng = np.random.default_rng([seed, 31])
    sensor, of = rng.integers(0, 3, tracks), np.sort(rng.integers(0, 3, count))
    reports = say(of, 0.0, rng.integers(0, 360, count) if seed % 2 else rng.uniform(0.0, 360.0, count), -1)
    middle, half = rng.uniform(-np.pi, np.pi, tracks), rng.uniform(0.0, wide, tracks)
    track, report = near_in_bearing(middle, half, sensor, reports)
    assert (np.diff(track * count + report) > 0).all()
    off = np.abs(wrap_rad(np.radians(reports.bearing_deg)[None] - middle[:, None]))
    for k in range(tracks):
        wanted = np.flatnonzero((off[k] <= half[k]) & (of == sensor[k]))
        got = report[track == k]
        assert (of[got] == sensor[k]).all()
        if len(wanted) <= MOST_GATED:
            assert set(wanted) <= set(got.tolist()) or len(got) == MOST_GATED
            assert (off[k][got] <= half[k] + 1e-5).all()
        else:
            assert np.sort(off[k][got]) == pytest.approx(np.sort(off[k][wanted])[:MOST_GATED], abs=1e-9)


@pytest.mark.parametrize(
    ("rate_hz", "period_s", "used"), [(5.0, 60.0, 300), (30.0, 3.0, 90), (30.0, 30.0, 900), (50.0, 3.0, 100)]
)
def test_one_target_is_one_track_at_any_rate_and_length_of_cycle(rate_hz: float, period_s: float, used: int) -> None:
    sensors, rng = bw.sensors_of(np.zeros((1, 2)), 7000.0, (0.0, 360.0)), np.random.default_rng([34, 0])
    count, cycles = round(rate_hz * period_s), []
    for k in range(4):
        stamp = period_s * k + (np.arange(count) + 1) / rate_hz
        cycles.append(say(0, stamp, 40.0 + 0.02 * stamp + rng.normal(0.0, 0.1, count), -1))
    memory, tracks = play(BearingWindow(), cycles, sensors, period_s)
    assert len(tracks) == 1
    assert memory.hits.max() >= 0.98 * 4 * used
    assert abs(memory.left_out - 4 * (count - used)) <= 0.01 * 4 * used


def test_of_more_looks_than_are_used_whole_looks_are_chosen() -> None:
    stamp = np.repeat(np.arange(300) / 101.0, 4)  # four bearings at each of 300 times in a second less than a share
    flood = say(0, stamp, np.tile([10.0, 100.0, 190.0, 280.0], 300), -1)
    quiet = say(1, np.repeat(np.arange(5) / 2.0, 3), np.tile([10.0, 100.0, 190.0], 5), -1)
    reports = BearingReports.join([flood, quiet])
    reports = reports.take(np.lexsort((reports.sensor, reports.time_s)))
    used = reports.take(used_of(reports))
    _, of_time = np.unique(used.time_s[used.sensor == 0], return_counts=True)
    assert of_time.tolist() == [4] * MOST_LOOKS
    assert (used.sensor == 1).sum() == 15
    sensors = two_sensors()
    memory, tracks = BearingWindow().step(BearingWindow().init(), BearingInput(reports, START + 3.0, sensors))
    assert memory.left_out == 4 * (300 - MOST_LOOKS)
    assert np.bincount(tracks.source - sensors.sonar_source(0)).tolist() == [4, 3]


@pytest.mark.parametrize(("times", "each", "contact", "most"), [(60, 100, -1, MOST_OWN), (900, 1, 3, MOST_NUMBERED)])
def test_of_very_many_bearings_an_even_choice_is_used_and_the_rest_is_counted(times, each, contact, most) -> None:
    sensors, method = two_sensors(), BearingWindow()
    stamp, bearing = np.repeat(np.linspace(0.0, 2.9, times), each), np.tile(np.linspace(0.0, 350.0, each), times)
    flood = say(0, stamp, bearing, contact)
    quiet = say(1, 1.0, 50.0, 3)
    together = BearingReports.join([flood, quiet])
    memory, tracks = method.step(method.init(), BearingInput(together, START + 3.0, sensors))
    assert len(stamp) == 3 * most
    assert memory.left_out == 2 * most
    assert (memory.contact == 3).sum() == 1 + (contact >= 0)
    assert len(tracks) == each + 1
    again = np.flatnonzero(np.unique(stamp, return_inverse=True)[1] % 3 == 0)
    memory, _ = method.step(memory, BearingInput(say(0, 3.0 + stamp[again], bearing[again], contact), START + 6.0, sensors))
    assert memory.left_out == 2 * most


@pytest.mark.parametrize("contact", [-1, 3])
def test_a_longer_cycle_takes_more_bearings_within_bounds(contact: int) -> None:
    most = MOST_LOOKS if contact < 0 else MOST_NUMBERED
    for span_s, shares in ((SHARE_S, 1.0), (4.5 * SHARE_S, 4.5), (MOST_SHARES * SHARE_S, MOST_SHARES), (1e9, MOST_SHARES)):
        stamp = np.linspace(0.0, span_s, int(1.5 * MOST_SHARES * most))
        reports = say(0, stamp, np.full(len(stamp), 20.0), contact)
        assert used_of(reports).sum() == pytest.approx(shares * most, abs=1)


def test_one_look_with_too_many_bearings_is_thinned() -> None:
    reports = say(0, 1.0, np.linspace(0.0, 359.0, 2 * MOST_OWN), -1)
    assert np.flatnonzero(used_of(reports)).tolist() == list(range(1, 2 * MOST_OWN, 2))


@given(st.integers(0, 10**6), st.integers(0, 40))
def test_looks_are_the_times_of_each_sensor_in_turn(seed: int, count: int) -> None:
    rng = np.random.default_rng([seed, 35])
    sensor, time_s = rng.integers(0, 3, count), np.sort(rng.integers(0, 9, count) / 3.0)
    reports = say(sensor, time_s, np.full(count, 20.0), -1)
    assert used_of(reports).all()
    looks = [rows.tolist() for rows in rounds(reports.sensor, reports.time_s)]
    times = [np.unique(time_s[sensor == k]) for k in range(3)]
    wanted = [
        [i for i in range(count) if r < len(times[sensor[i]]) and time_s[i] == times[sensor[i]][r]]
        for r in range(max(map(len, times), default=0))
    ]
    assert looks == wanted


@given(st.integers(0, 10**6), st.integers(0, 60))
def test_an_even_choice_takes_all_of_few_and_spreads_over_many(seed: int, count: int) -> None:
    key = np.random.default_rng([seed, 33]).integers(-3, 2, count)
    most = np.where(key < 0, 4, 7)
    chosen = _evenly(key, most)
    for k in np.unique(key):
        rows, limit = np.flatnonzero(key == k), 4 if k < 0 else 7
        got = np.flatnonzero(chosen[rows])
        assert len(got) == min(len(rows), limit)
        assert np.diff(got).max(initial=1) <= -(-len(rows) // limit)
