"""The feed of vessels that cross a disc does what its settings say."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from coastwatch.geodesy import difference_m, to_plane
from coastwatch.scenario import load_scenario

pytestmark = pytest.mark.contract

CHANCE = 1e-6


def recorded(seed, **settings):
    scenario = load_scenario("hem-figure-2", {f"input.{name}": str(value) for name, value in settings.items()})
    return scenario.input.load(scenario.sensors(), seed, scenario.plan()), scenario


def share_within(hits, count, probability):
    low, high = stats.binom.ppf([0.5 * CHANCE, 1.0 - 0.5 * CHANCE], count, probability)
    return low <= hits <= high


def test_vessels_come_from_the_edge_pass_near_the_centre_and_leave():
    recording, scenario = recorded(1, count=60)
    truth, site = recording.truth, scenario.sensors().radars.site_deg[0]
    distance = np.hypot(*np.moveaxis(to_plane(truth.position_deg, site), -1, 0))
    first = truth.present.argmax(axis=1)
    assert np.allclose(distance[np.arange(60), first], 500.0, atol=0.1)
    assert set(truth.time_s[first] - scenario.plan().instant_s(0)) == {0.0, 10.0}
    nearest = np.where(truth.present, distance, np.inf).min(axis=1)
    ended = ~truth.present[:, -1]
    assert ended.sum() > 5
    assert (nearest[ended] < 50.0).mean() > 0.9  # a few leave by turns that end outside
    speed = np.hypot(*np.moveaxis(truth.velocity_m_s[truth.present], -1, 0))
    assert 2.0 < speed.min() < speed.max() < 14.0  # 4 to 12 at the start


def test_plots_have_the_noise_and_the_detection_probability_that_are_set():
    recording, scenario = recorded(2, count=200, detection_probability=0.7, clutter_per_m2=0.0)
    radar, truth = recording.reports.radar, recording.truth
    present = sum(len(truth.at(scenario.plan().instant_s(c)).vessel) for c in range(scenario.cycles))
    assert share_within(len(radar), present, 0.7)
    square = []
    for cycle in range(scenario.cycles):
        now = scenario.plan().instant_s(cycle)
        seen, here = radar.take(radar.time_s == now), truth.at(now)
        at = np.searchsorted(here.vessel, seen.origin)
        place = difference_m(here.position_deg[at], seen.site_deg)
        distance, azimuth = np.hypot(*place.T), np.arctan2(*place.T)
        far = distance > 100.0
        range_error = (seen.range_m - distance)[far] / np.hypot(8.0, 6.6)
        off = np.angle(np.exp(1j * (np.radians(seen.azimuth_deg) - azimuth)))[far] * distance[far]
        square.append(range_error**2 + (off / np.hypot(6.6, np.radians(1.0) * distance[far])) ** 2)
    values = np.concatenate(square)
    assert values.mean() == pytest.approx(2.0, abs=5.0 * 2.0 / np.sqrt(len(values)))


def test_hidden_vessels_are_as_many_as_the_chain_says():
    plain, _ = recorded(3, count=300, detection_probability=1.0, clutter_per_m2=0.0)
    hiding, _ = recorded(3, count=300, detection_probability=1.0, clutter_per_m2=0.0, hide_share=0.1)
    assert len(hiding.reports.radar) / len(plain.reports.radar) == pytest.approx(0.52 / 0.62, abs=0.02)


def test_clutter_is_even_over_the_disc_and_some_ids_are_wrong():
    recording, scenario = recorded(4, count=300, clutter_per_m2=1e-4, wrong_id_share=0.2, ais_share=1.0)
    false = recording.reports.radar.take(recording.reports.radar.origin < 0)
    assert len(false) == pytest.approx(1e-4 * np.pi * 500.0**2 * scenario.cycles, rel=0.1)
    assert (false.range_m < 250.0).mean() == pytest.approx(0.25, abs=0.05)
    ais = recording.reports.ais
    assert share_within((ais.mmsi != 257_000_000 + ais.origin).sum(), len(ais), 0.2)
    assert (np.diff(ais.received_s) >= 0.0).all()


def test_a_change_of_clutter_moves_no_vessel():
    one, other = (recorded(5, clutter_per_m2=value)[0] for value in (0.0, 1e-5))
    assert np.array_equal(one.truth.position_deg, other.truth.position_deg)
    mine = other.reports.radar.origin >= 0
    assert np.array_equal(one.reports.radar.range_m, other.reports.radar.range_m[mine])


def test_a_family_has_the_births_the_looks_and_the_intervals_that_are_set():
    """Births within 50 s, a look every second cycle, AIS every 12 s below 14 kn and every 3 s above 23 kn."""
    scenario = load_scenario("sagild-normal", {"input.count": "80", "input.births_within_s": "50", "input.speed_to_m_s": "20"})
    recording = scenario.input.load(scenario.sensors(), 3, scenario.plan())
    truth, ais, start = recording.truth, recording.reports.ais, scenario.plan().instant_s(0)
    born = truth.time_s[truth.present.argmax(axis=1)] - start
    assert 0.0 <= born.min() < 10.0 < 40.0 < born.max() <= 50.5
    assert set((recording.reports.radar.time_s - start) % 2.0) == {0.0}
    outside = np.hypot(*np.moveaxis(to_plane(truth.position_deg, scenario.sensors().radars.site_deg[0]), -1, 0)) > 1000.01
    assert not (outside & truth.present).any()
    gap = [np.diff(ais.time_s[ais.origin == v]) for v in range(80)]
    speed = [np.hypot(*truth.velocity_m_s[v, truth.present[v]].T) for v in range(80)]
    slow = np.concatenate([g for g, s in zip(gap, speed, strict=True) if s.max() < 7.0])
    fast = np.concatenate([g for g, s in zip(gap, speed, strict=True) if s.min() > 12.0])
    assert 10.8 <= slow.min() <= slow.max() <= 13.2
    assert 2.7 <= fast.min() <= fast.max() <= 3.3
