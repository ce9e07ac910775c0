"""Candidate pairs of bearing tracks and vessels by octant, against loops over sets."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from coastwatch.geodesy import wrap_deg
from coastwatch.kernels.bearings.candidates import (
    SECTORS,
    pairs_of_tracks,
    sector_of,
    tracks_by_octant,
    vessels_by_octant,
)
from coastwatch.kernels.tables.groups import median_of_groups, ranges

pytestmark = pytest.mark.oracle

SENSORS, VESSELS = 4, 90


@pytest.mark.parametrize("seed", range(5))
def test_tracks_of_octants(seed: int) -> None:
    rng = np.random.default_rng([seed, 9])
    octant_of = rng.integers(0, SENSORS * SECTORS, 60)
    count = rng.integers(0, 4, 60)  # pairs of each track; some have none
    row, start = tracks_by_octant(np.repeat(np.arange(60), count), np.repeat(octant_of, count))
    used = np.unique(octant_of[count > 0])
    assert len(start) == len(used) + 1
    for k, octant in enumerate(used):
        np.testing.assert_array_equal(row[start[k] : start[k + 1]], np.flatnonzero((octant_of == octant) & (count > 0)))


def test_no_pair_is_no_octant() -> None:
    none = np.zeros(0, np.int64)
    row, start = tracks_by_octant(none, none)
    assert (row.tolist(), start.tolist()) == ([], [0])


def test_vessels_of_octants_and_tracks_with_them() -> None:
    rng = np.random.default_rng(8)
    direction = np.append(rng.uniform(-180.0, 180.0, 292), 45.0 * np.arange(-4, 4))
    tolerance, sensor = rng.uniform(0.0, 60.0, 300), rng.integers(0, SENSORS, 300)
    tolerance[::3] = 0.0
    row = np.sort(rng.integers(0, VESSELS, 300))
    start, vessel, from_middle = vessels_by_octant(direction, tolerance, sensor, row, SENSORS)
    off = np.abs(wrap_deg(direction[:, None] - 45.0 * (np.arange(SECTORS) + 0.5)))
    near = (off <= 22.5 + tolerance[:, None]) | (np.arange(SECTORS) == (np.floor(direction / 45.0) % SECTORS)[:, None])
    for k in range(SENSORS * SECTORS):
        np.testing.assert_array_equal(vessel[start[k] : start[k + 1]], row[near[:, k % SECTORS] & (sensor == k // SECTORS)])
    octant = rng.integers(0, SENSORS * SECTORS, 20)
    track, of_track = pairs_of_tracks(octant, np.zeros(20), (start, vessel, from_middle), 300)
    np.testing.assert_array_equal(track, np.repeat(np.arange(20), np.diff(start)[octant]))
    np.testing.assert_array_equal(of_track, np.concatenate([vessel[start[o] : start[o + 1]] for o in octant]))


@given(st.integers(0, 10**6), st.integers(0, 60), st.integers(0, 20), st.integers(1, 9))
def test_in_an_octant_of_many_vessels_each_track_has_those_nearest_in_direction(seed, vessels, tracks, most):
    rng = np.random.default_rng([seed, 9])
    direction = rng.integers(-180, 180, vessels) + rng.choice([0.0, 0.37], vessels)  # equal ones, and none half-way
    row, none = np.arange(vessels), np.zeros(vessels)
    found = vessels_by_octant(direction, none, np.zeros(vessels, np.int64), row, 1)
    octant, bearing = rng.integers(0, 3, tracks), rng.uniform(-22.5, 22.5, tracks)
    track, vessel = pairs_of_tracks(octant, bearing, found, most)
    assert (np.lexsort((vessel, track)) == np.arange(len(track))).all()
    for k in range(tracks):
        inside = np.flatnonzero(np.abs(wrap_deg(direction - 45.0 * octant[k] - 22.5)) <= 22.5)
        off = np.abs(wrap_deg(direction[inside] - 45.0 * octant[k] - 22.5) - bearing[k])
        got = vessel[track == k]
        assert len(got) == min(len(inside), most) == len(np.unique(got))
        assert np.isin(got, inside).all()
        of_got = np.abs(wrap_deg(direction[got] - 45.0 * octant[k] - 22.5) - bearing[k])
        np.testing.assert_allclose(np.sort(of_got), np.sort(off)[:most], atol=1e-9)


def test_sectors_begin_at_their_border() -> None:
    direction = np.array([0.0, 44.999, 45.0, 359.999, -0.001, -180.0, 180.0])
    assert sector_of(direction).tolist() == [0, 0, 1, 7, 7, 4, 4]


def test_ranges() -> None:
    assert ranges(np.array([5, 9, 0]), np.array([2, 0, 3])).tolist() == [5, 6, 0, 1, 2]
    assert ranges(np.zeros(0, np.int64), np.zeros(0, np.int64)).tolist() == []


def test_medians_of_groups() -> None:
    rng = np.random.default_rng(4)
    group, value = rng.integers(0, 12, 101), rng.normal(size=101)
    group[group == 7] = 3
    count, median = median_of_groups(group, value, 13)
    np.testing.assert_array_equal(count, np.bincount(group, minlength=13))
    expected = [np.median(value[group == g]) if (group == g).any() else np.nan for g in range(13)]
    np.testing.assert_array_equal(median, expected)
