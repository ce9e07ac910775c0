"""Hysteresis: a condition lasts once it has held for some time, until it has not held for some other time.

Both count seconds, so they do not depend on the period, nor on cycles that a late server has merged.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coastwatch.batches import Bools, Floats, Ints, joint_keys
from coastwatch.kernels.tables.lookup import find

KINDS = 64
"""A key is vessel_id * KINDS + kind."""

SLACK_S = 1e-3
"""What the difference of two times may be short of a limit: they are rounded to parts of a microsecond."""


@dataclass(frozen=True, eq=False)
class Lasting:
    """Conditions that hold, or held lately. D rows, each key and subject once, sorted by them."""

    key: Ints  # (D,)
    subject: Ints  # (D,)
    held_s: Floats  # (D,) how long it has held, without a break while it was not open
    missed_s: Floats  # (D,) since it held last, but for cycles in which nothing was known of it
    open: Bools  # (D,)
    since_s: Floats  # (D,) when it began to hold
    at_s: Floats  # (D,) the newest cycle
    mark: Bools  # (D,) as given when it began

    @classmethod
    def none(cls) -> Lasting:
        number, time = np.zeros(0, np.int64), np.zeros(0)
        return cls(number, number, time, time, number > 0, time, time, number > 0)

    @property
    def vessel_id(self) -> Ints:
        """(D,)"""
        return self.key // KINDS

    @property
    def kind(self) -> Ints:
        """(D,)"""
        return self.key % KINDS

    def take(self, rows: Ints | Bools) -> Lasting:
        """Some of them."""
        return Lasting(*(getattr(self, name)[rows] for name in vars(self)))


@dataclass(frozen=True, eq=False)
class Holding:
    """The conditions of one cycle. C rows, each key and subject once, sorted by them."""

    key: Ints  # (C,)
    subject: Ints  # (C,)
    strong: Bools  # (C,) it holds; else it keeps an open condition from ending, and no more
    mark: Bools  # (C,) for those that begin


def extend(
    before: Lasting, now: Holding, frozen: Ints, open_s: float, close_s: float, time_s: float
) -> tuple[Lasting, Lasting]:
    """The conditions after a cycle, and those open ones that have ended with it.

    Args: frozen: (F,) ascending vessel ids: of these nothing is known now, so their conditions stay as they are; open_s: how long a
    condition must hold before it is open; close_s: how long an open one must not hold before it ends.
    """
    before_s = time_s - before.at_s
    old, new = joint_keys((before.key, before.subject), (now.key, now.subject))
    at = find(old, new)
    was_open = np.zeros(len(new), np.bool_)
    was_open[at >= 0] = before.open[at[at >= 0]]
    kept = now.strong | was_open
    rows, at, was_open = np.flatnonzero(kept), at[kept], was_open[kept]
    known, strong = at >= 0, now.strong[rows]
    zero, at_s = np.zeros(len(rows)), np.full(len(rows), float(time_s))
    held_s, since_s, mark = zero.copy(), at_s.copy(), now.mark[rows]
    held_s[known] = before.held_s[at[known]] + np.where(strong[known], before_s[at[known]], 0.0)
    since_s[known], mark[known] = before.since_s[at[known]], before.mark[at[known]]
    is_open = was_open | (held_s >= open_s - SLACK_S)
    holds = Lasting(now.key[rows], now.subject[rows], held_s, zero, is_open, since_s, at_s, mark)

    rest = np.ones(len(old), np.bool_)
    rest[at[known]] = False
    gone = before.take(rest)
    waits = find(frozen, gone.vessel_id) >= 0
    missed_s = gone.missed_s + np.where(waits, 0.0, before_s[rest])
    stays = waits | (gone.open & (missed_s < close_s - SLACK_S))
    gone = replace(gone, missed_s=missed_s, at_s=np.full(len(missed_s), float(time_s)))
    parts = holds, gone.take(stays)
    both = Lasting(*(np.concatenate([getattr(part, name) for part in parts]) for name in vars(holds)))
    return both.take(np.lexsort((both.subject, both.key))), gone.take(~stays & gone.open)
