"""Where the leaves of multi-hypothesis trees stand among rows with gaps, and which trees share plots or MMSI. Compiled by numba."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coastwatch.kernels.arrays import Ints
from coastwatch.kernels.association.connected_components import root
from coastwatch.kernels.jit import jit

LEAST_PLACES = 1024  # of a hash table
RECENT = 1 << 17  # plots that are looked up by their number, not in a hash table
HASH_FACTOR = np.uint64(
    0x9E3779B97F4A7C15
)  # 2^64 over the golden ratio: D. Knuth, The Art of Computer Programming 3, section 6.4


class TreeRows(NamedTuple):
    """The rows of each slot, which stand together. S slots."""

    first: Ints  # (S,)
    leaves: Ints  # (S,) how many, 0: the slot has none
    rows: int  # up to the last one in use
    steps: int  # the same, of the steps of filters


@jit
def tree_rows(slot, step, slots):  # type: ignore[no-untyped-def]
    """The TreeRows of leaves. Args: slot: (L,) of each row, -1: a spare one; step: (L, W) rows of steps, -1: none; slots: S."""
    first, count, rows, steps = np.zeros(slots, np.int64), np.zeros(slots, np.int64), 0, 0
    for i in range(len(slot)):
        n = slot[i]
        if n < 0:
            continue
        if count[n] == 0:
            first[n] = i
        count[n] += 1
        rows = i + 1
        for w in range(step.shape[1]):
            steps = max(steps, step[i, w] + 1)
    return TreeRows(first, count, rows, steps)


@jit
def rows_of(trees, slots):  # type: ignore[no-untyped-def]
    """The rows of the leaves of these slots, in this order. Args: trees: TreeRows; slots: (N,)."""
    out, at = np.empty(trees.leaves[slots].sum(), np.int64), 0
    for n in slots:
        for i in range(trees.first[n], trees.first[n] + trees.leaves[n]):
            out[at] = i
            at += 1
    return out


@jit
def _unite(parent, owner, at, n):  # type: ignore[no-untyped-def]
    """Join the component of slot n with that of the slot that owns a place, or take the place, in place. Args: parent: (S,) of `root`."""
    if owner[at] < 0:
        owner[at] = n
    elif owner[at] != n:
        a, b = root(parent, owner[at]), root(parent, n)
        parent[max(a, b)] = min(a, b)


@jit
def _place(keys, key):  # type: ignore[no-untyped-def]
    """The place of a key in a hash table, which it takes. Args: keys: (2^k,), none of them negative, -1: free, with room for this one."""
    at = np.int64((np.uint64(key) * HASH_FACTOR) >> np.uint64(20)) & (len(keys) - 1)
    while keys[at] >= 0 and keys[at] != key:
        at = (at + 1) & (len(keys) - 1)
    keys[at] = key
    return at


@jit
def linked_trees(leaves, trees, name, looked):  # type: ignore[no-untyped-def]
    """Which slots have a tree that was looked at, or one that shares a plot or an MMSI with such a tree, also by way of others. (S,)

    Args: leaves: LeafColumns; trees: their TreeRows; name: (A,) MMSI that trees that were looked at may take now; looked: (S,).
    """
    window, places = leaves.plot.shape[1], LEAST_PLACES
    most = (window + 1) * trees.leaves.sum() + len(name)  # distinct plots and MMSI
    while places <= most:
        places *= 2
    parent, keys, owner, recent = np.arange(len(looked)), np.full(places, -1), np.full(places, -1), np.full(RECENT, -1)
    newest = leaves.plot[: trees.rows, window - 1].max() if trees.rows > 0 else 0
    for i in range(trees.rows):
        n = leaves.slot[i]
        for w in range(window if n >= 0 else 0):
            ago = newest - leaves.plot[i, w]
            if leaves.plot[i, w] >= 0 and 0 <= ago < RECENT:
                _unite(parent, recent, ago, n)
            elif leaves.plot[i, w] >= 0:
                _unite(parent, owner, _place(keys, 2 * leaves.plot[i, w]), n)
        if n >= 0 and leaves.mmsi[i] >= 0:
            _unite(parent, owner, _place(keys, 2 * leaves.mmsi[i] + 1), n)
    for n in np.flatnonzero(looked)[:1]:
        for mmsi in name[name >= 0]:
            _unite(parent, owner, _place(keys, 2 * mmsi + 1), n)
    reached, out = np.zeros(len(looked), np.bool_), np.zeros(len(looked), np.bool_)
    for n in range(len(looked)):
        if looked[n]:
            reached[root(parent, n)] = True
    for n in range(len(looked)):
        out[n] = trees.leaves[n] > 0 and reached[root(parent, n)]
    return out
