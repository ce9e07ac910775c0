"""Passes over pairs of bearing tracks and vessels, against sorting and sets of numpy."""

from __future__ import annotations

import numpy as np
import pytest

from coastwatch.geodesy import to_plane, wrap_deg
from coastwatch.kernels.bearings.candidates import (
    SECTORS,
    above,
    by_octant,
    first_pairs,
    heard_by,
    inside,
    medians,
    merged,
    paired,
    pairs_of,
    standing,
    within_sectors,
)

SENSORS, VESSELS = 4, 90


def octants(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Pairs as the octants have them: track, vessel, octant; and how many tracks there are. Some tracks have no pair."""
    rng = np.random.default_rng([seed, 9])
    octant_of = rng.integers(0, SENSORS * SECTORS, 60)
    held = [np.sort(rng.choice(VESSELS, int(rng.integers(0, 9)), replace=False)) for _ in range(SENSORS * SECTORS)]
    vessel = [held[o] for o in octant_of]
    size = [len(v) for v in vessel]
    return np.repeat(np.arange(60), size), np.concatenate(vessel), np.repeat(octant_of, size), 60


@pytest.mark.parametrize("seed", range(5))
def test_tracks_and_vessels_of_octants_and_sensors(seed: int) -> None:
    track, vessel, octant, tracks = octants(seed)
    first = first_pairs(track, tracks)
    np.testing.assert_array_equal(first, np.searchsorted(track, np.arange(tracks + 1)))
    row, start = by_octant(first, octant, SENSORS)
    for k in range(SENSORS * SECTORS):
        np.testing.assert_array_equal(row[start[k] : start[k + 1]], np.unique(track[octant == k]))
    heard, begin = heard_by(row, start, first, vessel, VESSELS)
    expected = np.unique(octant // SECTORS * VESSELS + vessel)
    np.testing.assert_array_equal(np.repeat(np.arange(SENSORS), np.diff(begin)) * VESSELS + heard, expected)
    at = np.empty(len(vessel), np.int64)
    for low, high in ((0, 7), (7, len(vessel))):
        standing(low, high, begin, heard, octant // SECTORS, vessel, at)
    np.testing.assert_array_equal(expected[at], octant // SECTORS * VESSELS + vessel)


def test_vessels_of_sectors_and_tracks_with_them() -> None:
    rng = np.random.default_rng(8)
    direction = np.append(rng.uniform(-180.0, 180.0, 292), 45.0 * np.arange(-4, 4))
    tolerance, sensor = rng.uniform(0.0, 60.0, 300), rng.integers(0, SENSORS, 300)
    tolerance[::3] = 0.0
    row = np.sort(rng.integers(0, VESSELS, 300))
    vessel, start = within_sectors(direction, tolerance, sensor, row, SENSORS)
    off = np.abs(wrap_deg(direction[:, None] - 45.0 * (np.arange(SECTORS) + 0.5)))
    near = (off <= 22.5 + tolerance[:, None]) | (np.arange(SECTORS) == (np.floor(direction / 45.0) % SECTORS)[:, None])
    for k in range(SENSORS * SECTORS):
        np.testing.assert_array_equal(vessel[start[k] : start[k + 1]], row[near[:, k % SECTORS] & (sensor == k // SECTORS)])
    octant = rng.integers(0, SENSORS * SECTORS, 20)
    track, of_track, of = paired(octant, start, vessel)
    np.testing.assert_array_equal(track, np.repeat(np.arange(20), np.diff(start)[octant]))
    np.testing.assert_array_equal(of_track, np.concatenate([vessel[start[o] : start[o + 1]] for o in octant]))
    np.testing.assert_array_equal(of, octant[track])


def test_inside_is_reach_and_arc_in_the_tangent_plane() -> None:
    rng = np.random.default_rng(3)
    site = np.array([[-22.9, -43.1], [0.0, 179.99], [np.nan, np.nan]])
    place = np.concatenate([site[k] + rng.uniform(-0.1, 0.1, (400, 2)) for k in range(2)] + [np.zeros((5, 2))])
    place[:, 1] = (place[:, 1] + 180.0) % 360.0 - 180.0
    begin, reach = np.array([0, 400, 800, 805]), np.array([9000.0, 7000.0, 9000.0])
    arc_from, arc_width = np.array([5.5, 0.0, 0.0]), np.array([1.5, 2.0 * np.pi, 2.0 * np.pi])
    of = np.repeat(np.arange(3), np.diff(begin))
    east, north = to_plane(place, site[of]).T
    expected = (np.hypot(east, north) <= reach[of]) & (
        (np.arctan2(east, north) - arc_from[of]) % (2.0 * np.pi) <= arc_width[of]
    )
    within = np.empty(805, np.bool_)
    for low, high in ((0, 1), (1, 3)):
        inside(low, high, begin, np.arange(805), place, site, reach, arc_from, arc_width, within)
    np.testing.assert_array_equal(within, expected)
    assert 20 < expected[:400].sum() < expected[400:800].sum()
    assert not expected[800:].any()


def test_medians_of_groups() -> None:
    rng = np.random.default_rng(4)
    group, value = rng.integers(0, 12, 101), rng.normal(size=101)
    group[group == 7] = 3
    count, median = medians(group, value, 13)
    np.testing.assert_array_equal(count, np.bincount(group, minlength=13))
    expected = [np.median(value[group == g]) if (group == g).any() else np.nan for g in range(13)]
    np.testing.assert_array_equal(median, expected)


def test_pairs_of_some_tracks_and_those_above_a_threshold() -> None:
    rng = np.random.default_rng(5)
    first = np.concatenate([[0], np.cumsum(rng.integers(0, 6, 30))])
    some, value = rng.permutation(30)[:20], rng.integers(0, 1000, first[-1])
    pair = np.concatenate([np.arange(first[i], first[i + 1]) for i in some])
    start, taken = pairs_of(some, first, value)
    np.testing.assert_array_equal(taken, value[pair])
    np.testing.assert_array_equal(np.diff(start), np.diff(first)[some])
    gain = rng.normal(size=len(pair))
    gain[:4] = np.nan, -np.inf, 0.2, np.inf
    which, of_all = above(some, first, start, gain, 0.2)
    np.testing.assert_array_equal(which, np.flatnonzero(gain > 0.2))
    np.testing.assert_array_equal(of_all, pair[which])


@pytest.mark.parametrize("seed", range(20))
def test_ids_are_merged_and_new_ones_get_the_lowest_free_slots(seed: int) -> None:
    rng = np.random.default_rng([seed, 6])
    ids, new = (np.sort(rng.choice(40, int(rng.integers(0, 20)), replace=False)) for _ in range(2))
    slot, last_s = rng.permutation(30)[: len(ids)], rng.uniform(0.0, 9.0, len(ids))
    every, slots, last, given = merged(ids, slot, last_s, new, 10.0)
    np.testing.assert_array_equal(every, np.union1d(ids, new))
    np.testing.assert_array_equal(slots[np.searchsorted(every, ids)], slot)
    fresh = np.setdiff1d(new, ids)
    free = np.setdiff1d(np.arange(80), slot)[: len(fresh)]
    np.testing.assert_array_equal(slots[np.searchsorted(every, fresh)], free)
    np.testing.assert_array_equal(given, slots[np.searchsorted(every, new)])
    expected = np.full(40, np.nan)
    expected[ids], expected[new] = last_s, 10.0
    np.testing.assert_array_equal(last, expected[every])
