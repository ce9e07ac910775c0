"""Table `chunk`, the full recording: where its parts stand, and how they are deleted. `chunks` writes them, `replay` reads them."""

from __future__ import annotations

from sqlalchemy import Connection, delete, func, select, update
from sqlalchemy.orm import Mapped

from coastwatch.store.declaring import IN_KEY_ORDER, Base, key, of_run
from coastwatch.store.opening import Store, writing
from coastwatch.store.tables import Cycle


class Chunk(Base):
    """Some rows of a recorded cycle, with their members. The box is the whole Earth where it would cross the antimeridian.

    The bytes come last: a row whose box is elsewhere is passed over without a look at them.
    """

    __tablename__ = "chunk"
    __table_args__ = IN_KEY_ORDER
    run_id: Mapped[int] = of_run()
    cycle: Mapped[int] = key()
    part: Mapped[int] = key()
    key_cycle: Mapped[
        int
    ]  # where the part of this number stands of whose rows this one tells; its own cycle where it stands alone
    rows: Mapped[int]
    south_deg: Mapped[float]
    west_deg: Mapped[float]
    north_deg: Mapped[float]
    east_deg: Mapped[float]
    data: Mapped[bytes]  # chunks_codec


def key_cycle(connection: Connection, run_id: int, cycle: int) -> int | None:
    """The key cycle that a recorded cycle is told against; None where none of its vessels is recorded."""
    of_cycle = select(func.min(Chunk.key_cycle)).where(Chunk.run_id == run_id, Chunk.cycle == cycle)
    return connection.scalar(of_cycle)


def discard_chunks_before(store: Store, run_id: int, cycle: int) -> int:
    """Delete the recording of the cycles before one; returns the first cycle that is still recorded from there on.

    The key cycle that the first kept cycle is told against stays with it, and what lies between. Raises: StoreError.
    """
    with writing(store) as connection:
        return forget_chunks(connection, run_id, cycle, None)


def forget_chunks(connection: Connection, run_id: int, kept: int, most: int | None) -> int:
    """As `discard_chunks_before`, in the transaction in hand. Args: most: cycles whose parts are deleted at once, the oldest; the
    others can no longer be read all the same.
    """
    of_run = Chunk.run_id == run_id
    later = connection.scalar(select(func.min(Chunk.cycle)).where(of_run, Chunk.cycle >= kept))
    needed = None if later is None else key_cycle(connection, run_id, later)
    first = kept if needed is None else min(kept, needed)
    oldest = connection.scalar(select(func.min(Chunk.cycle)).where(of_run))
    if oldest is None or oldest >= first:
        return first
    told = (Cycle.run_id == run_id) & Cycle.number.between(oldest, first - 1) & Cycle.recorded
    connection.execute(update(Cycle).where(told).values(recorded=False))
    connection.execute(delete(Chunk).where(of_run, Chunk.cycle < (first if most is None else min(first, oldest + most))))
    return first
