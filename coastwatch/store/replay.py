"""The full recording read back: each picture with its members, every column bit for bit as it was written."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from sqlalchemy import ColumnElement, Connection, Select, and_, or_, select, true

from coastwatch.batches import Bools, Ints, Members, Picture
from coastwatch.store.box import Box, inside
from coastwatch.store.chunks_table import Chunk
from coastwatch.store.opening import Store, StoreError, reading
from coastwatch.store.runs import run_exists
from coastwatch.store.tables import Cycle

if TYPE_CHECKING:  # decoding needs numba, which is slow to import
    from coastwatch.store.chunks_codec import Part


class Recorded(NamedTuple):
    """A cycle as it was recorded."""

    cycle: int
    time_s: float
    picture: Picture  # sorted by vessel_id
    members: Members


@dataclass
class Keys:
    """The parts of one key cycle that were needed so far."""

    cycle: int = -1
    parts: dict[int, Part] = field(default_factory=dict)


def replay(
    store: Store, run_id: int, from_s: float | None = None, to_s: float | None = None, bbox: Box | None = None
) -> Iterator[Recorded]:
    """Each recorded cycle between two instants, both included, oldest first.

    No transaction is held between two cycles: what is written meanwhile comes along, what is discarded is missing.

    Args: bbox: south, west, north, east in degrees: only vessels in it, with their members; west > east crosses the antimeridian.
    Raises: StoreError where there is no such run.
    """
    with reading(store) as connection:
        run_exists(connection, store, run_id)
    where = [Cycle.run_id == run_id, Cycle.recorded.is_(True)]
    where += [] if from_s is None else [Cycle.time_s >= from_s]
    where += [] if to_s is None else [Cycle.time_s <= to_s]
    following = select(Cycle.number, Cycle.time_s).where(*where).order_by(Cycle.number).limit(1)
    last, keys = -1, Keys()
    while True:
        with reading(store) as connection:
            found = connection.execute(following.where(Cycle.number > last)).first()
            if found is None:
                return
            last = found.number
            made = read_cycle(connection, run_id, last, bbox, keys)
        yield Recorded(last, found.time_s, *made)


def recorded_at(store: Store, run_id: int, at_s: float, bbox: Box | None = None) -> Recorded:
    """The newest recorded cycle up to an instant. Args: bbox: as of `replay`.

    Raises: StoreError where there is no such run, or nothing is recorded so early.
    """
    with reading(store) as connection:
        run_exists(connection, store, run_id)
        newest = select(Cycle.number, Cycle.time_s).where(Cycle.run_id == run_id, Cycle.recorded, Cycle.time_s <= at_s)
        found = connection.execute(newest.order_by(Cycle.number.desc()).limit(1)).first()
        if found is None:
            raise StoreError(f"{store.where}: run {run_id}: nothing is recorded up to then; `store.recording` records")
        made = read_cycle(connection, run_id, found.number, bbox)
    return Recorded(found.number, found.time_s, *made)


def read_cycle(
    connection: Connection, run_id: int, cycle: int, bbox: Box | None, keys: Keys | None = None
) -> tuple[Picture, Members]:
    """Picture and members of a recorded cycle. Args: bbox: as of `replay`; keys: in hand from the cycle before."""
    from coastwatch.store.chunks_codec import batches, unpacked

    parts = []
    told = connection.execute(_parts(run_id, cycle).where(_meets(bbox))).all()
    for part, key_cycle, data in told:
        if key_cycle == cycle:
            parts.append(unpacked(bytes(data), None))
        else:
            parts.append(unpacked(bytes(data), _key_part(connection, run_id, key_cycle, part, keys or Keys())))
    picture, members = batches(parts)
    return (picture, members) if bbox is None else _within(picture, members, bbox)


def _key_part(connection: Connection, run_id: int, cycle: int, part: int, keys: Keys) -> Part:
    from coastwatch.store.chunks_codec import unpacked

    if keys.cycle != cycle:
        keys.cycle, keys.parts = cycle, {}
    if part not in keys.parts:
        data = connection.execute(_parts(run_id, cycle).where(Chunk.part == part)).one().data
        keys.parts[part] = unpacked(bytes(data), None)
    return keys.parts[part]


def _parts(run_id: int, cycle: int) -> Select[int, int, bytes]:
    found = select(Chunk.part, Chunk.key_cycle, Chunk.data).where(Chunk.run_id == run_id, Chunk.cycle == cycle)
    return found.order_by(Chunk.part)


def _meets(bbox: Box | None) -> ColumnElement[bool]:
    """Whether the box of a part has a place in common with a box."""
    if bbox is None:
        return true()
    south, west, north, east = bbox
    after, before = Chunk.east_deg >= west, Chunk.west_deg <= east
    return and_(Chunk.south_deg <= north, Chunk.north_deg >= south, and_(after, before) if west <= east else or_(after, before))


def _within(picture: Picture, members: Members, bbox: Box) -> tuple[Picture, Members]:
    kept = picture.take(inside(picture.position_deg, bbox))
    return kept, members.take(_among(members.vessel_id, kept.vessel_id))


def _among(ids: Ints, known: Ints) -> Bools:
    """Which ids are among others. Both sorted."""
    at = np.searchsorted(known, ids)
    out: Bools = (at < len(known)) & (np.append(known, -1)[at] == ids)
    return out
