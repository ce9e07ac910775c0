"""How simulated vessels truly move."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.stats import kstest
from simulated_world import CENTRE_DEG, LEVEL, START_S, assert_unit_normal, recorded, sensors, simulated

from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M, difference_m
from coastwatch.sensors.simulated.trajectories import KICK_SHARE, VesselMotion, draw_motion
from coastwatch.stage import Plan

pytestmark = pytest.mark.contract

SPAN_S = 600.0
QUOTIENT_M_S = 1e-3  # error of a difference quotient over a tenth of a second
CONVERGENCE_M_S = 4e-3  # north turns by 3e-4 rad over 5 km at 23 degrees south, times the speed


def sailing(count=300, seed=2, span_s=SPAN_S, **motion):
    return draw_motion(VesselMotion(**motion), np.tile(CENTRE_DEG, (count, 1)), START_S, span_s, seed)


def states(sailed, elapsed_s):
    who = np.arange(len(sailed.anchor_deg))
    return sailed.state(who, np.full(len(who), START_S + elapsed_s))


def speed(velocity):
    return np.hypot(velocity[:, 0], velocity[:, 1]) / KNOT_M_S


@pytest.mark.parametrize(
    "motion",
    [
        {},
        {"circular_weight": 1.0, "linear_weight": 0.0},
        {"accelerated_weight": 1.0, "linear_weight": 0.0},
        {"process_noise": "ou", "circular_weight": 1.0},
        {"stopping_share": 1.0},
    ],
)
def test_velocity_is_the_derivative_of_position(motion):
    sailed = sailing(process_noise_fraction=0.3, **motion)
    for elapsed in (17.0, 433.0):
        (before, _), (after, _), (_, velocity) = (states(sailed, elapsed + d) for d in (-0.05, 0.05, 0.0))
        breaks = np.abs(sailed.break_s - elapsed).min(axis=1) < 0.06
        off = difference_m(after, before) / 0.1 - velocity
        assert breaks.mean() < 0.05
        np.testing.assert_allclose(off[~breaks], 0.0, atol=QUOTIENT_M_S)


def test_without_noise_vessels_go_straight_at_uniform_speeds():
    sailed = sailing(process_noise="none", speed_from_kn=5.0)
    (start, first), (end, last) = states(sailed, 0.0), states(sailed, SPAN_S)
    np.testing.assert_allclose(first, last, atol=CONVERGENCE_M_S)
    np.testing.assert_allclose(difference_m(end, start), SPAN_S * first, atol=CONVERGENCE_M_S * SPAN_S)
    assert kstest((speed(first) - 5.0) / 10.0, "uniform").pvalue > LEVEL
    assert kstest((np.arctan2(*first.T) + np.pi) / (2 * np.pi), "uniform").pvalue > LEVEL


def test_kinds_of_motion_have_their_shares():
    sailed = sailing(200, linear_weight=1.0, circular_weight=2.0, accelerated_weight=1.0)
    turning = sailed.turn_rate_rad_s[:, 0]
    gaining = np.hypot(*sailed.acceleration_m_s2[:, 0].T)
    assert ((turning == 0) & (gaining == 0)).sum() == 50
    assert (turning != 0).sum() == 100
    assert (gaining > 0).sum() == 50
    assert 20 < (turning > 0).sum() < 80
    rates = np.degrees(np.abs(turning[turning != 0]))
    assert rates.min() >= 0.2
    assert rates.max() <= 0.8


def test_circles_close():
    sailed = sailing(50, process_noise="none", linear_weight=0.0, circular_weight=1.0)
    period = 2 * np.pi / np.abs(sailed.turn_rate_rad_s[:, 0])
    who = np.arange(50)
    back, _ = sailed.state(who, START_S + period)
    start, velocity = states(sailed, 0.0)
    across, _ = sailed.state(who, START_S + period / 2)
    np.testing.assert_allclose(difference_m(back, start), 0.0, atol=1e-4)
    diameter = np.hypot(*difference_m(across, start).T)
    np.testing.assert_allclose(diameter, 2 * np.hypot(*velocity.T) * period / (2 * np.pi), rtol=1e-4)


def test_accelerated_vessels_keep_to_the_range_of_speeds():
    sailed = sailing(process_noise="none", linear_weight=0.0, accelerated_weight=1.0, speed_from_kn=2.0)
    first, last = (speed(states(sailed, t)[1]) for t in (0.0, SPAN_S))
    assert last.min() > 2.0 - 1e-3
    assert last.max() < 15.0 + 1e-3
    assert (np.abs(last - first) > 0.1).mean() > 0.9


@pytest.mark.parametrize(("model", "interval_s"), [("rw60", 60.0), ("rw1", 1.0)])
def test_random_walks_take_normal_steps_at_their_interval(model, interval_s):
    sailed = sailing(100, span_s=300.0, process_noise=model, process_noise_fraction=0.2)
    np.testing.assert_allclose(np.diff(sailed.kick_s, axis=1)[:, 0], interval_s)
    sigma = KICK_SHARE[model] * 0.2 * 15.0 * KNOT_M_S
    np.testing.assert_allclose(sailed.kick_m_s, sigma)
    steps = np.diff(sailed.velocity_m_s, axis=1)[np.isfinite(sailed.break_s[:, 1:])]
    assert_unit_normal(steps / sigma)
    assert kstest(sailed.kick_s[:, 0] / interval_s, "uniform").pvalue > LEVEL


def test_a_literal_share_can_be_set():
    assert VesselMotion(process_noise="rw1", velocity_jump_share=1.0).kick_m_s == pytest.approx(1.5 * KNOT_M_S)


def test_bounded_perturbations_stay_bounded():
    sailed = sailing(400, span_s=3000.0, process_noise="ou", process_noise_fraction=0.2)
    deviation = sailed.velocity_m_s[:, -3] - sailed.velocity_m_s[:, 0]
    assert_unit_normal(deviation / (KICK_SHARE["ou"] * 0.2 * 15.0 * KNOT_M_S))


def test_stopping_vessels_stand_and_say_that_no_model_knows_them():
    sailed = sailing(50, stopping_share=0.4, span_s=300.0)
    stops = np.isnan(sailed.kick_m_s)
    assert stops.sum() == 20
    (_, late), (_, later) = states(sailed, 360.1), states(sailed, 2000.0)
    np.testing.assert_array_equal(late[stops], 0.0)
    np.testing.assert_array_equal(later[stops], 0.0)
    assert (speed(late)[~stops] > 0.0).all()


def test_vessels_enter_and_leave():
    truth = recorded(100, motion={"entering_share": 0.3, "leaving_share": 0.2}).truth
    assert (~truth.present[:, 0]).sum() == 30
    gone = truth.present.any(axis=1) & ~truth.present[:, -1]
    assert 0 < gone.sum() <= 20
    assert len(truth.at(START_S)) == 70


def test_the_same_seed_gives_the_same_and_another_another():
    one, same, other = (recorded(seed=seed) for seed in (4, 4, 5))
    for part in ("radar", "ais", "statics", "bearing"):
        a, b = getattr(one.reports, part), getattr(same.reports, part)
        for f in dataclasses.fields(a):
            np.testing.assert_array_equal(getattr(a, f.name), getattr(b, f.name))
    assert not np.allclose(one.truth.position_deg, other.truth.position_deg)


def test_sensors_settings_move_no_vessel():
    plain = recorded().truth
    changed = recorded(radar={"clutter_per_m2": 1e-6, "detection_probability": 0.5}, ais={"share": 0.9, "loss": 0.3}).truth
    np.testing.assert_array_equal(plain.position_deg, changed.position_deg)
    ais = recorded().reports.ais
    np.testing.assert_array_equal(ais.position_deg, recorded(radar={"clutter_per_m2": 1e-6}).reports.ais.position_deg)


def test_vessels_start_evenly_over_the_area():
    truth = recorded(2000, cycles=1, area_width_nm=20.0, area_height_nm=5.0).truth
    metres = difference_m(truth.position_deg[:, 0], CENTRE_DEG) / NAUTICAL_MILE_M
    for axis, size in ((0, 20.0), (1, 5.0)):
        assert kstest(metres[:, axis] / size + 0.5, "uniform").pvalue > LEVEL


def test_the_truth_stands_at_the_instants_of_the_plan():
    plan = Plan(start_s=START_S, period_s=2.5, cycles=7)
    truth = simulated(5).load(sensors(), 1, plan).truth
    np.testing.assert_array_equal(truth.time_s, [START_S, *(plan.instant_s(c) for c in range(7))])


def test_an_area_across_the_antimeridian_and_far_north():
    made = simulated(50).model_copy(update={"area_latitude_deg": 80.0, "area_longitude_deg": 180.0})
    truth = made.load(sensors(), 1, Plan(start_s=START_S, period_s=3.0, cycles=5)).truth
    lon = truth.position_deg[..., 1]
    assert (np.abs(lon) <= 180.0).all()
    assert lon.min() < -179.0
    assert lon.max() > 179.0


def test_vessels_start_on_the_water_where_there_is_a_shore():
    lat, lon = CENTRE_DEG
    corners = [(lat - 0.06, lon - 0.06), (lat + 0.06, lon - 0.06), (lat - 0.06, lon + 0.06)]  # south-west of the diagonal
    truth = recorded(400, cycles=1, water_deg=corners).truth
    north, east = (truth.position_deg[:, 0] - CENTRE_DEG).T
    assert len(truth.vessel) == 400
    assert (np.minimum(north, east) >= -0.06).all()
    assert (north + east <= 0.0).all()
    with pytest.raises(ValueError, match=r"input\.water_deg"):
        recorded(20, water_deg=[(10.0, 10.0), (10.0, 11.0), (11.0, 11.0)])


@pytest.mark.parametrize(
    ("settings", "what"),
    [
        ({"motion": {"speed_from_kn": 20.0}}, "speed_from_kn: got 20.0"),
        ({"motion": {"linear_weight": 0.0}}, "needed one above 0"),
        ({"motion": {"process_noise": "rw2"}}, "process_noise"),
        ({"count": -1}, "count"),
        ({"knots": 3}, "knots"),
    ],
)
def test_wrong_settings_are_refused_by_name(settings, what):
    with pytest.raises(ValidationError, match=what):
        simulated(**{"count": 5, **settings})


def test_the_first_vessels_start_where_they_are_put_and_the_others_as_before():
    places = ((-23.01, -43.12), (-22.99, -43.08))
    plain, put = recorded(10).truth, recorded(10, places_deg=places).truth
    np.testing.assert_allclose(put.position_deg[:2, 0], places, rtol=0.0, atol=1e-12)  # to a plane and back
    np.testing.assert_array_equal(put.position_deg[2:], plain.position_deg[2:])
    with pytest.raises(ValueError, match="places_deg: got 2 places, needed at most input"):
        recorded(1, places_deg=places)
