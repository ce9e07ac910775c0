"""Names, types and sizes of vessels: a message that leaves something out does not wipe out what an earlier one said."""

from __future__ import annotations

import numpy as np
from sqlalchemy import Connection, select

from coastwatch.batches import AisStatics, Array, Bools, Ints
from coastwatch.store.bulk import append, renew
from coastwatch.store.cells import Column, Named, Texts, part
from coastwatch.store.tables import Base, VesselStatic

TABLE = Base.metadata.tables["vessel_static"]


def known(connection: Connection, run_id: int) -> Ints:
    """Every MMSI of which something is stored, sorted."""
    query = select(VesselStatic.mmsi).where(VesselStatic.run_id == run_id).order_by(VesselStatic.mmsi)
    return np.array(connection.scalars(query).all(), np.int64)


def merge(connection: Connection, run_id: int, before: Ints, heard: AisStatics) -> Ints:
    """Write what is new of the messages of a cycle. Args: before: every MMSI that has a row. Returns: the same afterwards."""
    if not len(heard):
        return before
    mmsi, said = _folded(heard)
    at = np.searchsorted(before, mmsi)
    new = np.append(before, -1)[at] != mmsi
    append(connection, TABLE, [run_id, mmsi[new], *(part(column, new) for column in said.values())])
    old = {name: part(column, ~new) for name, column in said.items()}
    renew(connection, TABLE, {"mmsi": mmsi[~new]}, {"run_id": run_id}, old)
    return np.insert(before, at[new], mmsi[new])


def _folded(heard: AisStatics) -> tuple[Ints, dict[str, Column]]:
    """One row a MMSI, sorted, and of each column the last message that said something."""
    order = np.argsort(heard.mmsi, kind="stable")
    mmsi = heard.mmsi[order]
    first = np.flatnonzero(np.append(True, mmsi[1:] != mmsi[:-1]))

    def newest(said: Bools) -> Array:
        rows = np.maximum.reduceat(np.where(said[order], np.arange(len(order)), -1), first)
        return np.where(rows < 0, -1, order[rows])

    def numbers(of: Array) -> Array:
        rows = newest(~np.isnan(of))
        return np.where(rows < 0, np.nan, of[rows])

    def texts(of: Array) -> Texts:
        cleaned = [_text(x) for x in of.tolist()]
        rows = newest(np.array([x != "" for x in cleaned], np.bool_))
        return Texts(np.where(rows < 0, -1, np.arange(len(rows))), [cleaned[row] for row in rows.tolist()])

    kind = newest(heard.ship_type >= 0)
    return mmsi[first], {
        "name": texts(heard.name),
        "call_sign": texts(heard.call_sign),
        "ship_type": Named(np.where(kind < 0, -1, heard.ship_type[kind])),
        "length_m": numbers(heard.length_m),
        "beam_m": numbers(heard.beam_m),
        "updated_s": heard.received_s[newest(np.ones(len(heard), np.bool_))],
    }


def _text(said: str) -> str:
    """What was said, without what PostgreSQL's text cannot hold and the padding of the wire."""
    return said.replace("\x00", "").strip().rstrip("@")
