"""Do identities stay with their vessels? Purity of tracks, switches of identity, longest time under one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coastwatch.batches import Bools, Ints


class Purity(NamedTuple):
    """Over all that was seen."""

    purity: float  # share of the rows that belong to the most frequent vessel of their track
    switches: int  # times at which a vessel was seen under none of the identities of the time before
    longest_single_share: float  # mean over vessels of the longest unbroken run under one identity, as a share of its times


def purity(identity: Ints, origin: Ints, cycle: Ints) -> Purity:
    """How well identities and true vessels agree; rows of no true vessel spoil purity and are otherwise passed over.

    A vessel may be seen under several identities at once; gaps in which it is not seen break nothing.

    Args: identity: (M,) of the track or vessel of the picture; origin: (M,) true vessel, -1 none; cycle: (M,) number of the time.
    """
    if not len(identity):
        return Purity(0.0, 0, 0.0)
    pairs, count = np.unique(np.column_stack([identity, origin]), axis=0, return_counts=True)
    first = np.flatnonzero(np.diff(pairs[:, 0], prepend=pairs[0, 0] - 1))
    most = np.maximum.reduceat(np.where(pairs[:, 1] >= 0, count, 0), first)
    real = origin >= 0
    rows = np.unique(np.column_stack([origin, cycle, identity])[real], axis=0)
    if not len(rows):
        return Purity(0.0, 0, 0.0)
    vessel, seen, times = _numbered(rows[:, 0], rows[:, 1])
    order = np.lexsort((seen, rows[:, 2], vessel))
    kept = _follows(vessel[order], rows[order, 2], seen[order])
    moment = np.cumsum(np.concatenate([[0], times[:-1]]))[vessel[order]] + seen[order]
    held = np.zeros(int(times.sum()), np.bool_)
    held[moment[kept]] = True
    longest = _longest_runs(vessel[order], kept)
    return Purity(
        float(most.sum() / len(identity)),
        int((~held).sum() - len(times)),
        float((longest / times).mean()),
    )


def _numbered(origin: Ints, cycle: Ints) -> tuple[Ints, Ints, Ints]:
    """Vessels numbered from 0, their times numbered from 0 each, and how many times each has. Rows sorted by origin, cycle."""
    new_vessel = np.diff(origin, prepend=origin[0] - 1) != 0
    new_time = new_vessel | (np.diff(cycle, prepend=cycle[0]) != 0)
    vessel, moment = np.cumsum(new_vessel) - 1, np.cumsum(new_time) - 1
    first = moment[new_vessel]
    return vessel, moment - first[vessel], np.diff(np.append(first, moment[-1] + 1))


def _follows(vessel: Ints, identity: Ints, seen: Ints) -> Bools:
    """Whether each row continues the row before: same vessel, same identity, next time. Rows sorted by these."""
    out = np.zeros(len(vessel), np.bool_)
    out[1:] = (np.diff(vessel) == 0) & (np.diff(identity) == 0) & (np.diff(seen) == 1)
    return out


def _longest_runs(vessel: Ints, kept: Bools) -> Ints:
    """The longest run of rows of each vessel."""
    starts = np.flatnonzero(~kept)
    length = np.diff(np.append(starts, len(kept)))
    out = np.zeros(int(vessel[-1]) + 1, np.int64)
    np.maximum.at(out, vessel[starts], length)
    return out
