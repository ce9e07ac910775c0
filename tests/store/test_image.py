"""Rows that reach SQLite as the bytes of a table are the rows that its own statements write, and what cannot go so goes as before."""

from __future__ import annotations

import sqlite3
import struct
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import store_world as world
from sqlalchemy import (
    BigInteger,
    Boolean,
    CheckConstraint,
    Column,
    Computed,
    Float,
    ForeignKey,
    LargeBinary,
    MetaData,
    Table,
    Text,
    UniqueConstraint,
)
from sqlalchemy.dialects import sqlite
from sqlalchemy.schema import CreateTable

from coastwatch import store as kept
from coastwatch.store import StoreError, bulk, image, native
from coastwatch.store.cells import Blobs, Named, Texts, part, plain
from coastwatch.store.cells import Column as Cells
from coastwatch.store.image_form import Form, form_of
from coastwatch.store.opening import Store, connect, reading, writing

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


@pytest.mark.parametrize("page_bytes", PAGES)
@pytest.mark.parametrize("count", [1, 2, 300, 3000])
def test_every_value_comes_back(count: int, page_bytes: int) -> None:
    given = columns(count)
    made = image.image_of(form(page_bytes=page_bytes), given, page_bytes)
    assert made is not None
    raw = opened(made.tobytes())
    assert raw.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
    found = [tuple(map(bits, row)) for row in raw.execute("SELECT * FROM rows ORDER BY run_id, id")]
    assert found == [tuple(map(bits, row[:1])) + row[1:] for row in expected(given, count)]
    types = {
        name: raw.execute(f"SELECT DISTINCT typeof({name}) FROM rows").fetchall() for name in ("real", "whole_as_real", "flag")
    }
    assert ("integer",) not in types["real"] + types["whole_as_real"]
    assert types["flag"] == [("integer",)]
    raw.close()


def records(memory: bytes) -> list[bytes]:
    """Those of a table that is one page, as they lie there."""
    page, found = image.PAGE_BYTES, []
    for n in range(int.from_bytes(memory[page + 3 : page + 5], "big")):
        at = page + int.from_bytes(memory[page + 8 + 2 * n : page + 10 + 2 * n], "big")
        size = memory[at] if memory[at] < 128 else (memory[at] & 127) << 7 | memory[at + 1]
        at += 1 if memory[at] < 128 else 2
        found.append(memory[at : at + size])
    return found


def test_records_are_those_that_sqlite_makes() -> None:
    """To the byte: whole reals are whole numbers there."""
    given = columns(200)
    raw = opened(form().empty)
    rows = zip(*(plain(column, 200) for column in given), strict=True)
    raw.executemany(f"INSERT INTO rows VALUES ({', '.join('?' * len(given))})", rows)
    raw.commit()
    made = image.image_of(form(), given, image.PAGE_BYTES)
    assert made is not None
    assert records(made.tobytes()) == records(raw.serialize())
    assert len(records(made.tobytes())) == 200
    raw.close()


PAIR = Table("pair", MetaData(), Column("a", BigInteger, **KEY), Column("b", Text), sqlite_with_rowid=False)  # type: ignore[arg-type]


