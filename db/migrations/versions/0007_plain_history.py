"""The history as plain rows with an index for boxes; the recording as one row a cycle.

Every point of the dropped tables `history_block` and `history_cell` is a row of `history` already. Points of schema 0003 and older
get their `previous_cycle`, so that one vessel is found by its chain alone. Each recorded cycle is decoded from table `chunk` and
written to `recording` as schema 0007 has it; what that takes is another copy of the recording on the disk.

A chunk held some rows of a cycle. It stood alone, or it differed from the chunk of the same part of a key cycle:

    bytes 0-3    rows of the key chunk; 0: it stands alone
    4-7          rows
    8-11, 12-15  lengths of the two tables that follow: rows (28 columns), members (2 columns)
    then         one bit for each row of the key chunk: whether it is still there; only where rows are fewer; then the tables

A table: length of its compressed bytes (4), then zstd(kind of each byte plane, compressible planes), then the other planes. A plane is
one byte of a column's 64-bit word in all rows. All numbers are little-endian.
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

import numpy as np
import sqlalchemy as sa
from alembic import op
from numpy.typing import NDArray
from zstandard import ZstdCompressor, ZstdDecompressor

revision = "0007"
down_revision = "0006"

Words = NDArray[np.uint64]
Ints = NDArray[np.int64]

HEAD, LENGTH = struct.Struct("<IIII"), struct.Struct("<I")
WORDS, COUNT = 28, 11  # columns of a row's table; the one with its count of members
SAME, COMPRESSED, STORED = 1, 2, 3  # kinds of plane; 0: all bytes are zero

KEY = sa.BigInteger().with_variant(sa.Integer(), "sqlite")

COLUMNS = (
    *("vessel_id", "time_s", "position_deg", "velocity_m_s", "covariance", "since_s", "updated_s", "mmsi", "flags", "origin"),
    *("member_vessel_id", "member_track_id", "member_source"),
)

UNLINKED = """
SELECT DISTINCT h.run_id FROM history h
WHERE h.previous_cycle IS NULL AND NOT EXISTS (
    SELECT 1 FROM presence p WHERE p.run_id = h.run_id AND p.vessel_id = h.vessel_id AND p.from_cycle = h.cycle)
"""

LINK = """
UPDATE history SET previous_cycle = before.cycle
FROM (
    SELECT run_id, cycle AS this_cycle, vessel_id,
        lag(cycle) OVER stay AS cycle, lag(closing) OVER stay AS closing
    FROM history WHERE run_id = :run
    WINDOW stay AS (PARTITION BY run_id, vessel_id ORDER BY cycle)
) before
WHERE history.run_id = before.run_id AND history.cycle = before.this_cycle AND history.vessel_id = before.vessel_id
    AND history.previous_cycle IS NULL AND NOT before.closing
