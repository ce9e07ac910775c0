"""Rows given as columns are the rows of the table, whatever is odd about a value; errors are the database's own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import store_world as world
from sqlalchemy import BigInteger, Boolean, Column, Float, LargeBinary, MetaData, Table, Text, select

from coastwatch import store as kept
from coastwatch.errors import StoreError
from coastwatch.store import rows as rows_in
from coastwatch.store.rows import Categorical, Column as Cells, NullableId, delete_rows, insert, update_rows
from coastwatch.store.schema.database import connect, reading, writing
from coastwatch.store.schema.tables import MEMBER

pytestmark = pytest.mark.contract

TEXTS = ("", "ais", "São Sebastião, 港", "x" * 300)

ROWS = Table(
    "rows",
    MetaData(),
    Column("run_id", BigInteger, primary_key=True, autoincrement=False),
    Column("id", BigInteger, primary_key=True, autoincrement=False),
    Column("real", Float(53)),
    Column("named", BigInteger),
    Column("flag", Boolean),
    Column("text", Text),
    Column("blob", LargeBinary),
    Column("same_text", Text),
    Column("same_real", Float(53)),
    Column("empty", BigInteger),
)


def columns(count: int) -> list[Cells]:
    """Rows with everything that may be odd about a value."""
    rng = np.random.default_rng([5, count])
    real = rng.choice([np.nan, 0.0, -0.0, 1.0 / 3.0, -1e308, 5e-324, np.inf, 7.0], count)
    named = rng.choice([-1, 0, 1, 2**40, 2**63 - 1], count)
    blob: list[bytes | None] = [rng.bytes(80) if rng.random() < 0.7 else None for _ in range(count)]
    ids = np.arange(2 * count)[::2] - 2**50  # not beside each other in memory
    texts = Categorical(rng.integers(-1, len(TEXTS), count), TEXTS)
    return [3, ids, real, NullableId(named), rng.random(count) < 0.5, texts, blob, "ü", 0.1, None]


def expected(count: int) -> list[tuple[Any, ...]]:
    """The rows as Python would say them."""
    _, ids, real, named, flag, text, blob, *_ = columns(count)
    assert isinstance(ids, np.ndarray)
    assert isinstance(real, np.ndarray)
    assert isinstance(flag, np.ndarray)
    assert isinstance(named, NullableId)
    assert isinstance(text, Categorical)
    assert isinstance(blob, list)
    reals = [None if np.isnan(x) else x for x in real.tolist()]
    names = [x if x >= 0 else None for x in named.values.tolist()]
    texts = [TEXTS[code] if code >= 0 else None for code in text.codes.tolist()]
    some = zip(ids.tolist(), reals, names, flag.tolist(), texts, blob, strict=True)
    return [(3, *row, "ü", 0.1, None) for row in some]


@contextmanager
def table_of(url: str) -> Iterator[Any]:
    with connect(url, 1.0, may_create=True) as store:
        with writing(store) as connection:
            ROWS.create(connection)
        yield store


@pytest.mark.parametrize("count", [0, 1, 8, 100])
def test_rows_are_those_of_the_columns(url: str, count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rows_in, "BATCH_ROWS", 8)
    with table_of(url) as store:
        with writing(store) as connection:
            assert insert(connection, ROWS, columns(count)) == count
        with reading(store) as connection:
            found = [tuple(row) for row in connection.execute(select(ROWS).order_by(ROWS.c.id))]
    assert found == expected(count)


def test_rows_are_changed_and_deleted_by_their_keys(url: str) -> None:
    ids = np.arange(300) * 2 - 2**50
    with table_of(url) as store, writing(store) as connection:
        insert(connection, ROWS, columns(300))
        delete_rows(connection, ROWS, {"id": ids[:100]}, {"run_id": 3})
        delete_rows(connection, ROWS, {"id": ids[100:200]}, {"run_id": 4})  # no row is of run 4
        delete_rows(connection, ROWS, {"id": ids[:0]}, {"run_id": 3})
        update_rows(connection, ROWS, {"run_id": np.full(100, 3), "id": ids[100:200]}, {"empty": None}, {"named": 5})
        changed = {"text": Categorical(np.where(ids[200:] % 4 == 0, 0, -1), ["new"])}
        changed["named"] = NullableId(np.where(ids[200:] % 4, 7, -1))  # type: ignore[assignment]
        update_rows(connection, ROWS, {"id": ids[200:]}, {"run_id": 3}, changed)
        found = [tuple(row) for row in connection.execute(select(ROWS.c.id, ROWS.c.named, ROWS.c.text).order_by(ROWS.c.id))]
    was = {row[1]: (row[3], row[5]) for row in expected(300)}
    wanted = [(i, 5, was[i][1]) for i in ids[100:200].tolist()]
    wanted += [(i, 7 if i % 4 else was[i][0], was[i][1] if i % 4 else "new") for i in ids[200:].tolist()]
    assert found == wanted


def test_rows_belong_to_the_transaction_of_the_connection(url: str) -> None:
    with table_of(url) as store:
        with writing(store) as connection:
            insert(connection, ROWS, columns(40))
            assert len(connection.execute(select(ROWS)).all()) == 40
            connection.rollback()
        with reading(store) as connection:
            assert connection.execute(select(ROWS)).all() == []


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([1, np.full(3, 7), 0, 1], "UNIQUE constraint failed"),
        ([1, np.arange(3), 0, NullableId(np.full(3, -1))], "NOT NULL constraint failed"),
        ([99, np.arange(3), 0, 1], "FOREIGN KEY constraint failed"),
    ],
)
def test_a_refused_row_takes_all_of_the_transaction_back(rows: list[Cells], said: str, tmp_path: Path) -> None:
    with kept.open_store(str(tmp_path / "x.db")) as store:
        world.begin(store)
        with pytest.raises(StoreError, match=said):
            _insert_both(store, MEMBER, [1, np.arange(5), 3, 1], rows)
        with reading(store) as connection:
            assert connection.execute(select(MEMBER)).all() == []


def _insert_both(store: kept.Store, table: Table, *of: list[Cells]) -> None:
    with writing(store) as connection:
        for rows in of:
            insert(connection, table, rows)
