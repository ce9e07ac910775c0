"""Tables and rows with values of every kind, and what reads an image of them."""

from __future__ import annotations

import sqlite3
import struct
from typing import Any

import numpy as np
from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    Float,
    LargeBinary,
    MetaData,
    Table,
    Text,
)
from sqlalchemy.dialects import sqlite
from sqlalchemy.schema import CreateTable

from coastwatch.store import image
from coastwatch.store.cells import Blobs, Named, Texts, plain
from coastwatch.store.cells import Column as Cells
from coastwatch.store.image_form import Form, form_of

VESSELS = 700
PAGES = (1024, 4096, image.PAGE_BYTES)
TEXTS = ("", "ais", "São Sebastião, 港", "x" * 60, "y" * 58)
"""The last two on either side of where the serial type of a text becomes two bytes."""

WHOLE = [s * (2**p + d) for p in (0, 7, 8, 15, 16, 23, 24, 31, 32, 47, 48, 62) for s in (1, -1) for d in (-1, 0, 1)]
REALS = (
    np.nan,
    0.0,
    -0.0,
    1.0 / 3.0,
    -1e308,
    5e-324,
    np.inf,
    -np.inf,
    1.0,
    7.0,
    -3e5,
    2.0**47,
    2.0**47 - 1,
    -(2.0**47),
    2.0**53,
)
KEY = {"primary_key": True, "autoincrement": False}


def table_of(*more: Any, name: str = "rows", rowid: bool = False) -> Table:
    """A table of whose columns one, `flag`, is before the key."""
    return Table(
        name,
        MetaData(),
        Column("flag", Boolean),
        Column("run_id", BigInteger, **KEY),  # type: ignore[arg-type]
        Column("id", BigInteger, **KEY),  # type: ignore[arg-type]
        Column("real", Float(53)),
        Column("whole", BigInteger, nullable=False),
        Column("named", BigInteger),
        Column("text", Text),
        Column("blob", LargeBinary),
        Column("same_text", Text),
        Column("same_real", Float(53)),
        Column("whole_as_real", Float(53)),
        Column("empty", Text),
        *more,
        sqlite_with_rowid=rowid,
    )


ROWS = table_of()


def sql_of(table: Table) -> str:
    return str(CreateTable(table).compile(dialect=sqlite.dialect()))  # type: ignore[no-untyped-call]


def columns(count: int) -> list[Cells]:
    """Rows with everything that may be odd about a value."""
    rng = np.random.default_rng([6, count])
    blob = Blobs(rng.integers(0, 256, (count, 80), dtype=np.uint8), rng.random(count) < 0.7)
    every = np.arange(2 * count)[::2] - count  # not beside each other in memory
    whole = np.array([*WHOLE, 2**63 - 1, -(2**63)])
    texts = Texts(rng.integers(-1, len(TEXTS), count), TEXTS)
    named = Named(rng.choice([-1, 0, 1, 2**40, 2**63 - 1], count))
    return [
        rng.random(count) < 0.5, 3, every, rng.choice(REALS, count), rng.choice(whole, count), named, texts, blob, "ü", 0.1,
        rng.integers(-5, 5, count), None,
    ]  # fmt: skip


def expected(given: list[Cells], count: int) -> list[tuple[Any, ...]]:
    """The rows as Python would say them: reals by their bits."""
    every = [list(plain(column, count)) for column in given]
    every[10] = [float(value) for value in every[10]]
    every[3] = [0.0 if value == 0.0 else value for value in every[3]]  # SQLite knows no -0.0
    return [tuple(map(bits, row)) for row in zip(*every, strict=True)]


def bits(value: Any) -> Any:
    return struct.pack("<d", value) if isinstance(value, float) else value


def form(table: Table = ROWS, page_bytes: int = image.PAGE_BYTES) -> Form:
    found = form_of(sql_of(table), table.name, page_bytes)
    assert found is not None
    return found


def levels(memory: bytes, page_bytes: int) -> int:
    """How many pages there are from root to leaf."""
    page, deep = 2, 1
    while memory[(page - 1) * page_bytes] == 0x02:
        at = (page - 1) * page_bytes + 8
        page, deep = int.from_bytes(memory[at : at + 4], "big"), deep + 1
    assert memory[(page - 1) * page_bytes] == 0x0A
    return deep


def opened(memory: bytes) -> sqlite3.Connection:
    raw = sqlite3.connect(":memory:")
    raw.deserialize(memory)
    return raw
