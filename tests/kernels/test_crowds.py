"""In a crowd each place is compared with the nearest alone, and the work of each is bounded; elsewhere no pair is left out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from test_candidate_pairs import brute_force, points

from coastwatch.geodesy import earth_centred
from coastwatch.kernels.association.candidate_pairs import candidate_pairs
from coastwatch.kernels.association.crowds import STEPS, WIDE, find_crowds
from coastwatch.kernels.association.places import sorted_places

pytestmark = pytest.mark.oracle


def found_pairs(position, source, gate_m, most, rank=None):
    """Rows of pairs, the distance to which each row is compared, and the crowds."""
    n = len(position)
    place = sorted_places(position, source, np.zeros(n, np.int64), gate_m)
    row = place["row"]
    crowds = find_crowds(place, (np.arange(n) if rank is None else rank)[row], gate_m, most)
    halo = np.zeros(n + 1, np.int64), np.zeros(0, np.int64)
    pair = candidate_pairs(0, n, np.arange(n), place, halo, crowds, gate_m)
    near_m = np.full(n, gate_m)
    if len(crowds.cell):
        crowded = crowds.cell >= 0
        near_m[row[crowded]] = crowds.near_m[crowds.cell[crowded]]
    pairs = sorted(zip(row[pair["first"]].tolist(), row[pair["second"]].tolist(), strict=True))
    return pairs, near_m, crowds


def in_cells_around(position, side_m):
    """How many are in the cell of each, and in the 26 beside it. (N,)"""
    cell = np.floor(earth_centred(position) / side_m).astype(np.int64)
    return (np.abs(cell[:, None] - cell[None]).max(axis=2) <= 1).sum(axis=1)


@given(
    st.integers(0, 10**6),
    st.integers(0, 90),
    st.sampled_from([5.0, 400.0, 1000.0, 60_000.0]),
    st.sampled_from([0.1, 0.4, 1.0]),
    st.sampled_from([4, 12, 30]),
)
def test_in_a_crowd_all_within_the_greatest_distance_with_few_enough_within_are_found(seed, n, gate_m, width, most):
    position, source = points(seed, n, width * gate_m)
    pairs, near_m, crowds = found_pairs(position, source, gate_m, most)
    gap = np.linalg.norm(earth_centred(position)[:, None] - earth_centred(position)[None], axis=2)
    wanted = np.argwhere((gap <= near_m[:, None]) & (source[:, None] < source[None])).tolist()
    alike = (gap <= near_m[:, None]).sum(axis=1) > most  # no distance tells them apart
    assert (near_m[alike] == gate_m * 0.5 ** (0.5 * STEPS)).all()
    assert [pair for pair in pairs if not alike[pair[0]]] == [tuple(pair) for pair in wanted if not alike[pair[0]]]
    assert set(pairs) <= {tuple(pair) for pair in wanted}
    for step in range(STEPS):
        side_m = gate_m * 0.5 ** (0.5 * step)
        within, around = (gap <= side_m).sum(axis=1), in_cells_around(position, side_m)
        assert (within[near_m == side_m] <= most).all()
        assert ((within > most) | (around > WIDE * most))[near_m < side_m].all()
    left = set(brute_force(position, source, gate_m)) - set(pairs)
    assert {first for first, _ in left} <= set(np.flatnonzero(near_m < gate_m).tolist())
    assert crowds.left_out >= len(left)
    if n <= WIDE * most and not alike.any():
        assert crowds.left_out == len(left)


@pytest.mark.parametrize("most", [31, 32, 33, 60])
def test_no_pair_is_left_out_where_no_more_than_most_are_within_the_gate(most):
    rng = np.random.default_rng([41, 0])
    position = np.array([50.0, -1.0]) + rng.uniform(0.0, 0.06, (1500, 2))
    source, gap = np.arange(1500) % 2, earth_centred(position)
    within = (np.linalg.norm(gap[:, None] - gap[None], axis=2) <= 400.0).sum(axis=1)
    keep = np.flatnonzero(within <= most)
    position, source = position[keep], source[keep]
    assert in_cells_around(position, 400.0).max() > 1.5 * most
    pairs, near_m, crowds = found_pairs(position, source, 400.0, most)
    assert pairs == sorted(brute_force(position, source, 400.0))
    assert (near_m == 400.0).all()
    assert crowds.left_out == 0


@given(st.integers(0, 10**6), st.integers(0, 90))
def test_crowds_do_not_depend_on_the_order_of_rows(seed, n):
    position, source = points(seed, n, 300.0)
    position[: n // 2] = position[:1]  # in one point: no cell tells them apart
    shuffled = np.random.default_rng([seed, 1]).permutation(n)
    pairs, near_m, crowds = found_pairs(position, source, 1000.0, 12)
    again, near_again_m, crowds_again = found_pairs(position[shuffled], source[shuffled], 1000.0, 12, shuffled)
    assert sorted((shuffled[a], shuffled[b]) for a, b in again) == pairs
    assert near_again_m.tolist() == near_m[shuffled].tolist()
    assert crowds_again.left_out == crowds.left_out


@pytest.mark.parametrize("spread_m", [0.0, 0.5, 200.0, 1500.0])
def test_the_pairs_of_a_crowd_grow_no_faster_than_the_crowd(spread_m):
    most, each = 60, []
    for n in (1000, 2000, 4000):
        rng = np.random.default_rng([n, 0])
        position = np.array([50.0, -1.0]) + rng.normal(0.0, spread_m / 111_000.0, (n, 2))
        pairs, _, crowds = found_pairs(position, np.arange(n) % 2, 1000.0, most)
        each.append(len(pairs) / n)
        assert np.bincount([first for first, _ in pairs], minlength=1).max() <= most
        assert crowds.left_out > n * n / 16
    assert max(each) <= most
    assert each[-1] <= 2.0 * each[0] + 1.0


def test_the_own_cell_comes_first_among_places_that_nothing_tells_apart():
    position = np.tile([[10.0, 20.0]], (100, 1))
    position[:50, 1] += 1e-5
    pairs, _, _ = found_pairs(position, np.arange(100) % 2, 1.0, 10)
    assert all((a < 50) == (b < 50) for a, b in pairs)
    assert pairs
