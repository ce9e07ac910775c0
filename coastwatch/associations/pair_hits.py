"""Pairs that pass a check in a cycle, how often each has passed in a row, and the one-to-one choice among associated pairs.

What is kept of a pair is two counters and one bit. Only pairs with a hit, or that are associated, are kept: all others are as new.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from coastwatch import kernels
from coastwatch.associations.inputs import AssociationInput
from coastwatch.associations.pairing import (
    PassedPairs,
    associations_of,
    gate_arrays,
    gated,
    one_to_one,
    over_members,
    passed_pairs,
)
from coastwatch.batches import Array, Associations, Bools, Floats, Ints, Struct, Tracks, column
from coastwatch.geodesy import difference_m
from coastwatch.stage import Arrays, Groups

MOST = 10_000  # where a counter stops; settings stay below
A_PAIR_M = 1e6  # what a pair is worth in metres of distance: the most pairs come first, then the least distance


class Check(NamedTuple):
    """What a pair must pass in a cycle."""

    gate_m: float  # greatest distance of the positions
    limit: float = math.inf  # greatest squared Mahalanobis distance of position and velocity
    measures_states: bool = False  # whether that distance is computed


def find_hits(check: Check, given: AssociationInput) -> PassedPairs:
    """The pairs that pass the check in this cycle, with distance, m, and squared Mahalanobis distance: infinite if not measured."""
    tracks = given.tracks
    arrays = gate_arrays(tracks, given.spots, check.gate_m)
    arrays |= {"position": tracks.position_deg, "velocity": tracks.velocity_m_s, "covariance": tracks.covariance}
    return passed_pairs(hits_in_spots, check, arrays, given)


def hits_in_spots(check: Check, arrays: Arrays, spots: Groups) -> tuple[Array, ...]:
    """Pairs that these spots own and that pass: rows of the first and second track, distances (A, 2); and how many are in the gate."""
    return over_members(_hits_of_members, arrays, spots, check)


def _hits_of_members(low: int, high: int, member: Ints, arrays: Arrays, check: Check) -> tuple[Array, ...]:
    """What `hits_in_spots` gives for the members low to high."""
    pair, row = gated(low, high, member, arrays, check.gate_m), arrays["place"]["row"]
    distances = np.empty((len(pair), 2))
    tracks = arrays["position"], arrays["velocity"], arrays["covariance"]
    kernels.association.pair_distance.pair_distances(pair, row, tracks, check.measures_states, distances)
    passed = (distances[:, 0] <= check.gate_m) & (distances[:, 1] <= check.limit)
    first, second = (row[pair[name][passed]].astype(np.int64) for name in ("first", "second"))
    return first, second, distances[passed], np.array([len(pair)])


@dataclass(frozen=True, eq=False)
class PairCounts(Struct):
    """Hits and misses in a row of the pairs that are kept."""

    first_id: Ints = column(np.int64, "P")
    second_id: Ints = column(np.int64, "P")
    hits: Ints = column(np.int64, "P")
    misses: Ints = column(np.int64, "P")
    associated: Bools = column(np.bool_, "P")

    def counted(
        self, tracks: Tracks, hits: PassedPairs, begin: int, end: int, at_once: Bools | None = None
    ) -> tuple[PairCounts, Ints, Ints]:
        """The counts after this cycle, and the associated pairs.

        Associated at the `begin`-th hit in a row, until the `end`-th miss in a row. A pair one of whose tracks has ended is dropped.
        Args: at_once: (A,) hits that associate immediately.
        Returns: counts; rows of the first and of the second track, (B,) each, by first, then second.
        """
        count, index_of = len(tracks), kernels.tables.match_ids.index_of
        first, second = (index_of(tracks.track_id, ids).astype(np.int64) for ids in (self.first_id, self.second_id))
        here = np.flatnonzero((first >= 0) & (second >= 0))
        kept = first[here] * count + second[here]
        key = hits.first * count + hits.second
        at = index_of(kept, key)
        counted_before, missed = at >= 0, np.ones(len(here), np.bool_)
        missed[at[counted_before]] = False
        missed &= self.associated[here]
        last = here[missed]
        misses = self.misses[last] + 1
        stays = misses < end
        last = last[stays]
        in_a_row, was = np.ones(len(key), np.int64), np.zeros(len(key), np.bool_)
        in_a_row[counted_before] = np.minimum(self.hits[here[at[counted_before]]] + 1, MOST)
        was[counted_before] = self.associated[here[at[counted_before]]]
        now = was | (in_a_row >= begin)
        if at_once is not None:
            now |= at_once
        key = np.concatenate([key, kept[missed][stays]])
        order = np.argsort(key)
        a, b = key[order] // max(count, 1), key[order] % max(count, 1)
        hit, left = len(in_a_row), len(last)
        after = PairCounts(
            tracks.track_id[a],
            tracks.track_id[b],
            np.append(in_a_row, np.zeros(left, np.int64))[order],
            np.append(np.zeros(hit, np.int64), misses[stays])[order],
            np.append(now, np.ones(left, np.bool_))[order],
        )
        return after, a[after.associated], b[after.associated]


def united(pairs: tuple[Ints, Ints], other_pairs: tuple[Ints, Ints], rows: int) -> tuple[Ints, Ints]:
    """The pairs of both, each once, by first, then second. Args: rows: N, of tracks."""
    key = np.union1d(pairs[0] * rows + pairs[1], other_pairs[0] * rows + other_pairs[1])
    return key // max(rows, 1), key % max(rows, 1)


def chosen(tracks: Tracks, first: Ints, second: Ints, statistic: Floats | None, hits: PassedPairs) -> Associations:
    """One-to-one associations: the most pairs, then the least sum of distances.

    Args: first, second: (A,) pairs, each once; statistic: (A,); none: the distance, m; hits: of this cycle.
    """
    distance = np.hypot(*difference_m(tracks.position_deg[second], tracks.position_deg[first]).T)
    gain = A_PAIR_M - np.minimum(distance, 0.5 * A_PAIR_M)
    kept = one_to_one(tracks, first, second, gain)
    shown = (distance if statistic is None else statistic)[kept]
    return associations_of(tracks, first[kept], second[kept], shown, gain[kept], is_distance=True, counts=hits)
