"""Rows that reach SQLite as the bytes of a table are the rows that its own statements write, and what cannot go so goes as before."""

from __future__ import annotations

import sqlite3
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import store_world as world
from image_world import KEY, ROWS, VESSELS, bits, columns, expected, form, sql_of, table_of
from sqlalchemy import (
    BigInteger,
    CheckConstraint,
    Column,
    Computed,
    Table,
    Text,
    UniqueConstraint,
)

from coastwatch import store as kept
from coastwatch.store import StoreError, bulk, image, native
from coastwatch.store.cells import Column as Cells
from coastwatch.store.cells import Named, Texts
from coastwatch.store.image_form import form_of
from coastwatch.store.opening import Store, connect, reading, writing


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
        assert "image_0" in [row[1] for row in connection.exec_driver_sql("PRAGMA database_list")]
    assert made[0]() is None
    assert [row[1] for row in told(store, "PRAGMA database_list")] == ["main"]
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


OTHER = {
    "rows have an address of their own": table_of(rowid=True),
    "a condition": table_of(CheckConstraint("whole > 0 OR whole <= 0")),
    "a second unique key": table_of(UniqueConstraint("id", "flag")),
    "a computed column": table_of(Column("twice", BigInteger, Computed("2 * id"))),
    "a key that is no number": table_of(Column("kind", Text, **KEY)),  # type: ignore[arg-type]
}
"""Tables of a form that is left to SQLite."""


@pytest.mark.parametrize("why", OTHER)
def test_a_table_of_another_form_is_bound(store: Store, ways: list[str], why: str) -> None:
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


def test_two_tables_in_a_transaction_are_two_images(store: Store, ways: list[str]) -> None:
    create(store)
    create(store, table_of(name="more_rows"))
    with writing(store) as connection:
        for table in (ROWS, table_of(name="more_rows")):
            bulk.append(connection, table, columns(300))
    assert ways == ["image", "image"]
    assert told(store, "SELECT * FROM rows ORDER BY id") == told(store, "SELECT * FROM more_rows ORDER BY id")
    assert [row[1] for row in told(store, "PRAGMA database_list")] == ["main"]


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
    assert (
        ways.count("image") == 8
    )  # twice the current picture; once history, stays, members and who they are, then as they come


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
