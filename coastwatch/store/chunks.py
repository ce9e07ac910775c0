"""The full recording: every row of every picture, with its members, in compressed parts of neighbouring vessels.

Every so many cycles is a key cycle, whose parts stand alone: vessels in the order of a curve through their places, cut into parts.
In the cycles after it each vessel stays in its part, which tells how the row differs from the key cycle's; vessels that are new
since then make parts of their own. A cycle is read from its own parts and those of its key cycle alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from sqlalchemy import Connection, insert, select, update
from zstandard import ZstdCompressor

from coastwatch.batches import Array, Ints, Members, Picture
from coastwatch.kernels.geometry.curve import curve_order, extent
from coastwatch.kernels.tables.picture_codec import WORDS, member_starts, member_words, row_words, whereabouts
from coastwatch.store.chunks_codec import Part, Words, compressor, packed, unpacked
from coastwatch.store.chunks_table import Chunk, key_cycle
from coastwatch.store.tables import Cycle

KEY_EVERY = 20  # cycles: at 3 s, a minute; a picture of the past is decoded from two cycles, however many lie between
PART_ROWS = 4096

Told = tuple[int, int, Ints, bytes]
"""Number of a part, its key cycle, its rows of the picture, its bytes."""

NONE = np.zeros(0, np.int64)


@dataclass(frozen=True, eq=False)
class Key:
    """A key cycle as it is held in hand while cycles are told against it. B rows in all parts, in their order: a row's slot."""

    cycle: int
    parts: tuple[Part, ...]
    start: Ints  # (parts + 1,) first slot of each part
    known: Ints  # (B,) numbers of vessels, sorted
    slot: Ints  # (B,) of each


@dataclass(frozen=True, eq=False)
class _Columns:
    """The columns of a cycle as words; what the kernels take."""

    single: tuple[Words, ...]
    position: Words
    velocity: Words
    covariance: Words
    first: Ints  # (V + 1,) where the members of each vessel begin
    track: Words
    source: Words


def record(connection: Connection, run_id: int, number: int, picture: Picture, members: Members, before: Key | None) -> Key:
    """Write the parts of a cycle, in the transaction in hand; returns the key cycle for the next one.

    Args: picture: sorted by vessel_id; members: sorted by vessel_id, of vessels of the picture; before: what this function returned
    for the last cycle; None: the database knows.
    Raises: ValueError where a member is of no vessel of the picture.
    """
    made, press = _columns(picture, members), compressor()
    key = None if number % KEY_EVERY == 0 else before or _last_key(connection, run_id, number)
    told = [] if key is None else _against(made, key, picture.vessel_id, press)
    if key is not None and told:
        after, fresh = key, _fresh(picture.vessel_id, key)
        new = enumerate(_cut(fresh), len(key.parts))
        told += [(k, number, rows, packed(_part(made, rows), None, NONE, NONE, press)) for k, rows in new]
    else:
        order = np.empty(len(picture), np.int64)
        curve_order(picture.position_deg, order)
        cut = _cut(order)
        after = _key(number, tuple(_part(made, rows) for rows in cut))
        both = enumerate(zip(cut, after.parts, strict=True))
        told = [(k, number, rows, packed(part, None, NONE, NONE, press)) for k, (rows, part) in both]
    _store(connection, run_id, number, told, picture)
    connection.execute(update(Cycle).where(Cycle.run_id == run_id, Cycle.number == number).values(recorded=True))
    return after


def _last_key(connection: Connection, run_id: int, number: int) -> Key | None:
    """The key cycle that the last cycle was told against; None where that one was not recorded."""
    cycle = key_cycle(connection, run_id, number - 1)
    if cycle is None:
        return None
    rows = select(Chunk.data).where(Chunk.run_id == run_id, Chunk.cycle == cycle).order_by(Chunk.part)
    return _key(cycle, tuple(unpacked(bytes(data), None) for data in connection.scalars(rows)))


def _columns(p: Picture, members: Members) -> _Columns:
    first = np.empty(len(p) + 1, np.int64)
    found = member_starts(p.vessel_id, members.vessel_id, first)
    if found != len(members):
        raise ValueError(f"members: got {len(members) - found} of no vessel of the picture, needed none")
    single = (p.vessel_id, p.time_s, p.since_s, p.updated_s, p.mmsi, p.flags, p.origin)
    position, velocity, covariance = (_words(column) for column in (p.position_deg, p.velocity_m_s, p.covariance))
    track, source = _words(members.track_id), _words(members.source)
    return _Columns(tuple(map(_words, single)), position, velocity, covariance, first, track, source)


def _words(values: Array) -> Words:
    return np.ascontiguousarray(values).view(np.uint64)


def _cut(order: Ints) -> list[Ints]:
    """Rows in parts of about the same size."""
    return np.array_split(order, -(-len(order) // PART_ROWS)) if len(order) else []


def _part(made: _Columns, rows: Ints) -> Part:
    return _part_against(made, rows, np.full(len(rows), -1), np.zeros(1, np.int64))[0]


def _part_against(made: _Columns, rows: Ints, place: Ints, first: Ints) -> tuple[Part, Ints]:
    """Some rows as a part, and which member of a known part each of its members is likely to be."""
    words = np.empty((WORDS, len(rows)), np.uint64)
    row_words(rows, made.single, made.position, made.velocity, made.covariance, made.first, words)
    count = int((made.first[rows + 1] - made.first[rows]).sum())
    members, member_place = np.empty((2, count), np.uint64), np.empty(count, np.int64)
    member_words(rows, made.first, made.track, made.source, place, first, members, member_place)
    return Part(words, members), member_place


def _against(made: _Columns, before: Key, numbers: Ints, press: ZstdCompressor) -> list[Told]:
    """The parts of the key cycle of which vessels are left."""
    at = np.empty(len(before.known), np.int64)
    whereabouts(numbers, before.known, before.slot, at, np.empty(len(numbers), np.int64))
    out: list[Told] = []
    for k, known in enumerate(before.parts):
        here = at[before.start[k] : before.start[k + 1]]
        place = np.flatnonzero(here >= 0)
        if len(place):
            part, member_place = _part_against(made, here[place], place, known.first())
            out.append((k, before.cycle, here[place], packed(part, known, place, member_place, press)))
    return out


def _fresh(numbers: Ints, before: Key) -> Ints:
    """Rows of vessels that the key cycle did not have."""
    out = np.empty(len(numbers), np.int64)
    return out[: whereabouts(numbers, before.known, before.slot, np.empty(len(before.known), np.int64), out)]


def _key(cycle: int, parts: tuple[Part, ...]) -> Key:
    start = np.concatenate([[0], np.cumsum([part.rows.shape[1] for part in parts])]).astype(np.int64)
    numbers = np.concatenate([NONE, *(part.rows[0].view(np.int64) for part in parts)])
    slot = np.argsort(numbers, kind="stable")
    return Key(cycle, parts, start, numbers[slot], slot)


def _store(connection: Connection, run_id: int, number: int, parts: Sequence[Told], picture: Picture) -> None:
    if not parts:
        return
    names = [column.name for column in Chunk.__table__.columns]
    rows = [(run_id, number, part, cycle, len(of), *_box(picture.position_deg[of]), data) for part, cycle, of, data in parts]
    connection.execute(insert(Chunk), [dict(zip(names, row, strict=True)) for row in rows])


def _box(place: Array) -> tuple[float, float, float, float]:
    """South, west, north, east."""
    south, west, north, east = extent(place)
    if south <= north and west <= east and east - west <= 180.0:
        return south, west, north, east
    return -90.0, -180.0, 90.0, 180.0
