"""What passes between centres: the cycles of tracks that a region keeps for its centres, and what a centre has used of each region."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from sqlalchemy import Connection, delete, func, insert, select
from zstandard import ZstdCompressor, ZstdDecompressor, ZstdError

from coastwatch.errors import StoreError
from coastwatch.store.schema.database import Store, reading
from coastwatch.store.schema.tables import REGION_INTAKE, RUN, TRACK_JOURNAL

LEVEL = 1
FRAME = b"\x28\xb5\x2f\xfd"
"""How a zstd frame begins."""


class JournalEntry(NamedTuple):
    """One cycle of tracks that a region keeps."""

    run_id: int
    cycle: int
    message: bytes


class Intake(NamedTuple):
    """What a cycle of a centre used of a region: an unbroken range of the region's cycles."""

    region: str  # name of its track source
    region_run: str
    first_seq: int
    last_seq: int
    late: int  # how many of them came after their cycle and were left out


class ForCentres(NamedTuple):
    """What a cycle passes between centres."""

    message: bytes | None = None  # tracks of a region for its centres; None: it has none
    intake: Sequence[Intake] = ()  # cycles of regions that a centre has used


NOTHING_PASSED = ForCentres()


def compressed(data: bytes) -> bytes:
    """The bytes compressed with zstd."""
    return ZstdCompressor(level=LEVEL).compress(data)


def decompressed(data: bytes) -> bytes:
    """The bytes that `compressed` was given; other bytes, of an older version, as they are. Raises: StoreError: they are damaged."""
    if not data.startswith(FRAME):
        return data
    try:
        return ZstdDecompressor().decompress(data)
    except ZstdError as error:
        raise StoreError(f"compressed value: it is damaged: {error}") from error


def write_for_centres(
    connection: Connection, run_id: int, number: int, time_s: float, for_centres: ForCentres, keep: int
) -> None:
    """Write what a cycle passes between centres, in the transaction of the connection. Args: keep: newest messages that are kept."""
    if for_centres.message is not None:
        message = compressed(for_centres.message)
        connection.execute(insert(TRACK_JOURNAL), [{"run_id": run_id, "cycle": number, "time_s": time_s, "message": message}])
        old = delete(TRACK_JOURNAL).where(TRACK_JOURNAL.c.run_id == run_id, TRACK_JOURNAL.c.cycle <= number - keep)
        connection.execute(old)
    if for_centres.intake:
        rows = [{"run_id": run_id, "cycle": number, "number": k, **one._asdict()} for k, one in enumerate(for_centres.intake)]
        connection.execute(insert(REGION_INTAKE), rows)


def journal_after(store: Store, run_id: int, cycle: int, count: int) -> list[JournalEntry]:
    """The kept cycles after one of a run, also those of later runs, oldest first. Args: count: at most so many. Raises: StoreError."""
    j = TRACK_JOURNAL.c
    later = ((j.run_id == run_id) & (j.cycle > cycle)) | (j.run_id > run_id)
    query = select(j.run_id, j.cycle, j.message).where(later).order_by(j.run_id, j.cycle).limit(count)
    with reading(store) as connection:
        rows = connection.execute(query).all()
    return [JournalEntry(row.run_id, row.cycle, decompressed(row.message)) for row in rows]


def journal_start(store: Store, after_s: float) -> tuple[int, int] | None:
    """Run and number of the cycle before the first kept one that ends after an instant, in the newest run with kept cycles.

    Where all are older, the last one. None: no cycle is kept. Raises: StoreError.
    """
    j = TRACK_JOURNAL.c
    with reading(store) as connection:
        run_id = connection.scalar(select(func.max(j.run_id)))
        if run_id is None:
            return None
        first = connection.scalar(select(func.min(j.cycle)).where(j.run_id == run_id, j.time_s > after_s))
        last = connection.scalar(select(func.max(j.cycle)).where(j.run_id == run_id))
        return int(run_id), int(first) - 1 if first is not None else int(last or 0)


def run_key(store: Store, run_id: int) -> str | None:
    """The name of a run for other centres: its number and when it began, `7@2026-07-01T12:00:00Z`; None: there is no such run."""
    with reading(store) as connection:
        started = connection.scalar(select(RUN.c.started_utc).where(RUN.c.id == run_id))
    return None if started is None else f"{run_id}@{started}"


def region_positions(store: Store, run_id: int, cycle: int) -> dict[str, tuple[str, int]]:
    """The last cycle of each region that a run had used after one of its own: run of the region, and its seq. Raises: StoreError."""
    i = REGION_INTAKE.c
    query = select(i.region, i.region_run, i.last_seq).where(i.run_id == run_id, i.cycle <= cycle)
    with reading(store) as connection:
        newest = select(i.region, func.max(i.cycle).label("cycle")).where(i.run_id == run_id, i.cycle <= cycle)
        newest_cycle = newest.group_by(i.region).subquery()
        rows = connection.execute(
            query.join(newest_cycle, (newest_cycle.c.region == i.region) & (newest_cycle.c.cycle == i.cycle)).order_by(i.number)
        ).all()
    return {row.region: (row.region_run, row.last_seq) for row in rows}  # of two runs in one cycle the later one
