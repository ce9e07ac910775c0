"""Bounds on reports and states: what is beyond them is dropped and counted, and everything else goes on as without it."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from coastwatch.batches import RadarReports, Recording, Reports, TrackReports, limits
from coastwatch.cycle import dropped, run_cycle, start_run
from coastwatch.scenario import load_scenario
from coastwatch.stage import serial, serial_regions

pytestmark = pytest.mark.contract

SCENARIO = load_scenario("guanabara", {"input.count": "12"})
SENSORS, PLAN = SCENARIO.sensors(), SCENARIO.plan()


@cache
def recording() -> Recording:
    return SCENARIO.input.load(SENSORS, 1, PLAN)


def run(cycles: int, more: Any = None) -> tuple[Any, Any]:
    """Memory and cycle after so many cycles. Args: more: reports -> reports."""
    memory, before_s = start_run(SCENARIO, SENSORS), -np.inf
    for k in range(cycles):
        now_s = PLAN.instant_s(k)
        reports = recording().reports.between(before_s, now_s)
        reports = reports if more is None else more(reports, now_s)
        memory, cycle = run_cycle(SCENARIO, SENSORS, memory, reports, now_s, serial, lambda _: nullcontext(), serial_regions)
        before_s = now_s
    return memory, cycle


def with_odd(kind: str, **fields: Any) -> Any:
    """A source of a copy of the first report of a kind in each cycle, with other fields."""

    def more(reports: Reports, now_s: float) -> Reports:
        batch = getattr(reports, kind)
        if not len(batch):
            return reports
        odd = replace(batch.take(np.array([0])), **{name: np.array([value]) for name, value in fields.items()})
        joined = type(batch).join([odd, batch])
        return replace(reports, **{kind: joined.take(np.argsort(joined.received_s, kind="stable"))})

    return more


ODD = {
    "radar sigma": ("radar", {"range_sigma_m": 1e10, "azimuth_sigma_deg": 1e-10}),
    "radar range": ("radar", {"range_m": 1e300}),
    "radar range none": ("radar", {"range_m": np.nan}),
    "radar azimuth": ("radar", {"azimuth_deg": np.inf}),
    "radar time": ("radar", {"time_s": np.nan}),
    "bearing sigma": ("bearing", {"bearing_sigma_deg": 1e-200}),
    "bearing": ("bearing", {"bearing_deg": np.nan}),
    "ais position": ("ais", {"position_deg": [np.nan, 0.0]}),
    "ais latitude": ("ais", {"position_deg": [95.0, 0.0]}),
    "ais time": ("ais", {"time_s": np.inf}),
}


@pytest.fixture(scope="module")
def without() -> Any:
    """The last of 8 cycles in which no report is odd."""
    return run(8)[1]


@pytest.mark.parametrize("name", ODD)
def test_one_odd_report_a_cycle_changes_nothing_but_its_count(name: str, without: Any) -> None:
    kind, fields = ODD[name]
    memory, cycle = run(8, with_odd(kind, **fields))
    counts = {fault.kind: fault.count for fault in dropped(memory, SENSORS)}
    assert sum(count for text, count in counts.items() if text.startswith(limits.BEYOND)) > 0
    assert np.array_equal(cycle.picture.vessel_id, without.picture.vessel_id)
    assert np.array_equal(cycle.picture.position_deg, without.picture.position_deg)
    assert np.isfinite(cycle.picture.position_deg).all()


def tracks(count: int) -> TrackReports:
    """Sound states of tracks of another system."""
    rng = np.random.default_rng([51, count])
    root = rng.normal(size=(count, 4, 4)) * np.array([30.0, 30.0, 0.5, 0.5])[:, None]
    number = np.arange(count)
    when = np.full(count, 1.7e9)
    return TrackReports(
        sensor=np.zeros(count, np.int64), number=number, time_s=when, received_s=when,
        position_deg=rng.uniform([-60.0, -180.0], [60.0, 180.0], (count, 2)), velocity_m_s=rng.normal(size=(count, 2)),
        covariance=root @ root.transpose(0, 2, 1) + np.diag([25.0, 25.0, 0.01, 0.01]), origin=np.full(count, -1),
    )  # fmt: skip


def changed(batch: TrackReports, row: int, field: str, at: tuple[int, ...], value: float) -> TrackReports:
    column = getattr(batch, field).copy()
    column[(row, *at)] = value
    return replace(batch, **{field: column})


@given(
    row=st.integers(0, 4),
    odd=st.sampled_from(
        [
            ("position_deg", (0,), 95.0), ("position_deg", (1,), np.nan), ("velocity_m_s", (0,), 1e10), ("velocity_m_s", (1,), np.inf),
            ("covariance", (0, 0), -1.0), ("covariance", (0, 0), np.inf), ("covariance", (0, 1), 1e9), ("covariance", (3, 3), 0.0),
            ("covariance", (1, 1), 1e300), ("time_s", (), -1e18), ("received_s", (), np.nan),
        ]
    ),
)  # fmt: skip
def test_an_odd_state_of_another_system_is_found_and_no_other_one(row: int, odd: tuple[str, tuple[int, ...], float]) -> None:
    batch = changed(tracks(5), row, *odd)
    kept, found = limits.within(batch)
    assert len(found) == 1
    assert kept.number.tolist() == [k for k in range(5) if k != row]
    assert limits.within(kept)[1] == {}


def test_states_without_covariance_or_with_that_of_the_position_alone_are_sound() -> None:
    batch = tracks(3)
    none, position = np.full((3, 4, 4), np.nan), batch.covariance.copy()
    position[:, 2:, :] = position[:, :, 2:] = np.nan
    for covariance in (none, position):
        given_so = replace(batch, covariance=covariance, velocity_m_s=np.full((3, 2), np.nan))
        assert limits.within(given_so)[1] == {}


def test_usual_sensors_are_far_within_all_bounds() -> None:
    reports = SCENARIO.input.load(SENSORS, 1, PLAN).reports.between(-np.inf, np.inf)
    assert limits.reports_within(reports) == (reports, {})
    wide = RadarReports.join([reports.radar])
    wide = replace(wide, range_sigma_m=np.full(len(wide), 500.0), azimuth_sigma_deg=np.full(len(wide), 5.0))
    assert not limits.within(wide)[1]


def test_states_without_covariances_are_sound_and_infinite_or_half_given_ones_are_not() -> None:
    none, position = np.full((4, 4), np.nan), np.full((4, 4), np.nan)
    position[:2, :2] = np.eye(2)
    infinite, half = np.diag([np.inf, 1.0, 1.0, 1.0]), np.eye(4)
    half[0, 0] = np.nan
    covariance = np.array([np.eye(4), none, position, infinite, half])
    assert limits.are_sound(np.tile([50.0, -1.0], (5, 1)), covariance).tolist() == [True, True, True, False, False]


def test_ais_tracks_without_covariances_are_associated_and_drop_nothing() -> None:
    """The tracks of `dead_reckoning` have none: once all of them were dropped as unsound."""
    scenario = load_scenario("guanabara", {"input.count": "40", "ais_tracks.method": "dead_reckoning"})
    sensors, plan = scenario.sensors(), scenario.plan()
    recording, memory, before_s = scenario.input.load(sensors, 1, plan), start_run(scenario, sensors), -np.inf
    for k in range(10):
        reports = (
            recording.of_first_cycle(plan.start_s, plan.instant_s(0))
            if k == 0
            else recording.reports.between(before_s, plan.instant_s(k))
        )
        before_s = plan.instant_s(k)
        memory, cycle = run_cycle(scenario, sensors, memory, reports, before_s, serial, lambda _: nullcontext(), serial_regions)
    of_ais = cycle.tracks.source == sensors.ais_source
    assert np.isnan(cycle.tracks.covariance[of_ais]).all()
    assert of_ais.sum() > 5
    assert memory.beyond == {}


def test_a_vessel_that_passes_the_highest_latitude_ends_and_is_no_fault() -> None:
    north, last_s = 257_000_004, PLAN.instant_s(3)

    def more(reports: Reports, now_s: float) -> Reports:
        if not len(reports.ais) or now_s > last_s:  # it is silent, and its track goes on
            return reports
        ship = {"time_s": now_s, "received_s": now_s, "mmsi": north, "sog_kn": 20.0, "cog_deg": 0.0}
        fields = {key: np.array([value]) for key, value in ship.items()}
        fields["position_deg"] = np.array([[84.999 + 9.2e-5 * (now_s - last_s), 20.0]])
        one = replace(reports.ais.take(np.array([0])), **fields)
        return replace(reports, ais=type(one).join([reports.ais, one]))

    _, shown = run(4, more)
    assert north in shown.picture.mmsi
    memory, later = run(12, more)
    assert north not in later.picture.mmsi
    assert [fault for fault in dropped(memory, SENSORS) if fault.kind.startswith(limits.BEYOND)] == []
