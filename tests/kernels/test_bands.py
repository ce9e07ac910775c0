"""Points in bands: the order, and that every pair within the gate is found anywhere on Earth."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coastwatch.geodesy import earth_centred
from coastwatch.kernels.association import prune_pairs as screening
from coastwatch.kernels.association.candidate_pairs import candidates, fill_halo
from coastwatch.kernels.geometry.bands import PART, TURN, height_deg, in_order
from coastwatch.kernels.threads import threads

OPEN = screening.Rule(0.0, 10.0, 0.5, 2.0, 0.9, 20.0, 0.01, 4.0, -np.inf)


def points(seed, n, reach_m):
    """Clusters as wide as the reach: at the equator, near the poles, on the antimeridian, anywhere."""
    rng = np.random.default_rng([seed, 0])
    centre = np.array(
        [[0.0, 10.0], [89.99, 0.0], [-84.9, 180.0], [47.0, -180.0], [-90.0, 7.0], *rng.uniform(-80.0, 80.0, (3, 2))]
    )
    spread = reach_m / 111_000.0 * rng.normal(0.0, 1.0, (n, 2))
    out = centre[rng.integers(0, len(centre), n)] + spread / np.stack([np.ones(n), rng.choice([1.0, 0.05], n)], axis=1)
    return np.stack([np.clip(out[:, 0], -90.0, 90.0), (out[:, 1] + 180.0) % 360.0 - 180.0], axis=1), rng.integers(0, 3, n)


def pairs_within(position, source, gate_m, home=None, halo=None):
    """Rows of pairs that the kernel finds with screening open."""
    n = len(position)
    key, row, _ = in_order(position, gate_m, np.empty)
    point = np.column_stack([earth_centred(position), source])[row]
    rule = OPEN._replace(gate=gate_m)
    home = np.zeros(n, np.int64) if home is None else home
    table = np.full(64, -1, np.int64)
    if halo is not None:
        fill_halo(*halo, table)
    places = key, point, home[row].astype(np.int32), np.arange(n, dtype=np.int32), row, table, height_deg(gate_m), 2.0
    tracks = np.ones(n, np.int32), np.zeros((n, 16)), np.zeros((n, screening.COLUMNS))
    first, second, density, tested = candidates(0, n, *places, *tracks, rule, screening.cuts(rule, 1))
    assert tested == len(first)
    around = np.bincount(first, minlength=n)[first]
    assert density == pytest.approx(np.maximum(around - 1, 1) / (np.pi * gate_m**2))
    return sorted(zip(row[first].tolist(), row[second].tolist(), strict=True))


def brute_force(position, source, gate_m):
    p = earth_centred(position)
    gap = np.linalg.norm(p[:, None] - p[None], axis=2)
    return list(zip(*(x.tolist() for x in np.nonzero((gap <= gate_m) & (source[:, None] < source[None]))), strict=True))


@given(st.integers(0, 10**6), st.integers(0, 60), st.sampled_from([5.0, 400.0, 1000.0, 60_000.0, 3e6, 1e7]))
def test_every_pair_within_the_gate_is_found(seed, n, gate_m):
    position, source = points(seed, n, gate_m)
    assert pairs_within(position, source, gate_m) == brute_force(position, source, gate_m)


def test_a_pair_across_spots_counts_where_the_second_is_in_the_halo_of_the_first():
    position = np.array([[10.0, 20.0], [10.0, 20.001], [10.001, 20.0]])
    source, home = np.array([0, 1, 2]), np.array([0, 1, 2])
    assert pairs_within(position, source, 1000.0, home) == []
    halo = np.array([0, 2, 2], np.int32), np.array([1, 0, 1])
    assert pairs_within(position, source, 1000.0, home, halo) == [(0, 1)]
    assert pairs_within(position, source, 1000.0, np.array([-1, 1, 1])) == [(1, 2)], "a row that is no member has no pairs"


@pytest.mark.parametrize("n", [0, 1, PART + 1, 3 * PART])
def test_the_order_is_by_key_then_row_and_threads_do_not_matter(n):
    position, _ = points(1, n, 1000.0)
    key, row, rank = in_order(position, 1000.0, np.empty)
    assert np.array_equal(rank[row], np.arange(n))
    assert (np.diff(key * 2**28 + row) > 0).all()
    longitude = np.floor((position[row, 1] + 180.0) / 360.0 * TURN).astype(np.int64) % TURN
    assert np.array_equal(key % TURN, longitude)
    with threads(3):
        others = in_order(position, 1000.0, np.empty)
    assert all(a.tobytes() == b.tobytes() for a, b in zip((key, row, rank), others, strict=True))
