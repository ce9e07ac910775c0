"""The windows of some tracks, kept where the work on them is done: each cycle brings one entry of each, never the window again.

`Part` is on the side of the coordinator, which has all windows: it says what one holder needs. `Holder` is on the other side, in a process
of its own, most likely on another machine. Arrays follow the convention of `stage.Shared` for arrays that can be cut.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Array, Floats, Ints
from coastwatch.stage import RING, Groups, Shared, Work

ROOM = 1.25  # of an entry, for tracks whose windows come later


@dataclass(frozen=True)
class Sent:
    """What a holder is sent in a cycle, n tracks."""

    anew: bool  # what is held is of no use
    arrays: dict[str, Array]  # (n, ...) but for chain and ring
    groups: Groups  # of rows as the coordinator numbers them
    entry: Floats  # (n, C) the newest of the ring
    before: Array  # (n,) place in the last cycle, -1 for those whose window is given and those that have none
    given: Ints  # (m,) places whose windows are given
    window: Floats  # (m, W - 1, C) theirs, the last cycle first


class Part:
    """What one holder holds, as the coordinator knows it."""

    def __init__(self) -> None:
        self._entry: Array | None = None  # of all tracks, the newest that was sent
        self._place = np.zeros(0, np.int32)  # of its rows at the holder

    def cut(self, arrays: Shared, groups: Groups) -> Sent:
        """What the holder needs for these groups; he then holds it."""

        ring, every = arrays["ring"], len(arrays["rank"])
        follows = len(ring) > 1 and ring[-2] is self._entry
        ranks, place = kernels.tables.subset.cut(groups.row, arrays["rank"])
        some = {
            name: kernels.tables.subset.rows_of(a, ranks) for name, a in arrays.items() if name not in RING and len(a) == every
        }
        chain, length = kernels.tables.subset.rows_of(arrays["chain"], ranks), some["length"]
        before = np.full(len(ranks), -1, np.int32)
        if follows:
            before[length > 1] = self._place[chain[length > 1, 0]]
        given = np.flatnonzero((length > 1) & (before < 0))
        window = np.zeros((len(given), chain.shape[1], ring[-1].shape[1]))
        for age in range(1, min(len(ring), chain.shape[1] + 1)):
            known = length[given] > age
            window[known, age - 1] = ring[-1 - age][chain[given[known], age - 1]]
        self._entry, self._place = ring[-1], place
        return Sent(not follows, some, groups, kernels.tables.subset.rows_of(ring[-1], ranks), before, given, window)


class Holder:
    """The windows of the tracks of some groups."""

    def __init__(self) -> None:
        self._ring: list[_Entry] = []  # newest last
        self._chain = np.zeros((0, 0), np.int32)

    def work(self, work: Work, settings: Any, sent: Sent) -> tuple[Array, ...]:
        """What the work gives for the groups that were sent."""
        count, older = len(sent.before), sent.window.shape[1]
        held = [] if sent.anew else self._ring
        ring = [*(_Entry(sent.entry[:0]) for _ in range(older - len(held))), *held]
        chain = np.zeros((count, older), np.int32)
        if held and len(self._chain):
            at = np.maximum(sent.before, 0)
            chain[:, 0], chain[:, 1:] = at, self._chain[at, :-1]
        length = sent.arrays["length"]
        for age in range(1, int(length[sent.given].max(initial=1))):
            known = length[sent.given] > age
            ring[-age], chain[sent.given[known], age - 1] = ring[-age].with_rows(sent.window[known, age - 1])
        ring.append(_Entry(sent.entry))
        self._ring, self._chain = ring[-older:] if older else [], chain
        row = sent.arrays["row"]
        rank = np.full(int(row.max(initial=-1)) + 1, -1, np.int32)
        rank[row] = np.arange(count)
        own = {"rank": rank, "chain": chain, "ring": tuple(entry.rows for entry in ring)}
        return work(settings, {**sent.arrays, **own}, sent.groups)


class _Entry:
    """The entries of one cycle, to which rows can be added."""

    def __init__(self, rows: Floats) -> None:
        self._room = np.empty((int(ROOM * len(rows)) + 64, rows.shape[1]))
        self._room[: len(rows)] = rows
        self._count = len(rows)

    @property
    def rows(self) -> Floats:
        return self._room[: self._count]

    def with_rows(self, rows: Floats) -> tuple[_Entry, Ints]:
        """With these rows too, in the same room where there is enough; and where they stand."""
        first, out = self._count, self
        if first + len(rows) > len(self._room):
            out = _Entry(np.concatenate([self.rows, rows]))
        else:
            out._room[first : first + len(rows)] = rows
            out._count = first + len(rows)
        return out, np.arange(first, first + len(rows))