"""


def upgrade() -> None:
    connection = op.get_bind()
    for run_id in connection.scalars(sa.text(UNLINKED)).all():
        connection.execute(sa.text(LINK), {"run": run_id})
    op.create_index("history_box", "history", ["run_id", "cycle", "latitude_deg", "longitude_deg"])
    op.create_table(
        "recording",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("cycle", KEY, primary_key=True, autoincrement=False),
        sa.Column("vessels", KEY, nullable=False),
        sa.Column("members", KEY, nullable=False),
        *(sa.Column(name, sa.LargeBinary(), nullable=False) for name in COLUMNS),
    )
    cycles = "SELECT run_id, number FROM cycle WHERE recorded ORDER BY run_id, number"
    key_parts: dict[tuple[int, int, int], Part] = {}
    for run_id, cycle in connection.execute(sa.text(cycles)).all():
        convert(connection, run_id, cycle, key_parts)
    for name in ("history_cell", "history_block", "vessel_place", "chunk"):
        op.drop_table(name)


class Part(NamedTuple):
    """A decoded chunk. N rows, M members."""

    rows: Words  # (28, N) vessel, time, latitude, longitude, velocity (2), since, updated, MMSI, flags, origin, count, covariance (16)
    members: Words  # (2, M) track, source


def convert(connection: Any, run_id: int, cycle: int, key_parts: dict[tuple[int, int, int], Part]) -> None:
    """Write one recorded cycle in the new form. Args: key_parts: decoded chunks of the key cycle, kept from cycle to cycle."""
    chunks = "SELECT part, key_cycle, data FROM chunk WHERE run_id = :run AND cycle = :cycle ORDER BY part"
    parts = []
    for part, key_cycle, data in connection.execute(sa.text(chunks), {"run": run_id, "cycle": cycle}).all():
        if key_cycle != cycle and (run_id, key_cycle, part) not in key_parts:
            key_parts.clear()
            for other, _, key_data in connection.execute(sa.text(chunks), {"run": run_id, "cycle": key_cycle}):
                key_parts[run_id, key_cycle, other] = _decode(bytes(key_data), None)
        parts.append(_decode(bytes(data), None if key_cycle == cycle else key_parts[run_id, key_cycle, part]))
    rows = np.concatenate([np.zeros((WORDS, 0), np.uint64), *(part.rows for part in parts)], 1)
    members = np.concatenate([np.zeros((2, 0), np.uint64), *(part.members for part in parts)], 1)
    owner = np.repeat(rows[0], rows[COUNT].astype(np.int64)).view(np.int64)
    order, by_owner = np.argsort(rows[0].view(np.int64), kind="stable"), np.argsort(owner, kind="stable")
    values = _encoded(rows[:, order], owner[by_owner], members[:, by_owner])
    table = sa.table("recording", *(sa.column(name) for name in ("run_id", "cycle", "vessels", "members", *COLUMNS)))
    values |= {"run_id": run_id, "cycle": cycle, "vessels": rows.shape[1], "members": len(owner)}
    connection.execute(table.insert(), [values])


def _encoded(rows: Words, owner: Ints, members: Words) -> dict[str, Any]:
    """The columns of a row of `recording`: bytes transposed and compressed. Args: rows: (28, N); owner: (M,); members: (2, M)."""
    number, time, latitude, longitude, east, north, since, updated, mmsi, flags, origin, _ = rows[: COUNT + 1]
    upper, strict = rows[COUNT + 1 : COUNT + 11].T, [1, 2, 3, 5, 6, 8]  # of the upper triangle those above the diagonal
    lower = rows[COUNT + 11 :].T + upper[:, strict]
    by_row = [0, 1, 3, 2, 4, 5]  # the lower triangle stood in the order of the upper one
    covariance = np.concatenate([upper, (lower ^ upper[:, strict])[:, by_row]], 1)
    columns = (
        *(np.diff(number.view(np.int64), prepend=0), time, np.stack([latitude, longitude], 1), np.stack([east, north], 1)),
        *(covariance, since, updated, mmsi, flags, origin, np.diff(owner, prepend=0), members[0], members[1]),
    )
    compressor = ZstdCompressor(level=1, write_checksum=True)

    def compressed(values: Any) -> bytes:
        planes = np.ascontiguousarray(values).reshape(len(values), -1 if len(values) else 1).view(np.uint8).T
        return compressor.compress(planes.tobytes())

    return dict(zip(COLUMNS, map(compressed, columns), strict=True))


def _decode(data: bytes, key: Part | None) -> Part:
    """Args: key: the decoded chunk that this one differs from."""
    known, count, first, second = HEAD.unpack_from(data)
    at = HEAD.size
    if known == 0 or key is None:
        rows = _table(data[at : at + first], WORDS, count)
        return Part(rows, _table(data[at + first : at + first + second], 2, int(rows[COUNT].sum())))
    place = np.arange(known)
    if count < known:
        length = -(-known // 8)
        place = np.flatnonzero(np.unpackbits(np.frombuffer(data, np.uint8, length, at), count=known))
        at += length
    rows = _undo_difference(_table(data[at : at + first], WORDS, count), key.rows, place)
    member_place = _member_places(rows[COUNT].astype(np.int64), place, key.rows[COUNT].astype(np.int64))
    members = _table(data[at + first : at + first + second], 2, len(member_place))
    return Part(rows, _undo_difference(members, key.members, member_place))


def _table(data: bytes, columns: int, count: int) -> Words:
    """The words of a table. Returns: (columns, count)."""
    (length,) = LENGTH.unpack_from(data)
    body = np.frombuffer(ZstdDecompressor().decompress(data[LENGTH.size : LENGTH.size + length]), np.uint8)
    kinds, compressed, stored = body[: 8 * columns], body[8 * columns :], np.frombuffer(data, np.uint8)[LENGTH.size + length :]
    out = np.zeros((columns, count), np.uint64)
    for plane, kind in enumerate(kinds.tolist()):
        column, byte = divmod(plane, 8)
        values, compressed, stored = _next_plane(kind, count, compressed, stored)
        out[column] |= values.astype(np.uint64) << np.uint64(8 * byte)
    return out


def _next_plane(
    kind: int, count: int, compressed: NDArray[np.uint8], stored: NDArray[np.uint8]
) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.uint8]]:
    """The bytes of a plane, and what is left of the two sources."""
    if kind == SAME:
        return np.repeat(compressed[:1], count), compressed[1:], stored
    if kind == COMPRESSED:
        return compressed[:count], compressed[count:], stored
    if kind == STORED:
        return stored[:count], compressed, stored[count:]
    return np.zeros(count, np.uint8), compressed, stored


def _undo_difference(words: Words, base: Words, place: Ints) -> Words:
    """Words from zigzag differences. Args: place: column of the base that each differs from, -1: none (from 0)."""
    before = np.where(place >= 0, np.append(base, np.zeros((len(base), 1), np.uint64), axis=1)[:, place], np.uint64(0))
    one = np.uint64(1)
    return before + ((words >> one) ^ (np.uint64(0) - (words & one)))


def _member_places(count: Ints, place: Ints, key_count: Ints) -> Ints:
    """Member of the key chunk that each member differs from: of the same rank, where its row has as many; else -1."""
    start = np.cumsum(key_count) - key_count
    rank = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    same = np.repeat(key_count[place] == count, count)
    return np.where(same, np.repeat(start[place], count) + rank, -1)
