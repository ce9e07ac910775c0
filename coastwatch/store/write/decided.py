"""The corrected past of a cycle into the database: each state goes to the vessel that had its track at the time of the state.

A state is decided some looks later, and the last ones of a track when it ends. By then another vessel may have the track, or none.
"""

from __future__ import annotations

import numpy as np
from sqlalchemy import Connection, select

from coastwatch.batches import ID_STRIDE, DecidedPath, Floats, Ints
from coastwatch.store.rows import NullableId, fetch_arrays, insert, motion
from coastwatch.store.schema.tables import CYCLE, DECIDED_PATH, MEMBER_HISTORY
from coastwatch.store.write.events import Timeline


def write_decided(
    connection: Connection, run_id: int, number: int, decided: DecidedPath, members: Ints, timeline: Timeline
) -> int:
    """Write the states that became final in a cycle, of tracks that are or were in the picture. The stays of its members are written.

    Args: number: of the cycle; members: (L, 3) vessel, source, track. Returns: rows.
    """
    if not len(decided):
        return 0
    oldest_s = float(decided.time_s.min())
    first = min(max(int((oldest_s - timeline.start_s) / timeline.period_s) - 2, 0), number)
    cycle = _cycle_of(connection, run_id, first, decided.time_s)
    vessel = vessel_at(decided.track_id, cycle, _stays(connection, run_id, first, members))
    rows = np.flatnonzero(vessel >= 0)
    rows = rows[np.lexsort((decided.time_s[rows], vessel[rows]))]
    decided, count = decided.take(rows), np.arange(len(rows))
    where = *decided.position_deg.T, *motion(decided.velocity_m_s, decided.covariance).T
    columns = [run_id, number, vessel[rows], count, decided.time_s, *where, decided.track_id, NullableId(decided.radar)]
    return insert(connection, DECIDED_PATH, columns)


def vessel_at(track: Ints, cycle: Ints, stays: Ints) -> Ints:
    """The vessel of each track in a cycle; where it had none, the last one before, else the first one after; -1: it never had one. (A,)

    Args: track, cycle: (A,); stays: (S, 3) track, first cycle, vessel.
    """
    stays = stays[np.lexsort((stays[:, 1], stays[:, 0]))]
    tracks, of = np.unique(stays[:, 0], return_inverse=True)
    if not len(tracks):
        return np.full(len(track), -1)
    wide = int(max(stays[:, 1].max(), cycle.max(initial=0))) + 2  # cycles count from -1 on
    at = np.minimum(np.searchsorted(tracks, track), len(tracks) - 1)
    begun = np.searchsorted(of * wide + stays[:, 1] + 1, at * wide + cycle + 1, side="right") - 1
    row = np.maximum(begun, np.searchsorted(of, at))  # else its first one
    return np.where(tracks[at] == track, stays[row, 2], -1)


def _cycle_of(connection: Connection, run_id: int, first: int, time_s: Floats) -> Ints:
    """The cycle at whose end each time was past. Args: first: cycle before all of them."""
    query = select(CYCLE.c.number, CYCLE.c.time_s).where(CYCLE.c.run_id == run_id, CYCLE.c.number >= first)
    numbers, ends_s = fetch_arrays(connection, query.order_by(CYCLE.c.number))
    at: Ints = numbers[np.minimum(np.searchsorted(ends_s, time_s), len(numbers) - 1)]
    return at


def _stays(connection: Connection, run_id: int, first: int, members: Ints) -> Ints:
    """The stays of radar tracks in vessels since a cycle. (S, 3) track, first cycle (-1: before it), vessel."""
    m = MEMBER_HISTORY.c
    columns = select(m.vessel_id, m.source, m.track_id, m.from_cycle, m.to_cycle).where(m.run_id == run_id)
    both = (
        columns.where(m.from_cycle > first),
        columns.where(m.to_cycle >= first),
    )  # each by its index; OR reads all stays of a run
    parts = zip(*(fetch_arrays(connection, query) for query in both), strict=True)
    vessel, source, track, begun, ended = (np.concatenate(part) for part in parts)
    of_radar = source == track // ID_STRIDE
    changed, lasting = np.stack([track, begun, vessel], 1)[of_radar], track[of_radar & (ended < 0)]
    of_radars = members[members[:, 1] == members[:, 2] // ID_STRIDE]
    unchanged = of_radars[~np.isin(of_radars[:, 2], lasting)]
    return np.concatenate([changed, np.stack([unchanged[:, 2], np.full(len(unchanged), -1), unchanged[:, 0]], 1)])