def test_a_tree_of_any_number_of_rows_is_whole() -> None:
    """Small pages, so that every way in which pages, and pages of pages, can end comes up."""
    page_bytes, depths, rng = 512, set(), np.random.default_rng(7)
    texts = ["z" * length for length in range(80)]
    codes = rng.integers(0, 80, 1500)
    for count in [*range(1, 700), 1500]:
        made = image.image_of(form(PAIR, page_bytes), [np.arange(count) * 1000, Texts(codes[:count], texts)], page_bytes)
        assert made is not None
        raw = opened(made.tobytes())
        assert raw.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        assert raw.execute("SELECT count(*), sum(length(b)), max(a) FROM pair").fetchall() == [
            (count, int(codes[:count].sum()), (count - 1) * 1000)
        ]
        assert raw.execute("SELECT b FROM pair WHERE a = ?", (count // 2 * 1000,)).fetchone() == (texts[codes[count // 2]],)
        raw.close()
        depths.add(levels(made.tobytes(), page_bytes))
    assert depths >= {1, 2, 3, 4}


def test_a_page_is_filled_to_its_last_byte() -> None:
    """Rows of one length: as many as fit in a page are one page, one more are three."""
    page_bytes, sizes = 4096, []
    same = Texts(np.zeros(200, np.int64), ["z" * 90])
    for count in range(30, 60):
        made = image.image_of(form(PAIR, page_bytes), [np.arange(count) + 1000, part(same, slice(count))], page_bytes)
        assert made is not None
        sizes.append(len(made) // page_bytes)
    cell = 2 + 1 + 1 + 2 + 1 + 2 + 90  # place, length, length of the header, its two types, 1000, text
    whole = (page_bytes - 8) // cell
    assert sizes == [2 if count <= whole else 4 for count in range(30, 60)]


def test_rows_go_by_way_of_an_image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cycle's picture: bit for bit what the bound statements write."""
    said = []
    for way in ("image", "bound"):
        with monkeypatch.context() as patch, kept.open_store(str(tmp_path / f"{way}.db")) as store:
            if way == "bound":
                patch.setattr(image, "image_of", lambda *given: None)
            run = world.begin(store)
            for number in range(3):
                world.write(store, run, number, VESSELS)
            said.append(
                told(store, "SELECT *, typeof(sog_kn), typeof(mmsi), typeof(covariance) FROM vessel ORDER BY vessel_id")
            )
            assert told(store, "PRAGMA integrity_check") == [("ok",)]
    assert len(said[0]) > 600
    assert said[0] == said[1]


def told(store: Store, query: str) -> list[tuple[Any, ...]]:
    with reading(store) as connection:
        return [tuple(map(bits, row)) for row in connection.exec_driver_sql(query)]


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    with connect(str(tmp_path / "x.db"), 1.0, may_create=True) as found:
        yield found


@pytest.fixture
def ways(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Which ways rows went."""
    went: list[str] = []

    def load(*given: Any) -> bool:
        done = usual[0](*given)
        went.extend(["image"] * done)
        return done

    def carry_out(*given: Any) -> None:
        went.append("bound")
        usual[1](*given)

    usual = image.load, native.carry_out
    monkeypatch.setattr(image, "load", load)
    monkeypatch.setattr(native, "carry_out", carry_out)
    return went


def write(store: Store, table: Table, given: list[Cells]) -> None:
    with writing(store) as connection:
        bulk.append(connection, table, given)


def create(store: Store, table: Table = ROWS) -> None:
    with writing(store) as connection:
        table.create(connection)


def test_sqlite_copies_without_a_look(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """What makes it fast, and why all is checked before: were NULL let through, SQLite would let it through too."""
    create(store)
    free = form()._replace(required=(False,) * len(ROWS.columns))
    monkeypatch.setattr(image, "form_of", lambda *given: free)
    given = columns(400)
    given[4] = Named(np.full(400, -1))
    write(store, ROWS, given)
    assert told(store, "SELECT typeof(whole), count(*) FROM rows GROUP BY 1") == [("null", 400)]


def test_an_image_lives_as_long_as_its_transaction(store: Store, ways: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    create(store)
    made: list[weakref.ref[Any]] = []
    usual = image.image_of

    def image_of(*given: Any) -> Any:
        found = usual(*given)
        made.append(weakref.ref(found))
        return found

    monkeypatch.setattr(image, "image_of", image_of)
    with writing(store) as connection:
        bulk.append(connection, ROWS, columns(400))
        assert made[0]() is not None
        assert "image" in [row[1] for row in connection.exec_driver_sql("PRAGMA database_list")]
    assert made[0]() is None
    assert "image" not in [row[1] for row in told(store, "PRAGMA database_list")]
    assert ways == ["image"]


def test_what_is_rolled_back_was_never_there(store: Store, ways: list[str]) -> None:
    create(store)
    write(store, ROWS, columns(300))
    before = told(store, "SELECT * FROM rows ORDER BY id")
    with writing(store) as connection:
        connection.exec_driver_sql("DELETE FROM rows")
        bulk.append(connection, ROWS, columns(900))
        connection.rollback()
    assert told(store, "SELECT * FROM rows ORDER BY id") == before
    replace(store, columns(900), 100_000)
    assert told(store, "SELECT count(*) FROM rows") == [(900,)]
    assert told(store, "PRAGMA integrity_check") == [("ok",)]
    assert ways == ["image"] * 3


def test_a_disk_that_is_full_within_an_image_keeps_what_it_has(store: Store, ways: list[str]) -> None:
    create(store)
    write(store, ROWS, columns(300))
    before = told(store, "SELECT * FROM rows ORDER BY id")
    pages = told(store, "PRAGMA page_count")[0][0]
    with pytest.raises(StoreError, match="disk full"):
        replace(store, columns(9000), pages + 3)
    assert told(store, "SELECT * FROM rows ORDER BY id") == before
    replace(store, columns(9000), 100_000)
    assert told(store, "SELECT count(*) FROM rows") == [(9000,)]
    assert ways == ["image", "image"]


def replace(store: Store, given: list[Cells], pages: int) -> None:
    """Other rows instead, in a database that may have so many pages."""
    with writing(store) as connection:
        connection.exec_driver_sql(f"PRAGMA max_page_count = {pages}")
        connection.exec_driver_sql("DELETE FROM rows")
        bulk.append(connection, ROWS, given)


def refused(given: list[Cells]) -> dict[str, list[Cells]]:
    """Rows that an image cannot take."""
    ids, whole = given[2], given[4]
    assert isinstance(ids, np.ndarray)
    assert isinstance(whole, np.ndarray)
    long, number = Texts(np.zeros(len(ids), np.int64), ["x" * 20_000]), np.full(len(ids), 0.5)
    changed = {
        "backwards": (2, ids[::-1]), "text too long": (6, long), "text as a number": (5, "17"), "real as a number": (5, number),
        "number as text": (6, np.arange(len(ids))),
    }  # fmt: skip
    return {why: [*given[:at], column, *given[at + 1 :]] for why, (at, column) in changed.items()}


@pytest.mark.parametrize("why", refused(columns(300)))
def test_rows_that_are_not_as_they_would_be_stored_are_bound(store: Store, ways: list[str], why: str) -> None:
    create(store)
    write(store, ROWS, refused(columns(300))[why])
    assert ways == ["bound"]
    assert told(store, "SELECT count(*) FROM rows") == [(300,)]
    if why == "text as a number":
        assert told(store, "SELECT DISTINCT named FROM rows") == [(17,)]


@pytest.mark.parametrize(("at", "column", "says"), [(2, np.full(300, 7), "UNIQUE"), (4, Named(np.full(300, -1)), "NOT NULL")])
def test_a_row_that_may_not_be_is_refused_in_sqlites_words(
    store: Store, ways: list[str], at: int, column: Cells, says: str
) -> None:
    create(store)
    given = columns(300)
    given[at] = column
    with pytest.raises(StoreError, match=f"{says} constraint failed: rows"):
        write(store, ROWS, given)
    assert ways == ["bound"]
    assert told(store, "SELECT * FROM rows") == []


OF = Table("of", MetaData(), Column("id", BigInteger, primary_key=True))
OTHER = {
    "rows have an address of their own": table_of(rowid=True),
    "a foreign key": table_of(Column("of", BigInteger, ForeignKey(OF.c.id))),
    "a condition": table_of(CheckConstraint("whole > 0 OR whole <= 0")),
    "a second unique key": table_of(UniqueConstraint("id", "flag")),
    "a computed column": table_of(Column("twice", BigInteger, Computed("2 * id"))),
    "a key that is no number": table_of(Column("kind", Text, **KEY)),  # type: ignore[arg-type]
}
"""Tables of a form that is left to SQLite."""


@pytest.mark.parametrize("why", OTHER)
def test_a_table_of_another_form_is_bound(store: Store, ways: list[str], why: str) -> None:
    create(store, OF)
    create(store, OTHER[why])
    wider = len(OTHER[why].columns) > len(ROWS.columns)
    given = [*columns(300), "more" if "no number" in why else None] if wider else columns(300)
    if "computed" in why:
        assert form_of(sql_of(OTHER[why]), "rows", image.PAGE_BYTES) is None
        return
    write(store, OTHER[why], given)
    assert ways == ["bound"]
    assert told(store, "SELECT count(*) FROM rows") == [(300,)]


@pytest.mark.parametrize("why", ["rows", "columns in another order", "no function", "no handle", "many attached", "UTF-16"])
def test_where_there_can_be_no_image_rows_are_written_as_before(
    tmp_path: Path, ways: list[str], why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if why == "UTF-16":
        with sqlite3.connect(tmp_path / "x.db") as raw:
            raw.execute("PRAGMA encoding = 'UTF-16le'")
            raw.execute("CREATE TABLE before (a)")
    with connect(str(tmp_path / "x.db"), 1.0, may_create=True) as store:
        create(store)
        given = columns(300)
        if why == "no function":
            monkeypatch.setattr(image, "library", lambda: native.Library(object(), np.zeros(0, np.int64)))
        with writing(store) as connection:
            if why == "rows":
                connection.exec_driver_sql("INSERT INTO rows (run_id, id, whole) VALUES (2, 0, 0)")
            if why == "columns in another order":
                connection.exec_driver_sql("DROP TABLE rows")
                connection.exec_driver_sql(
                    sql_of(ROWS)
                    .replace("whole_as_real FLOAT", "x FLOAT")
                    .replace("real FLOAT", "whole_as_real FLOAT", 1)
                    .replace("x FLOAT", "real FLOAT")
                )
            for number in range(10 if why == "many attached" else 0):
                connection.exec_driver_sql(f"ATTACH ':memory:' AS other_{number}")
            if why == "no handle":
                monkeypatch.setattr(native, "KNOWN_LAYOUT", ())
            bulk.append(connection, ROWS, given)
        found = told(
            store, f"SELECT {', '.join(column.name for column in ROWS.columns)} FROM rows WHERE run_id = 3 ORDER BY id"
        )
    assert ways == ([] if why == "no handle" else ["bound"])
    assert [row[1:] for row in found] == [row[1:] for row in expected(given, 300)]


def test_of_two_tables_in_a_transaction_one_is_an_image(store: Store, ways: list[str]) -> None:
    create(store)
    create(store, table_of(name="more_rows"))
    with writing(store) as connection:
        for table in (ROWS, table_of(name="more_rows")):
            bulk.append(connection, table, columns(300))
    assert ways == ["image", "bound"]
    assert told(store, "SELECT * FROM rows ORDER BY id") == told(store, "SELECT * FROM more_rows ORDER BY id")


def test_an_index_of_the_operator_is_kept_up(store: Store, ways: list[str]) -> None:
    """SQLite sees that the tables differ, and looks at every row."""
    create(store)
    with writing(store) as connection:
        connection.exec_driver_sql("CREATE INDEX own ON rows (named)")
    write(store, ROWS, columns(300))
    assert ways == ["image"]
    assert told(store, "PRAGMA integrity_check") == [("ok",)]
    assert told(store, "SELECT count(*) FROM rows WHERE named > 0") == [(int((columns(300)[5].values > 0).sum()),)]  # type: ignore[union-attr]


def test_a_database_in_memory_takes_an_image_too(ways: list[str]) -> None:
    with kept.open_store("sqlite://") as store:
        run = world.begin(store)
        for number in range(2):
            world.write(store, run, number, VESSELS)
        assert len(kept.picture(store, run).rows) > 600
    assert ways.count("image") == 2


def test_pictures_of_two_runs_stand_side_by_side(tmp_path: Path, ways: list[str]) -> None:
    with kept.open_store(str(tmp_path / "x.db")) as store:
        runs = [world.begin(store), world.begin(store)]
        for number in range(2):
            for run in runs:
                world.write(store, run, number, VESSELS)
        found = [kept.picture(store, run).rows for run in runs]
    assert "image" in ways
    assert [len(rows) for rows in found] == [len(found[0])] * 2
    assert len(found[0]) > 600
