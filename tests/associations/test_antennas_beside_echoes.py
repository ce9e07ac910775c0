"""AIS beside the echo of a large ship of unknown size: one vessel after it lasted, and two where there may be two."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from coastwatch.associations.antennas_beside_echoes import AFTER_S, BesideEchoes, join_beside
from coastwatch.batches import AisStatics, Associations, Floats, HullOffsets, SourceKind, Tracks
from coastwatch.cycle import run_cycle, start_run
from coastwatch.geodesy import offset_deg
from coastwatch.scenario import load_scenario
from coastwatch.stage import serial

pytestmark = pytest.mark.contract

HOME = np.array([54.15, 12.1])
KINDS = np.array([SourceKind.RADAR, SourceKind.AIS])
COURSE = np.array([0.6, 0.8])
ABEAM = np.array([0.8, -0.6])
CYCLE_S = 3.0
AIS, RADAR = 1, 0


def tracks(ships: list[tuple[int, Floats]], speed_m_s: float, time_s: float) -> Tracks:
    """Tracks of these sources at these places, metres from home, all on one course."""
    n = len(ships)
    source = np.array([of for of, _ in ships])
    velocity = np.tile(speed_m_s * COURSE, (n, 1))
    place = offset_deg(HOME, np.array([at for _, at in ships]) + velocity * time_s)
    return Tracks(
        np.arange(n) + 7, source, np.full(n, time_s), place, velocity, np.tile(np.diag([64.0, 64.0, 0.1, 0.1]), (n, 1, 1)),
        np.tile(100.0 * np.eye(2), (n, 1, 1)), np.full(n, time_s), np.zeros(n), np.where(source == AIS, 219_000_000, -1),
        np.full(n, -1),
    )  # fmt: skip


def vessels_after(
    ships: list[tuple[int, Floats]],
    speed_m_s: float = 6.0,
    drift_m_s: float = 0.0,
    hulls: HullOffsets | None = None,
    lasts_s: float = 120.0,
    pairs: tuple[tuple[int, int], ...] = (),
) -> int:
    """How many vessels these tracks are in the end. Args: drift_m_s: of the first ship ahead; pairs: rows associated before."""
    memory = BesideEchoes.empty()
    first, second = np.array(pairs, np.int64).reshape(-1, 2).T
    vessel = np.arange(len(ships))
    for one, other in pairs:
        vessel[vessel == vessel[other]] = vessel[one]
    vessel = np.unique(vessel, return_inverse=True)[1]
    for cycle in range(int(lasts_s / CYCLE_S) + 1):
        time_s = cycle * CYCLE_S
        moved = [(ships[0][0], ships[0][1] + drift_m_s * time_s * COURSE), *ships[1:]]
        given = Associations(first, second, np.ones(len(first)), vessel)
        now = tracks(moved, speed_m_s, time_s)
        memory, found, on = join_beside(memory, now, given, KINDS, hulls or HullOffsets.empty(), time_s, CYCLE_S)
    assert len(on.ais) == int(vessel.max()) - int(found.vessel.max())
    return int(found.vessel.max()) + 1


@pytest.mark.parametrize(
    ("off_m", "speed_m_s"), [(130.0 * COURSE, 6.0), (-175.0 * COURSE, 6.0), (130.0 * ABEAM, 0.0), (80.0 * COURSE, 3.0)]
)
def test_a_constant_distance_along_the_course_is_an_antenna_once_it_has_lasted(off_m: Floats, speed_m_s: float) -> None:
    ship = [(AIS, np.zeros(2)), (RADAR, off_m)]
    assert vessels_after(ship, speed_m_s, lasts_s=AFTER_S - CYCLE_S) == 2
    assert vessels_after(ship, speed_m_s) == 1


@pytest.mark.parametrize(
    ("ships", "drift_m_s"),
    [
        ([(AIS, np.zeros(2)), (RADAR, 130.0 * ABEAM)], 0.0),  # abreast
        ([(AIS, np.zeros(2)), (RADAR, 300.0 * COURSE)], 0.0),  # longer than a ship
        ([(AIS, np.zeros(2)), (RADAR, 10.0 * COURSE)], 0.0),  # another rule says why this is not one
        ([(AIS, np.zeros(2)), (RADAR, 130.0 * COURSE), (RADAR, 0.0 * COURSE)], 0.0),  # an echo at the antenna: two ships
        ([(AIS, np.zeros(2)), (RADAR, 130.0 * COURSE), (AIS, 260.0 * COURSE)], 0.0),  # whose echo?
        ([(AIS, np.zeros(2)), (RADAR, 130.0 * COURSE)], 1.0),  # it departs
    ],
)
def test_what_may_be_two_ships_stays_two(ships: list[tuple[int, Floats]], drift_m_s: float) -> None:
    assert vessels_after(ships, drift_m_s=drift_m_s) == len(ships)


def test_the_echo_of_another_ship_with_ais_and_a_ship_of_known_size_are_left_alone() -> None:
    column = [(AIS, np.zeros(2)), (RADAR, 100.0 * COURSE), (AIS, 100.0 * COURSE)]
    assert vessels_after(column, pairs=((1, 2),)) == 2
    small = HullOffsets(np.array([219_000_000]), np.array([2.0]), np.array([False]))
    pair = [(AIS, np.zeros(2)), (RADAR, 100.0 * COURSE)]
    assert vessels_after(pair, hulls=small) == 2
    assert vessels_after(pair, hulls=replace(small, sigma_m=np.array([100.0]))) == 1


def test_a_tug_that_passes_parts_them_for_no_longer_than_it_is_near() -> None:
    """The pair is kept for half a minute, and its time goes on."""
    memory, counts = BesideEchoes.empty(), list[int]()
    for cycle in range(60):
        time_s = cycle * CYCLE_S
        tug = [(RADAR, 100.0 * ABEAM)] if 40 <= cycle < 45 else []
        now = tracks([(AIS, np.zeros(2)), (RADAR, 130.0 * COURSE), *tug], 6.0, time_s)
        alone = Associations(*np.zeros((2, 0), np.int64), np.zeros(0), np.arange(len(now)))
        memory, found, _ = join_beside(memory, now, alone, KINDS, HullOffsets.empty(), time_s, CYCLE_S)
        counts.append(int(found.vessel.max()) + 1 - len(tug))
    assert counts[:30] == [2] * 30
    assert counts[30:] == [1] * 30


def test_a_ship_whose_antenna_is_far_from_its_echo_is_one_vessel_in_the_picture() -> None:
    """Through all stages: plots without extent, an antenna 130 m ahead, and no size."""
    settings = {"input.count": "1", "input.radar.clutter_per_m2": "0", "input.motion.speed_from_kn": "10"}
    scenario = load_scenario("guanabara", settings | {"registration.method": "none", "sonars": "[]"})
    sensors, plan = scenario.sensors(), scenario.plan()
    reports, memory, before_s = scenario.input.load(sensors, 4, plan).reports, start_run(scenario, sensors), -np.inf
    counts: list[int] = []
    for k in range(80):
        now_s = plan.instant_s(k)
        given = reports.between(before_s, now_s)
        course = np.radians(given.ais.cog_deg)
        ahead_m = 130.0 * np.column_stack([np.sin(course), np.cos(course)])
        ais = replace(given.ais, position_deg=offset_deg(given.ais.position_deg, ahead_m))
        given = replace(given, ais=ais, statics=AisStatics.empty())
        memory, cycle = run_cycle(scenario, sensors, memory, given, now_s, serial, lambda name: nullcontext())
        counts.append(len(cycle.picture))
        before_s = now_s
    assert 2 in counts[:40]
    assert counts[-20:] == [1] * 20
