"""The promise of the history: from its rows alone every vessel is found at every cycle, no other, and none further off than the bound."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import store_world as world
from hypothesis import HealthCheck, given, settings, strategies as st
from sqlalchemy import text

from coastwatch import store as kept
from coastwatch.batches import Picture
from coastwatch.geodesy import KNOT_M_S, difference_m, offset_deg
from coastwatch.scenario import StoreSettings
from coastwatch.store import history_rule
from coastwatch.store.rows import to_python
from coastwatch.store.schema.database import reading
from coastwatch.store.schema.migrate import check

pytestmark = pytest.mark.contract

NAMES = (
    "vessel_id", "latitude_deg", "longitude_deg", "sog_kn", "cog_deg", "major_m", "minor_m", "orientation_deg", "updated_s",
    "mmsi", "flags", "previous_cycle", "closing", "nav_status",
)  # fmt: skip

PLACES = np.array([[-22.9, -43.2], [0.0, 180.0], [70.0, -180.0], [84.0, 10.0], [-0.001, 0.0]])
"""The antimeridian, the equator and the far north are among them."""


def pictures(seed: int, cycles: int, vessels: int, wild: float, period_s: float) -> list[Picture]:
    """Vessels that come, go, turn, jump, stand still and change their flags. Args: wild: how much of that there is, 0 to 1."""
    rng = np.random.default_rng([7, seed])
    place, velocity = PLACES[rng.integers(0, len(PLACES), vessels)], rng.normal(0.0, 8.0, (vessels, 2))
    there, mmsi, flags = rng.random(vessels) < 0.7, np.full(vessels, -1), np.zeros(vessels, np.int64)
    made = []
    for number in range(cycles):
        turn = rng.random(vessels) < 0.2 * wild
        velocity = np.where(turn[:, None], rng.normal(0.0, 8.0, (vessels, 2)) * (rng.random((vessels, 1)) < 0.8), velocity)
        noise = rng.normal(0.0, 3.0 * wild, (vessels, 2)) + (rng.random((vessels, 1)) < 0.02 * wild) * 5000.0
        place = offset_deg(place, velocity * period_s + noise)
        there ^= rng.random(vessels) < 0.1 * wild
        mmsi = np.where(rng.random(vessels) < 0.02 * wild, 710_000_000 + rng.integers(0, 9, vessels), mmsi)
        flags = np.where(rng.random(vessels) < 0.05 * wild, rng.integers(0, 32, vessels), flags)
        said = velocity.copy()
        said[rng.random(vessels) < 0.05 * wild] = np.nan
        k = np.flatnonzero(there)
        made.append(picture(k + 1, place[k], said[k], mmsi[k], flags[k], world.START_S + period_s * (number + 1)))
    return made


def picture(vessel: Any, place: Any, velocity: Any, mmsi: Any, flags: Any, time_s: float) -> Picture:
    n = len(vessel)
    when = np.full(n, time_s)
    covariance = np.broadcast_to(np.eye(4), (n, 4, 4)).copy()
    return Picture(vessel, when, place, velocity, covariance, when, when, mmsi, flags, np.full(n, -1))


def rows_of(made: list[Picture], bound: history_rule.Bound) -> tuple[dict[str, np.ndarray], np.ndarray, list[int]]:
    """What the rule writes: columns with `cycle`, the time of each cycle, and from which cycle on its points are."""
    points, rows, firsts, times = history_rule.no_points(), [], [], [float(p.time_s[0]) if len(p) else np.nan for p in made]
    period_s = np.nanmin(np.append(np.diff(times), 3.0))
    times = [world.START_S + period_s * (k + 1) if t != t else t for k, t in enumerate(times)]
    for number, seen in enumerate(made):
        before_s = times[number - 1] if number else -np.inf
        points, added = history_rule.extend(points, bound, number, times[number], before_s, seen)
        columns = [to_python(column, added.points) for column in added.columns]
        rows += [dict(zip(NAMES, row, strict=True), cycle=number) for row in zip(*columns, strict=True)]
        firsts.append(added.first_cycle)
    table = {name: np.array([np.nan if row[name] is None else row[name] for row in rows]) for name in (*NAMES, "cycle")}
    return table, np.array(times), firsts


def found(table: dict[str, np.ndarray], times: np.ndarray, first: int, cycle: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vessels, places and rows at a cycle, from rows of the table alone."""
    some = np.flatnonzero((table["cycle"] >= first) & (table["cycle"] <= cycle))
    of = {name: column[some] for name, column in table.items()}
    rows = history_rule.newest_rows(of["vessel_id"], of["cycle"], of["closing"].astype(bool))
    place = np.stack([of["latitude_deg"], of["longitude_deg"]], 1)[rows]
    passed_s = times[cycle] - times[of["cycle"][rows].astype(int)]
    return of["vessel_id"][rows], history_rule.dead_reckon(place, of["sog_kn"][rows], of["cog_deg"][rows], passed_s), some[rows]


