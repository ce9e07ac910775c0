"""Simulated video does what its settings say, and is the same wherever it is read."""

from __future__ import annotations

import time
import tracemalloc
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from coastwatch.geodesy import offset_deg, to_plane
from coastwatch.scenario import load_scenario
from coastwatch.sensors.simulated import simulation
from coastwatch.sensors.simulated.video import Receiver, Ship, _disc, _levels, motion_of

pytestmark = pytest.mark.contract

SMALL = {"radars.0.range_nm": "3.0", "input.cells": "256", "input.spokes": "512", "cycles": "6"}
SITE = np.array([54.3, 12.0])


def recorded(seed=1, **settings):
    scenario = load_scenario("heymann-table-1", SMALL | {key.replace("__", "."): str(value) for key, value in settings.items()})
    return scenario.input.load(scenario.sensors(), seed, scenario.plan()), scenario


def video(recording, after_s, until_s):
    return recording.reports.between(after_s, until_s).video.parts


def ships(*places_m, length_m=32.0):
    """Ships that lie still. Args: places_m: east and north of the radar, and heading."""
    at = [(offset_deg(SITE, np.array(place[:2])), place[2]) for place in places_m]
    rows = [
        f"{{latitude_deg = {p[0]}, longitude_deg = {p[1]}, course_deg = {course}, length_m = {length_m}}}" for p, course in at
    ]
    return f"[{', '.join(rows)}]"


def test_the_stream_is_the_same_wherever_it_is_cut_and_begins():
    whole, scenario = recorded(3)
    start_s = scenario.plan().start_s
    want = np.concatenate([part.level for part in video(whole, start_s, start_s + 7.0)])
    cut, _ = recorded(3)
    times = [start_s, *np.sort(np.random.default_rng(1).uniform(start_s, start_s + 7.0, 9)), start_s + 7.0]
    got = [part.level for a, b in pairwise(times) for part in video(cut, a, b)]
    assert np.array_equal(np.concatenate(got), want)
    late, _ = recorded(3)
    assert np.array_equal(video(late, start_s + 4.8, start_s + 7.0)[0].level, want[1024:])
    assert whole.reports.rest(start_s) == 0


def test_noise_and_sea_have_their_strength():
    recording, scenario = recorded(input__ships="[]", input__power__sea_shape=5.0)
    start_s = scenario.plan().start_s
    (part,) = video(recording, start_s, start_s + 2.4)
    power = 10.0 ** ((part.level + 0.5 - 20.0) / 20.0)
    assert power[:, 240:].mean() == pytest.approx(1.0 + 0.22, abs=0.1)  # sea of 18 dB at 0.5 NM falls to 0.3 at 3 NM
    near = round(0.5 * 1852.0 / part.cell_m)
    assert 10.0 * np.log10(power[:, near - 2 : near + 3].mean()) == pytest.approx(18.0, abs=1.5)


def test_a_ship_is_where_its_way_leads_when_the_beam_meets_it():
    recording, scenario = recorded(5, radars__0__range_nm=3.0, input__power__sea_db=-50.0)
    start_s, sensors = scenario.plan().start_s, scenario.sensors()
    (part,) = video(recording, start_s, start_s + 2.4)
    strong = 10.0 ** (part.level.astype(float) / 40.0) * (part.level > 40)
    for v in range(2):
        seen = np.isfinite(part.vessel_m[:, v])
        mine = np.where(seen[:, None], strong, 0.0)
        row = int(mine.sum(axis=1).argmax())
        truth = recording.truth.at(float(part.time_s[row]))
        at = to_plane(truth.position_deg[v], sensors.radars.site_deg[0])
        range_m = (mine.sum(axis=0) * (np.arange(256) + 0.5)).sum() / mine.sum() * part.cell_m
        azimuth = (mine.sum(axis=1) * part.azimuth_rad).sum() / mine.sum()
        assert range_m == pytest.approx(float(np.hypot(*at)), abs=25.0)
        assert np.degrees(azimuth) == pytest.approx(np.degrees(np.arctan2(at[0], at[1])) % 360.0, abs=0.5)


def test_a_ship_behind_another_is_hidden():
    def level(*places):
        recording, scenario = recorded(6, input__ships=ships(*places), input__power__sea_db=-50.0)
        (part,) = video(recording, scenario.plan().start_s, scenario.plan().start_s + 2.4)
        row, cell = 512 // 4, int(3000.0 / part.cell_m)
        return int(part.level[row - 2 : row + 3, cell - 1 : cell + 2].max())

    behind, ahead = (3000.0, 0.0, 0.0), (1500.0, 0.0, 0.0)
    assert level(behind) - level(ahead, behind) > 20  # ten decibels at least


