"""What is told of vessels beside where they are: name and type, since when they have been there, who sees them."""

from __future__ import annotations

from typing import Any

import numpy as np
from sqlalchemy import Connection, Select, and_, or_, select

from coastwatch.batches import Array, Floats, Ints
from coastwatch.store import columns
from coastwatch.store.collect import among, collected, loaded
from coastwatch.store.tables import MemberHistory, Presence, Source, VesselStatic

FEW = 1000
"""Vessels that are asked for by name; of more the whole table of the run is read."""

STATIC = ("name", "call_sign", "ship_type", "length_m", "beam_m")


def statics_of(connection: Connection, run_id: int, mmsi: Ints) -> dict[str, Array]:
    """Name, call sign, type and size for each MMSI of a row, -1 for none. Args: (V,)."""
    s = VesselStatic
    query = select(s.mmsi, *(getattr(s, name) for name in STATIC)).where(s.run_id == run_id)
    known, *found = _of(connection, query, s.mmsi, mmsi, len(mmsi))
    order = np.argsort(known, kind="stable")
    row = np.append(order, len(order))[np.searchsorted(known[order], mmsi)]
    row[np.append(known, -1)[row] != mmsi] = len(order)
    return {name: _ended(column)[row] for name, column in zip(STATIC, found, strict=True)}


def since_of(connection: Connection, run_id: int, cycle: int, vessel_id: Ints) -> Floats:
    """When the stay of each vessel began that had this cycle in it, by its own account. Args: (V,) sorted."""
    p = Presence
    query = select(p.vessel_id, p.since_s).where(p.run_id == run_id, holds(p, cycle))
    known, since = _of(connection, query, p.vessel_id, vessel_id, len(vessel_id))
    out = np.full(len(vessel_id), np.nan)
    at = np.searchsorted(vessel_id, known)
    here = np.append(vessel_id, -1)[at] == known
    out[at[here]] = since[here]
    return out


def sources_of(connection: Connection, run_id: int, cycle: int, vessel_id: Ints) -> Array:
    """Names of the sources that each vessel had in a cycle, "guanabara,ais". Args: (V,) sorted."""
    m = MemberHistory
    query = select(m.vessel_id, m.source, m.track_id).where(m.run_id == run_id, holds(m, cycle))
    members = np.stack(_of(connection, query, m.vessel_id, vessel_id, 3 * len(vessel_id)), 1)
    names = select(Source.number, Source.name).where(Source.run_id == run_id)
    name_of = {row.number: row.name for row in connection.execute(names)}
    texts = [name_of.get(k, "") for k in range(max(name_of, default=-1) + 1)]
    if not loaded():
        return _texts(vessel_id, members, texts)
    members = members[np.lexsort(members.T[::-1])] if _unsorted(members) else members
    found = columns.sources(vessel_id, members, texts)
    return np.array(found.of, object)[found.codes]


def holds(stay: type[Presence] | type[MemberHistory], cycle: int) -> Any:
    """Whether a stay has a cycle in it. The sum keeps SQLite from an index by cycles, most of which are before this one."""
    return and_(stay.from_cycle + 0 <= cycle, or_(stay.to_cycle.is_(None), stay.to_cycle >= cycle))


def _of(connection: Connection, query: Select[*tuple[Any, ...]], key: Any, wanted: Ints, most: int) -> list[Array]:
    """The rows of these keys, or, where they are many, of all keys."""
    if len(wanted) <= FEW:
        return collected(connection, query.where(among(connection, key, wanted)), most, likely=len(wanted))
    return collected(connection, query, most)


def _ended(column: Array) -> Array:
    """The column with a last value that stands for none."""
    absent = {"S": b"", "i": -1, "f": np.nan}[column.dtype.kind]
    return np.append(column, np.array([absent], column.dtype))


def _unsorted(members: Ints) -> bool:
    vessel, source = members[:, 0], members[:, 1]
    same, later = vessel[1:] == vessel[:-1], vessel[1:] > vessel[:-1]
    return not bool((later | (same & (source[1:] >= source[:-1]))).all())


def _texts(vessel_id: Ints, members: Ints, names: list[str]) -> Array:
    """The same as compiled code makes of many."""
    sources: dict[int, set[int]] = {}
    for vessel, source in members[:, :2].tolist():
        sources.setdefault(vessel, set()).add(source)
    texts = [",".join(names[k] for k in sorted(sources.get(vessel, ()))) for vessel in vessel_id.tolist()]
    return np.array([*texts, ""], object)[:-1]
