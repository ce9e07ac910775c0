"""Bearings without contact numbers where vessels crowd: the vessels of the picture predict them."""

from __future__ import annotations

import bearing_world as bw
import numpy as np
import pytest
from as_bytes import as_bytes

from coastwatch import kernels
from coastwatch.batches import BearingAssociations, BearingReports, ExpectedVessels, Floats, Picture, Sensors
from coastwatch.geodesy import from_plane
from coastwatch.tracks import BearingInput
from coastwatch.tracks.bearing.tracker import OF_VESSEL, OWN, BearingWindow
from coastwatch.tracks.bearing.vessels import chosen_pairs, expected_vessels, predicted_bearings

pytestmark = pytest.mark.contract

START = bw.START_S
DISTANCE_M = 4000.0


def sensors() -> Sensors:
    return bw.sensors_of(np.zeros((1, 2)), 7000.0, (0.0, 360.0))


def vessels_at(bearing_deg: Floats, time_s: float = 0.0, distance_m: float = DISTANCE_M) -> ExpectedVessels:
    """Vessels at rest, known exactly; their ids are 100, 101, ..."""
    n, angle = len(bearing_deg), np.radians(bearing_deg)
    where = from_plane(distance_m * np.column_stack([np.sin(angle), np.cos(angle)]), bw.ORIGIN_DEG)
    still, none = np.zeros((n, 2)), np.zeros(1)
    return ExpectedVessels(100 + np.arange(n), np.full(n, START + time_s), where, still, np.full(n, 25.0), none, none)


def look(time_s: float, bearing_deg: Floats, origin: Floats) -> BearingReports:
    n = len(bearing_deg)
    stamp, none = np.full(n, START + time_s), np.full(n, -1)
    site = np.tile(bw.ORIGIN_DEG, (n, 1))
    return BearingReports(none * 0, stamp, stamp, bearing_deg % 360.0, none, site, none, np.asarray(origin))


def crowd(seed: int, looks: int) -> tuple[Floats, list[BearingReports]]:
    """Sixty vessels at rest, and looks of 1 deg in a shuffled order."""
    rng = np.random.default_rng([seed, 51])
    true = rng.uniform(0.0, 360.0, 60)
    rows = [rng.permutation(60) for _ in range(looks)]
    return true, [look(3.0 * k + 2.0, true[r] + rng.normal(0.0, 1.0, 60), r) for k, r in enumerate(rows)]


def play(method: BearingWindow, cycles: list[BearingReports], expected: ExpectedVessels):
    memory, tracks = method.init(), None
    for k, reports in enumerate(cycles):
        memory, tracks = method.step(memory, BearingInput(reports, START + 3.0 * (k + 1), sensors(), expected))
    return memory, tracks


def test_in_a_crowd_each_vessel_has_one_track_of_the_bearings_that_are_most_probably_its_own() -> None:
    true, cycles = crowd(1, 12)
    memory, tracks = play(BearingWindow(), cycles, vessels_at(true))
    of_vessel = np.isin(tracks.track_id, memory.track_id[memory.contact <= OF_VESSEL])
    assert of_vessel.sum() >= 57
    vessel = OF_VESSEL - memory.contact[np.searchsorted(memory.track_id, tracks.track_id[of_vessel])] - 100
    assert len(np.unique(vessel)) == len(vessel)
    newest = tracks.updated_s[of_vessel] == START + 35.0
    right, certainty = (tracks.origin[of_vessel] == vessel)[newest], tracks.certainty[of_vessel][newest]
    assert certainty.mean() == pytest.approx(right.mean(), abs=0.15)  # fifty decisions
    assert right.mean() > 0.6
    off = np.abs(bw_wrap(np.degrees(tracks.bearing_rad[of_vessel]) - true[vessel]))
    assert np.median(off) < 0.5


def bw_wrap(angle: Floats) -> Floats:
    return (angle + 180.0) % 360.0 - 180.0


def test_few_vessels_change_no_bit_of_our_own_tracks() -> None:
    _, cycles = crowd(2, 6)
    few = vessels_at(np.array([10.0, 100.0, 190.0]))
    without, with_few = (play(BearingWindow(), cycles, e) for e in (ExpectedVessels.empty(), few))
    assert as_bytes(without[0]) == as_bytes(with_few[0])
    assert as_bytes(without[1]) == as_bytes(with_few[1])
    assert np.isnan(without[1].certainty).all()


