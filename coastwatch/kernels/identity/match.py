"""Votes of tracks for vessels: which vessel of the last cycle a group of tracks continues.

A vessel is a row of the vessels known from the last cycle. A group is the tracks that are associated in this cycle.
"""

from __future__ import annotations

import numpy as np

from coastwatch.kernels.jit import jit

FIRST_VESSEL_SHARE = 0.1
"""Share of a track's weight that goes to the first vessel it ever was in: a pair joined in error splits into its old vessels."""


@jit
def _add_vote(vessels, gains, begin, end, vessel, weight):  # type: ignore[no-untyped-def]
    """Add a vote to the entries begin to end, which hold one vessel each. Returns: the end after it."""
    for k in range(begin, end):
        if vessels[k] == vessel:
            gains[k] += weight
            return end
    vessels[end], gains[end] = vessel, weight
    return end + 1


NOT_REMEMBERED, AS_FIRST, AS_PREVIOUS = range(3)
"""How a living track remembers a vessel: not at all, as the first it ever was in, as the one it was in at the last cycle."""


@jit
def recall(row_before, vessel, first_vessel, vessels):  # type: ignore[no-untyped-def]
    """What the tracks of this cycle remember of the vessels of the last one.

    Args:
        row_before: (N,) row of each track in the last cycle, -1 if it is new.
        vessel, first_vessel: (L,) the vessel that each track of the last cycle was in, and the first it ever was in.
        vessels: K, how many vessels are known.
    Returns: previous, first: (N,) vessels, -1 if the track is new; remembered: (K,) NOT_REMEMBERED, AS_FIRST or AS_PREVIOUS.
    """
    previous, first = np.full(len(row_before), -1, np.int32), np.full(len(row_before), -1, np.int32)
    remembered = np.full(vessels, NOT_REMEMBERED, np.int8)
    for n in range(len(row_before)):
        if row_before[n] >= 0:
            previous[n], first[n] = vessel[row_before[n]], first_vessel[row_before[n]]
            remembered[previous[n]] = AS_PREVIOUS
            if remembered[first[n]] == NOT_REMEMBERED:
                remembered[first[n]] = AS_FIRST
    return previous, first, remembered


@jit
def count_votes(first, last, groups, previous, first_vessel, weight, seniority):  # type: ignore[no-untyped-def]
    """Every vessel that groups first to last vote for, with the gain of continuing it; group by group.

    Args:
        groups: start, row: (V + 1,), (N,) the tracks of group g are row[start[g]:start[g + 1]].
        previous, first_vessel: (N,) the vessel that a track was in at the last cycle, and the first it ever was in; -1 if new.
        weight: (N,) of the vote of each track.
        seniority: (K,) added to the gain of each vessel.
    Returns: group, vessel, gain: (A,) each.
    """
    start, row = groups
    most = 2 * (start[last] - start[first])
    group, vessel, gain = np.empty(most, np.int64), np.empty(most, np.int64), np.empty(most)
    end = 0
    for g in range(first, last):
        begin = end
        for k in range(start[g], start[g + 1]):
            n = row[k]
            if previous[n] >= 0:
                end = _add_vote(vessel, gain, begin, end, previous[n], weight[n])
        for k in range(start[g], start[g + 1]):
            n = row[k]
            if previous[n] >= 0:
                end = _add_vote(vessel, gain, begin, end, first_vessel[n], FIRST_VESSEL_SHARE * weight[n])
        for k in range(begin, end):
            group[k] = g
            gain[k] += seniority[vessel[k]]
    return group[:end], vessel[:end], gain[:end]


@jit
def settle_uncontested(group, vessel, gain, vessel_id, vessel_of_group):  # type: ignore[no-untyped-def]
    """Settle each group that shares no vessel with another: it continues the vessel of greatest gain, of equals the lowest id.

    Args:
        group, vessel, gain: (A,) of `count_votes`; vessel_id: (K,).
        vessel_of_group: (V,) -1 throughout; written for the groups that are settled.
    Returns: (A,) bool, the votes of the other groups.
    """
    voters = np.zeros(len(vessel_id), np.int32)
    for v in vessel:
        voters[v] += 1
    contested = np.zeros(len(group), np.bool_)
    begin = 0
    while begin < len(group):
        end, best, shared = begin, begin, False
        while end < len(group) and group[end] == group[begin]:
            lower_id = vessel_id[vessel[end]] < vessel_id[vessel[best]]
            if gain[end] > gain[best] or (gain[end] == gain[best] and lower_id):
                best = end
            shared |= voters[vessel[end]] > 1
            end += 1
        if shared:
            contested[begin:end] = True
        else:
            vessel_of_group[group[begin]] = vessel[best]
        begin = end
    return contested


@jit
def _has_successor(track, group, groups, source, started_s, updated_s):  # type: ignore[no-untyped-def]
    """Whether a track of the same source in this group began after the newest report of the track."""
    start, row = groups
    found = False
    for k in range(start[group], start[group + 1]):
        found |= source[row[k]] == source[track] and started_s[row[k]] > updated_s[track]
    return found


@jit
def _is_succeeded(old, new, vessel, groups, previous, tracks):  # type: ignore[no-untyped-def]
    """Whether each track of the group `old` has a successor in `new`, which has a track that was in the vessel."""
    start, row = groups
    for k in range(start[old], start[old + 1]):
        if not _has_successor(row[k], new, groups, *tracks):
            return False
    was_in = False
    for k in range(start[new], start[new + 1]):
        was_in |= previous[row[k]] == vessel
    return was_in


@jit
def hand_on(group, vessel, gain, groups, previous, seniority, tracks):  # type: ignore[no-untyped-def]
    """Give the votes of groups that are no longer heard to the groups with their successors.

    A group is succeeded in a vessel by another one that votes for it, if each of its tracks has a successor there: a track of the
    same source that began after its newest report, as after a source has given its vessel a new number. Of several such groups the
    one of greatest gain succeeds it, of equals the first.
    Args:
        group, vessel, gain: (A,) of `count_votes`; groups, previous, seniority: as there.
        tracks: source, started_s, updated_s: (N,) of each track.
    Returns: kept, gain: (A,) which votes are left; their gains.
    """
    order = np.argsort(vessel, kind="mergesort")
    kept, after = np.ones(len(group), np.bool_), gain.copy()
    begin = 0
    while begin < len(order):
        end = begin
        while end < len(order) and vessel[order[end]] == vessel[order[begin]]:
            end += 1
        for i in range(begin, end):
            old, best = order[i], -1
            for j in range(begin, end):
                new = order[j]
                is_better = best < 0 or gain[new] > gain[best]
                if i != j and is_better and _is_succeeded(group[old], group[new], vessel[old], groups, previous, tracks):
                    best = new
            if best >= 0:
                kept[old] = False
                after[best] += gain[old] - seniority[vessel[old]]
        begin = end
    return kept, after