def test_land_rain_lost_spokes_and_jitter():
    corner = [
        offset_deg(SITE, np.array(p)).tolist() for p in ([-900.0, 1500.0], [900.0, 1500.0], [900.0, 2500.0], [-900.0, 2500.0])
    ]
    rain = offset_deg(SITE, np.array([0.0, -3000.0]))
    recording, scenario = recorded(
        7,
        input__ships="[]",
        input__land_deg=[corner],
        input__rain=f"[{{latitude_deg = {rain[0]}, longitude_deg = {rain[1]}, radius_m = 800.0, rain_db = 20.0}}]",
        input__lost_share=0.2,
        input__jitter_deg=0.3,
    )
    start_s = scenario.plan().start_s
    (part,) = video(recording, start_s, start_s + 2.4)
    assert len(part) == pytest.approx(0.8 * 512, abs=50)
    off = np.degrees(part.azimuth_rad - (part.time_s - start_s) / 2.4 * 2.0 * np.pi)
    assert 0.1 < np.abs(off).max() <= 0.3 + 1e-6
    row = {
        name: int(np.abs(part.azimuth_rad - azimuth).argmin())
        for name, azimuth in (("north", 0.05), ("south", np.pi), ("east", 1.57))
    }
    cell = {
        name: slice(int(m / part.cell_m), int((m + 300.0) / part.cell_m)) for name, m in (("land", 1900.0), ("rain", 2900.0))
    }
    assert part.level[row["north"], cell["land"]].mean() > part.level[row["east"], cell["land"]].mean() + 15
    assert part.level[row["south"], cell["rain"]].mean() > part.level[row["east"], cell["rain"]].mean() + 10


def one_turn(**settings):
    recording, scenario = recorded(9, **settings)
    (part,) = video(recording, scenario.plan().start_s, scenario.plan().start_s + 2.4)
    return part


@pytest.mark.parametrize("db_per_level", [0.5, 0.0])
def test_a_receiver_without_settings_leaves_the_levels_of_the_power_as_they_are(db_per_level):
    power = np.random.default_rng(2).standard_exponential((300, 200), dtype=np.float32) * np.float32(50.0)
    if db_per_level:
        decibels = np.float32(10.0) * np.log10(np.maximum(power, np.float32(1e-3)))
        want = np.clip((decibels + np.float32(10.0)) / np.float32(db_per_level), 0.0, 255.0).astype(np.uint8)
    else:
        want = np.clip(3.0 * np.sqrt(power), 0.0, 255.0).astype(np.uint8)
    got = _levels(Receiver().received(power, np.linspace(1.0, 5e3, 200)), db_per_level, Receiver().bits)
    np.testing.assert_array_equal(got, want)
    whole = one_turn(radars__0__db_per_level=db_per_level)
    stated = one_turn(radars__0__db_per_level=db_per_level, input__receiver="{bits = 8, stc_db = 0.0, saturation_db = 200.0}")
    np.testing.assert_array_equal(stated.level, whole.level)