@given(
    st.integers(0, 10**6), st.integers(1, 25), st.integers(0, 12), st.floats(0.0, 1.0),
    st.sampled_from([0.5, 10.0, 200.0]), st.sampled_from([0.0, 7.0, 60.0, 1e6]), st.sampled_from([1.0, 3.0, 60.0]),
)  # fmt: skip
@settings(suppress_health_check=list(HealthCheck))
def test_no_vessel_is_ever_further_off_than_the_bound(
    seed: int, cycles: int, vessels: int, wild: float, error_m: float, max_s: float, period_s: float
) -> None:
    made = pictures(seed, cycles, vessels, wild, period_s)
    table, times, firsts = rows_of(made, history_rule.Bound(error_m, max_s))
    for number, truth in enumerate(made):
        vessel, place, rows = found(table, times, firsts[number], number)
        assert vessel.tolist() == truth.vessel_id.tolist()
        assert (np.hypot(*difference_m(place, truth.position_deg).T) <= error_m).all()
        assert np.array_equal(table["mmsi"][rows], np.where(truth.mmsi < 0, np.nan, truth.mmsi), equal_nan=True)
        assert np.array_equal(table["flags"][rows], truth.flags)
        assert (times[number] - times[table["cycle"][rows].astype(int)] < max(max_s, period_s)).all()
        assert firsts[number] == table["cycle"][rows].min(initial=number)
    keys = list(zip(table["cycle"].tolist(), table["vessel_id"].tolist(), strict=True))
    assert keys == sorted(set(keys))  # in append order, each once


def test_a_point_is_written_just_where_the_distance_is_more_than_the_bound() -> None:
    """From the equator to 89.9 degrees, across the antimeridian, straight along a degree and askew, with distances about the bound."""
    rng, count, bound = np.random.default_rng(17), 20_000, 10.0
    latitude = np.where(rng.random(count) < 0.5, rng.uniform(-89.9, 89.9, count), rng.choice([0.0, 89.9, -89.9], count))
    longitude = np.where(rng.random(count) < 0.5, rng.uniform(-180.0, 180.0, count), 180.0)
    was, number = np.stack([latitude, longitude], 1), np.arange(count)
    angle = np.where(rng.random(count) < 0.5, rng.uniform(0.0, 2.0 * np.pi, count), 0.5 * np.pi * rng.integers(0, 4, count))
    far = bound * np.where(rng.random(count) < 0.5, rng.uniform(0.5, 1.5, count), rng.normal(1.0, 0.005, count))
    here = offset_deg(was, far[:, None] * np.stack([np.sin(angle), np.cos(angle)], 1))
    zeros, rule = np.zeros(count, np.int64), history_rule.Bound(bound, 1e9)
    one, two = (picture(number, place, np.zeros((count, 2)), zeros, zeros, 3.0 * k) for k, place in enumerate((was, here)))
    points, _ = history_rule.extend(history_rule.no_points(), rule, 0, 0.0, -np.inf, one)
    after, _ = history_rule.extend(points, rule, 1, 3.0, 0.0, two)
    written, off = after.cycle == 1, np.hypot(*difference_m(here, was).T)
    clear = np.abs(off - bound) > 2.0 * history_rule.ROUNDING_M
    assert (written == (off > bound))[clear].all()
    assert 0.4 < written.mean() < 0.6


def test_the_points_of_a_stay_are_a_chain() -> None:
    made = pictures(3, 30, 8, 1.0, 3.0)
    table, _, _ = rows_of(made, history_rule.Bound(10.0, 30.0))
    newest: dict[float, float] = {}
    for vessel, cycle, before, closing in zip(
        *(table[name].tolist() for name in ("vessel_id", "cycle", "previous_cycle", "closing")), strict=True
    ):
        assert newest.get(vessel) == (None if np.isnan(before) else before)
        newest[vessel] = cycle
        if closing:
            del newest[vessel]
    assert set(newest) == set(made[-1].vessel_id.tolist())


