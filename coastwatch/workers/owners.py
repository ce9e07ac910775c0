"""Who does which groups when it costs to change hands: groups stay where they are until loads are uneven."""

from __future__ import annotations

import numpy as np

from coastwatch.batches import Floats, Ints
from coastwatch.workers.costs import chunks

UNEVEN = 1.1  # the greatest load over the mean at which groups begin to move


def owners(before: Ints, expected: Floats, hands: Ints, order: Ints | None) -> Ints:
    """The hand that does each group.

    Args: before: (K,) the hand of each group, any other number where it has none; expected: (K,) cost; hands: (H,) numbers of those at
    hand, at least one; order: (K,) in which neighbours are cheaper in one hand, if any is known. Returns: (K,).

    Where no group has a hand they are cut into equal parts in that order. Groups without a hand go else, costliest first, to the hand
    with the least. Then, while the greatest load is uneven, the hand with the
    greatest gives the one with the least the costliest of its groups that makes the two more even.
    """
    at = np.full(len(before), -1, np.int64)
    for k, hand in enumerate(hands):
        at[before == hand] = k
    if order is not None and (at < 0).all():
        at = chunks(expected, len(hands), order)[0]
    load = np.bincount(at[at >= 0], expected[at >= 0], len(hands)).astype(np.float64)
    free = np.flatnonzero(at < 0)
    for group in free[np.argsort(-expected[free], kind="stable")]:
        at[group] = load.argmin()
        load[at[group]] += expected[group]
    for _ in range(len(at)):
        most, least = int(load.argmax()), int(load.argmin())
        if load[most] <= UNEVEN * load.mean():
            break
        own = np.flatnonzero(at == most)
        small = own[2.0 * expected[own] <= load[most] - load[least]]
        if len(small) == 0:
            break
        moved = small[expected[small].argmax()]
        at[moved] = least
        load[[most, least]] += expected[moved] * np.array([-1.0, 1.0])
    return np.asarray(hands[at], np.int64)
