"""Speed, course, ellipse and sets of sources are what numpy and Python make of them the long way."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from coastwatch.kernels.tables.picture_rows import motion_rows, source_sets, vessel_of
from coastwatch.store.columns import sources

ROUNDING_DEG = 1e-9
"""Course and ellipse go through an arctangent: a few rounding errors of 360 degrees."""

AROUND_0 = 1e-6
"""Speeds and axes under which a direction is noise."""

numbers = st.floats(-1e6, 1e6, allow_subnormal=False) | st.just(np.nan)


def filled(velocity: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    count = len(velocity)
    out = np.empty((count, 5)), np.empty((count, 10)), np.empty(count, np.bool_)
    for low, high in ((0, count // 2), (count // 2, count)):
        motion_rows(low, high, velocity, covariance, *out)
    return out


def turned(one: np.ndarray, two: np.ndarray, whole: float) -> np.ndarray:
    """How far two directions are apart."""
    return np.abs((one - two + whole / 2.0) % whole - whole / 2.0)


@given(
    st.integers(0, 5).flatmap(
        lambda n: st.tuples(arrays(float, (n, 2), elements=numbers), arrays(float, (n, 4, 4), elements=numbers))
    )
)
def test_rows_are_those_of_numpy(given_rows: tuple[np.ndarray, np.ndarray]) -> None:
    velocity, covariance = given_rows
    moving, upper, known = filled(velocity, covariance)
    assert np.array_equal(upper, covariance[(slice(None), *np.triu_indices(4))], equal_nan=True)
    assert np.array_equal(known, ~np.isnan(upper).any(1))
    speed = np.hypot(*velocity.T)
    assert moving[:, 0] == pytest.approx(speed / (1852.0 / 3600.0), nan_ok=True)
    assert np.array_equal(np.isnan(moving[:, 1]), ~(speed > 0.0))
    fast = speed > AROUND_0
    course = np.degrees(np.arctan2(*velocity.T))
    assert (turned(moving[fast, 1], course[fast], 360.0) < ROUNDING_DEG).all()
    assert ((moving[fast, 1] >= 0.0) & (moving[fast, 1] < 360.0)).all()
    east, both, north = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    mean, half = 0.5 * (east + north), np.hypot(0.5 * (east - north), both)
    assert moving[:, 2] == pytest.approx(np.sqrt(np.maximum(mean + half, 0.0)), nan_ok=True)
    assert moving[:, 3] == pytest.approx(np.sqrt(np.maximum(mean - half, 0.0)), nan_ok=True)
    long = half > AROUND_0
    direction = np.degrees(0.5 * np.arctan2(2.0 * both, north - east))
    assert (turned(moving[long, 4], direction[long], 180.0) < ROUNDING_DEG).all()
    assert ((moving[long, 4] >= 0.0) & (moving[long, 4] < 180.0)).all()


def test_an_ellipse_points_where_its_covariance_does() -> None:
    """Half axes 5 and 2 m, the longer one 30 degrees clockwise from north; and what is unknown stays unknown."""
    east, north = np.sin(np.radians(30.0)), np.cos(np.radians(30.0))
    turn = np.array([[east, north], [north, -east]])
    covariance = np.full((2, 4, 4), np.nan)
    covariance[0, :2, :2] = turn @ np.diag([25.0, 4.0]) @ turn.T
    moving, _, known = filled(np.zeros((2, 2)), covariance)
    assert moving[0, 2:] == pytest.approx([5.0, 2.0, 30.0], abs=ROUNDING_DEG)
    assert np.isnan(moving[1, 2:]).all()
    assert known.tolist() == [False, False]


def test_speed_and_course() -> None:
    velocity = np.array([[0.0, 1852.0 / 3600.0], [-1e-20, 1.0], [-1.0, 0.0], [0.0, 0.0]])
    moving, _, _ = filled(velocity, np.zeros((4, 4, 4)))
    assert moving[0, 0] == 1.0
    assert moving[:3, 1] == pytest.approx([0.0, 0.0, 270.0], abs=ROUNDING_DEG)
    assert np.isnan(moving[3, 1])
    assert (moving[:3, 1] < 360.0).all()


@given(st.lists(st.tuples(st.integers(0, 6), st.integers(0, 3), st.integers(0, 2)), max_size=40), st.integers(0, 6))
def test_vessels_of_the_same_sources_have_the_same_set(rows: list[tuple[int, int, int]], vessels: int) -> None:
    members = np.array(sorted(set(rows)), np.int64).reshape(-1, 3)
    vessel_id, code = np.arange(vessels), np.empty(vessels, np.int64)
    parent, last = np.zeros(64, np.int64), np.zeros(64, np.int64)
    count = source_sets(vessel_id, members, code, parent, last)
    sets: list[tuple[int, ...]] = [()]
    for k in range(1, count):
        assert parent[k] < k
        sets.append((*sets[parent[k]], int(last[k])))
    assert len(set(sets)) == count
    for vessel in range(vessels):
        assert sets[code[vessel]] == tuple(sorted({source for v, source, _ in rows if v == vessel}))


def test_there_is_room_for_as_many_sets_as_there_are() -> None:
    vessels = 5000
    rows = [(vessel, source) for vessel in range(vessels) for source in (vessel // 100, 100 + vessel % 100)]
    members = np.array([(vessel, source, 0) for vessel, source in rows], np.int64)
    names = [f"source {k}" for k in range(200)]
    told = sources(np.arange(vessels), members, names)
    assert len(told.of) == 1 + 50 + vessels
    assert [told.of[code] for code in told.codes.tolist()] == [
        f"source {v // 100},source {100 + v % 100}" for v in range(vessels)
    ]
    code = np.empty(vessels, np.int64)
    assert source_sets(np.arange(vessels), members, code, *np.empty((2, 4096), np.int64)) == -1


@given(
    st.dictionaries(st.tuples(st.integers(0, 3), st.integers(0, 2**33)), st.integers(1, 50), max_size=60),
    st.lists(st.tuples(st.integers(0, 3), st.integers(0, 2**33)), max_size=20),
)
def test_the_vessel_of_a_track_is_that_of_a_dictionary(
    of_track: dict[tuple[int, int], int], others: list[tuple[int, int]]
) -> None:
    members = np.array([(vessel, *track) for track, vessel in of_track.items()], np.int64).reshape(-1, 3)
    wanted = np.array([*of_track, *others, *of_track], np.int64).reshape(-1, 2)
    out = np.empty(len(wanted), np.int64)
    vessel_of(members, wanted[:, 0].copy(), wanted[:, 1].copy(), out)
    assert out.tolist() == [of_track.get(tuple(track), -1) for track in wanted.tolist()]  # type: ignore[arg-type]
