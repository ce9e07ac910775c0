"""The feed of vessels with fixed start states does what its settings say."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from coastwatch.geodesy import KNOT_M_S, difference_m, to_plane
from coastwatch.scenario import load_scenario
from coastwatch.sensors.simulated.start_states import paths

pytestmark = pytest.mark.contract

CHANCE = 1e-6
CHI2_2 = 2.0  # mean of a squared error of two axes, in sigmas


def recorded(seed, **settings):
    scenario = load_scenario("liland-tracking", {f"input.{name}": str(value) for name, value in settings.items()})
    return scenario.input.load(scenario.sensors(), seed, scenario.plan()), scenario


@pytest.mark.golden
def test_the_paths_are_those_of_the_program_and_other_seeds_give_others():
    """The last states of vessels 0, 4 and 14 as a retyped generator of the program drew them."""
    path = paths(5447)
    assert path.shape == (16, 241, 4)
    assert path[0, -1] == pytest.approx([-2479.030877, 3312.484852, 9.102449, 11.559838], abs=1e-5)
    assert path[4, -1] == pytest.approx([-735.815722, -681.638177, 23.554345, -14.230371], abs=1e-5)
    assert path[14, -1] == pytest.approx([1258.051775, 90.841965, 11.660835, -3.232216], abs=1e-5)
    assert np.allclose(paths(1)[:, 0], path[:, 0])
    assert not np.allclose(paths(1)[:, -1], path[:, -1], atol=50.0)


def test_plots_have_the_detection_probability_noise_and_clutter_that_are_set():
    recording, scenario = recorded(1, detection_probability=0.5)
    radar, truth, plan = recording.reports.radar, recording.truth, scenario.plan()
    first_s = plan.instant_s(8)
    assert set(np.round((radar.time_s - first_s) / 2.5, 9)) == set(range(-8, 61))
    late = radar.take(radar.time_s >= first_s)
    own, false = late.take(late.origin >= 0), late.take(late.origin < 0)
    few, many = stats.binom.ppf([CHANCE, 1.0 - CHANCE], 16 * 61, 0.5)
    assert few <= len(own) <= many
    mean = 1e-5 * np.pi * 5500.0**2 * 61
    assert abs(len(false) - mean) < 5.0 * np.sqrt(mean)
    assert false.range_m.max() <= 5500.0
    assert np.median(false.range_m) == pytest.approx(5500.0 / np.sqrt(2.0), rel=0.01)
    assert (radar.origin[radar.time_s < first_s] >= 0).all()
    assert (radar.time_s == first_s - 2.5).sum() == 16  # the newest look of the lead-in
    place = own.range_m[:, None] * np.column_stack([np.sin(np.radians(own.azimuth_deg)), np.cos(np.radians(own.azimuth_deg))])
    step = np.round((own.time_s - first_s) / 0.625).astype(int)
    off = place - to_plane(truth.position_deg[own.origin, step], scenario.sensors().radars.site_deg[0])
    assert ((off / 2.5) ** 2).sum(axis=1).mean() == pytest.approx(CHI2_2, abs=5.0 * CHI2_2 / np.sqrt(len(own)))


def test_a_burst_is_clutter_of_its_looks():
    radar = recorded(1, **{"clutter_per_m2": 1e-6, "burst.per_m2": 2.5e-5})[0].reports.radar
    false = radar.take(radar.origin < 0)
    look = np.round((false.time_s - radar.time_s[0]) / 2.5).astype(int) - 8
    each, area_m2 = np.bincount(look, minlength=61), np.pi * 5500.0**2
    stormy = (np.arange(61) >= 20) & (np.arange(61) < 32)
    for looks, density in ((stormy, 2.6e-5), (~stormy, 1e-6)):
        assert each[looks].mean() == pytest.approx(density * area_m2, abs=5.0 * np.sqrt(density * area_m2 / looks.sum()))


@pytest.mark.parametrize(("transponders", "senders"), [("S0", 0), ("S1", 8), ("S2", 8), ("S3", 16), ("S4", 16)])
def test_the_vessels_of_table_5_2_send_and_none_in_the_second_of_a_look(transponders, senders):
    recording, scenario = recorded(1, transponders=transponders)
    ais, first_s = recording.reports.ais, scenario.plan().instant_s(8)
    assert len(np.unique(ais.mmsi)) == senders
    assert ais.class_b.all() == (transponders in ("S0", "S1", "S3"))
    after_s = ais.time_s - first_s
    assert (after_s % 1.0 == 0.0).all()
    assert not (after_s % 2.5 == 0.0).any()
    apart_s = [np.diff(after_s[ais.origin == vessel]) for vessel in np.unique(ais.origin)]
    if senders:
        assert np.median(np.concatenate(apart_s)) == (30.0 if transponders in ("S1", "S3") else 6.0)


def test_reports_have_the_noise_that_their_accuracy_states():
    recording, scenario = recorded(1, transponders="S4", intervals="itu")
    ais, truth, first_s = recording.reports.ais, recording.truth, scenario.plan().instant_s(8)
    course = np.radians(ais.cog_deg)
    velocity = KNOT_M_S * ais.sog_kn[:, None] * np.column_stack([np.sin(course), np.cos(course)])
    step = np.ceil((ais.time_s - first_s) / 0.625 - 1e-9).astype(int)  # the path goes straight on between its steps
    back_s = 0.625 * step - (ais.time_s - first_s)
    off = difference_m(ais.position_deg, truth.position_deg[ais.origin, step])
    off += back_s[:, None] * truth.velocity_m_s[ais.origin, step]
    both = np.column_stack([off, velocity - truth.velocity_m_s[ais.origin, step]])
    for accuracy, sigma in ((1, 1.0), (2, 3.0)):
        mine = ais.accuracy == accuracy
        assert mine.mean() == pytest.approx(0.5, abs=0.15)
        square = ((both[mine] / sigma) ** 2).sum(axis=1).mean()
        assert square == pytest.approx(4.0, abs=5.0 * np.sqrt(8.0 / mine.sum()))
        assert np.allclose(ais.covariance[mine], sigma**2 * np.eye(2))


def test_a_shadow_hides_plots_and_no_reports():
    hidden, scenario = recorded(1, transponders="S4", shadow_from_deg=330.0, shadow_to_deg=30.0)
    clear, _ = recorded(1, transponders="S4")
    radar = hidden.reports.radar
    north = (radar.azimuth_deg >= 330.0) | (radar.azimuth_deg < 30.0)
    assert 0 < north.sum() < 0.1 * len(radar)
    assert radar.range_m[north].max() <= scenario.input.shadow_beyond_m
    assert len(radar) < len(clear.reports.radar)
    assert np.array_equal(hidden.reports.ais.time_s, clear.reports.ais.time_s)
