"""The filter of plots and reports: fed with measurements, when it goes on, when it begins again, and what it does without."""

import numpy as np
import pytest

from coastwatch.batches import AisAlarms, Associations, Measurements, Tracks
from coastwatch.fused_tracks import CentralImm, CovarianceIntersection, FusionInput
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.server.checkpoint import load, save

pytestmark = pytest.mark.contract

KINDS = np.array([0, 0, 1], np.int64)  # two regions of radars, AIS
PERIOD_S = 3.0
HOME = np.array([58.0, 179.99])
SITE = offset_deg(HOME, np.array([-6000.0, 0.0]))
VELOCITY = np.array([3.0, 4.0])
PLOT_M, REPORT_M, REPORT_M_S = 20.0, 3.33, 0.1
CYCLES = 25
VESSELS = 12
ROUNDING_M = 1e-6


def truth_deg(vessel, time_s):
    start = offset_deg(HOME, 3000.0 * np.asarray(vessel)[:, None] * np.array([0.0, 1.0]))
    return offset_deg(start, np.asarray(time_s)[:, None] * VELOCITY)


def tracks_of(vessel, source, time_s, updated_s=None, off_m=0.0, generation=0):
    """Tracks that are `off_m` to the east of the truth and know their velocity to 0.3 m/s."""
    vessel, source = np.asarray(vessel), np.asarray(source)
    n, ids = len(vessel), 10_000 * np.asarray(source) + np.asarray(vessel) + 1000 * generation
    sigma = np.where(source == 2, 3.0, 15.0)
    covariance = np.zeros((n, 4, 4))
    covariance[:, [0, 1], [0, 1]], covariance[:, [2, 3], [2, 3]] = sigma[:, None] ** 2, 0.3**2
    place = offset_deg(truth_deg(vessel, np.full(n, time_s)), np.column_stack([np.broadcast_to(off_m, n), np.zeros(n)]))
    updated = np.full(n, time_s if updated_s is None else updated_s)
    report = np.tile(np.eye(2) * 100.0, (n, 1, 1))
    mmsi = np.where(source == 2, ids, -1)
    velocity = np.tile(VELOCITY, (n, 1))
    return Tracks(
        ids, source, np.full(n, time_s), place, velocity, covariance, report, updated, np.zeros(n), mmsi, vessel.copy()
    )


def measured(tracks, time_s, rng, bias_m=0.0):
    """One plot or report of each track at these times (N,), with noise as large as it says."""
    n, ais = len(tracks), tracks.source == 2
    sigma = np.where(ais, REPORT_M, PLOT_M)
    noise = rng.normal(size=(n, 2)) * sigma[:, None]
    noise[~ais, 0] += bias_m
    covariance = np.full((n, 4, 4), np.nan)
    covariance[:, :2, :2] = (sigma**2)[:, None, None] * np.eye(2)
    covariance[ais, 2:], covariance[ais, :, 2:] = 0.0, 0.0
    covariance[ais, 0, 1] = covariance[ais, 1, 0] = 0.0
    covariance[ais, [[0], [1], [2], [3]], [[0], [1], [2], [3]]] = np.array([[REPORT_M**2] * 2 + [REPORT_M_S**2] * 2]).T
    velocity = np.where(ais[:, None], VELOCITY + rng.normal(size=(n, 2)) * REPORT_M_S, np.nan)
    site = np.where(ais[:, None], np.nan, SITE)
    place = offset_deg(truth_deg(tracks.origin, time_s), noise)
    order = np.lexsort((time_s, tracks.track_id))
    made = Measurements(tracks.track_id, np.where(ais, -1, tracks.source), time_s, place, velocity, covariance, site)
    return made.take(order)


def associated(vessel):
    none = np.zeros(0, np.int64)
    return Associations(none, none, np.zeros(0), np.asarray(vessel))


def world(seed=0, late_s=0.0, bias_m=0.0):
    """Cycles of (tracks, measurements, vessel, time): a radar and an AIS track of each vessel, measured once a cycle."""
    rng = np.random.default_rng([seed, 23])
    vessel, source = np.repeat(np.arange(VESSELS), 2), np.tile([0, 2], VESSELS)
    for cycle in range(CYCLES):
        time_s = PERIOD_S * cycle
        at = time_s - rng.uniform(0.2, 2.8, len(vessel)) - np.where(source == 2, late_s, 0.0)
        tracks = tracks_of(vessel, source, time_s, time_s - 0.1)
        tracks.updated_s[:] = np.maximum(at, time_s - PERIOD_S)
        yield tracks, measured(tracks, at, rng, bias_m), vessel, time_s


