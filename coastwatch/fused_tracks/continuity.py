"""Which filters of vessels go on from one cycle to the next: those that have heard of one vessel only, as far as is known now."""

from __future__ import annotations

import numpy as np

from coastwatch.batches import Floats, Ints
from coastwatch.kernels.lookup import find


def former(known_id: Ints, known_row: Ints, track_id: Ints) -> Ints:
    """The filter that each track was in; -1 where none. Args: known_id: (L,) sorted; known_row: (L,); track_id: (N,)."""
    at = find(known_id, track_id)
    return np.where(at >= 0, known_row[at], -1).astype(np.int64) if len(known_id) else at


def going_on(vessel: Ints, before: Ints, vessels: int) -> Ints:
    """The filter with which each vessel goes on; -1: with none.

    A filter goes on where all of its tracks that still live are, and no track of another filter: then nothing that it heard was of
    another vessel. Tracks may have ended, and tracks without a filter may have come.
    Args: vessel: (N,) of each track; before: (N,) its filter, -1 where none; vessels: how many. Returns: (V,).
    """
    filters = int(before.max(initial=-1)) + 1
    lowest, highest = np.full(vessels, filters, np.int64), np.full(vessels, -1, np.int64)
    old = before >= 0
    np.minimum.at(lowest, vessel[old], before[old])
    np.maximum.at(highest, vessel[old], before[old])
    alive = np.bincount(before[old], minlength=filters)
    here = np.bincount(vessel[old], minlength=vessels)
    one = (highest >= 0) & (lowest == highest)
    whole = one.copy()
    whole[one] = alive[highest[one]] == here[one]
    return np.where(whole, highest, -1)


def newest(vessel: Ints, updated_s: Floats, vessels: int) -> Floats:
    """When the tracks of each vessel were updated last: a filter that has heard of nothing so new was not told of it. (V,)

    Args: vessel: (N,) of each track; updated_s: (N,); vessels: how many.
    """
    out = np.full(vessels, -np.inf)
    np.maximum.at(out, vessel, updated_s)
    return out
