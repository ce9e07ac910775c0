"""Which ways cross a line and which positions are inside an area, against every edge one by one, on edges and corners too."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, strategies as st
from shapely import contains_xy

from coastwatch.alarms import zone_alarms
from coastwatch.alarms.zone_alarms import LINE_REACH_M, Shape, Zone

pytestmark = pytest.mark.oracle

PLACE = st.tuples(st.integers(-4, 4), st.integers(-4, 4))
STEP_DEG, SITES = 0.01, st.sampled_from([(0.0, 0.0), (-17.0, 180.0), (60.0, 10.0), (-84.0, -179.995)])


def placed(site: tuple[float, float], places: list[tuple[int, int]]) -> np.ndarray:
    """Places of a coarse grid about a site, in degrees, so that many lie on edges and corners. (K, 2)"""
    at = np.array(site) + STEP_DEG * np.array(places, np.float64).reshape(-1, 2)
    at[:, 1] = (at[:, 1] + 180.0) % 360.0 - 180.0
    return at


def crossings_edge_by_edge(shape: Shape, from_deg: np.ndarray, to_deg: np.ndarray) -> list[int]:
    """As `Shape.crossings`, of every edge with every way."""
    corner, start, end = (shape.chart_m(at) for at in (shape.points_deg, from_deg, to_deg))
    count = np.zeros(len(start), np.int64)
    for a, b in pairwise(corner):
        before, after = zone_alarms._left_of(a, b, start) > 0.0, zone_alarms._left_of(a, b, end) > 0.0
        between = (zone_alarms._left_of(start, end, a) > 0.0) != (zone_alarms._left_of(start, end, b) > 0.0)
        count += np.where(between, before.astype(np.int64) - after.astype(np.int64), 0)
    return count.tolist()


@given(SITES, st.lists(PLACE, min_size=2, max_size=8, unique=True), st.lists(st.tuples(PLACE, PLACE), max_size=12))
def test_ways_cross_a_line_as_every_edge_says(
    site: tuple[float, float], line: list[tuple[int, int]], ways: list[tuple[tuple[int, int], tuple[int, int]]]
) -> None:
    zone = Zone(name="bar", kind="line", points_deg=tuple(map(tuple, placed(site, line).tolist())), crossing="both")
    shape = Shape(1, zone, LINE_REACH_M)
    start, end = (placed(site, [way[k] for way in ways]) for k in (0, 1))
    assert shape.crossings(start, end).tolist() == crossings_edge_by_edge(shape, start, end)


def test_edges_far_from_a_way_are_not_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    rng, along = np.random.default_rng(1), np.linspace(-1.0, 1.0, 1_000)
    points = tuple(map(tuple, np.stack([10.0 + along, 20.0 + 0.01 * np.sin(60.0 * along)], 1).tolist()))
    shape = Shape(1, Zone(name="coast", kind="line", points_deg=points, crossing="both"), LINE_REACH_M)
    start = np.stack([rng.uniform(9.0, 11.0, 2_000), rng.uniform(19.98, 20.02, 2_000)], 1)
    end = start + rng.normal(0.0, 1e-3, start.shape)
    expected = crossings_edge_by_edge(shape, start, end)
    looked, left_of = [], zone_alarms._left_of
    monkeypatch.setattr(zone_alarms, "_left_of", lambda a, b, p: (looked.append(np.broadcast(a, p).size), left_of(a, b, p))[1])
    assert shape.crossings(start, end).tolist() == expected
    assert np.count_nonzero(expected) > 10
    assert sum(looked) < 100_000, "of 2,000 ways with 999 edges"


@given(SITES, st.integers(3, 12), st.lists(PLACE, max_size=20), st.sampled_from([0.0, 100.0]))
def test_inside_and_near_are_what_two_tests_of_every_position_say(
    site: tuple[float, float], corners: int, places: list[tuple[int, int]], margin_m: float
) -> None:
    turn = 2.0 * np.pi * np.arange(corners) / corners
    radius = np.where(np.arange(corners) % 2, 2.0, 3.0)
    ring = [(round(r * np.cos(t)), round(r * np.sin(t))) for r, t in zip(radius, turn, strict=True)]
    points = placed(site, list(dict.fromkeys(ring)))
    shape = Shape(1, Zone(name="port", kind="polygon", points_deg=tuple(map(tuple, points.tolist()))), margin_m)
    at = placed(site, places)
    inside, near = shape.contains(at)
    east, north = shape.chart_m(at).T
    assert inside.tolist() == contains_xy(shape.polygon, east, north).tolist()
    assert near.tolist() == (contains_xy(shape.polygon.buffer(margin_m), east, north) | inside).tolist()
