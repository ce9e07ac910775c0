"""AIS positions of large ships, moved from the antenna to the middle of the hull."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from coastwatch.batches import AisReports, AisStatics
from coastwatch.cycle import run_cycle, start_run
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.scenario import load_scenario
from coastwatch.sensors.simulated.ais import AisTruth
from coastwatch.sensors.simulated.video import Ship
from coastwatch.server.checkpoint import load, save
from coastwatch.stage import serial
from coastwatch.tracks import HullMiddle

pytestmark = pytest.mark.contract

HOME = np.array([54.3, 12.0])


def reports(time_s, mmsi, heading, sog_kn=2.0):
    """Reports of ships whose antennas are at HOME, on the course 090."""
    count = len(mmsi)
    return AisReports(
        time_s=np.full(count, float(time_s)) + 0.1 * np.arange(count),
        received_s=np.full(count, float(time_s)),
        mmsi=np.array(mmsi),
        position_deg=np.tile(HOME, (count, 1)),
        sog_kn=np.full(count, float(sog_kn)),
        cog_deg=np.full(count, 90.0),
        class_b=np.zeros(count, bool),
        origin=np.arange(count),
        heading_deg=np.array(heading, float),
    )


def sizes(time_s, rows):
    """Messages with sizes. Args: rows: MMSI, to bow, stern, port, starboard."""
    mmsi, bow, stern, port, starboard = np.array(rows, float).T
    texts = np.full(len(mmsi), "")
    return AisStatics(
        received_s=np.full(len(mmsi), float(time_s)),
        mmsi=mmsi.astype(np.int64),
        name=texts.astype("U20"),
        call_sign=texts.astype("U7"),
        ship_type=np.full(len(mmsi), -1),
        length_m=bow + stern,
        beam_m=port + starboard,
        to_bow_m=bow,
        to_stern_m=stern,
        to_port_m=port,
        to_starboard_m=starboard,
    )


def test_how_far_a_position_may_be_from_the_echo():
    """The middle of the hull, and a tenth of the length about it; the antenna where no heading is sent. None while it moves."""
    method = HullMiddle()
    memory, _ = method.step(
        method.init(), (reports(0.0, [1, 2], [90.0, np.nan]), sizes(0.0, [(1, 160, 40, 10, 10), (2, 160, 40, 10, 10)]), 0.0)
    )
    for time_s, moves in ((3.0, True), (60.0, True), (100.0, False)):
        memory, _ = method.step(memory, (reports(time_s, [1, 2], [90.0, np.nan]), AisStatics.empty(), time_s))
        got = method.hull_offsets(memory, time_s)
        assert got.mmsi.tolist() == [1, 2]
        assert got.moves.tolist() == [moves, False]
        assert got.sigma_m == pytest.approx([20.0, np.hypot(20.0, 60.0)])


LARGE, SMALL, UNSAID = (
    (235000003, 280.0, 20.0, 30.0, 12.0),
    (235000002, 7.0, 2.0, 1.5, 1.5),
    (235000001, 0.0, 300.0, 0.0, 42.0),
)


def moved(found):
    return difference_m(found.position_deg, np.tile(HOME, (len(found), 1)))


def test_a_large_ship_moves_to_its_middle_by_its_heading_over_a_minute():
    """130 m ahead and 9 m to port; a boat of 9 m, and a ship that does not say where its antenna is, stay."""
    method = HullMiddle()
    memory, found = method.step(method.init(), (reports(0.0, [235000003], [90.0]), sizes(0.0, [LARGE, SMALL, UNSAID]), 0.0))
    np.testing.assert_allclose(moved(found), 0.0, atol=1e-6)
    memory, found = method.step(memory, (reports(30.0, [235000003], [90.0]), AisStatics.empty(), 30.0))
    np.testing.assert_allclose(moved(found), [[65.0, 4.5]], atol=0.01)
    memory = load(save(memory))
    some = reports(90.0, [235000003, 235000002, 235000001, 235000003], [90.0, 90.0, 90.0, 180.0])
    memory, found = method.step(memory, (some, sizes(90.0, [LARGE]), 90.0))
    np.testing.assert_allclose(moved(found), [[130.0, 9.0], [0.0, 0.0], [0.0, 0.0], [9.0, -130.0]], atol=0.01)


def test_a_report_without_heading_has_that_of_the_report_before_and_without_any_it_stays():
    method = HullMiddle(ramp_s=1e-3)
    memory, _ = method.step(method.init(), (AisReports.empty(), sizes(0.0, [LARGE]), 0.0))
    memory, found = method.step(memory, (reports(3.0, [235000003], [np.nan]), AisStatics.empty(), 3.0))
    np.testing.assert_allclose(moved(found), 0.0, atol=1e-6)
    memory, found = method.step(memory, (reports(6.0, [235000003] * 3, [np.nan, 0.0, np.nan]), AisStatics.empty(), 6.0))
    np.testing.assert_allclose(moved(found), [[0.0, 0.0], [-9.0, 130.0], [-9.0, 130.0]], atol=0.01)
    memory, found = method.step(memory, (reports(9.0, [235000003] * 3, [90.0, 0.0, np.nan]), AisStatics.empty(), 9.0))
    np.testing.assert_allclose(moved(found), [[130.0, 9.0], [-9.0, 130.0], [-9.0, 130.0]], atol=0.01)
    memory, found = method.step(memory, (reports(12.0, [235000003], [np.nan]), AisStatics.empty(), 12.0))
    np.testing.assert_allclose(moved(found), [[-9.0, 130.0]], atol=0.01)
    memory, found = method.step(memory, (reports(1e6, [1], [0.0]), AisStatics.empty(), 1e6))
    assert len(memory) == 0, "a ship that was not heard for a day is forgotten"


def move(given):
    """How far the reports of LARGE lie ahead of its antenna, on heading 090. Args: given: time, heading, speed, size or None."""
    method, out = HullMiddle(), []
    memory = method.init()
    for time_s, heading, sog_kn, size in given:
        statics = sizes(time_s, [size]) if size else AisStatics.empty()
        memory, found = method.step(memory, (reports(time_s, [235000003], [heading], sog_kn), statics, time_s))
        out.append(float(moved(found)[0, 0]))
    return np.array(out)


def test_a_new_size_moves_a_ship_as_slowly_as_the_first():
    """Bow and stern are swapped after two minutes: from 130 m ahead of the antenna to 130 m aft of it."""
    swapped = (LARGE[0], 20.0, 280.0, 30.0, 12.0)
    given = [(t, 90.0, 8.0, LARGE if t == 0.0 else swapped if t == 120.0 else None) for t in np.arange(0.0, 240.0, 6.0)]
    ahead = move(given)
    assert np.abs(np.diff(ahead)).max() < 27.0
    np.testing.assert_allclose(ahead[[20, 25, -1]], [130.0, 0.0, -130.0], atol=0.1)


@pytest.mark.parametrize(("sog_kn", "ahead_m"), [(8.0, 0.0), (1.0, 130.0), (np.nan, 0.0)])
def test_an_old_heading_moves_only_a_ship_that_is_not_under_way(sog_kn, ahead_m):
    """The last heading is of the 60th second. After the 120th the ship goes back to its antenna, over a minute."""
    times = np.arange(0.0, 300.0, 6.0)
    ahead = move([(t, 90.0 if t <= 60.0 else np.nan, sog_kn, LARGE if t == 0.0 else None) for t in times])
    np.testing.assert_allclose(ahead[times == 120.0], 130.0, atol=0.1)
    np.testing.assert_allclose(ahead[-1], ahead_m, atol=0.1)
    assert np.abs(np.diff(ahead)).max() < 14.0


@pytest.mark.parametrize(("heading", "sog_kn", "moves"), [(155.0, 8.0, False), (145.0, 8.0, True), (155.0, 2.0, True)])
def test_a_heading_far_from_the_course_under_way_is_none(heading, sog_kn, moves):
    """The course is 090."""
    ahead = move([(t, heading, sog_kn, LARGE if t == 0.0 else None) for t in np.arange(0.0, 120.0, 6.0)])
    assert (abs(ahead[-1]) > 10.0) == moves


@pytest.mark.whole
@pytest.mark.parametrize("says_its_size", [True, False])
def test_a_ship_of_300_m_with_its_antenna_130_m_aft_is_one_vessel(says_its_size):
    """Video and AIS through all centres, from a minute after the ship said its size; or it never does, and is found on its echo."""
    turns, settled = 80, 45
    scenario = load_scenario("heymann-table-1", {"cycles": str(turns), "radars.0.range_nm": "2.0", "input.cells": "341"})
    start = offset_deg(HOME, np.array([1500.0, -600.0]))
    ship = Ship(
        latitude_deg=start[0],
        longitude_deg=start[1],
        course_deg=20.0,
        speed_kn=8.0,
        length_m=300.0,
        width_m=42.0,
        antenna_m=-130.0,
    )
    ais = AisTruth(share=1.0, intervals="itu", static_within_s=5.0)
    feed = scenario.input.model_copy(update={"ships": (ship,), "ais": ais, "spokes": 512})
    scenario = scenario.model_copy(update={"input": feed})
    sensors, plan = scenario.sensors(), scenario.plan()
    recording, memory, counts, errors = feed.load(sensors, 1, plan), start_run(scenario, sensors), [], []
    for cycle in range(plan.cycles):
        now_s = plan.instant_s(cycle)
        arrived = recording.reports.between(plan.instant_s(cycle - 1) if cycle else plan.start_s, now_s)
        if not says_its_size:
            arrived = replace(arrived, statics=AisStatics.empty())
        memory, made = run_cycle(scenario, sensors, memory, arrived, now_s, serial, lambda _: nullcontext())
        if cycle >= settled:
            counts.append(len(made.picture))
            truth = recording.truth.at(now_s).position_deg
            errors.append(float(np.hypot(*difference_m(made.picture.position_deg[:1], truth)[0])))
    assert counts.count(1) == len(counts)
    assert np.median(errors) < 15.0
    assert made.picture.mmsi[0] > 0
    assert made.picture.echo_length_m[0] == pytest.approx(300.0, rel=0.16)
