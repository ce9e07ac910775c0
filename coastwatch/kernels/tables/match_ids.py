"""Where the rows of one cycle stood in the last: ids mostly come in the order in which they came before. Linear, whatever the order.

Scalar code compiled by numba. Ids are any integers, none twice.
"""

from __future__ import annotations

from weakref import ReferenceType, ref

import numpy as np
from numpy.typing import NDArray

from coastwatch.kernels.jit import jit

Ints = NDArray[np.int64]
Rows = NDArray[np.int32]

LOOK = 16  # rows that may have ended between two that go on before an id is sought elsewhere
PATIENCE = 64  # ids in a row that were not found before all is searched for one; doubled each time
SPREAD = np.uint64(0x9E3779B97F4A7C15)  # 2^64 over the golden ratio (Fibonacci hashing)


@jit
def _in_order(before, now, at, to):  # type: ignore[no-untyped-def]
    """Rows that come in the order of the last cycle, into `at` and `to`; how many ids of now were not found."""
    expected = waited = missing = 0
    patience = PATIENCE
    for n in range(len(now)):
        found = -1
        for k in range(expected, min(expected + LOOK, len(before))):
            if before[k] == now[n]:
                found = k
                break
        if found < 0 and waited >= patience:
            patience *= 2
            for k in range(len(before)):
                if before[k] == now[n] and to[k] < 0:
                    found = k
                    break
        if found < 0:
            waited, missing = waited + 1, missing + 1
            continue
        waited, expected = 0, found + 1
        if to[found] < 0:
            at[n], to[found] = found, n
        else:
            missing += 1
    return missing


@jit
def _table(count):  # type: ignore[no-untyped-def]
    """An empty table for so many ids, and by how much a spread id is shifted to be a place in it."""
    bits = 1
    while (1 << bits) < 2 * count:
        bits += 1
    return np.full(1 << bits, -1, np.int32), np.uint64(64 - bits)


@jit
def _place(table, shift, ids, wanted):  # type: ignore[no-untyped-def]
    """The place of an id in a table of rows of `ids`, or the free one where it would be."""
    at = np.int64((np.uint64(wanted) * SPREAD) >> shift)
    while table[at] >= 0 and ids[table[at]] != wanted:
        at = (at + 1) & (len(table) - 1)
    return at


@jit
def _followed(before, now):  # type: ignore[no-untyped-def]
    at, to = np.full(len(now), -1, np.int32), np.full(len(before), -1, np.int32)
    missing = _in_order(before, now, at, to) if len(before) > 0 else 0
    if missing == 0 or len(now) - missing == len(before):
        return at, to
    table, shift = _table(missing)
    for n in range(len(now)):
        if at[n] < 0:
            table[_place(table, shift, now, now[n])] = n
    for k in range(len(before)):
        if to[k] < 0:
            n = table[_place(table, shift, now, before[k])]
            if n >= 0:
                at[n], to[k] = k, n
    return at, to


_latest: list[tuple[ReferenceType[Ints], ReferenceType[Ints], tuple[Rows, Rows]]] = []


def followed(before: Ints, now: Ints) -> tuple[Rows, Rows]:
    """The row in `before` of each id of `now`, and the row in `now` of each id of `before`; -1 where none. (L,), (N,) -> (N,), (L,)

    The latest answer is kept, and is not to be written to: three stages ask it of the same two arrays in a cycle. So neither are they.
    """
    for one, other, known in _latest:
        if one() is before and other() is now:
            return known
    answer: tuple[Rows, Rows] = _followed(before, now)
    _latest[:] = [(ref(before), ref(now), answer)]
    return answer


@jit
def among(ids, wanted):  # type: ignore[no-untyped-def]
    """Which ids are wanted; best where few are. Args: (N,), (M,) both may have an id twice. Returns: (N,)."""
    out = np.zeros(len(ids), np.bool_)
    if len(wanted) == 0:
        return out
    table, shift = _table(len(wanted))
    for k in range(len(wanted)):
        table[_place(table, shift, wanted, wanted[k])] = k
    for n in range(len(ids)):
        out[n] = table[_place(table, shift, wanted, ids[n])] >= 0
    return out


@jit
def standing(ids, wanted, guess):  # type: ignore[no-untyped-def]
    """The row of each wanted id, -1 where it is not; `guess` (M,) is where it may be, and costs next to nothing where it is right."""
    out = np.full(len(wanted), -1, np.int32)
    right = 0
    for k in range(len(wanted)):
        if 0 <= guess[k] < len(ids) and ids[guess[k]] == wanted[k]:
            out[k] = guess[k]
            right += 1
    if right == len(wanted):
        return out
    table, shift = _table(len(wanted))
    for k in range(len(wanted)):
        table[_place(table, shift, wanted, wanted[k])] = k
    for n in range(len(ids)):
        k = table[_place(table, shift, wanted, ids[n])]
        if k >= 0:
            out[k] = n
    return out


@jit
def owned(ids, wanted):  # type: ignore[no-untyped-def]
    """The row of each wanted id, -1 where it is not: many may want one id, mostly one after the other and in the order of the ids."""
    out = np.full(len(wanted), -1, np.int32)
    expected = missing = 0
    for k in range(len(wanted)):
        if k > 0 and wanted[k] == wanted[k - 1]:
            out[k] = out[k - 1]
        else:
            for n in range(expected, min(expected + LOOK, len(ids))):
                if ids[n] == wanted[k]:
                    out[k], expected = n, n + 1
                    break
        missing += out[k] < 0
    if missing == 0:
        return out
    table, shift = _table(missing)
    for k in range(len(wanted)):
        if out[k] < 0:
            table[_place(table, shift, wanted, wanted[k])] = k
    row = np.full(len(table), -1, np.int32)
    for n in range(len(ids)):
        at = _place(table, shift, wanted, ids[n])
        if table[at] >= 0:
            row[at] = n
    for k in range(len(wanted)):
        if out[k] < 0:
            out[k] = row[_place(table, shift, wanted, wanted[k])]
    return out
