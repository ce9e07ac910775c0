"""The load of the whole chain: its plots, AIS and bearings against the truth."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from coastwatch.batches import RadarReports, Reports
from coastwatch.geodesy import KNOT_M_S, difference_m, to_plane, wrap_rad
from coastwatch.sensors.simulated.ais import CLASS_A, CLASS_B
from scaling.load.chain.reports import initial_state, next_cycle
from scaling.load.chain.world import Size, World, build_world

pytestmark = pytest.mark.contract

EXACT = {"input.radar.noise_factor": "0", "input.radar.detection_probability": "1", "input.sonar.noise_factor": "0"}
PERIOD_S, CYCLES = 3.0, 12
BEAM_S = 1e-3  # error of the beam time of a plot, which comes from a position at a constant velocity


@cache
def exact() -> tuple[World, Reports]:
    """A coast of three regions without noise, misses and clutter, and all its reports."""
    world = build_world(Size(900, CYCLES, 300, radars=3, clutter_per_m2=0.0), EXACT, 7)
    state, parts = initial_state(world), []
    for _ in range(CYCLES):
        state, reports = next_cycle(world, state)
        parts.append(reports)
    kinds = ("radar", "ais", "statics", "bearing")
    return world, Reports(*(type(getattr(parts[0], k)).join([getattr(p, k) for p in parts]) for k in kinds))


def plots_of(radar: int) -> tuple[World, RadarReports]:
    """The plots of one radar."""
    world, reports = exact()
    return world, reports.radar.take(reports.radar.sensor == radar)


@pytest.mark.parametrize("radar", [0, 4, 8])
def test_plots_are_where_the_vessels_were_when_the_beam_passed(radar: int) -> None:
    world, plots = plots_of(radar)
    at = to_plane(world.vessels.position(plots.origin, plots.time_s), world.sensors.radars.site_deg[radar])
    azimuth = np.arctan2(at[:, 0], at[:, 1])
    np.testing.assert_allclose(plots.range_m, np.hypot(at[:, 0], at[:, 1]), atol=1e-6)
    np.testing.assert_allclose(wrap_rad(np.radians(plots.azimuth_deg) - azimuth), 0.0, atol=1e-9)
    period_s = world.sensors.radars.period_s[radar]
    north = (plots.time_s - world.plan.start_s) / period_s - azimuth / (2.0 * np.pi)
    off = (north - north[0] + 0.5) % 1.0 - 0.5
    far = plots.range_m > 300.0
    assert np.abs(off[far] - np.median(off)).max() * period_s < BEAM_S
    assert len(plots) > 500


@pytest.mark.parametrize("radar", [0, 4, 8])
def test_a_vessel_in_range_is_seen_once_in_each_turn_also_from_the_next_region(radar: int) -> None:
    world, plots = plots_of(radar)
    radars = world.sensors.radars
    rows, span_s = np.arange(world.count), CYCLES * PERIOD_S
    ends = [world.plan.start_s, world.plan.start_s + span_s]
    near = [np.hypot(*to_plane(world.vessels.position(rows, np.full(len(rows), t)), radars.site_deg[radar]).T) for t in ends]
    inside = np.flatnonzero(np.maximum(*near) < radars.range_m[radar] - 50.0)
    beyond = np.minimum(*near) > radars.range_m[radar] + 50.0
    seen = np.bincount(plots.origin, minlength=world.count)
    turns = span_s / radars.period_s[radar]
    assert set(seen[inside]) <= {int(np.floor(turns)), int(np.ceil(turns))}
    assert not seen[beyond].any()
    order = np.lexsort((plots.time_s, plots.origin))
    step_s = np.diff(plots.time_s[order])[np.diff(plots.origin[order]) == 0]
    far = plots.range_m[order][1:][np.diff(plots.origin[order]) == 0] > 300.0
    np.testing.assert_allclose(step_s[far], radars.period_s[radar], rtol=0.05)
    home = np.arange(world.count) // 300
    assert (home[inside] != radars.region[radar]).any()


def test_ais_reports_have_the_intervals_of_their_class_and_arrive_late() -> None:
    world, reports = exact()
    ais = reports.ais
    order = np.lexsort((ais.time_s, ais.origin))
    same = np.diff(ais.origin[order]) == 0
    step_s, first = np.diff(ais.time_s[order])[same], order[:-1][same]
    _, velocity = world.vessels.state(ais.origin[first], ais.time_s[first])
    knots = np.hypot(velocity[:, 0], velocity[:, 1]) / KNOT_M_S
    for class_b, table in ((False, CLASS_A), (True, CLASS_B)):
        mine = ais.class_b[first] == class_b
        wanted = np.select([knots[mine] < limit for limit, *_ in table], [s for _, s, _ in table])
        whole = np.isclose(step_s[mine] % wanted, 0.0, atol=1e-6) | np.isclose(step_s[mine] % wanted, wanted, atol=1e-6)
        assert whole.mean() > 0.98  # a kick is a turn of a moment, and a missing report may hide a change of speed
        assert mine.sum() > 10
    delay_s = ais.received_s - ais.time_s
    assert delay_s.min() >= 1.0
    assert delay_s.mean() == pytest.approx(2.0, abs=0.2)  # 1 s and an exponential part of 1 s; the run cuts off the latest
    assert (np.diff(ais.received_s) >= 0.0).all()
    assert len(np.unique(ais.mmsi)) == len(np.unique(ais.origin))
    error_m = np.hypot(*difference_m(ais.position_deg, world.vessels.position(ais.origin, ais.time_s)).T)
    assert np.sqrt((error_m**2).mean()) == pytest.approx(np.sqrt(2.0) * 3.33, rel=0.1)


def test_about_half_of_the_vessels_carry_ais_and_some_of_them_class_b() -> None:
    world, _ = exact()
    assert len(world.senders.row) == 450
    assert world.senders.class_b.sum() == 135
    assert world.heard.all()


def test_bearings_point_at_their_vessels() -> None:
    world, reports = exact()
    bearing = reports.bearing
    at = to_plane(world.vessels.position(bearing.origin, bearing.time_s), bearing.site_deg)
    error_rad = wrap_rad(np.radians(bearing.bearing_deg) - np.arctan2(at[:, 0], at[:, 1]))
    np.testing.assert_allclose(error_rad, 0.0, atol=1e-9)
    assert len(np.unique(bearing.sensor)) == 3
    assert len(bearing) > 1000


def test_misses_noise_and_clutter_are_as_many_as_set() -> None:
    world = build_world(Size(2000, 8, clutter_per_m2=1e-6), {}, 3)
    state, parts = initial_state(world), []
    for _ in range(8):
        state, reports = next_cycle(world, state)
        parts.append(reports.radar)
    plots = RadarReports.join(parts)
    radars = world.sensors.radars
    turns = 8 * PERIOD_S / radars.period_s
    clutter = plots.take(plots.origin < 0)
    wanted = (1e-6 * np.pi * radars.range_m**2 * turns).sum()
    assert len(clutter) == pytest.approx(wanted, abs=5.0 * np.sqrt(wanted))
    inner = (clutter.range_m < radars.range_m[clutter.sensor] / np.sqrt(2.0)).mean()
    assert inner == pytest.approx(0.5, abs=2.5 / np.sqrt(len(clutter)))  # uniform over the disc
    real = plots.take(plots.origin >= 0)
    at = to_plane(world.vessels.position(real.origin, real.time_s), radars.site_deg[real.sensor])
    error_m = real.range_m - np.hypot(at[:, 0], at[:, 1])
    assert error_m.std() == pytest.approx(10.0, rel=0.05)
    error_deg = np.degrees(wrap_rad(np.radians(real.azimuth_deg) - np.arctan2(at[:, 0], at[:, 1])))
    assert error_deg.std() == pytest.approx(0.3, rel=0.05)
    always = build_world(Size(2000, 8, clutter_per_m2=1e-6), {"input.radar.detection_probability": "1"}, 3)
    _, every = next_cycle(always, initial_state(always))
    assert (parts[0].origin >= 0).sum() / (every.radar.origin >= 0).sum() == pytest.approx(0.9, abs=0.03)


def test_the_input_is_the_same_to_the_bit_for_the_same_seed() -> None:
    def plots(seed: int) -> RadarReports:
        world = build_world(Size(500, 3), {}, seed)
        state, _ = next_cycle(world, initial_state(world))
        return next_cycle(world, state)[1].radar

    first, second, other = plots(1), plots(1), plots(2)
    for name in ("time_s", "range_m", "azimuth_deg", "origin"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    assert len(other) != len(first) or (other.range_m != first.range_m).any()