def test_a_track_goes_on_as_our_own_when_its_vessel_leaves_the_picture() -> None:
    true, cycles = crowd(3, 8)
    method = BearingWindow()
    memory, _ = play(method, cycles[:6], vessels_at(true))
    last = int(memory.track_id[memory.contact == OF_VESSEL - 107][0])
    fewer = vessels_at(true)
    rows = np.arange(60) != 7
    columns = {name: value[rows] if len(value) == 60 else value for name, value in vars(fewer).items()}
    memory, _ = method.step(memory, BearingInput(cycles[6], START + 21.0, sensors(), ExpectedVessels(**columns)))
    assert memory.contact[memory.track_id == last].tolist() == [OWN]


def test_the_order_of_the_bearings_does_not_matter() -> None:
    true, cycles = crowd(4, 5)
    shuffled = [c.take(np.random.default_rng(9).permutation(60)) for c in cycles]
    first, second = (play(BearingWindow(), c, vessels_at(true)) for c in (cycles, shuffled))
    assert as_bytes(first[1]) == as_bytes(second[1])


def probability_of_pairs(vessels_deg: Floats, bearing_deg: Floats) -> dict[tuple[int, int], float]:
    reports, sonar = look(0.0, bearing_deg, np.arange(len(bearing_deg))), sensors()
    predicted = predicted_bearings(vessels_at(vessels_deg), reports, sonar)
    every = np.divmod(np.arange(len(vessels_deg) * len(bearing_deg)), len(bearing_deg))
    noise = np.full(len(bearing_deg), sonar.sonars.bearing_sigma_rad[0] ** 2)
    vessel, report, probability = chosen_pairs(predicted, reports, every, noise, 3.5, 0.95, sonar)
    return dict(zip(zip(vessel.tolist(), report.tolist(), strict=True), probability.tolist(), strict=True))


def test_certainty_is_near_one_for_a_vessel_alone_and_a_half_for_two_in_one_direction() -> None:
    alone = probability_of_pairs(np.array([50.0]), np.array([50.5]))
    assert alone[0, 0] > 0.99
    both = probability_of_pairs(np.array([50.0, 50.01]), np.array([50.5, 49.0]))
    assert len(both) == 2
    assert all(0.4 < p < 0.6 for p in both.values())
    assert probability_of_pairs(np.array([50.0]), np.array([60.0])) == {}


def test_vessels_beyond_the_range_or_the_arc_are_not_expected() -> None:
    reports = look(0.0, np.array([10.0]), np.array([0]))
    assert len(predicted_bearings(vessels_at(np.array([10.0]), distance_m=7100.0), reports, sensors()).sensor) == 0
    half = bw.sensors_of(np.zeros((1, 2)), 7000.0, (0.0, 180.0))
    got = predicted_bearings(vessels_at(np.array([10.0, 190.0])), reports, half)
    assert got.vessel_id.tolist() == [100]
    assert np.degrees(got.bearing_rad) == pytest.approx([10.0], abs=1e-3)
    assert np.sqrt(got.variance) == pytest.approx([np.hypot(5.0, 3.0) / DISTANCE_M], rel=1e-3)


def test_unknown_vessels_are_counted_by_direction() -> None:
    rng = np.random.default_rng([6, 51])
    known, unknown = rng.uniform(0.0, np.pi, 300), rng.uniform(np.pi, 2.0 * np.pi, 100)
    bearing = np.concatenate([known, unknown])
    none, arc = np.zeros(400, np.int64), np.full(1, 2.0 * np.pi)
    density = kernels.bearings.directions.unknown_density(none, bearing, none[:300], known, 0.95, arc)
    assert density[bearing < np.pi].mean() < 0.3 * density[bearing > np.pi].mean()
    assert density[bearing > np.pi].mean() == pytest.approx(100.0 / np.pi, rel=0.3)


def test_only_vessels_near_a_sensor_without_contact_numbers_are_expected() -> None:
    where = from_plane(np.array([[0.0, 4000.0], [0.0, 60_000.0]]), bw.ORIGIN_DEG)
    none, stamp = np.full(2, -1), np.full(2, START)
    picture = Picture(
        np.array([5, 6]), stamp, where, np.zeros((2, 2)), np.full((2, 4, 4), 9.0), stamp, stamp, none, none * 0, none
    )
    found = BearingAssociations(none[:0], none[:0], np.zeros(0), np.full(1, 0.01))
    got = expected_vessels(np.zeros(1, np.int64), bw.ORIGIN_DEG[None], picture, found, sensors())
    assert got.vessel_id.tolist() == [5]
    assert got.bias_rad.tolist() == [0.01]
    assert got.bias_sigma_rad.tolist() == [0.0]
    assert len(expected_vessels(none[:0], np.zeros((0, 2)), picture, found, sensors()).vessel_id) == 0