def test_a_steady_vessel_costs_a_point_an_interval_and_not_all_at_once() -> None:
    """1,000 vessels that came together and go straight on for ten minutes: one point a minute each, spread over the minute."""
    n = 1000
    rng = np.random.default_rng(5)
    start, velocity = np.stack([rng.uniform(-60, 60, n), rng.uniform(-180, 180, n)], 1), rng.normal(0, 5, (n, 2))
    made = [
        picture(np.arange(n), offset_deg(start, velocity * 3.0 * k), velocity, np.full(n, -1), np.zeros(n, np.int64), 3.0 * k)
        for k in range(200)
    ]
    table, _, _ = rows_of(made, history_rule.Bound(10.0, 60.0))
    a_cycle = np.bincount(table["cycle"].astype(int))
    assert a_cycle[0] == n
    assert 9 * n <= a_cycle[1:].sum() <= 10 * n
    assert a_cycle[1:].max() < 2 * n // 20


def test_a_closing_point_is_where_the_vessel_was_last() -> None:
    """North at 10 m/s for three cycles, then gone; a second stay begins a new chain."""
    place = offset_deg(np.zeros((3, 2)), np.array([[0.0, 30.0 * k] for k in range(3)]))
    there = [
        picture(np.array([7]), place[k : k + 1], np.array([[0.0, 10.0]]), np.array([5]), np.array([3]), 3.0 * k)
        for k in range(3)
    ]
    gone = there[0].take(slice(0, 0))
    table, _, _ = rows_of([*there, gone, gone, there[2]], history_rule.Bound(5.0, 1e6))
    assert table["cycle"].tolist() == [0, 3, 5]
    assert table["closing"].tolist() == [0, 1, 0]
    assert np.array_equal(table["previous_cycle"], [np.nan, 0.0, np.nan], equal_nan=True)
    assert (table["mmsi"].tolist(), table["flags"].tolist()) == ([5, 5, 5], [3, 3, 3])
    assert 111_000.0 * table["latitude_deg"][1] == pytest.approx(60.0, rel=0.01)
    assert table["sog_kn"] == pytest.approx(10.0 / KNOT_M_S)


@pytest.mark.parametrize("again_from", [0, 7, 12])
def test_the_store_keeps_the_promise_after_a_restart_too(url: str, again_from: int) -> None:
    keep = StoreSettings(history_error_m=25.0, history_max_s=15.0)
    made = pictures(1, 14, 40, 0.7, world.PERIOD_S)

    def write(store: Any, run: int, number: int) -> None:
        world.write(store, run, number, keep=keep, cycle=world.cycle_of(number, 0, made[number]))

    with kept.open_store(url) as store:
        run = world.begin(store)
        for number in range(13):
            write(store, run, number)
        store.run_states.clear()
        for number in range(again_from, 14):
            write(store, run, number)
        straight = world.begin(store)
        for number in range(14):
            write(store, straight, number)
        with reading(store) as connection:
            of_run = "SELECT * FROM history WHERE run_id = {} ORDER BY cycle, vessel_id"
            one, two = ([tuple(row)[1:] for row in connection.execute(text(of_run.format(r)))] for r in (run, straight))
        assert one == two
        assert len(one) < 0.9 * sum(map(len, made))
        for number, truth in enumerate(made):
            then = kept.picture(store, run, world.instant_s(number) + 1.0)
            assert then.column("vessel_id") == truth.vessel_id.tolist()
            place = np.array([then.column("latitude_deg"), then.column("longitude_deg")]).T
            assert (np.hypot(*difference_m(place, truth.position_deg).T) <= 25.0).all()
            assert set(then.column("time_s")) == {world.instant_s(number)}
            box = (truth.position_deg[0, 0] - 0.001, truth.position_deg[0, 1] - 0.001, *(truth.position_deg[0] + 0.001))
            inside = kept.picture(store, run, world.instant_s(number), box)
            assert set(inside.rows) <= set(then.rows)
            assert truth.vessel_id[0] in inside.column("vessel_id")
    assert check(url) == []


def test_a_vessel_that_has_left_is_where_it_was_last(url: str) -> None:
    """Vessel 22 is away in cycles 0 and 11: between its points it is taken to go on."""
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number in range(12):
            world.write(store, run, number, keep=StoreSettings())
        gone = kept.track(store, run, 22)
        there = world.picture_of(10, 30)
        row = there.vessel_id.tolist().index(22)
        assert not gone.vessel["in_picture"]
        place = np.array([[gone.vessel["latitude_deg"], gone.vessel["longitude_deg"]]])
        assert np.hypot(*difference_m(place, there.position_deg[row : row + 1])[0]) <= StoreSettings().history_error_m
        assert gone.vessel["time_s"] == world.instant_s(10)
        assert gone.history.column("cycle")[0] == 1
        assert max(gone.history.column("cycle")) <= 10
        lost = kept.operator_query(store, "lost_vessels")
        at = lost.column("vessel_id").index(22)
        assert (lost.column("latitude_deg")[at], lost.column("longitude_deg")[at]) == tuple(place[0])
