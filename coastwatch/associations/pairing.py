"""Candidate pairs of a spot, one-to-one assignment, and how accepted pairs become vessels."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from coastwatch import kernels
from coastwatch.associations.inputs import AssociationInput
from coastwatch.batches import Array, Associations, Bools, Floats, Ints, Spots, Tracks
from coastwatch.kernels.threads import in_blocks
from coastwatch.stage import Arrays, Groups, S, Work

LEAST_TRACKS = 1024  # for a thread
MOST_NEAR = 512
"""Tracks within the gate of one that it is compared with, itself one of them. Of more it is compared with the nearest alone."""


class PassedPairs(NamedTuple):
    """Pairs that passed the check of a cycle, by first, then second."""

    first: Ints  # (A,) row of a track
    second: Ints  # (A,) row of a track of a later source
    score: Floats  # (A, d) what the check measured
    tested: int  # pairs inside the gate
    left_out: int  # more of them that were not looked at, at most

    def take(self, some: Bools) -> PassedPairs:
        """These pairs."""
        return self._replace(first=self.first[some], second=self.second[some], score=self.score[some])


def gate_arrays(tracks: Tracks, spots: Spots, gate_m: float) -> dict[str, Array]:
    """The arrays that `gated` reads: tracks in the order of a grid, the spots whose halo each is in, and what is crowded."""
    halo = Groups.by_key(spots.halo_row, len(tracks))
    place = kernels.association.places.sorted_places(tracks.position_deg, tracks.source, spots.spot, gate_m)
    crowds = kernels.association.crowds.find_crowds(place, tracks.track_id[place["row"]], gate_m, MOST_NEAR)
    of_crowds = *crowds[:-2], np.array(crowds[-2:])
    return {"place": place, "halo_start": halo.start, "halo_spot": spots.halo_spot[halo.row], "crowds": of_crowds}


def passed_pairs(work: Work[S], settings: S, arrays: Arrays, given: AssociationInput) -> PassedPairs:
    """The pairs that `work` lets pass, each once.

    Args: work: gives rows of the first and second track, what it measured, and (1,) how many it tested; arrays: of `gate_arrays`.
    """
    members = Groups.by_key(given.spots.spot, len(given.spots.centre_m))
    parts = given.map_(work, settings, arrays, members)
    first, second, score, tested = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(first * len(given.tracks) + second)
    left_out = int(arrays["crowds"][-1][1])
    return PassedPairs(first[order], second[order], score[order], int(tested.sum()), left_out)


def over_members(
    work: Callable[..., tuple[Array, ...]], arrays: Arrays, spots: Groups, *arguments: object
) -> tuple[Array, ...]:
    """What `work` gives for the members of these spots, over threads. Args: arrays: of `gate_arrays`."""
    place = arrays["place"]
    chosen = np.zeros(len(place), np.bool_)
    chosen[spots.row] = True
    member = np.flatnonzero(chosen[place["row"]] & (place["source"] < place["source"].max(initial=0)))
    parts = in_blocks(work, len(member), member, arrays, *arguments, least=LEAST_TRACKS)
    return tuple(np.concatenate(column) for column in zip(*parts, strict=True))


def gated(low: int, high: int, member: Ints, arrays: Arrays, gate_m: float) -> Array:
    """Pairs of tracks of different sources within the gate whose first is one of the members low to high.

    The second is a member of the same spot or in its halo. Returns: (A,) PAIR, rows of `place`.
    """
    halo = arrays["halo_start"], arrays["halo_spot"]
    *of_crowds, counts = arrays["crowds"]
    crowds = kernels.association.crowds.Crowds(*of_crowds, int(counts[0]), int(counts[1]))
    pairs: Array = kernels.association.candidate_pairs.candidate_pairs(low, high, member, arrays["place"], halo, crowds, gate_m)
    return pairs


def one_to_one(tracks: Tracks, first: Ints, second: Ints, gain: Floats) -> Ints:
    """Rows of the pairs of the best one-to-one assignment: a track has at most one partner in each other source.

    A pair whose tracks are in no other pair is taken without a search.
    Args: first, second: (A,) rows of tracks, pairs each once; gain: (A,), pairs without a positive gain are never chosen.
    Returns: (B,) indices into the pairs, sorted.
    """
    useful = gain > 0.0
    alone = useful & ~_repeated(first, useful, len(tracks)) & ~_repeated(second, useful, len(tracks))
    rest = np.flatnonzero(useful & ~alone)
    sources = int(tracks.source.max(initial=0)) + 1
    row, column = first[rest] * sources + tracks.source[second[rest]], second[rest] * sources + tracks.source[first[rest]]
    alone[rest] = kernels.association.assignment.assign(row, column, gain[rest])
    return np.flatnonzero(alone)


def _repeated(row: Ints, useful: Bools, rows: int) -> Bools:
    """Whether the row of each pair is in more than one useful pair."""
    return np.asarray(np.bincount(row[useful], minlength=rows)[row] > 1)


def associations_of(
    tracks: Tracks,
    first: Ints,
    second: Ints,
    statistic: Floats,
    gain: Floats,
    *,
    is_distance: bool,
    counts: PassedPairs | Associations,
) -> Associations:
    """The vessels that these pairs make, and the pairs that are kept.

    Args: first, second, statistic, gain: (A,); is_distance: as `Associations.statistic_is_distance`; counts: of pairs.
    """
    vessel, kept = vessels(tracks, first, second, gain)
    return Associations(first[kept], second[kept], statistic[kept], vessel, counts.tested, counts.left_out, is_distance)


def vessels(tracks: Tracks, first: Ints, second: Ints, gain: Floats) -> tuple[Ints, Ints]:
    """The vessel of every track, and the pairs that are kept. No vessel has two tracks of one source.

    Connected pairs are one vessel. If a component has two tracks of one source, its pairs are taken in order of gain. A pair
    that would join two tracks of one source is left out.
    Args: first, second, gain: (A,). Returns: (N,) vessel of each track, numbered by first track row; (B,) indices of pairs kept.
    """
    components, rows = kernels.association.connected_components.components, len(tracks)
    vessel = components(first, second, rows)
    broken = _with_repeated_source(vessel, tracks.source)[vessel[first]]
    if not broken.any():
        return vessel, np.arange(len(first))
    pairs = np.flatnonzero(broken)
    order = pairs[np.lexsort((tracks.track_id[second[pairs]], tracks.track_id[first[pairs]], -gain[pairs]))]
    stands = ~broken
    stands[order] = kernels.association.connected_components.joined_without_sharing(first[order], second[order], tracks.source)
    kept = np.flatnonzero(stands)
    return components(first[kept], second[kept], rows), kept


def _with_repeated_source(vessel: Ints, source: Ints) -> Bools:
    """Whether each vessel has two tracks of one source. Args: (N,), (N,). Returns: (V,)."""
    size = np.bincount(vessel)
    rows = np.flatnonzero(size[vessel] > 2)  # two tracks that are a pair are of different sources
    sources = int(source.max(initial=0)) + 1
    key = np.sort(vessel[rows] * sources + source[rows])
    has_repeated = np.zeros(len(size), np.bool_)
    has_repeated[key[1:][key[1:] == key[:-1]] // sources] = True
    return has_repeated
