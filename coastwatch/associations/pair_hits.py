"""Pairs that pass a check in a cycle, how often each has passed in a row, and the one-to-one choice among associated pairs.

What is kept of a pair is two counters and one bit. Only pairs with a hit, or that are associated, are kept: all others are as new.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from coastwatch import kernels
from coastwatch.associations.pairing import (
    blocks_of_members,
    gate_arrays,
    gated,
    joined_parts,
    left_out,
    members_of_spots,
    one_to_one,
    vessels,
)
from coastwatch.batches import Array, Associations, Bools, Floats, Ints, Spots, Struct, Tracks, column
from coastwatch.geodesy import difference_m
from coastwatch.stage import Arrays, Groups, Map

MOST = 10_000  # where a counter stops; settings stay below
A_PAIR_M = 1e6  # what a pair is worth in metres of distance: the most pairs come first, then the least distance


class Check(Protocol):
    """What a method checks of a pair in a cycle."""

    @property
    def gate_m(self) -> float:
        """Greatest distance of the positions."""
        ...

    @property
    def limit(self) -> float:
        """Greatest squared Mahalanobis distance of the states; infinite: the distance of the positions alone."""
        ...

    @property
    def measures_states(self) -> bool:
        """Whether the squared Mahalanobis distance is computed."""
        ...


class Hits(NamedTuple):
    """Pairs that passed the check of a cycle, by first, then second."""

    first: Ints  # (A,) row of a track
    second: Ints  # (A,) row of a track of a later source
    distance_m: Floats  # (A,)
    squared: Floats  # (A,) Mahalanobis distance of the states, squared; infinite where it was not measured
    tested: int  # pairs inside the gate
    left_out: int  # more of them that were not looked at, at most

    def take(self, some: Bools) -> Hits:
        """These pairs."""
        return Hits(self.first[some], self.second[some], self.distance_m[some], self.squared[some], self.tested, self.left_out)


def find_hits(check: Check, tracks: Tracks, spots: Spots, map_: Map) -> Hits:
    """The pairs that pass the check in this cycle."""
    arrays = gate_arrays(tracks, spots, check.gate_m)
    arrays |= {"position": tracks.position_deg, "velocity": tracks.velocity_m_s, "covariance": tracks.covariance}
    parts = map_(hits_in_spots, check, arrays, members_of_spots(spots))
    first, second, distances, tested = joined_parts(parts, len(tracks))
    return Hits(first, second, distances[:, 0], distances[:, 1], tested, left_out(arrays))


def hits_in_spots(check: Check, arrays: Arrays, spots: Groups) -> tuple[Array, ...]:
    """Pairs that these spots own and that pass: rows of the first and second track, distances (A, 2); and how many are in the gate."""
    parts = blocks_of_members(_hits_of_members, arrays, spots, check.gate_m, check.limit, check.measures_states)
    return tuple(np.concatenate(column) for column in zip(*parts, strict=True))


def _hits_of_members(
    low: int, high: int, member: Ints, arrays: Arrays, gate_m: float, limit: float, measures_states: bool
) -> tuple[Array, ...]:
    """What `hits_in_spots` gives for the members low to high."""
    pair, row = gated(low, high, member, arrays, gate_m), arrays["place"]["row"]
    distances = np.empty((len(pair), 2))
    tracks = arrays["position"], arrays["velocity"], arrays["covariance"]
    kernels.association.pair_distance.pair_distances(pair, row, tracks, measures_states, distances)
    passed = (distances[:, 0] <= gate_m) & (distances[:, 1] <= limit)
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

    @staticmethod
    def none() -> PairCounts:
        """Before the first cycle."""
        zero = np.zeros(0, np.int64)
        return PairCounts(zero, zero, zero, zero, np.zeros(0, np.bool_))

    def counted(
        self, tracks: Tracks, hits: Hits, begin: int, end: int, at_once: Bools | None = None
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
        known, missed = at >= 0, np.ones(len(here), np.bool_)
        missed[at[known]] = False
        missed &= self.associated[here]
        last = here[missed]
        misses = self.misses[last] + 1
        stays = misses < end
        last = last[stays]
        in_a_row, was = np.ones(len(key), np.int64), np.zeros(len(key), np.bool_)
        in_a_row[known] = np.minimum(self.hits[here[at[known]]] + 1, MOST)
        was[known] = self.associated[here[at[known]]]
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


def united(some: tuple[Ints, Ints], more: tuple[Ints, Ints], rows: int) -> tuple[Ints, Ints]:
    """The pairs of both, each once, by first, then second. Args: rows: N, of tracks."""
    key = np.union1d(some[0] * rows + some[1], more[0] * rows + more[1])
    return key // max(rows, 1), key % max(rows, 1)


def chosen(tracks: Tracks, first: Ints, second: Ints, statistic: Floats | None, found: Hits) -> Associations:
    """One-to-one associations: the most pairs, then the least sum of distances.

    Args: first, second: (A,) pairs, each once; statistic: (A,); none: the distance, m; found: hits of this cycle.
    """
    distance = np.hypot(*difference_m(tracks.position_deg[second], tracks.position_deg[first]).T)
    gain = A_PAIR_M - np.minimum(distance, 0.5 * A_PAIR_M)
    taken = one_to_one(tracks, first, second, gain)
    first, second, gain = first[taken], second[taken], gain[taken]
    shown = (distance if statistic is None else statistic)[taken]
    vessel, kept = vessels(tracks, first, second, gain)
    return Associations(first[kept], second[kept], shown[kept], vessel, found.tested, found.left_out)
