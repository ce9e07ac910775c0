"""Rows in groups: the numbers of rows that stand together, and the median of each group. No numba."""

import numpy as np

from coastwatch.kernels.arrays import Floats, Ints


def ranges(first: Ints, count: Ints) -> Ints:
    """The numbers first[k], first[k] + 1, ... of which there are count[k], of all k one after the other."""
    return np.asarray(np.arange(count.sum()) + np.repeat(first - (np.cumsum(count) - count), count))


def median_of_groups(group: Ints, value: Floats, groups: int) -> tuple[Ints, Floats]:
    """How many values each group has, and their median, NaN for none. Args: (A,) 0 to groups - 1, (A,). Returns: (groups,), (groups,)."""
    order = np.lexsort((value, group))
    count = np.bincount(group, minlength=groups)
    median = np.full(groups, np.nan)
    some = np.flatnonzero(count)
    first = (np.cumsum(count) - count)[some]
    middle = value[order[first + (count[some] - 1) // 2]], value[order[first + count[some] // 2]]
    median[some] = 0.5 * (middle[0] + middle[1])
    return count, median
