"""Pairs brought in order and numbered, rows joined by pairs, against numpy's sorts and sets."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from coastwatch.kernels.association.connected_components import joined, joined_without_sharing, numbered, told_of
from coastwatch.kernels.tables.groups import NEAR, NOWHERE, alone, by_both, combined, gathered, greatest, parted
from coastwatch.kernels.tables.sorting import chosen

ROWS, SOURCES = 12, 4


def pairs(seed, count):
    rng = np.random.default_rng([seed, 6])
    return rng.integers(0, ROWS, (2, count))


@given(st.integers(0, 10**6), st.integers(0, 40))
def test_order_and_numbers(seed, count):
    first, second = pairs(seed, count)
    assert np.array_equal(by_both(first, ROWS, second, ROWS), np.lexsort((second, first)))
    number, most = combined(first, ROWS, second, ROWS)
    every, inverse = np.unique(first * ROWS + second, return_inverse=True)
    assert most == len(every)
    assert np.array_equal(number, inverse)


@given(st.integers(0, 10**6), st.integers(0, 20))
def test_alone(seed, count):
    first, second = pairs(seed, count)
    gain = np.random.default_rng([seed, 7]).integers(-1, 3, count).astype(float)
    useful = gain > 0.0
    firsts, seconds = (np.bincount(side[useful], minlength=ROWS)[side] for side in (first, second))
    assert np.array_equal(alone(first, second, gain, ROWS), useful & (firsts == 1) & (seconds == 1))


def test_alone_counts_beyond_a_byte():
    first, second = np.zeros(600, np.int64), np.arange(600)
    assert not alone(first, second, np.ones(600), 600).any()


def grouped(first, second, members):
    """Sets of rows that pairs join; where a set would have two members of one source, left out."""
    group = {row: {row} for row in range(ROWS)}
    stands = []
    for a, b in zip(first.tolist(), second.tolist(), strict=True):
        same = group[a] is group[b]
        stands.append(same or members is None or not {members[r] for r in group[a]} & {members[r] for r in group[b]})
        if stands[-1] and not same:
            group[a] |= group[b]
            for row in group[b]:
                group[row] = group[a]
    return group, stands


@given(st.integers(0, 10**6), st.integers(0, 14))
def test_groups(seed, count):
    first, second = pairs(seed, count)
    source = np.random.default_rng([seed, 8]).integers(0, SOURCES, ROWS)
    keep = source[first] != source[second]
    first, second = first[keep], second[keep]
    parent, following, twice = joined(first, second, source)
    group, _ = grouped(first, second, None)
    want = {row: min(members) for row, members in group.items()}
    number = {low: k for k, low in enumerate(sorted(set(want.values())))}
    assert numbered(parent).tolist() == [number[want[row]] for row in range(ROWS)]
    crowded = [len({source[r] for r in group[row]}) < len(group[row]) for row in range(ROWS)]
    broken = told_of(parent, twice, first)
    assert broken.tolist() == [crowded[row] for row in first]
    stands = joined_without_sharing(first[broken], second[broken], source, parent, following)
    group, wanted = grouped(first, second, source)
    assert stands.tolist() == np.array(wanted, np.bool_)[broken].tolist()
    want = {row: min(members) for row, members in group.items()}
    number = {low: k for k, low in enumerate(sorted(set(want.values())))}
    assert numbered(parent).tolist() == [number[want[row]] for row in range(ROWS)]


def test_members_and_halos():
    row, start, rank = np.array([2, 0, -4, -2, 1, -1]), np.array([0, 3, 3, 6]), np.array([3, 1, 0, 2])
    members, low, home, halo_home, halo_row = parted(row, start, rank)
    assert (members, low, home.tolist()) == (3, 0, [0, 2, NEAR, 0])
    assert (halo_home.tolist(), halo_row.tolist()) == ([0, 2, 2], [3, 1, 0])
    members, low, home, halo_home, halo_row = parted(row[1:4], np.array([0, 3]), np.array([9, 6, 0, 8, 1, 2, 3, 4, 5, 7]))
    assert (members, low, home.tolist()) == (1, 6, [NEAR, NOWHERE, NEAR, 0])
    assert (halo_home.tolist(), halo_row.tolist()) == ([0, 0], [3, 1])
    assert parted(row[:0], start[:1], rank)[2].tolist() == []


def test_chosen_groups():
    row, start = np.arange(10, 16), np.array([0, 2, 2, 5, 6])
    rows, starts = chosen(row, start, np.array([3, 0, 1, 2]))
    assert (rows.tolist(), starts.tolist()) == ([15, 10, 11, 12, 13, 14], [0, 1, 3, 3, 6])
    assert [a.tolist() for a in chosen(row, start, np.zeros(0, np.int64))] == [[], [0]]


def test_what_is_somewhere_is_brought_together():
    key, point = np.arange(10, 17), np.random.default_rng([5, 1]).normal(0.0, 1.0, (7, 4))
    home = np.array([4, NOWHERE, NEAR, 0, NOWHERE], np.int32)
    keys, points, homes, track, top = gathered(2, home, 4, key, point)
    assert (keys.tolist(), homes.tolist(), track.tolist()) == ([12, 14, 15], [4, NEAR, 0], [2, 4, 5])
    assert points.tolist() == point[[2, 4, 5]].tolist()
    assert top == max(points[:, 3].max(), 0.0)
    assert greatest(point, 3) == max(point[:, 3].max(), 0.0)
    assert gathered(7, home[:0], 0, key, point)[4] == greatest(-np.abs(point), 3) == 0.0
