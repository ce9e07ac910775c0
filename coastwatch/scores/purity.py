"""Whether ids stay with their vessels: purity, switches of id, longest time under one id."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Ints, Struct, column
from coastwatch.kernels.tables.lookup import find

SHIFT = np.int64(1) << 32  # origin and identity in one number; both stay below 2**31


@dataclass(frozen=True, eq=False)
class Identities(Struct):
    """Sums so far. Their size depends on the number of vessels and ids, not of cycles."""

    pair: Ints = column(np.int64, "P")  # sorted: identity and true vessel seen together, -1 none
    rows: Ints = column(np.int64, "P")  # how often
    last: Ints = column(np.int64, "L")  # sorted: true vessel and identity when the vessel was last seen
    run: Ints = column(np.int64, "L")  # for how many times in a row by then
    vessel: Ints = column(np.int64, "V")  # sorted: true vessels seen at all
    times: Ints = column(np.int64, "V")  # how often
    longest: Ints = column(np.int64, "V")  # longest run under one identity
    switches: int = 0

    def seen(self, identity: Ints, origin: Ints) -> Identities:
        """The sums after one more cycle. A vessel may have several ids at once; a cycle in which it is not seen does not end its run.

        Args: identity: (M,) of the tracks or vessels of the picture; origin: (M,) true vessel, -1 none.
        """
        pair, rows = _summed(self.pair, self.rows, identity * SHIFT + origin + 1)
        now = _distinct((origin * SHIFT + identity)[origin >= 0])
        run = 1 + _looked_up(self.last, self.run, now)
        who = now // SHIFT
        vessels = _distinct(who)
        vessel, times = _summed(self.vessel, self.times, vessels)
        longest = _looked_up(self.vessel, self.longest, vessel)
        np.maximum.at(longest, np.searchsorted(vessel, who), run)
        returned = _looked_up(self.vessel, self.times, vessels) > 0
        stay = _looked_up(vessels, np.ones_like(vessels), self.last // SHIFT) == 0
        last, runs = np.concatenate([self.last[stay], now]), np.concatenate([self.run[stay], run])
        order = np.argsort(last)
        switches = self.switches + int(returned.sum()) - len(_distinct(who[run > 1]))
        return Identities(pair, rows, last[order], runs[order], vessel, times, longest, switches)

    def as_dict(self) -> dict[str, float | int | None]:
        """purity: share of the rows that are of the most frequent vessel of their identity (rows of no vessel lower it);
        id_switches: times at which a vessel was seen under none of the identities of the time before; longest_single_id:
        mean over vessels of the longest run under one identity, as a share of its times. None where nothing was seen.
        """
        if not len(self.pair):
            return {"purity": None, "id_switches": 0, "longest_single_id": None}
        identity, real = self.pair // SHIFT, self.pair % SHIFT > 0
        first = np.flatnonzero(np.diff(identity, prepend=identity[0] - 1))
        most = np.maximum.reduceat(np.where(real, self.rows, 0), first)
        longest = float((self.longest / self.times).mean()) if len(self.vessel) else None
        return {"purity": float(most.sum() / self.rows.sum()), "id_switches": self.switches, "longest_single_id": longest}


def _distinct(values: Ints) -> Ints:
    """The values sorted, each once; half of the time of np.unique, which builds a hash table."""
    ordered = np.sort(values)
    distinct: Ints = ordered[np.append(True, ordered[1:] != ordered[:-1])[: len(ordered)]]
    return distinct


def _summed(keys: Ints, counts: Ints, added: Ints) -> tuple[Ints, Ints]:
    """Sorted keys with their counts, with one added for each occurrence in `added`."""
    every_key, at = np.unique(np.concatenate([keys, added]), return_inverse=True)
    total = np.zeros(len(every_key), np.int64)
    np.add.at(total, at, np.concatenate([counts, np.ones(len(added), np.int64)]))
    return every_key, total


def _looked_up(keys: Ints, values: Ints, wanted: Ints) -> Ints:
    """The values of wanted keys, 0 where there is no such key. Args: keys: sorted."""
    return np.append(values, 0)[find(keys, wanted)]
