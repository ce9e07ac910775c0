"""Names, types and sizes of vessels: a message that leaves something out does not wipe out what an earlier one said."""

from __future__ import annotations

from typing import NamedTuple

from sqlalchemy import Connection, bindparam, delete, select

from coastwatch.batches import AisStatics
from coastwatch.store.bulk import append
from coastwatch.store.columns import named, plain
from coastwatch.store.tables import Base, VesselStatic

TABLE = Base.metadata.tables["vessel_static"]


class Static(NamedTuple):
    """One row of `vessel_static`, without run and MMSI."""

    name: str | None
    call_sign: str | None
    ship_type: int | None
    length_m: float | None
    beam_m: float | None
    updated_s: float


def known(connection: Connection, run_id: int) -> dict[int, Static]:
    """What is stored of a run, by MMSI."""
    rows = connection.execute(select(TABLE).where(VesselStatic.run_id == run_id))
    return {row.mmsi: Static(*tuple(row)[2:]) for row in rows}


def merge(connection: Connection, run_id: int, before: dict[int, Static], heard: AisStatics) -> dict[int, Static]:
    """Write what is new of the messages of a cycle; returns all that is then known. `before` is left as it was."""
    if not len(heard):
        return before
    texts = [[_text(x) for x in column.tolist()] for column in (heard.name, heard.call_sign)]
    numbers = [named(heard.ship_type), plain(heard.length_m), plain(heard.beam_m), heard.received_s.tolist()]
    fresh: dict[int, Static] = {}
    for mmsi, *said in zip(heard.mmsi.tolist(), *texts, *numbers, strict=True):
        old = fresh.get(mmsi) or before.get(mmsi)
        fresh[mmsi] = (
            Static(*said) if old is None else Static._make(a if a is not None else b for a, b in zip(said, old, strict=True))
        )
    connection.execute(
        delete(TABLE).where(TABLE.c.run_id == run_id, TABLE.c.mmsi == bindparam("of_mmsi")),
        [{"of_mmsi": mmsi} for mmsi in fresh],
    )
    mmsi = sorted(fresh)
    columns = list(zip(*(fresh[number] for number in mmsi), strict=True))
    append(connection, TABLE, [[run_id] * len(mmsi), mmsi, *columns])
    return {**before, **fresh}


def _text(said: str) -> str | None:
    """What was said, without what PostgreSQL's text cannot hold and the padding of the wire; None where that is nothing."""
    return said.replace("\x00", "").strip().rstrip("@") or None
