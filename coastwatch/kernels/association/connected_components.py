"""Rows that pairs join into groups: forests of parents, and the members of a group as a ring of next rows."""

from __future__ import annotations

import numpy as np

from coastwatch.kernels.jit import jit


@jit
def root(parent, row):  # type: ignore[no-untyped-def]
    """The row that stands for the group of a row; paths are halved on the way."""
    while parent[row] != row:
        parent[row] = parent[parent[row]]
        row = parent[row]
    return row


@jit
def _shares(following, source, a, b):  # type: ignore[no-untyped-def]
    """Whether a member of the group of a and one of that of b have one source."""
    i = a
    while True:
        j = b
        while True:
            if source[i] == source[j]:
                return True
            j = following[j]
            if j == b:
                break
        i = following[i]
        if i == a:
            return False


@jit
def _join(parent, following, a, b):  # type: ignore[no-untyped-def]
    """Make one group of those of two roots, the lower its root."""
    parent[max(a, b)] = min(a, b)
    following[a], following[b] = following[b], following[a]


@jit
def joined(first, second, source):  # type: ignore[no-untyped-def]
    """The parents of all rows when each pair joins two of them; the ring of every group; at a root, whether it has two rows of one source.

    A pair whose rows are in no other, as most are, is not entered in the rings.
    """
    rows = len(source)
    parent, following = np.empty(rows, np.int32), np.empty(rows, np.int32)
    pairs, twice = np.zeros(rows, np.uint8), np.zeros(rows, np.bool_)
    for row in range(rows):
        parent[row] = following[row] = row
    for p in range(len(first)):
        for row in (first[p], second[p]):
            pairs[row] = min(pairs[row] + 1, 2)
    for p in range(len(first)):
        if pairs[first[p]] == 1 and pairs[second[p]] == 1:
            parent[max(first[p], second[p])] = min(first[p], second[p])
            continue
        a, b = root(parent, first[p]), root(parent, second[p])
        if a != b:
            both = twice[a] or twice[b] or _shares(following, source, a, b)
            _join(parent, following, a, b)
            twice[min(a, b)] = both
    return parent, following, twice


@jit
def told_of(parent, flag, row):  # type: ignore[no-untyped-def]
    """What is said at the root of the group of each of these rows. Returns: as `row`."""
    out = np.empty(len(row), np.bool_)
    for k in range(len(row)):
        out[k] = flag[root(parent, row[k])]
    return out


@jit
def joined_without_sharing(first, second, source, parent, following):  # type: ignore[no-untyped-def]
    """Take the groups of these pairs apart and join them in order again, leaving out what would put two rows of one source together.

    Args: parent, following: of `joined`, changed. Returns: (A,) whether each pair stands.
    """
    stands = np.zeros(len(first), np.bool_)
    for p in range(len(first)):
        for row in (first[p], second[p]):
            parent[row] = following[row] = row
    for p in range(len(first)):
        a, b = root(parent, first[p]), root(parent, second[p])
        stands[p] = a == b or not _shares(following, source, a, b)
        if a != b and stands[p]:
            _join(parent, following, a, b)
    return stands


@jit
def numbered(parent):  # type: ignore[no-untyped-def]
    """The number of the group of each row; groups are numbered by their first row. Returns: (N,)."""
    out, count = np.empty(len(parent), np.int64), 0
    for row in range(len(parent)):
        top = root(parent, row)
        if top == row:
            out[row] = count
            count += 1
        else:
            out[row] = out[top]
    return out
