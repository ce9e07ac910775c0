"""Tables of whole numbers whose rows are sorted and each there once: merged, and compared with what they were."""

from coastwatch.kernels.jit import jit


@jit
def is_sorted(rows):  # type: ignore[no-untyped-def]
    """Whether every row of (R, C) comes after the one before it."""
    r = 1
    while r < rows.shape[0] and _order(rows, r - 1, rows, r) < 0:
        r += 1
    return r >= rows.shape[0]


@jit
def _order(one, i, two, j):  # type: ignore[no-untyped-def]
    """-1, 0 or 1: row i of one table comes before row j of the other, is the same, comes after it."""
    for c in range(one.shape[1]):
        if one[i, c] != two[j, c]:
            return -1 if one[i, c] < two[j, c] else 1
    return 0


@jit
def merge(one, two, out):  # type: ignore[no-untyped-def]
    """The rows of (R, C) and (S, C) in order into (R + S, C)."""
    i, j = 0, 0
    for r in range(out.shape[0]):
        if j == two.shape[0] or (i < one.shape[0] and _order(one, i, two, j) <= 0):
            out[r] = one[i]
            i += 1
        else:
            out[r] = two[j]
            j += 1


@jit
def differences(before, now, gone, come):  # type: ignore[no-untyped-def]
    """Marks the rows of (R, C) that are not in (S, C), and those that are only there. Args: gone: (R,); come: (S,) bool."""
    i, j = 0, 0
    while i < before.shape[0] or j < now.shape[0]:
        if j == now.shape[0]:
            order = -1
        elif i == before.shape[0]:
            order = 1
        else:
            order = _order(before, i, now, j)
        if order <= 0:
            gone[i] = order < 0
            i += 1
        if order >= 0:
            come[j] = order > 0
            j += 1
