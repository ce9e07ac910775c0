"""A run taken back to before one of its cycles, for when it goes on from an older checkpoint."""

from __future__ import annotations

from sqlalchemy import Connection, delete, insert, select, update

from coastwatch.store.blocks import forget_blocks
from coastwatch.store.tables import Base, Checkpoint, Member, MemberHistory

OF_CYCLE = ("stage_timing", "history", "association", "bearing_association", "spot", "sensor_registration", "chunk")
"""Tables with rows of one cycle each, under column `cycle`."""


def rewind(connection: Connection, run_id: int, number: int) -> None:
    """Delete this cycle and all later ones; the stays of vessels and members are as they were after the one before it.

    The tables of the current picture are left to the cycle that is about to be written, in the same transaction.
    """
    tables = Base.metadata.tables
    for name in OF_CYCLE:
        table = tables[name]
        connection.execute(delete(table).where(table.c.run_id == run_id, table.c.cycle >= number))
    forget_blocks(connection, run_id, from_cycle=number)
    for stay in (tables["presence"], tables["member_history"], tables["identity"]):
        of_run = stay.c.run_id == run_id
        connection.execute(delete(stay).where(of_run, stay.c.from_cycle >= number))
        connection.execute(update(stay).where(of_run, stay.c.to_cycle >= number - 1).values(to_cycle=None))
    connection.execute(delete(Member).where(Member.run_id == run_id))
    old = select(MemberHistory.run_id, MemberHistory.vessel_id, MemberHistory.source, MemberHistory.track_id)
    old = old.where(MemberHistory.run_id == run_id, MemberHistory.to_cycle.is_(None))
    connection.execute(insert(Member).from_select(["run_id", "vessel_id", "source", "track_id"], old))
    connection.execute(delete(Checkpoint).where(Checkpoint.run_id == run_id, Checkpoint.cycle >= number))
    cycle = tables["cycle"]
    connection.execute(delete(cycle).where(cycle.c.run_id == run_id, cycle.c.number >= number))