@pytest.mark.parametrize("bits", [1, 2, 4, 8, 16, 32])
def test_fewer_bits_are_coarser_levels_that_end_at_the_highest(bits):
    whole, coarse = one_turn(), one_turn(radars__0__db_per_level=6.0, input__receiver__bits=bits)
    assert coarse.bits == bits
    np.testing.assert_array_equal(coarse.level, np.minimum(whole.level // 12, 2 ** min(bits, 8) - 1))
    assert coarse.level.max() == (2**bits - 1 if bits <= 2 else whole.level.max() // 12)


def test_sensitivity_time_control_lowers_near_levels_by_r4_and_saturation_cuts_what_is_left():
    whole, lowered, cut = (
        one_turn(input__power__sea_db=40.0, **more)
        for more in (
            {},
            {"input__receiver__stc_db": 30.0},
            {"input__receiver__stc_db": 30.0, "input__receiver__saturation_db": 10.0},
        )
    )
    off_db = 0.5 * (whole.level.astype(float) - lowered.level)
    range_m = (np.arange(256) + 0.5) * whole.cell_m
    seen = lowered.level > 0
    for cell, wanted_db in ((10, 30.0), (170, 40.0 * np.log10(3704.0 / range_m[170])), (200, 0.0)):
        assert off_db[seen[:, cell], cell].mean() == pytest.approx(wanted_db if range_m[cell] < 3704.0 else 0.0, abs=0.3)
    np.testing.assert_array_equal(cut.level, np.minimum(lowered.level, 40))
    assert lowered.level.max() > 60


def test_a_long_coast_takes_little_memory():
    azimuth = np.linspace(0.0, 2.0 * np.pi, 600, endpoint=False)
    offset_m = 1500.0 * np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1)
    scenario = load_scenario("heymann-table-1", SMALL)
    sensors = replace(scenario.sensors(), land_deg=(tuple(map(tuple, offset_deg(SITE, offset_m).tolist())),))
    tracemalloc.start()
    disc = _disc(scenario.input, sensors, 0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert np.abs(disc.land.sum(axis=1) - 1500.0 / disc.cell_m).max() < 1.5
    assert peak < 150e6  # 131,072 cells and 600 sides at once: 1 GB


def by_pairs(position, corners):
    """The even-odd rule by each position with each side: how many of them lie to the east at its latitude."""
    (lat_1, lon_1), (lat_2, lon_2) = corners.T[:, None], np.roll(corners, -1, axis=0).T[:, None]
    lat, lon = position.T[..., None]
    spans = (np.minimum(lat_1, lat_2) <= lat) & (lat < np.maximum(lat_1, lat_2))
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = lon_1 + (lat - lat_1) / (lat_2 - lat_1) * (lon_2 - lon_1)
    return (spans & (lon < crossing)).sum(axis=1) % 2 == 1


def test_what_is_inside_a_coast_is_as_by_each_side_and_takes_a_long_one_no_longer():
    rng = np.random.default_rng(4)
    corners = rng.uniform(-1.0, 1.0, (400, 2)).round(2)  # crosses itself, with level and double sides
    position = np.concatenate([rng.uniform(-1.2, 1.2, (4_000, 2)), corners, 0.5 * (corners + np.roll(corners, -1, axis=0))])
    found = simulation.inside(position, corners)
    np.testing.assert_array_equal(found, by_pairs(position, corners))
    assert 0.3 < found.mean() < 0.7
    begun_s = time.process_time()
    simulation.inside(
        rng.uniform(-1.2, 1.2, (500_000, 2)), np.stack([np.sin(turn := np.arange(2_000) / 318.3), np.cos(turn)], -1)
    )
    assert time.process_time() - begun_s < 1.5  # 0.1 s; each position with each side takes 6 s


def test_legs_turn_a_ship_and_come_again():
    _, scenario = recorded()
    motion = motion_of(scenario.input.ships, 0.0, 8.0 * (542.99 + 45.0))
    row, time = np.ones(2, np.int64), np.array([0.0, 8.0 * (542.99 + 45.0)])
    at = to_plane(motion.position(row, time), SITE)
    assert np.hypot(*(at[1] - at[0])) < 15.0  # the octagon is closed, but for the curvature of the sea
    _, velocity = motion.state(row, np.array([10.0, 600.0]))
    course = np.degrees(np.arctan2(velocity[:, 0], velocity[:, 1]))
    assert (course[1] - course[0]) % 360.0 == pytest.approx(45.0, abs=0.5)


def test_the_ais_of_a_ship_comes_from_its_antenna_with_heading_and_size():
    at = offset_deg(SITE, np.array([900.0, 900.0]))
    moored = (
        f"[{{latitude_deg = {at[0]}, longitude_deg = {at[1]}, course_deg = 90.0, length_m = 300.0, width_m = 42.0, "
        "antenna_m = -130.0}]"
    )
    ais = "{share = 1.0, position_sigma_m = 0.0, wire_steps = false, static_within_s = 0.0, interval_s = 1.0}"
    recording, scenario = recorded(8, input__ships=moored, input__ais=ais, cycles=5)
    start_s = scenario.plan().start_s
    arrived = recording.reports.between(-np.inf, start_s + 2.0 * scenario.plan().period_s)
    assert len(arrived.ais) >= 3
    np.testing.assert_allclose(to_plane(arrived.ais.position_deg, SITE), [[770.0, 900.0]] * len(arrived.ais), atol=0.1)
    np.testing.assert_allclose(arrived.ais.heading_deg, 90.0)
    sides = [getattr(arrived.statics, f"to_{side}_m").tolist() for side in ("bow", "stern", "port", "starboard")]
    assert sides == [[280.0], [20.0], [21.0], [21.0]]
    assert len(recording.beside.ais) > len(arrived.ais)
    assert len(recorded(8)[0].beside) == 0


def test_an_antenna_lies_on_its_ship():
    with pytest.raises(ValueError, match=r"antenna_m: got -20\.0, needed -16\.0 to 16\.0: half of length_m"):
        Ship(latitude_deg=54.0, longitude_deg=12.0, length_m=32.0, antenna_m=-20.0)
    assert Ship(latitude_deg=54.0, longitude_deg=12.0, length_m=32.0, antenna_m=-16.0).antenna_m == -16.0
