"""Hysteresis: a condition lasts once it has held for some cycles, until it has not held for some others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Bools, Floats, Ints, joint_keys
from coastwatch.kernels.tables.lookup import find

KINDS = 64
"""A key is vessel_id * KINDS + kind."""


@dataclass(frozen=True, eq=False)
class Lasting:
    """Conditions that hold, or held lately. D rows, each key and subject once, sorted by them."""

    key: Ints  # (D,)
    subject: Ints  # (D,)
    held: Ints  # (D,) cycles that it has held, without a break while it was not open
    missed: Ints  # (D,) cycles since it held last
    open: Bools  # (D,)
    since_s: Floats  # (D,) when it began to hold
    mark: Bools  # (D,) as given when it began

    @classmethod
    def none(cls) -> Lasting:
        number, time = np.zeros(0, np.int64), np.zeros(0)
        return cls(number, number, number, number, number > 0, time, number > 0)

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
    before: Lasting, now: Holding, frozen: Ints, open_cycles: int, close_cycles: int, time_s: float
) -> tuple[Lasting, Lasting]:
    """The conditions after a cycle, and those open ones that have ended with it.

    Args: frozen: (F,) ascending vessel ids: of these nothing is known now, so their conditions stay as they are.
    """
    old, new = joint_keys((before.key, before.subject), (now.key, now.subject))
    at = find(old, new)
    was_open = np.zeros(len(new), np.bool_)
    was_open[at >= 0] = before.open[at[at >= 0]]
    kept = now.strong | was_open
    rows, at, was_open = np.flatnonzero(kept), at[kept], was_open[kept]
    known, strong = at >= 0, now.strong[rows]
    held, since_s, mark = strong.astype(np.int64), np.full(len(rows), float(time_s)), now.mark[rows]
    held[known] += before.held[at[known]]
    since_s[known], mark[known] = before.since_s[at[known]], before.mark[at[known]]
    is_open = was_open | (held >= open_cycles)
    holds = Lasting(now.key[rows], now.subject[rows], held, np.zeros(len(rows), np.int64), is_open, since_s, mark)

    rest = np.ones(len(old), np.bool_)
    rest[at[known]] = False
    gone = before.take(rest)
    waits = find(frozen, gone.vessel_id) >= 0
    missed = gone.missed + ~waits
    stays = waits | (gone.open & (missed < close_cycles))
    gone = Lasting(gone.key, gone.subject, gone.held, missed, gone.open, gone.since_s, gone.mark)
    parts = holds, gone.take(stays)
    both = Lasting(*(np.concatenate([getattr(part, name) for part in parts]) for name in vars(holds)))
    return both.take(np.lexsort((both.subject, both.key))), gone.take(~stays & gone.open)
