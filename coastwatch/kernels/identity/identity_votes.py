"""Votes of tracks for the vessels they were in: what is clear is settled here, what several vessels vie for is handed out as pairs.

A vessel of the last cycle is named by its slot, a number from 0; a vessel of this cycle by its number, the group of its tracks. A
track votes for the slot it was in, and with a share of its weight for the slot of the first vessel it ever was in.
"""

from __future__ import annotations

import numpy as np

from coastwatch.kernels.jit import jit
from coastwatch.kernels.prefetch import fetch
from coastwatch.kernels.tables.grouping import longest

HOME_SHARE = 0.1  # of a vote goes to the first vessel that a track ever was in
AGE_GAIN, AGE_S = 0.5, 60.0  # what a vessel that has long been seen counts more, and how long is long
NOBODY, OPEN = -1, -2
AHEAD = 16  # groups: memory is asked for those of so many on


@jit
def recalled(at, vessel, was_in, was_home, previous, home, voter, alive, chosen):  # type: ignore[no-untyped-def]
    """What tracks remember, and who votes for what.

    Args:
        at: (N,) row of each track in the last cycle, -1 where none; vessel: (N,) its group now; was_in, was_home: (L,) slots of the
        tracks of the last cycle.
        previous, home: (N,) slots, NOBODY for a new track: written.
        voter: (K,) all NOBODY: the one group with a vote for each slot, OPEN for several: written; alive: (K,) all False: whether
        a track that was in it lives; chosen: (V,) all NOBODY: the slot that a group votes for, OPEN where there are several.
    """
    for n in range(len(at)):
        if at[n] < 0:
            previous[n] = home[n] = NOBODY
            continue
        g, slot, first = vessel[n], was_in[at[n]], was_home[at[n]]
        previous[n], home[n] = slot, first
        alive[slot] = True
        if voter[slot] != g:
            voter[slot] = g if voter[slot] == NOBODY else OPEN
        if first != slot:
            chosen[g] = OPEN
            if voter[first] != g:
                voter[first] = g if voter[first] == NOBODY else OPEN
        elif chosen[g] != slot:
            chosen[g] = slot if chosen[g] == NOBODY else OPEN


@jit
def _count(slot, weight, slots, votes, count):  # type: ignore[no-untyped-def]
    """One vote more; how many slots have votes."""
    for k in range(count):
        if slots[k] == slot:
            votes[k] += weight
            return count
    slots[count], votes[count] = slot, weight
    return count + 1


@jit
def of_slot(parts, slot, otherwise):  # type: ignore[no-untyped-def]
    """What stands for a slot in a column of the shown and of the hidden."""
    if slot < len(parts[0]):
        return parts[0][slot]
    return parts[1][slot - len(parts[0])] if slot - len(parts[0]) < len(parts[1]) else otherwise


@jit
def _tally(begin, end, row, memory, weights, since, now, slots, gains):  # type: ignore[no-untyped-def]
    """The slots that a group votes for and what each gains by it, into the last two; how many."""
    previous, home, source = memory
    count = 0
    for k in range(begin, end):
        if previous[row[k]] >= 0:
            count = _count(previous[row[k]], weights[source[row[k]]], slots, gains, count)
    for k in range(begin, end):
        if previous[row[k]] >= 0:
            count = _count(home[row[k]], HOME_SHARE * weights[source[row[k]]], slots, gains, count)
    for k in range(count):
        age = now - of_slot(since, slots[k], now)
        gains[k] += AGE_GAIN * age / (age + AGE_S)
    return count


@jit
def _ask(g, high, chosen, start, row, memory):  # type: ignore[no-untyped-def]
    """Asks memory for the votes of a group that is to be tallied."""
    if g < high and chosen[g] == OPEN:
        for k in range(start[g], start[g + 1]):
            fetch(memory[0], row[k])
            fetch(memory[1], row[k])
            fetch(memory[2], row[k])


@jit
def settled(low, high, start, row, memory, weights, voter, ids, since, now, chosen, taken):  # type: ignore[no-untyped-def]
    """The slot of groups low to high that nobody else votes for the slots of: the one with the most votes, of equals the lowest id.

    Args:
        start, row: the tracks of each group; memory: previous, home and source of each track; weights: of a vote of each source.
        voter: of `recalled`; ids: (K,) of each slot; since: of the shown and of the hidden; now: s.
        chosen: (V,) of `recalled`: OPEN where others vie for one of its slots; taken: (K,) all NOBODY: the group of each chosen
        slot. Written.
    """
    most = 2 * longest(low, high, start)
    _settled(
        low, high, start, row, memory, weights, voter, ids, since, now, np.empty(most, np.int32), np.empty(most), chosen, taken
    )


@jit
def _settled(low, high, start, row, memory, weights, voter, ids, since, now, slots, gains, chosen, taken):  # type: ignore[no-untyped-def]
    """The same with room to work in, `slots` and `gains`."""
    for g in range(low, high):
        _ask(g + AHEAD, high, chosen, start, row, memory)
        if chosen[g] >= 0:
            if voter[chosen[g]] == g:
                taken[chosen[g]] = g
            else:
                chosen[g] = OPEN
        elif chosen[g] == OPEN:
            count = _tally(start[g], start[g + 1], row, memory, weights, since, now, slots, gains)
            best = 0
            for k in range(count):
                if voter[slots[k]] != g:
                    best = -1
                    break
                if gains[k] > gains[best] or (gains[k] == gains[best] and ids[slots[k]] < ids[slots[best]]):
                    best = k
            if best >= 0:
                chosen[g] = slots[best]
                taken[slots[best]] = g


@jit
def ballots(groups, start, row, memory, weights, since, now):  # type: ignore[no-untyped-def]
    """All votes of these groups: group, slot and gain, (A,) each."""
    total = 0
    for g in groups:
        total += 2 * (start[g + 1] - start[g])
    group, slot, gain = np.empty(total, np.int64), np.empty(total, np.int32), np.empty(total)
    count = 0
    for g in groups:
        more = _tally(start[g], start[g + 1], row, memory, weights, since, now, slot[count:], gain[count:])
        group[count : count + more] = g
        count += more
    return group[:count], slot[:count], gain[:count]