def rmse(fused, time_s):
    off = difference_m(fused.position_deg, truth_deg(np.arange(len(fused)), np.full(len(fused), time_s)))
    return float(np.sqrt((off**2).sum(axis=1).mean()))


BY_FILTER = CentralImm(ais_doubt=1e12)  # a vessel is reported by its filter, whatever its AIS track says
TRUSTING = CentralImm(plot_doubt=1e12)  # takes each plot at its stated noise


def run(method, cycles):
    memory, fused, time_s = method.init(), None, 0.0
    for tracks, measurements, vessel, time_s in cycles:
        memory, fused = method.step(memory, FusionInput(tracks, measurements, associated(vessel), time_s, KINDS))
    return memory, fused, time_s


def test_it_is_the_measurements_that_count_not_the_tracks():
    cycles = [(tracks_of(v, t.source, s, off_m=9.0), m, v, s) for t, m, v, s in world()]
    for (t, *_), (u, *_) in zip(cycles, world(), strict=True):
        t.updated_s[:] = u.updated_s
    _, fused, time_s = run(BY_FILTER, cycles)
    assert rmse(fused, time_s) < 3.0  # of 25 reports of 3.33 m an axis; the tracks are 9 m off


@pytest.mark.parametrize("bias_m", [0.0, 30.0, 100.0])
def test_plots_of_a_neighbour_make_no_vessel_worse_than_its_ais(bias_m, monkeypatch):
    """AIS reports each 24 s, and AIS tracks that err as they state, by 5 m an axis."""
    rng, cycles, reported_s = np.random.default_rng([3, 23]), [], np.zeros(VESSELS)
    for number, (tracks, m, vessel, time_s) in enumerate(world(bias_m=bias_m)):
        ais = np.flatnonzero(tracks.source == 2)
        tracks.position_deg[ais] = offset_deg(tracks.position_deg[ais], rng.normal(0.0, 5.0, (VESSELS, 2)))
        tracks.covariance[ais, :2, :2] = 25.0 * np.eye(2)
        if number % 8 == 0:
            reported_s = tracks.updated_s[ais].copy()
        tracks.updated_s[ais] = reported_s
        cycles.append((tracks, m if number % 8 == 0 else m.take(m.sensor >= 0), vessel, time_s))
    of_ais = cycles[-2][0].take(np.flatnonzero(cycles[-2][0].source == 2))
    _, fused, time_s = run(CentralImm(), cycles[:-1])  # up to 21 s after the last report
    assert rmse(fused, time_s) < 1.25 * rmse(of_ais, time_s)
    monkeypatch.setattr(CentralImm, "_leave_to_ais", lambda *_: None)
    _, trusting, _ = run(TRUSTING, cycles[:-1])
    assert (rmse(trusting, time_s) > 2.0 * rmse(of_ais, time_s)) == (bias_m == 100.0)


def test_an_ais_track_that_is_too_sure_does_not_take_the_place_of_the_filter():
    """Its model is too quiet: it errs by 5 m an axis, and states 1 m. All vessels were reported as it."""
    rng, cycles = np.random.default_rng([3, 29]), []
    for tracks, m, vessel, time_s in world():
        ais = np.flatnonzero(tracks.source == 2)
        tracks.position_deg[ais] = offset_deg(tracks.position_deg[ais], rng.normal(0.0, 5.0, (VESSELS, 2)))
        tracks.covariance[ais, :2, :2] = np.eye(2)
        cycles.append((tracks, m, vessel, time_s))
    _, fused, time_s = run(CentralImm(), cycles)
    assert rmse(fused, time_s) < 4.0


def test_a_filter_that_is_not_finite_leaves_the_vessel_to_its_ais():
    cycles = list(world())
    memory, _, _ = run(CentralImm(), cycles[:-1])
    memory.covariance[0] = np.nan
    tracks, m, vessel, time_s = cycles[-1]
    _, fused = CentralImm().step(memory, FusionInput(tracks, m, associated(vessel), time_s, KINDS))
    assert np.isfinite(fused.covariance).all()
    assert rmse(fused, time_s) < 3.0


