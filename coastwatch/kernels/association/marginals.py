"""Association probabilities: how likely each plot is of each track, over all joint assignments. Scalar code, compiled by numba.

In a joint assignment every track takes one plot at most, and every plot goes to one track at most. Its weight is the product of the
weights of its pairs. The weight of a pair is its likelihood divided by that of "track missed, plot of none of these tracks".
Clusters are the connected components of the pairs; the answer for a cluster does not depend on the others.

Sources: Y. Bar-Shalom, X. R. Li, Multitarget-Multisensor Tracking, 1995, section 6.2 (joint probabilistic data association); J. Williams,
R. Lau, Approximate evaluation of marginal association probabilities with belief propagation, IEEE Trans. AES 50(4), 2014 (sum-product).
"""

from __future__ import annotations

import numpy as np

from coastwatch.kernels.arrays import Floats, Ints
from coastwatch.kernels.association.connected_components import components
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.copies import copy_into
from coastwatch.kernels.tables.counting_sort import counting_sort

ROUNDS = 200  # of sum-product, at most
SETTLED = 1e-9  # largest change of a message in the last round


def plots_of_tracks(plot: Ints, track: Ints, share: Floats, plots: int, tracks: int, likely: float) -> tuple[Ints, Ints, Ints]:
    """Who took which plot. Args: plot, track, share: (A,) as of `marginals`; likely: a probability of one half or more.

    Returns: the track that likely took each plot, -1: none (M,); the tracks that likely took some plot of their gate; the most
    probable plot of each track, -1: none (N,).
    """
    of_plot, best, surely = np.full(plots, -1), np.full(tracks, -1), share > likely
    of_plot[plot[surely]] = track[surely]
    rising = np.argsort(share, kind="stable")
    best[track[rising]] = plot[rising]
    return of_plot, np.flatnonzero(np.bincount(track, share, tracks) > likely), best


@jit
def marginals(plot, track, weight, plots, tracks, exact):  # type: ignore[no-untyped-def]
    """The probability that each plot is of each track. (A,)

    A cluster with one track or one plot has a closed form. One with up to `exact` tracks or up to `exact` plots is summed over all joint
    assignments. Larger ones are solved by sum-product, which is exact on trees.
    Args: plot, track: (A,) pairs, each once, from 0; weight: (A,), 0 or more; plots, tracks: their numbers; exact: at most 20 or so.
    """
    out = np.empty(len(plot))
    cluster = components(plot, plots + track, plots + tracks)
    start, by_cluster = counting_sort(cluster[plot], plots + tracks)
    number = np.full(plots + tracks, -1)
    for c in range(plots + tracks):
        pairs = by_cluster[start[c] : start[c + 1]]
        if len(pairs) == 0:
            continue
        row, rows = _numbered(track[pairs], number[plots:])
        column, columns = _numbered(plot[pairs], number[:plots])
        if rows == 1 or columns == 1:
            w = weight[pairs]
            found = w / (1.0 + w.sum())
        elif columns <= min(rows, exact):
            found = sum_over_assignments(row, column, weight[pairs], rows, columns)
        elif rows <= exact:
            found = sum_over_assignments(column, row, weight[pairs], columns, rows)
        else:
            found = sum_product(row, column, weight[pairs], rows, columns)
        for k in range(len(pairs)):
            out[pairs[k]] = found[k]
    return out


@jit
def _numbered(name, number):  # type: ignore[no-untyped-def]
    """Names as numbers from 0 in order of their first row, (A,), and how many there are. Args: number: all -1, and again after the call."""
    out, count = np.empty(len(name), np.int64), 0
    for k in range(len(name)):
        if number[name[k]] < 0:
            number[name[k]] = count
            count += 1
        out[k] = number[name[k]]
    for k in range(len(name)):
        number[name[k]] = -1
    return out, count


@jit
def sum_over_assignments(row, column, weight, rows, columns):  # type: ignore[no-untyped-def]
    """The probability of each pair of one cluster, by sums over the sets of taken columns, forward and backward over the rows. (A,)

    The work grows with rows 2^columns. Sums are scaled row by row, so that no number of rows makes them overflow.
    Args: as of `marginals`; row, column: (A,), either of them the tracks.
    """
    start, by_row = counting_sort(row, rows)
    sets = 1 << columns
    before = np.zeros((rows + 1, sets))  # weight of the assignments of the rows before, by the set of columns that they take
    before[0, 0] = 1.0
    for i in range(rows):
        copy_into(before[i + 1], before[i])
        for k in by_row[start[i] : start[i + 1]]:
            bit = 1 << column[k]
            for taken in range(sets):
                if taken & bit == 0:
                    before[i + 1, taken | bit] += weight[k] * before[i, taken]
        before[i + 1] /= before[i + 1].sum()
    out, after = np.empty(len(row)), np.ones(sets)  # weight of the assignments of the rows after, by the set taken before
    for i in range(rows - 1, -1, -1):
        total, both = 0.0, after.copy()
        for taken in range(sets):
            total += before[i, taken] * after[taken]
        for k in by_row[start[i] : start[i + 1]]:
            bit, out[k] = 1 << column[k], 0.0
            for taken in range(sets):
                if taken & bit == 0:
                    out[k] += weight[k] * before[i, taken] * after[taken | bit]
                    both[taken] += weight[k] * after[taken | bit]
            total += out[k]
        for k in by_row[start[i] : start[i + 1]]:
            out[k] /= total
        after = both / both.max()
    return out


@jit
def _sums_of_others(start, order, value, out):  # type: ignore[no-untyped-def]
    """For each pair the sum over the other pairs of its group, into `out`; nothing is subtracted, so small sums keep their digits."""
    for g in range(len(start) - 1):
        total = 0.0
        for k in order[start[g] : start[g + 1]]:
            out[k] = total
            total += value[k]
        total = 0.0
        for k in order[start[g] : start[g + 1]][::-1]:
            out[k] += total
            total += value[k]


@jit
def sum_product(row, column, weight, rows, columns):  # type: ignore[no-untyped-def]
    """The probability of each pair of one cluster by sum-product, approximate where pairs form loops. (A,) Args: as of `marginals`."""
    row_start, by_row = counting_sort(row, rows)
    column_start, by_column = counting_sort(column, columns)
    to_row, others = np.ones(len(row)), np.empty(len(row))
    for _ in range(ROUNDS):
        _sums_of_others(row_start, by_row, weight * to_row, others)
        to_column = weight / (1.0 + others)
        _sums_of_others(column_start, by_column, to_column, others)
        largest = 0.0
        for k in range(len(row)):
            message = 1.0 / (1.0 + others[k])
            largest = max(largest, abs(message - to_row[k]))
            to_row[k] = message
        if largest < SETTLED:
            break
    value = weight * to_row
    _sums_of_others(row_start, by_row, value, others)
    return value / (1.0 + value + others)
