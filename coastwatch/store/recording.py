"""The full recording: every picture with its members, bit for bit, one compressed value for each column of a cycle.

The bytes of a column are transposed (all first bytes, then all second bytes, ...), so that equal bytes stand together, and compressed
with zstd. Sorted ids are stored as differences. The lower triangle of a covariance is stored as its difference in bits (XOR) from the
upper one, which is zero nearly everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields
from typing import NamedTuple

import numpy as np
from sqlalchemy import Connection, delete, func, insert, select, update
from zstandard import ZstdCompressor, ZstdDecompressor

from coastwatch.batches import Array, Members, Picture
from coastwatch.kernels.tables.lookup import find
from coastwatch.store.bbox import Box, inside
from coastwatch.store.runs import between, run_exists
from coastwatch.store.schema.database import Store, reading
from coastwatch.store.schema.tables import CYCLE, RECORDING

LEVEL = 1
UPPER, LOWER = np.triu_indices(4), np.tril_indices(4, -1)

SHAPES: dict[str, tuple[int, ...]] = {"position_deg": (2,), "velocity_m_s": (2,), "covariance": (4, 4)}
"""Shape of a vessel's value, in columns that hold more than one number."""

WHOLE = ("vessel_id", "mmsi", "flags", "origin", "nav_status", "member_vessel_id", "member_track_id", "member_source")
"""Columns of int64; the others are of float64."""

DIFFERENCES = ("vessel_id", "member_vessel_id")


class Recorded(NamedTuple):
    """A cycle as it was recorded."""

    cycle: int
    time_s: float
    picture: Picture  # sorted by vessel_id
    members: Members


def record(connection: Connection, run_id: int, number: int, picture: Picture, members: Members) -> None:
    """Write the recording of a cycle, in the transaction of the connection.

    Args: picture: sorted by vessel_id; members: sorted by vessel_id, of vessels of the picture.
    Raises: ValueError where a member is of no vessel of the picture.
    """
    is_shown = find(picture.vessel_id, members.vessel_id) >= 0
    if not is_shown.all():
        raise ValueError(f"members: got {int((~is_shown).sum())} of no vessel of the picture, needed none")
    columns = {field.name: getattr(picture, field.name) for field in fields(picture)}
    columns |= {f"member_{field.name}": getattr(members, field.name) for field in fields(members)}
    compressor = ZstdCompressor(level=LEVEL, write_checksum=True)
    row: dict[str, object] = {name: encode(name, values, compressor) for name, values in columns.items()}
    row |= {"run_id": run_id, "cycle": number, "vessels": len(picture), "members": len(members)}
    connection.execute(insert(RECORDING), [row])


def encode(name: str, values: Array, compressor: ZstdCompressor) -> bytes:
    """One column as compressed bytes."""
    if name in DIFFERENCES:
        values = np.diff(values, prepend=0)
    if name == "covariance":
        bits = values.view(np.int64)
        upper = bits[:, UPPER[0], UPPER[1]]
        values = np.concatenate([upper, bits[:, LOWER[0], LOWER[1]] ^ bits[:, LOWER[1], LOWER[0]]], 1)
    planes = np.ascontiguousarray(values).reshape(len(values), math.prod(SHAPES.get(name, ()))).view(np.uint8).T
    return compressor.compress(planes.tobytes())


def decode(name: str, data: bytes, count: int) -> Array:
    """The column that `encode` was given. Args: count: of rows."""
    planes = np.frombuffer(ZstdDecompressor().decompress(data), np.uint8).reshape(8 * math.prod(SHAPES.get(name, ())), count)
    values: Array = np.ascontiguousarray(planes.T).view(np.int64)
    if name in DIFFERENCES:
        values = np.cumsum(values, axis=0)
    if name == "covariance":
        bits = np.empty((count, 4, 4), np.int64)
        bits[:, UPPER[0], UPPER[1]] = values[:, :10]
        bits[:, LOWER[0], LOWER[1]] = values[:, 10:] ^ bits[:, LOWER[1], LOWER[0]]
        values = bits
    values = values if name in WHOLE else values.view(np.float64)
    return values.reshape(count, *SHAPES.get(name, ()))


def replay(
    store: Store, run_id: int, from_s: float | None = None, to_s: float | None = None, bbox: Box | None = None
) -> Iterator[Recorded]:
    """Each recorded cycle between two instants, both included, oldest first.

    No transaction is held between two cycles: cycles written meanwhile are included, deleted ones are missing.

    Args: bbox: south, west, north, east in degrees: only vessels in it, with their members; west > east crosses the antimeridian.
    Raises: StoreError where there is no such run.
    """
    with reading(store) as connection:
        run_exists(connection, store, run_id)
    following = select(CYCLE.c.number, CYCLE.c.time_s).where(CYCLE.c.run_id == run_id, CYCLE.c.recorded.is_(True))
    following = following.where(*between(from_s, to_s)).order_by(CYCLE.c.number).limit(1)
    last = -1
    while True:
        with reading(store) as connection:
            cycle = connection.execute(following.where(CYCLE.c.number > last)).first()
            if cycle is None:
                return
            last = cycle.number
            picture, members = read_recorded(connection, run_id, last, bbox)
        yield Recorded(last, cycle.time_s, picture, members)


def read_recorded(connection: Connection, run_id: int, cycle: int, bbox: Box | None) -> tuple[Picture, Members]:
    """Picture and members of a recorded cycle. Args: bbox: as of `replay`."""
    query = select(RECORDING).where(RECORDING.c.run_id == run_id, RECORDING.c.cycle == cycle)
    row = connection.execute(query).mappings().one()
    kept = [field.name for field in fields(Picture) if row[field.name] is not None]
    picture = Picture(**{name: decode(name, row[name], row["vessels"]) for name in kept})
    names = [f"member_{field.name}" for field in fields(Members)]
    members = Members(*(decode(name, row[name], row["members"]) for name in names))
    if bbox is None:
        return picture, members
    picture = picture.take(np.flatnonzero(inside(picture.position_deg, bbox)))
    return picture, members.take(np.flatnonzero(find(picture.vessel_id, members.vessel_id) >= 0))


def delete_recording(connection: Connection, run_id: int, first: int, most: int | None) -> int:
    """Delete the recording of the cycles before one, in the transaction of the connection. Args: most: cycles at once, the oldest ones.

    Returns: cycles deleted.
    """
    oldest = connection.scalar(select(func.min(RECORDING.c.cycle)).where(RECORDING.c.run_id == run_id))
    if oldest is not None and oldest < first:
        upto = first if most is None else min(first, oldest + most)
        gone = update(CYCLE).where(CYCLE.c.run_id == run_id, CYCLE.c.number >= oldest, CYCLE.c.number < upto)
        connection.execute(gone.values(recorded=False))
        return connection.execute(delete(RECORDING).where(RECORDING.c.run_id == run_id, RECORDING.c.cycle < upto)).rowcount
    return 0
