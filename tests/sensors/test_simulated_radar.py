"""What simulated radars report."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.stats import binom, kstest, poisson
from simulated_world import CENTRE_DEG, LEVEL, START_S, assert_unit_normal, recorded, sensors

from coastwatch.batches import Trajectories
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M, difference_m, offset_deg, to_plane, wrap_deg
from coastwatch.sensors.simulated.radar import Burst, RadarTruth, interpolated, observe
from coastwatch.sensors.simulated.trajectories import VesselMotion, draw_motion

pytestmark = pytest.mark.contract

BEAM_S = 1e-5  # the beam time is found by iteration to less than this
NEAR_M = 300.0  # nearer vessels move through the beam too fast for that
SPAN_S = 120.0
QUIET = RadarTruth(noise_factor=0.0)


def moving(count=40, seed=3, **motion):
    rng = np.random.default_rng([seed, 99])
    anchors = offset_deg(np.tile(CENTRE_DEG, (count, 1)), rng.uniform(-9000.0, 9000.0, (count, 2)))
    return draw_motion(VesselMotion(**motion), anchors, START_S, SPAN_S, seed)


def seen(truths, vessels=None, seed=5, place=None):
    vessels = vessels or moving()
    who = np.arange(len(vessels.anchor_deg))
    return observe((place or sensors()).radars, truths, vessels.position, who, START_S, START_S + SPAN_S, seed), vessels


def from_site(reports, vessels, rows=slice(None)):
    at = to_plane(vessels.position(reports.origin[rows], reports.time_s[rows]), reports.site_deg[rows])
    return np.hypot(at[:, 0], at[:, 1]), np.degrees(np.arctan2(at[:, 0], at[:, 1]))


def test_a_plot_is_where_the_vessel_was_when_the_beam_passed():
    reports, vessels = seen((QUIET, QUIET), moving(circular_weight=1.0, accelerated_weight=1.0))
    distance, azimuth = from_site(reports, vessels)
    far = distance > NEAR_M
    assert far.sum() > 500
    np.testing.assert_allclose(reports.range_m[far], distance[far], atol=1e-3)
    np.testing.assert_allclose(wrap_deg(reports.azimuth_deg - azimuth)[far], 0.0, atol=1e-5)
    period = sensors().radars.period_s[reports.sensor]
    phase = (reports.time_s - START_S) / period - reports.azimuth_deg / 360.0
    for r in (0, 1):
        turns = phase[far & (reports.sensor == r)]
        np.testing.assert_allclose((turns - turns[0] + 0.5) % 1.0 - 0.5, 0.0, atol=BEAM_S)


def test_every_vessel_in_range_is_hit_once_a_turn_also_when_it_crosses_north():
    site = sensors().radars.site_deg[0]
    start = offset_deg(np.tile(site, (2, 1)), np.array([[-30.0, 4000.0], [30.0, 4000.0]]))
    vessels = draw_motion(VesselMotion(process_noise="none", speed_from_kn=15.0), start, START_S, SPAN_S, 1)
    east = dataclasses.replace(vessels, velocity_m_s=np.array([[1.0, 0.0], [-1.0, 0.0]])[:, None] + 0 * vessels.velocity_m_s)
    reports, _ = seen((QUIET, QUIET), east)
    for vessel in (0, 1):
        times = np.sort(reports.time_s[(reports.origin == vessel) & (reports.sensor == 0)])
        np.testing.assert_allclose(np.diff(times), 4.0, atol=1e-3)
        assert len(times) == SPAN_S / 4.0


def test_noise_is_that_of_the_specification():
    reports, vessels = seen((RadarTruth(), RadarTruth(noise_factor=2.0)), moving(200))
    distance, azimuth = from_site(reports, vessels)
    factor = np.where(reports.sensor == 0, 1.0, 2.0)
    assert_unit_normal((reports.range_m - distance) / (10.0 * factor))
    assert_unit_normal(wrap_deg(reports.azimuth_deg - azimuth) / (0.3 * factor))


def test_detection_probability_and_range():
    reports, vessels = seen((QUIET, RadarTruth(noise_factor=0.0, detection_probability=0.8)), moving(200))
    every, _ = seen((QUIET, QUIET), vessels)
    assert (reports.range_m <= 6.0 * NAUTICAL_MILE_M).all()
    there, found = ((batch.sensor == 1).sum() for batch in (every, reports))
    low, high = binom.ppf([LEVEL / 2, 1 - LEVEL / 2], there, 0.8)
    assert low <= found <= high
    kept = np.isin(every.time_s, reports.time_s)
    np.testing.assert_array_equal(every.take(kept).range_m, reports.range_m)


def test_a_burst_adds_clutter_while_it_lasts_and_changes_nothing_else():
    calm, burst = RadarTruth(clutter_per_m2=1e-7), Burst(per_m2=2e-6, first_s=30.0, duration_s=10.0, every_s=50.0)
    reports, _ = seen((calm.model_copy(update={"burst": burst}), RadarTruth()))
    without, _ = seen((calm, RadarTruth()))
    added = ~np.isin(reports.range_m, without.range_m)
    assert len(reports) - added.sum() == len(without)
    phase_s, period_s = (reports.time_s[added] - START_S) % 50.0, float(sensors().radars.period_s[0])
    assert np.all((phase_s >= 30.0) & (phase_s < 40.0 + period_s))
    assert (phase_s < 40.0).any()
    mean = 2e-6 * np.pi * float(sensors().radars.range_m[0]) ** 2
    turns = added.sum() / mean
    assert abs(turns - 20.0 / period_s) < 2.0
    assert (reports.origin[added] == -1).all()


def test_clutter_is_poisson_and_even_over_the_disc():
    density, reach = 2e-7, 6.0 * NAUTICAL_MILE_M
    truth = RadarTruth(clutter_per_m2=density)
    reports, vessels = seen((truth, RadarTruth()))
    plain, _ = seen((RadarTruth(), RadarTruth()), vessels)
    clutter = reports.take(reports.origin == -1)
    low, high = poisson.ppf([LEVEL / 2, 1 - LEVEL / 2], density * np.pi * reach**2 * SPAN_S / 4.0)
    assert low <= len(clutter) <= high
    assert (clutter.sensor == 0).all()
    assert kstest((clutter.range_m / reach) ** 2, "uniform").pvalue > LEVEL
    assert kstest(clutter.azimuth_deg / 360.0, "uniform").pvalue > LEVEL
    np.testing.assert_array_equal(reports.take(reports.origin >= 0).range_m, plain.range_m)


def test_biases_and_latency():
    wrong = RadarTruth(range_bias_m=40.0, azimuth_bias_deg=0.5, time_bias_s=1.5, latency_s=0.7)
    reports, vessels = seen((wrong, wrong))
    plain, _ = seen((RadarTruth(), RadarTruth()), vessels)
    np.testing.assert_allclose(reports.received_s - reports.time_s, 0.7 - 1.5)
    np.testing.assert_allclose(np.sort(reports.time_s), np.sort(plain.time_s) + 1.5)
    assert np.mean(reports.range_m) - np.mean(plain.range_m) == pytest.approx(40.0, abs=1e-6)
    order, plain_order = np.lexsort((reports.time_s, reports.sensor)), np.lexsort((plain.time_s, plain.sensor))
    turned = wrap_deg(reports.azimuth_deg[order] - plain.azimuth_deg[plain_order])
    np.testing.assert_allclose(turned, 0.5, atol=1e-9)


def test_a_site_that_is_stated_wrong():
    """The stated site is 60 m east of the antenna: what the plots show is 60 m too far east."""
    wrong = RadarTruth(site_error_m=(60.0, 0.0))
    reports, vessels = seen((wrong, RadarTruth()))
    plain, _ = seen((RadarTruth(), RadarTruth()), vessels)
    mine, right = (r.take(np.lexsort((r.time_s, r.origin, r.sensor))) for r in (reports, plain))
    np.testing.assert_array_equal(mine.site_deg, right.site_deg)
    shown = [
        r.range_m[:, None] * np.column_stack([np.sin(np.radians(r.azimuth_deg)), np.cos(np.radians(r.azimuth_deg))])
        for r in (mine.take(mine.sensor == 0), right.take(right.sensor == 0))
    ]
    np.testing.assert_allclose(np.mean(shown[0], axis=0) - np.mean(shown[1], axis=0), [60.0, 0.0], atol=3.0)


def test_switched_on_and_off():
    reports, _ = seen((RadarTruth(start_s=30.0, stop_s=60.0, clutter_per_m2=1e-7), RadarTruth()))
    west = reports.time_s[reports.sensor == 0] - START_S
    assert west.min() >= 30.0
    assert west.max() <= 60.0
    assert (reports.time_s[reports.sensor == 1] - START_S).min() < 1.0


def test_one_that_is_never_on_has_no_plots_and_one_that_stops_before_it_starts_is_refused():
    for never in (RadarTruth(start_s=50.0, stop_s=50.0), RadarTruth(start_s=1e6)):
        reports, _ = seen((never, RadarTruth()))
        assert (reports.sensor == 1).all()
    with pytest.raises(ValueError, match=r"stop_s: got 20.0, needed start_s = 50.0 or more"):
        RadarTruth(start_s=50.0, stop_s=20.0)


def test_a_moving_platform_says_where_it_was():
    moving = RadarTruth(noise_factor=0.0, course_deg=90.0, speed_kn=20.0)
    reports, vessels = seen((moving, QUIET))
    own = reports.take(reports.sensor == 0)
    gone = difference_m(own.site_deg, sensors().radars.site_deg[0])
    np.testing.assert_allclose(gone[:, 0], (own.time_s - START_S) * 20.0 * KNOT_M_S, atol=0.1)
    np.testing.assert_allclose(own.range_m, from_site(own, vessels)[0], atol=0.01)


def test_order_and_span():
    reports, _ = seen((RadarTruth(), RadarTruth()))
    assert (np.diff(reports.received_s) >= 0.0).all()
    assert reports.time_s.min() >= START_S
    assert reports.time_s.max() <= START_S + SPAN_S


def test_absent_vessels_give_no_echo():
    vessels = moving(40)
    entering = dataclasses.replace(vessels, appear_s=np.full(40, 50.0), disappear_s=np.full(40, 80.0))
    reports, _ = seen((RadarTruth(), RadarTruth()), entering)
    assert len(reports) > 100
    assert (reports.time_s - START_S).min() >= 50.0
    assert (reports.time_s - START_S).max() < 80.0


def test_sampled_trajectories_serve_as_well():
    vessels = moving(20, process_noise="none")
    sampled = vessels.sampled(START_S + np.arange(-10.0, SPAN_S + 10.0, 1.0))
    always = dataclasses.replace(sampled, present=np.ones_like(sampled.present))
    who = np.arange(20)
    a = observe(sensors().radars, (QUIET, QUIET), interpolated(always), who, START_S, START_S + SPAN_S, 5)
    b, _ = seen((QUIET, QUIET), vessels)
    assert len(a) == len(b)
    np.testing.assert_allclose(a.range_m, b.range_m, atol=0.02)


def test_along_is_absent_between_samples_of_which_one_is():
    one = np.zeros((1, 3, 2))
    one[0, :, 1] = [179.0, -180.0, -179.0]
    path = Trajectories(
        vessel=np.zeros(1, np.int64),
        time_s=np.array([0.0, 10.0, 20.0]),
        position_deg=one,
        velocity_m_s=np.zeros((1, 3, 2)),
        present=np.array([[True, True, False]]),
        kick_s=np.zeros((1, 0)),
        kick_m_s=np.zeros(1),
        turn_rate_rad_s=np.zeros(1),
        acceleration_m_s2=np.zeros((1, 2)),
    )
    got = interpolated(path)(np.zeros(4, np.int64), np.array([5.0, 15.0, -1.0, 21.0]))
    np.testing.assert_allclose(got[0], [0.0, 179.5])
    assert np.isnan(got[1:]).all()


def test_no_vessel_no_radar():
    assert len(recorded(count=0).reports) == 0
    nothing = sensors()
    nothing = dataclasses.replace(nothing, radars=nothing.radars.take(slice(0, 0)))
    assert len(recorded(count=3, where=nothing).reports.radar) == 0


def test_named_radars_differ_and_unknown_names_are_refused():
    made = recorded(radars=[{"name": "east", "stop_s": 0.0}])
    assert (made.reports.radar.sensor == 0).all()
    with pytest.raises(ValueError, match=r"input\.radars: got the names \['north'\]"):
        recorded(radars=[{"name": "north"}])
    with pytest.raises(ValidationError, match="detection_probability"):
        recorded(radar={"detection_probability": 1.2})
