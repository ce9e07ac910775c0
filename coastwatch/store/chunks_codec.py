"""A part of a recorded cycle as bytes, bit for bit: rows of the picture and their members, as they are or against a key part.

    bytes 0-3    rows of the key part that the part tells of; 0: it stands alone
    4-7          rows
    8-11, 12-15  lengths of the two tables that follow the presence: rows (28 words), members (2 words)
    then         presence: one bit a row of the key part, where some of them are gone and the part does not stand alone; the tables

A table: length of its compressed bytes (4), then zstd(kind of each plane, quiet planes), then the noise. All numbers little-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import zstandard
from numpy.typing import NDArray

from coastwatch.batches import Array, Ints, Members, Picture
from coastwatch.kernels.tables.byte_planes import join, split
from coastwatch.kernels.tables.picture_codec import COUNT, WORDS, member_places, members_of, rows_of

Words = NDArray[np.uint64]

HEAD = struct.Struct("<IIII")
LENGTH = struct.Struct("<I")
LEVEL = 1
NONE = np.zeros((WORDS, 0), np.uint64)
NO_PLACE = np.zeros(0, np.int64)


@dataclass(frozen=True, eq=False)
class Part:
    """Some rows of a cycle. N rows, M members."""

    rows: Words  # (WORDS, N), see kernels.words
    members: Words  # (2, M) track, source

    @property
    def count(self) -> Words:
        """Members of each row."""
        out: Words = self.rows[COUNT]
        return out

    def first(self) -> Ints:
        """(N + 1,) where the members of each row begin."""
        out = np.zeros(self.rows.shape[1] + 1, np.int64)
        np.cumsum(self.count, out=out[1:])
        return out


def packed(part: Part, key: Part | None, place: Ints, member_place: Ints, press: zstandard.ZstdCompressor) -> bytes:
    """The part as bytes.

    Args: key: the part whose rows it repeats with small changes; place: (N,) which row of it each row is, ascending; member_place:
    (M,) which member of it each member is likely to be, -1 for none; press: from `compressor`, of this thread alone.
    """
    rows, known = part.rows.shape[1], 0 if key is None else key.rows.shape[1]
    presence = b"" if rows == known or key is None else np.packbits(_mask(place, known)).tobytes()
    one = _table(part.rows, None if key is None else key.rows, place, press)
    two = _table(part.members, None if key is None else key.members, member_place, press)
    return b"".join((HEAD.pack(known, rows, *(sum(map(len, table)) for table in (one, two))), presence, *one, *two))


def compressor() -> zstandard.ZstdCompressor:
    """What presses bytes: to be made once for many parts, as its memory is larger than a part."""
    return zstandard.ZstdCompressor(level=LEVEL, write_checksum=True)


def unpacked(data: bytes, key: Part | None) -> Part:
    """The part of these bytes. Args: key: the part that it was packed against."""
    known, rows, first, second = HEAD.unpack_from(data)
    at = HEAD.size
    if known == 0:
        made = _words(data, at, first, WORDS, rows, None, NO_PLACE)
        members = int(made[COUNT].sum())
        return Part(made, _words(data, at + first, second, 2, members, None, NO_PLACE))
    if key is None or key.rows.shape[1] != known:
        raise ValueError(f"key part: got {'none' if key is None else key.rows.shape[1]} rows, needed {known}")
    place = np.arange(known)
    if rows < known:
        length = -(-known // 8)
        place = np.flatnonzero(np.unpackbits(np.frombuffer(data, np.uint8, length, at), count=known))
        at += length
    made = _words(data, at, first, WORDS, rows, key.rows, place)
    member_place = np.empty(int(made[COUNT].sum()), np.int64)
    member_places(made[COUNT], place, key.first(), member_place)
    return Part(made, _words(data, at + first, second, 2, len(member_place), key.members, member_place))


def batches(parts: Sequence[Part]) -> tuple[Picture, Members]:
    """Picture and members of all parts, sorted by vessel_id."""
    rows = sum(part.rows.shape[1] for part in parts)
    number = np.concatenate([NO_PLACE, *(part.rows[0].view(np.int64) for part in parts)])
    to = np.empty(rows, np.int64)
    to[np.argsort(number, kind="stable")] = np.arange(rows)
    ends = np.cumsum([0, *(part.rows.shape[1] for part in parts)])
    places = [to[a:b] for a, b in pairwise(ends.tolist())]
    one, two = np.empty((7, rows), np.uint64), np.empty((2, rows, 2), np.uint64)
    covariance, first = np.empty((rows, 4, 4), np.uint64), np.zeros(rows + 1, np.int64)
    for part, at in zip(parts, places, strict=True):
        rows_of(part.rows, at, tuple(one), two[0], two[1], covariance)
        first[at + 1] = part.count
    np.cumsum(first, out=first)
    row, name = np.empty(first[-1], np.int64), np.empty((2, first[-1]), np.uint64)
    for part, at in zip(parts, places, strict=True):
        members_of(part.members, part.count, at, first, row, name[0], name[1])
    vessel = one[0].view(np.int64)
    since, updated, time = (one[k].view(np.float64) for k in (2, 3, 1))
    place, velocity = two.view(np.float64)
    last = (one[k].view(np.int64) for k in (4, 5, 6))
    picture = Picture(vessel, time, place, velocity, covariance.view(np.float64), since, updated, *last)
    return picture, Members(vessel[row], *name.view(np.int64))


def _mask(place: Ints, known: int) -> Array:
    out = np.zeros(known, np.uint8)
    out[place] = 1
    return out


def _table(words: Words, base: Words | None, place: Ints, press: zstandard.ZstdCompressor) -> tuple[bytes, bytes, Any]:
    """Length, compressed bytes and noise."""
    columns, rows = words.shape
    quiet, noise = np.empty((columns * (rows + 1) * 8), np.uint8), np.empty(columns * rows * 8, np.uint8)
    kind = quiet[: columns * 8].reshape(columns, 8)
    q, s = split(words, NONE if base is None else base, place, base is not None, quiet[columns * 8 :], noise, kind)
    pressed = press.compress(_view(quiet[: columns * 8 + q]))
    return LENGTH.pack(len(pressed)), pressed, _view(noise[:s])


def _words(data: bytes, at: int, length: int, columns: int, rows: int, base: Words | None, place: Ints) -> Words:
    (pressed,) = LENGTH.unpack_from(data, at)
    body = at + LENGTH.size
    quiet = np.frombuffer(zstandard.ZstdDecompressor().decompress(memoryview(data)[body : body + pressed]), np.uint8)
    noise = np.frombuffer(data, np.uint8, at + length - body - pressed, body + pressed)
    out = np.empty((columns, rows), np.uint64)
    kind = quiet[: columns * 8].reshape(columns, 8)
    join(quiet[columns * 8 :], noise, kind, NONE if base is None else base, place, base is not None, out)
    return out


def _view(values: Array) -> Any:
    return memoryview(values)  # type: ignore[arg-type]