def test_measurements_and_tracks_may_come_in_any_order_and_memory_is_plain_and_never_written_to():
    method, rng = CentralImm(), np.random.default_rng([1, 24])
    memory, other = method.init(), method.init()
    for tracks, measurements, vessel, time_s in world(late_s=2.0):
        before = save(memory)
        again, same = method.step(load(before), FusionInput(tracks, measurements, associated(vessel), time_s, KINDS))
        after, fused = method.step(memory, FusionInput(tracks, measurements, associated(vessel), time_s, KINDS))
        assert save(memory) == before
        assert save(again) == save(after)
        np.testing.assert_array_equal(same.position_deg, fused.position_deg)
        rows, lines = rng.permutation(len(tracks)), rng.permutation(len(measurements))
        relabel = rng.permutation(VESSELS)
        shuffled = tracks.take(rows), measurements.take(lines), associated(relabel[vessel[rows]])
        other, moved = method.step(other, FusionInput(*shuffled, time_s, KINDS))
        back = moved.take(relabel)
        assert np.abs(difference_m(back.position_deg, fused.position_deg)).max() < ROUNDING_M
        np.testing.assert_allclose(back.covariance, fused.covariance, rtol=1e-9, atol=1e-12)
        memory = after


def test_a_vessel_that_was_joined_with_a_stranger_begins_again():
    cycles = list(world())
    crossed = np.arange(2 * VESSELS) // 2
    crossed[[1, 3]] = [1, 0]  # the AIS of the first two vessels the wrong way round
    memory, _, _ = run(CentralImm(), [(t, m, crossed, s) for t, m, _, s in cycles[:-1]])
    t, m, vessel, s = cycles[-1]
    _, fused = CentralImm().step(memory, FusionInput(t, m, associated(vessel), s, KINDS))
    _, plain = CovarianceIntersection().step(None, FusionInput(t, m, associated(vessel), s, KINDS))
    off = np.hypot(*difference_m(fused.position_deg, plain.position_deg).T)
    assert (off[:2] < ROUNDING_M).all()
    assert (off[2:] > 0.01).all()  # the others went on
    np.testing.assert_allclose(fused.covariance[:2], plain.covariance[:2])


def test_a_vessel_whose_pair_is_broken_is_its_tracks_again():
    cycles = list(world())
    memory, _, _ = run(CentralImm(), cycles[:-1])
    t, m, vessel, s = cycles[-1]
    apart = vessel.copy()
    apart[1] = VESSELS  # the first AIS track on its own
    _, fused = CentralImm().step(memory, FusionInput(t, m, associated(apart), s, KINDS))
    for row, track in ((0, 0), (VESSELS, 1)):
        assert np.abs(difference_m(fused.position_deg[row], t.position_deg[track])).max() < ROUNDING_M
        np.testing.assert_array_equal(fused.covariance[row], t.covariance[track])


@pytest.mark.parametrize("ended", [0, 2], ids=["radar", "ais"])
def test_when_a_track_ends_the_filter_goes_on_and_is_shown_where_plots_feed_it(ended):
    cycles = list(world())
    memory, before, time_s = run(BY_FILTER, cycles[:-1])
    t, m, _, s = cycles[-1]
    left = np.flatnonzero(t.source != ended)
    rest = t.take(left)
    memory, fused = BY_FILTER.step(memory, FusionInput(rest, m, associated(np.arange(VESSELS)), s, KINDS))
    is_track = np.abs(difference_m(fused.position_deg, rest.position_deg)).max(axis=1) < ROUNDING_M
    assert is_track.all() == (ended == 0)
    assert is_track.any() == (ended == 0)
    if ended == 2:
        assert rmse(fused, s) < 1.5 * rmse(before, time_s)
    new = tracks_of(np.arange(VESSELS), np.full(VESSELS, ended), s + PERIOD_S, s + PERIOD_S, off_m=50.0, generation=1)
    both = Tracks.join([tracks_of(rest.origin, rest.source, s + PERIOD_S, s - 1.0), new])
    nothing, vessel = Measurements.empty(), np.tile(np.arange(VESSELS), 2)
    both.updated_s[:] = s - 3.0
    _, fused = BY_FILTER.step(memory, FusionInput(both, nothing, associated(vessel), s + PERIOD_S, KINDS))
    assert rmse(fused, s + PERIOD_S) < 4.0  # a new partner adds what it hears from now on: its 50 m error is not taken over


