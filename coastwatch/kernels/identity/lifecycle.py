"""What becomes of the vessels of the last cycle, and the vessels of this one in order of their ids, in linear passes.

Slots name the vessels of the last cycle: those shown, sorted by id, then those hidden, then those that only are the home of a track.
`taken`, `voter` and `alive` are those of `voting`. Scalar code compiled by numba.
"""

from __future__ import annotations

import numpy as np

from coastwatch.kernels.identity.identity_votes import NOBODY, of_slot
from coastwatch.kernels.jit import jit

PRESENT, COASTING, HIDDEN, GONE, FORGOTTEN = range(5)


@jit
def fates(low, high, taken, voter, alive, updated, mmsi, times, out):  # type: ignore[no-untyped-def]
    """What becomes of slots low to high.

    Args: taken, voter, alive: (K,); updated, mmsi: of the shown and of the hidden; times: now; how long a vessel without tracks is shown,
    may come back by its place, and by its MMSI. out: (K,) written.
    """
    now, coast, hold, keep = times
    for slot in range(low, high):
        if taken[slot] >= 0:
            out[slot] = PRESENT
            continue
        out[slot] = FORGOTTEN if voter[slot] == NOBODY else GONE
        away = now - of_slot(updated, slot, -np.inf)
        if not alive[slot] and (away <= hold or (away <= keep and of_slot(mmsi, slot, -1) >= 0)):
            out[slot] = COASTING if away <= coast else HIDDEN


@jit
def lined_up(ids, fate, taken, shown, back, fresh, next_id):  # type: ignore[no-untyped-def]
    """The vessels of this cycle, sorted by id, and where those of the last went.

    Args:
        ids, fate, taken: (K,) of each slot; shown: how many slots come first, sorted by id; back: (B,) the later ones that are PRESENT or
        COASTING, sorted by id; fresh: (F,) groups without a slot: they get next_id and those after it.
    Returns: vessel_id (R,); come (R,) its group, or -1 - slot of a vessel without tracks; moved (K,) the slot of each slot in the next
        cycle, -1 where none: the shown, then the hidden, then the gone, in the order in which they were.
    """
    most = shown + len(back) + len(fresh)
    vessel_id, come, moved = np.empty(most, np.int64), np.empty(most, np.int32), np.full(len(ids), -1, np.int32)
    rows = b = 0
    for a in range(shown + 1):
        while b < len(back) and (a == shown or ids[back[b]] < ids[a]):
            slot = back[b]
            vessel_id[rows], come[rows], moved[slot] = ids[slot], taken[slot] if taken[slot] >= 0 else -1 - slot, rows
            rows, b = rows + 1, b + 1
        if a < shown and fate[a] <= COASTING:
            vessel_id[rows], come[rows], moved[a] = ids[a], taken[a] if taken[a] >= 0 else -1 - a, rows
            rows += 1
    for k in range(len(fresh)):
        vessel_id[rows + k], come[rows + k] = next_id + k, fresh[k]
    rows += len(fresh)
    following = rows
    for kind in (HIDDEN, GONE):
        for slot in range(len(ids)):
            if fate[slot] == kind:
                moved[slot] = following
                following += 1
    return vessel_id[:rows], come[:rows], moved


@jit
def placed(come, start):  # type: ignore[no-untyped-def]
    """The row of each group (V,), and where the tracks of each row begin, one row after the other (R + 1,)."""
    row_of, begin = np.empty(len(start) - 1, np.int32), np.zeros(len(come) + 1, np.int32)
    for r in range(len(come)):
        begin[r + 1] = begin[r]
        if come[r] >= 0:
            row_of[come[r]] = r
            begin[r + 1] += start[come[r] + 1] - start[come[r]]
    return row_of, begin


@jit
def remembered(low, high, vessel, row_of, home, moved, was_in, was_home):  # type: ignore[no-untyped-def]
    """The slots in the next cycle of the vessels that tracks low to high are in, and were first in: into the last two.

    Args: vessel: (N,) group; row_of: (V,) of each group; home: (N,) slot in the last cycle, NOBODY for a new track; moved: (K,).
    """
    for n in range(low, high):
        was_in[n] = row_of[vessel[n]]
        was_home[n] = moved[home[n]] if home[n] >= 0 else was_in[n]
