"""Every pair within the gate is found anywhere on Earth, and no other."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from coastwatch.geodesy import earth_centred
from coastwatch.kernels.association.candidate_pairs import candidate_pairs
from coastwatch.kernels.association.crowds import no_crowds
from coastwatch.kernels.association.places import sorted_places

pytestmark = pytest.mark.oracle


def points(seed, n, reach_m):
    """Clusters as wide as the reach: at the equator, near the poles, on the antimeridian, anywhere."""
    rng = np.random.default_rng([seed, 0])
    centre = np.array(
        [[0.0, 10.0], [89.99, 0.0], [-84.9, 180.0], [47.0, -180.0], [-90.0, 7.0], *rng.uniform(-80.0, 80.0, (3, 2))]
    )
    spread = reach_m / 111_000.0 * rng.normal(0.0, 1.0, (n, 2))
    out = centre[rng.integers(0, len(centre), n)] + spread / np.stack([np.ones(n), rng.choice([1.0, 0.05], n)], axis=1)
    return np.stack([np.clip(out[:, 0], -90.0, 90.0), (out[:, 1] + 180.0) % 360.0 - 180.0], axis=1), rng.integers(0, 3, n)


def pairs_within(position, source, gate_m, spot=None, halo=None, member=None):
    """Rows of pairs. Args: halo: the spots whose halo each row is in, a list each; member: rows that may be the first."""
    n = len(position)
    place = sorted_places(position, source, np.zeros(n, np.int64) if spot is None else spot, gate_m)
    halo = [[] for _ in range(n)] if halo is None else halo
    start = np.cumsum([0, *map(len, halo)])
    halo = start, np.array([k for spots in halo for k in spots], np.int64)
    members = np.flatnonzero(np.isin(place["row"], np.arange(n) if member is None else member))
    pair = candidate_pairs(0, len(members), members, place, halo, no_crowds(), gate_m)
    around = np.bincount(pair["first"], minlength=n)[pair["first"]]
    assert pair["density"] == pytest.approx(np.maximum(around - 1, 1) / (np.pi * gate_m**2))
    row = place["row"]
    return sorted(zip(row[pair["first"]].tolist(), row[pair["second"]].tolist(), strict=True))


def brute_force(position, source, gate_m):
    p = earth_centred(position)
    gap = np.linalg.norm(p[:, None] - p[None], axis=2)
    return list(zip(*(x.tolist() for x in np.nonzero((gap <= gate_m) & (source[:, None] < source[None]))), strict=True))


@given(st.integers(0, 10**6), st.integers(0, 60), st.sampled_from([5.0, 400.0, 1000.0, 60_000.0, 3e6, 1e7]))
def test_every_pair_within_the_gate_is_found(seed, n, gate_m):
    position, source = points(seed, n, gate_m)
    assert pairs_within(position, source, gate_m) == brute_force(position, source, gate_m)


def test_more_pairs_than_there_is_room_for_at_first():
    position = np.tile([[10.0, 20.0]], (400, 1))
    source = np.arange(400) % 2
    assert len(pairs_within(position, source, 10.0)) == 200 * 200


def test_a_pair_across_spots_counts_where_the_second_is_in_the_halo_of_the_first():
    position = np.array([[10.0, 20.0], [10.0, 20.001], [10.001, 20.0]])
    source, spot = np.array([0, 1, 2]), np.array([0, 1, 2])
    assert pairs_within(position, source, 1000.0, spot) == []
    assert pairs_within(position, source, 1000.0, spot, [[2], [0], [1, 2]]) == [(0, 1), (1, 2)]
    assert pairs_within(position, source, 1000.0, spot, [[2], [0], [1, 2]], [1, 2]) == [(1, 2)]
    assert pairs_within(position, source, 1000.0, np.array([3, 1, 1])) == [(1, 2)]
