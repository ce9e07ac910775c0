"""Rows that SQLite takes from an image one by one: into a table that has rows, or foreign keys that it is to heed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import store_world as world
from image_world import ROWS, bits, columns, expected, table_of
from sqlalchemy import BigInteger, Column, ForeignKey, MetaData, Table

from coastwatch import store as kept
from coastwatch.store import StoreError, bulk, image, native
from coastwatch.store.opening import Store, connect, reading, writing
from coastwatch.store.tables import Base

MANY = image.MANY + 5
OF = Table("of", MetaData(), Column("id", BigInteger, primary_key=True))
CHILD = table_of(Column("of", BigInteger, ForeignKey(OF.c.id)))


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Store]:
    """Rows that would be bound are an error here."""

    def carry_out(*given: object) -> None:
        raise AssertionError("bound")

    monkeypatch.setattr(native, "carry_out", carry_out)
    with connect(str(tmp_path / "x.db"), 1.0, may_create=True) as found:
        with writing(found) as connection:
            OF.create(connection)
        yield found


def told(store: Store, query: str) -> list[tuple[object, ...]]:
    with reading(store) as connection:
        return [tuple(map(bits, row)) for row in connection.exec_driver_sql(query)]


def test_many_rows_come_to_those_that_are_there(store: Store) -> None:
    """Bit for bit, on either side of a row that lies between them."""
    given = columns(MANY)
    with writing(store) as connection:
        ROWS.create(connection)
        connection.exec_driver_sql("INSERT INTO rows (run_id, id, whole) VALUES (3, 0, 7), (4, 1, 7)")
        given[2] = np.arange(MANY) * 2 - MANY
        bulk.append(connection, ROWS, given)
    names = ", ".join(column.name for column in ROWS.columns)
    assert told(store, f"SELECT {names} FROM rows WHERE whole <> 7 OR id % 2 ORDER BY id")[:10] == expected(given, MANY)[:10]
    assert told(store, f"SELECT {names} FROM rows WHERE run_id = 3 AND id <> 0 ORDER BY id") == expected(given, MANY)
    assert told(store, "PRAGMA integrity_check") == [("ok",)]


def test_a_row_that_is_there_already_is_refused_in_sqlites_words(store: Store) -> None:
    with writing(store) as connection:
        ROWS.create(connection)
        bulk.append(connection, ROWS, columns(MANY))
    with pytest.raises(StoreError, match=r"UNIQUE constraint failed: rows\.run_id, rows\.id"), writing(store) as connection:
        bulk.append(connection, ROWS, columns(MANY))
    assert told(store, "SELECT count(*) FROM rows") == [(MANY,)]


@pytest.mark.parametrize("known", [False, True])
def test_a_foreign_key_is_heeded_unless_the_parent_is_known(store: Store, known: bool) -> None:
    with writing(store) as connection:
        CHILD.create(connection)
        connection.exec_driver_sql("INSERT INTO of (id) VALUES (5)")
    with writing(store, parents_known=known) as connection:
        bulk.append(connection, CHILD, [*columns(300), 5])
    assert told(store, "SELECT count(*) FROM rows") == [(300,)]
    with writing(store) as connection:
        connection.exec_driver_sql("DELETE FROM rows")
    with pytest.raises(StoreError, match="FOREIGN KEY constraint failed"), writing(store) as connection:
        bulk.append(connection, CHILD, [*columns(300), 6])
    assert told(store, "SELECT count(*) FROM rows") == [(0,)]


def test_every_parent_is_a_run() -> None:
    """So it is enough that `write_cycle` looks for its run."""
    parents = {key.target_fullname for table in Base.metadata.tables.values() for key in table.foreign_keys}
    assert parents == {"run.id"}


def test_a_cycle_of_a_run_that_another_process_has_deleted_is_refused(tmp_path: Path) -> None:
    """Though the foreign keys are not heeded, and the store has the run in hand."""
    with kept.open_store(str(tmp_path / "x.db")) as first, kept.open_store(str(tmp_path / "x.db")) as second:
        run = world.begin(first)
        world.write(first, run, 0, 20)
        kept.discard_runs(second, "sea")
        with pytest.raises(StoreError, match=f"there is no run {run}"):
            world.write(first, run, 1, 20)
        assert told(first, "PRAGMA foreign_key_check") == []
        assert told(first, "SELECT count(*) FROM history") == [(0,)]