def test_tracks_without_measurements_are_intersected():
    """Black-box sources yield tracks only: a filter that hears nothing while its tracks are updated would starve."""
    cycles = [(t, Measurements.empty(), v, s) for t, _, v, s in world()]
    for t, *_, s in cycles:
        t.updated_s[:] = s - 0.5
    _, fused, _ = run(CentralImm(), cycles)
    _, plain, _ = run(CovarianceIntersection(), cycles)
    np.testing.assert_array_equal(fused.position_deg, plain.position_deg)
    np.testing.assert_array_equal(fused.covariance, plain.covariance)


def test_late_reports_cost_little():
    """Forty metres a report too far back would show: vessels go 5 m/s and reports are up to 8 s old."""
    prompt, late = (np.mean([rmse(*run(CentralImm(), world(k, late_s=x))[1:]) for k in range(3)]) for x in (0.0, 5.0))
    assert late < 1.3 * prompt


def test_a_radar_that_is_off_pulls_little_where_ais_is_there():
    """Every plot is 20 m too far east, which is one standard deviation."""
    plain, doubting = (CentralImm(range_registration=share, azimuth_registration=share) for share in (0.0, 3.0))
    pulled, held = (run(method, world(2, bias_m=20.0)) for method in (plain, doubting))
    assert rmse(held[1], held[2]) < rmse(pulled[1], pulled[2])
    without = run(plain, world(2))
    same = run(doubting, world(2))
    assert rmse(same[1], same[2]) < 1.2 * rmse(without[1], without[2])


def kicked(jump_m_s, vessels, alarm=False, order=None):
    """The method and its memory after two minutes of AIS and radar in which each vessel jumps once a minute.

    Args: order: (vessels,) in which they are given.
    """
    rng, method = np.random.default_rng([5, 29]), CentralImm()
    memory, vessel, source = method.init(), np.repeat(np.arange(vessels), 2), np.tile([0, 2], vessels)
    velocity, place = np.tile(VELOCITY, (vessels, 1)), truth_deg(np.arange(vessels), np.zeros(vessels))
    rows = ((np.arange(vessels) if order is None else order)[:, None] * 2 + [0, 1]).ravel()
    for cycle in range(40):
        velocity = velocity + (rng.random((vessels, 1)) < 0.05) * rng.normal(0.0, jump_m_s, (vessels, 2))
        place, now = offset_deg(place, PERIOD_S * velocity), PERIOD_S * cycle
        tracks = tracks_of(vessel, source, now, now)
        tracks.position_deg[:] = place[vessel]
        m = measured(tracks, np.full(len(tracks), now), rng)
        of, ais = m.track_id % 10_000, m.sensor < 0
        off = difference_m(m.position_deg, truth_deg(of, np.full(len(of), now)))
        m.position_deg[:] = offset_deg(place[of], off)
        m.velocity_m_s[ais] += velocity[of[ais]] - VELOCITY
        no = np.zeros(vessels, np.bool_)
        alarms = AisAlarms(tracks.track_id[source == 2], np.arange(vessels), no, no | alarm)
        given = FusionInput(tracks.take(rows), m, associated(vessel), now, KINDS, alarms=alarms)
        memory, _ = method.step(memory, given)
    return method, memory


def test_the_size_of_jumps_is_learnt_from_many_vessels_with_ais_and_hardly_from_few():
    prior_m_s = CentralImm().velocity_jump_m_s
    method, memory = kicked(0.8, 30)
    assert method.learnt_motion(memory.evidence)[0] == pytest.approx(0.8, rel=0.3)
    method, memory = kicked(0.15, 30)
    assert method.learnt_motion(memory.evidence)[0] < 1.2 * prior_m_s
    method, memory = kicked(0.8, 30, alarm=True)
    assert method.learnt_motion(memory.evidence)[0] < 1.2 * prior_m_s


def test_what_is_learnt_is_the_same_to_the_bit_in_every_order_of_vessels():
    order = np.random.default_rng(3).permutation(12)
    (_, one), (_, other) = kicked(0.5, 12), kicked(0.5, 12, order=order)
    assert one.evidence.any()
    np.testing.assert_array_equal(one.evidence, other.evidence)
