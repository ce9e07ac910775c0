"""The history by place: of every block of some ten thousand points, what lies in each cell of a grid over the Earth.

Points stand in the history in the order of time. As soon as enough of them have come since the last block, they are written once
more, in short and cell by cell: 14 bytes a point, the place to 0.2 m, speed to 0.01 kn, course to 0.01 deg. So a box and a span of
time are answered from the cells of the box in the blocks of the span, and from the points after the last block, which are few.
Blocks are made from the history alone, or from the same points in memory. Figures: scaling/decisions/history_blocks.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from sqlalchemy import Connection, and_, delete, func, insert, or_, select, text, true
from sqlalchemy.orm import Mapped

from coastwatch.batches import Array, Bools, Floats, Ints
from coastwatch.store.box import Box
from coastwatch.store.cells import Column
from coastwatch.store.collect import collected, listed
from coastwatch.store.declaring import IN_KEY_ORDER, Base, key, of_run
from coastwatch.store.tables import Cycle, History

BLOCK_POINTS = 65_536
BLOCK_CYCLES = 30_000  # what two bytes hold
HELD_CYCLES = (
    64  # whose points stay in memory until they are a block: of large pictures, where to read them again takes half of the time
)
BLOCKS_AT_ONCE = 4  # where the history of an older version is made up for

CELLS_A_DEG = 10
ROWS, COLUMNS = 180 * CELLS_A_DEG, 360 * CELLS_A_DEG
STEPS = 65_536  # of a place within its cell
CLOSING = 32_768
NOTHING = 65_535  # where there is no speed or course
MOST_ROWS = 200
"""Rows of cells of a box above which the history itself is read: such a box has about all of it."""

POINT = np.dtype([("cycle", "<u2"), ("vessel", "<u4"), ("place", "<u2", 2), ("motion", "<u2", 2)])
"""Cycle less the block's first, CLOSING added to a closing one; vessel less the block's smallest; latitude, longitude; SOG, COG."""

CELLS = """
WITH {span}
SELECT c.from_cycle, c.cell, c.data FROM span s CROSS JOIN history_cell c
WHERE c.run_id = :run AND c.from_cycle = s.block AND c.cell BETWEEN s.low AND s.high
"""
SPANS_AT_ONCE = 2000


class HistoryBlock(Base):
    """The cycles of a block and how many points they have. The next block begins with the cycle after its last."""

    __tablename__ = "history_block"
    __table_args__ = IN_KEY_ORDER
    run_id: Mapped[int] = of_run()
    from_cycle: Mapped[int] = key()
    to_cycle: Mapped[int]
    points: Mapped[int]
    first_vessel: Mapped[int]  # the smallest number in it


class HistoryCell(Base):
    """The points of a block that lie in one cell of 0.1 by 0.1 degrees."""

    __tablename__ = "history_cell"
    __table_args__ = IN_KEY_ORDER
    run_id: Mapped[int] = of_run()
    from_cycle: Mapped[int] = key()  # of the block
    cell: Mapped[int] = key()  # row from the south pole times 3600, and column from 180 W
    data: Mapped[bytes]  # POINT after POINT


class Points(NamedTuple):
    """Points of the history, in no order. P points."""

    cycle: Ints
    vessel_id: Ints
    position_deg: Floats  # (P, 2)
    sog_kn: Floats
    cog_deg: Floats
    closing: Bools

    def take(self, rows: Array) -> Points:
        """Some of them."""
        return Points._make(column[rows] for column in self)


class Tail(NamedTuple):
    """The cycles after the last block."""

    from_cycle: int
    points: int
    held: (
        tuple[Points, ...] | None
    )  # all of these points, a cycle each; None: they are read from the database when they are wanted


def placed(number: int, columns: Sequence[Column]) -> Points:
    """The points that a cycle adds to the history. Args: columns: as `history_rule.Added` has them."""
    arrays = (column for column in columns if isinstance(column, np.ndarray))
    vessel, latitude, longitude, speed, course, *_, closing = arrays
    return Points(np.full(len(vessel), number), vessel, np.stack([latitude, longitude], 1), speed, course, closing)


def extend(connection: Connection, run_id: int, number: int, points: Points, before: Tail | None) -> Tail:
    """Make a block where enough points have come, in the transaction of the cycle.

    Args: points: that this cycle wrote into the history; before: what this function returned for the last cycle; None: the database
    knows.
    """
    tail = _tail(connection, run_id, number - 1) if before is None else before
    held = None if tail.held is None or len(tail.held) == HELD_CYCLES else (*tail.held, points)
    tail = Tail(tail.from_cycle, tail.points + len(points.cycle), held)
    for _ in range(BLOCKS_AT_ONCE):
        if tail.points < BLOCK_POINTS and number - tail.from_cycle < BLOCK_CYCLES:
            break
        last, count = _end(connection, run_id, tail.from_cycle, number)
        whole = tail.held if last == number else None
        found = _stored(connection, run_id, tail.from_cycle, last, count) if whole is None else _joined(whole)
        _write(connection, run_id, tail.from_cycle, last, found)
        tail = Tail(last + 1, tail.points - count, () if last == number else None)
    return tail


def forget_blocks(connection: Connection, run_id: int, from_cycle: int | None = None, before_cycle: int | None = None) -> None:
    """Delete the blocks that reach into the cycles from one on, or that end before another; of the latter the newest stays, which says
    where the next one begins."""
    b = HistoryBlock
    newest = select(func.max(b.from_cycle)).where(b.run_id == run_id)
    reach = true() if from_cycle is None else b.to_cycle >= from_cycle
    ended = true() if before_cycle is None else and_(b.to_cycle < before_cycle, b.from_cycle < newest.scalar_subquery())
    gone = list(connection.scalars(select(b.from_cycle).where(b.run_id == run_id, reach, ended)))
    if gone:
        connection.execute(delete(HistoryCell).where(HistoryCell.run_id == run_id, HistoryCell.from_cycle.in_(gone)))
        connection.execute(delete(b).where(b.run_id == run_id, b.from_cycle.in_(gone)))


def points_between(connection: Connection, run_id: int, first: int, last: int, bbox: Box) -> Points:
    """The points of the cycles from first to last in a box, and some beside it."""
    spans = _spans(bbox)
    if len(spans) > MOST_ROWS:
        return _from_history(connection, run_id, first, last, bbox)
    b = HistoryBlock
    before = select(func.max(b.from_cycle)).where(b.run_id == run_id, b.from_cycle <= first).scalar_subquery()
    known = select(b.from_cycle, b.to_cycle, b.first_vessel).where(b.run_id == run_id, b.from_cycle <= last)
    blocks = connection.execute(known.where(b.from_cycle >= func.coalesce(before, 0)).order_by(b.from_cycle)).all()
    wanted = [(block.from_cycle, *span) for block in blocks for span in spans]
    parts = [_read(_cells(connection, run_id, wanted), {block.from_cycle: block.first_vessel for block in blocks})]
    since = max(first, blocks[-1].to_cycle + 1) if blocks else first
    if since <= last:
        parts.append(_from_history(connection, run_id, since, last, bbox))
    found = _joined(parts)
    return found.take((found.cycle >= first) & (found.cycle <= last))


def _cells(connection: Connection, run_id: int, wanted: Sequence[tuple[int, int, int]]) -> list[Any]:
    """The cells in ranges of them, each of one block: the key is sought once for each."""
    out: list[Any] = []
    for some in range(0, len(wanted), SPANS_AT_ONCE):
        span, given = listed(connection, "span", ("block", "low", "high"), wanted[some : some + SPANS_AT_ONCE])
        out += connection.execute(text(CELLS.format(span=span)), {"run": run_id, **given}).all()
    return out


def _tail(connection: Connection, run_id: int, last: int) -> Tail:
    end = connection.scalar(select(func.max(HistoryBlock.to_cycle)).where(HistoryBlock.run_id == run_id))
    first = 0 if end is None else end + 1
    since = (Cycle.run_id == run_id) & Cycle.number.between(first, last)
    points = int(connection.scalar(select(func.coalesce(func.sum(Cycle.history_points), 0)).where(since)) or 0)
    return Tail(first, points, None if points else ())


def _end(connection: Connection, run_id: int, first: int, number: int) -> tuple[int, int]:
    """The cycle with which the block that begins at another ends, and the points of the block."""
    since = (Cycle.run_id == run_id) & Cycle.number.between(first, min(number, first + BLOCK_CYCLES))
    rows = connection.execute(select(Cycle.number, Cycle.history_points).where(since).order_by(Cycle.number)).all()
    points = np.cumsum([row.history_points for row in rows])
    at = min(int(np.searchsorted(points, BLOCK_POINTS)), len(points) - 1)
    return int(rows[at].number), int(points[at])


def _stored(connection: Connection, run_id: int, first: int, last: int, count: int) -> Points:
    """The points of some cycles, of which there are so many, from the rows of the history."""
    return _points(collected(connection, _history(run_id, first, last), count))


def _joined(parts: Sequence[Points]) -> Points:
    return Points._make(np.concatenate(columns) for columns in zip(*parts, strict=True))


def _write(connection: Connection, run_id: int, first: int, last: int, found: Points) -> None:
    points, smallest = len(found.cycle), int(found.vessel_id.min()) if len(found.cycle) else 0
    block = {"run_id": run_id, "from_cycle": first, "to_cycle": last, "points": points, "first_vessel": smallest}
    connection.execute(insert(HistoryBlock), [block])
    cell, packed = _packed(found, first, smallest)
    order = np.lexsort((found.cycle, found.vessel_id, cell))
    cell, packed = cell[order], packed.view(f"V{POINT.itemsize}")[order]  # as bytes, not field by field
    ends = np.flatnonzero(np.append(np.append(True, cell[1:] != cell[:-1]), True))[: points + 1]
    rows = [(run_id, first, int(cell[a]), packed[a:b].tobytes()) for a, b in pairwise(ends.tolist())]
    if rows and connection.dialect.name == "sqlite":
        connection.exec_driver_sql("INSERT INTO history_cell (run_id, from_cycle, cell, data) VALUES (?, ?, ?, ?)", rows)
    elif rows:
        names = ("run_id", "from_cycle", "cell", "data")
        connection.execute(insert(HistoryCell), [dict(zip(names, row, strict=True)) for row in rows])


def _history(run_id: int, first: int, last: int, bbox: Box | None = None) -> Any:
    h = History
    columns = (h.cycle, h.vessel_id, h.latitude_deg, h.longitude_deg, h.sog_kn, h.cog_deg, h.closing)
    return select(*columns).where(h.run_id == run_id, h.cycle.between(first, last), _inside(bbox))


def _inside(bbox: Box | None) -> Any:
    if bbox is None:
        return true()
    south, west, north, east = bbox
    after, before = History.longitude_deg >= west, History.longitude_deg <= east
    return and_(History.latitude_deg.between(south, north), and_(after, before) if west <= east else or_(after, before))


def _points(columns: Sequence[Array]) -> Points:
    cycle, vessel, latitude, longitude, sog, cog, closing = columns
    return Points(cycle, vessel, np.stack([latitude, longitude], 1), sog, cog, closing != 0)


def _from_history(connection: Connection, run_id: int, first: int, last: int, bbox: Box) -> Points:
    """As it would come from blocks."""
    span = (Cycle.run_id == run_id) & Cycle.number.between(first, last)
    most = connection.scalar(select(func.coalesce(func.sum(Cycle.history_points), 0)).where(span))
    found = _points(collected(connection, _history(run_id, first, last, bbox), int(most or 0)))
    cell, packed = _packed(found, 0, 0)
    return _unpacked(packed, cell, found.cycle, found.vessel_id)


def _packed(found: Points, first: int, smallest: int) -> tuple[Ints, Array]:
    """The cell of each point, and the points as they are stored."""
    latitude, longitude = found.position_deg.T
    y, x = (latitude + 90.0) * CELLS_A_DEG, (longitude + 180.0) * CELLS_A_DEG
    row, column = np.clip(np.floor(y), 0, ROWS - 1), np.clip(np.floor(x), 0, COLUMNS - 1)
    out = np.empty(len(found.cycle), POINT)
    out["cycle"] = (found.cycle - first) % CLOSING + CLOSING * found.closing
    out["vessel"] = found.vessel_id - smallest
    out["place"] = np.clip(np.floor((np.stack([y - row, x - column], 1)) * STEPS), 0, STEPS - 1)
    speed, course = np.clip(np.round(found.sog_kn * 100.0), 0, NOTHING - 1), np.round(found.cog_deg * 100.0) % 36_000
    out["motion"] = np.nan_to_num(np.stack([speed, course], 1), nan=NOTHING)
    return (row * COLUMNS + column).astype(np.int64), out


def _unpacked(packed: Array, cell: Ints, cycle: Ints, vessel: Ints) -> Points:
    row, column = np.divmod(cell, COLUMNS)
    place = (np.stack([row, column], 1) + (packed["place"] + 0.5) / STEPS) / CELLS_A_DEG - (90.0, 180.0)
    motion = np.where(packed["motion"] == NOTHING, np.nan, packed["motion"] / 100.0)
    return Points(cycle, vessel, place, motion[:, 0], motion[:, 1], packed["cycle"] >= CLOSING)


def _read(rows: Sequence[Any], smallest: dict[int, int]) -> Points:
    """The points of stored cells. Args: smallest: number of a vessel in each block."""
    packed = np.frombuffer(b"".join(bytes(row.data) for row in rows), POINT)
    sizes = [len(row.data) // POINT.itemsize for row in rows]
    block = np.array([(row.from_cycle, smallest[row.from_cycle], row.cell) for row in rows], np.int64).reshape(-1, 3)
    first, base, cell = np.repeat(block, sizes, axis=0).T
    return _unpacked(packed, cell, first + packed["cycle"] % CLOSING, base + packed["vessel"])


def _spans(bbox: Box) -> list[tuple[int, int]]:
    """Ranges of cells that cover a box, one or two for each row."""
    south, west, north, east = bbox
    low, high = (int(np.clip((x + 90.0) * CELLS_A_DEG, 0, ROWS - 1)) for x in (south, north))
    first, last = (int(np.clip((x + 180.0) * CELLS_A_DEG, 0, COLUMNS - 1)) for x in (west, east))
    sides = [(first, last)] if west <= east else [(first, COLUMNS - 1), (0, last)]
    return [(row * COLUMNS + a, row * COLUMNS + b) for row in range(low, high + 1) for a, b in sides]
