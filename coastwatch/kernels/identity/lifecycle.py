"""Life cycle of a vessel: with tracks, without them for a while, and gone."""

from __future__ import annotations

from coastwatch.kernels.identity.match import AS_PREVIOUS, NOT_REMEMBERED
from coastwatch.kernels.jit import jit

PRESENT, COASTING, HIDDEN, MERGED, DELETED = range(5)


@jit
def lifecycle(first, last, group_of_vessel, remembered, updated_s, mmsi, limits, state):  # type: ignore[no-untyped-def]
    """Life cycle state of each vessel of the last cycle.

    A vessel with tracks is PRESENT. One whose tracks have all ended coasts for `coast_s`, then is HIDDEN: not shown, but it may
    return within `hold_s`, or within `return_s` if its MMSI is known. A vessel whose tracks went into other vessels is MERGED: its
    id returns if a track that was first in it splits off again. All others are DELETED.
    Args:
        first, last: range of rows to decide, for threads.
        group_of_vessel: (K,) group of tracks that continues the vessel, -1 if none.
        remembered: (K,) by living tracks, as `match.recall` says.
        updated_s: (K,) time of its last measurement, -inf if it is merged already. mmsi: (K,), -1 if unknown.
        limits: (time_s, coast_s, hold_s, return_s). state: (K,) written.
    """
    time_s, coast_s, hold_s, return_s = limits
    for vessel in range(first, last):
        silent_s = time_s - updated_s[vessel]
        may_return = silent_s <= hold_s or (mmsi[vessel] >= 0 and silent_s <= return_s)
        if group_of_vessel[vessel] >= 0:
            state[vessel] = PRESENT
        elif remembered[vessel] != AS_PREVIOUS and may_return:
            state[vessel] = COASTING if silent_s <= coast_s else HIDDEN
        elif remembered[vessel] != NOT_REMEMBERED:
            state[vessel] = MERGED
        else:
            state[vessel] = DELETED
