"""Rows of ids among other ids: where the tracks of this cycle stood in the last one."""

from __future__ import annotations

import numpy as np

from coastwatch.kernels.jit import jit

LOOK_AHEAD = 16  # rows that may have ended between two that go on; beyond them an id is looked up in a hash table
GOLDEN = np.uint64(0x9E3779B97F4A7C15)  # 2^64 over the golden ratio (Fibonacci hashing)


@jit
def _slot(table, shift, ids, wanted):  # type: ignore[no-untyped-def]
    """The slot of an id, or the free slot where it belongs; a used slot holds the row of an id.

    Source: D. E. Knuth, The Art of Computer Programming 3, 6.4.
    """
    at = np.int64((np.uint64(wanted) * GOLDEN) >> shift)
    while table[at] >= 0 and ids[table[at]] != wanted:
        at = (at + 1) & (len(table) - 1)
    return at


@jit
def _index_in_order(ids, wanted, out):  # type: ignore[no-untyped-def]
    """Write the rows of ids that come in the same order in both. Returns: how many are still missing."""
    following = missing = 0
    for k in range(len(wanted)):
        if k > 0 and wanted[k] == wanted[k - 1]:
            out[k] = out[k - 1]
        else:
            for n in range(following, min(following + LOOK_AHEAD, len(ids))):
                if ids[n] == wanted[k]:
                    out[k], following = n, n + 1
                    break
        missing += out[k] < 0
    return missing


@jit
def index_of(ids, wanted):  # type: ignore[no-untyped-def]
    """The row of each wanted id, -1 where it is not among the ids. Linear; fastest where both come in the same order.

    Args: ids: (N,) int64, none twice; wanted: (M,) int64, may repeat. Returns: (M,) int32.
    """
    out = np.full(len(wanted), -1, np.int32)
    missing = _index_in_order(ids, wanted, out)
    if missing == 0 or len(ids) == 0:
        return out
    bits = 1
    while (1 << bits) < 2 * missing:
        bits += 1
    table, shift = np.full(1 << bits, -1, np.int32), np.uint64(64 - bits)
    for k in range(len(wanted)):
        if out[k] < 0:
            table[_slot(table, shift, wanted, wanted[k])] = k
    row = np.full(len(table), -1, np.int32)
    for n in range(len(ids)):
        slot = _slot(table, shift, wanted, ids[n])
        if table[slot] >= 0:
            row[slot] = n
    for k in range(len(wanted)):
        if out[k] < 0:
            out[k] = row[_slot(table, shift, wanted, wanted[k])]
    return out


@jit
def match_ids(before, now):  # type: ignore[no-untyped-def]
    """Rows of the same ids in two arrays: the row in `before` of each id of `now`, and the row in `now` of each id of `before`.

    Args: before: (L,), now: (N,), both none twice. Returns: (N,), (L,), -1 where an id is in one array alone.
    """
    row_before = index_of(before, now)
    row_now = np.full(len(before), -1, np.int32)
    for n in range(len(now)):
        if row_before[n] >= 0:
            row_now[row_before[n]] = n
    return row_before, row_now
