"""Rows go in the same whichever way they go: compiled code on SQLite's handle, executemany, COPY."""

from __future__ import annotations

import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import store_world as world
from sqlalchemy import BigInteger, Boolean, Column, Connection, Float, LargeBinary, MetaData, Table, Text, create_engine, select

from coastwatch import store as kept
from coastwatch.store import StoreError, bulk, native
from coastwatch.store.cells import Blobs, Named, Texts
from coastwatch.store.cells import Column as Cells
from coastwatch.store.opening import connect, reading, writing

SIZES = (1, 31, 32, 33, native.BLOCK + 40)
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
    blob = Blobs(rng.integers(0, 256, (count, 80), dtype=np.uint8), rng.random(count) < 0.7)
    every = np.arange(2 * count)[::2] - 2**50  # not beside each other in memory
    return [
        3, every, real, Named(named), rng.random(count) < 0.5, Texts(rng.integers(-1, len(TEXTS), count), TEXTS), blob, "ü", 0.1, None,
    ]  # fmt: skip


@pytest.fixture(params=["compiled", "tuples", "copied"])
def way(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The address of a database and the way to it."""
    if request.param == "copied":
        return str(request.getfixturevalue("postgresql_url"))
    monkeypatch.setattr(bulk, "NATIVE_FROM", 1 if request.param == "compiled" else 10**9)
    monkeypatch.setattr(native, "carry_out", counted(native.carry_out) if request.param == "compiled" else forbidden)
    return f"sqlite:///{tmp_path / 'x.db'}"


def counted(act: Any) -> Any:
    def counting(*given: Any) -> None:
        calls.append(len(given))
        act(*given)

    calls.clear()
    return counting


calls: list[int] = []


def forbidden(*given: Any) -> None:
    raise AssertionError("compiled code was not to be used")


@contextmanager
def table_of(url: str) -> Iterator[Any]:
    with connect(url, 1.0, may_create=True) as store:
        with writing(store) as connection:
            ROWS.create(connection)
        yield store


def expected(count: int) -> list[tuple[Any, ...]]:
    """The rows as Python would say them."""
    _, every, real, named, flag, text, blob, *_ = columns(count)
    assert isinstance(text, Texts)
    assert isinstance(blob, Blobs)
    return [
        (
            3,
            int(every[k]),  # type: ignore[index]
            None if np.isnan(real[k]) else float(real[k]),  # type: ignore[index]
            int(named.values[k]) if named.values[k] >= 0 else None,  # type: ignore[union-attr]
            bool(flag[k]),  # type: ignore[index]
            TEXTS[text.codes[k]] if text.codes[k] >= 0 else None,
            blob.rows[k].tobytes() if blob.there[k] else None,
            "ü",
            0.1,
            None,
        )
        for k in range(count)
    ]


@pytest.mark.parametrize("count", SIZES)
def test_every_way_writes_the_same_rows(way: str, count: int) -> None:
    with table_of(way) as store:
        with writing(store) as connection:
            bulk.append(connection, ROWS, columns(count))
        with reading(store) as connection:
            found = [tuple(row) for row in connection.execute(select(ROWS).order_by(ROWS.c.id))]
    assert found == expected(count)


def test_no_rows_are_no_work(way: str) -> None:
    with table_of(way) as store, writing(store) as connection:
        bulk.append(connection, ROWS, columns(0))
        bulk.erase(connection, ROWS, {"id": np.zeros(0, np.int64)}, {"run_id": 3})
        assert connection.execute(select(ROWS)).all() == []


def test_rows_are_changed_and_deleted_by_their_keys(way: str) -> None:
    ids = np.arange(300) * 2 - 2**50
    with table_of(way) as store, writing(store) as connection:
        bulk.append(connection, ROWS, columns(300))
        bulk.erase(connection, ROWS, {"id": ids[:100]}, {"run_id": 3})
        bulk.erase(connection, ROWS, {"id": ids[100:200]}, {"run_id": 4})  # no row is of run 4
        bulk.amend(connection, ROWS, {"run_id": np.full(100, 3), "id": ids[100:200]}, {"empty": None}, {"named": None})
        renewed = {"text": Texts(np.where(ids[200:] % 4 == 0, 0, -1), ["new"]), "named": Named(np.where(ids[200:] % 4, 7, -1))}
        bulk.renew(connection, ROWS, {"id": ids[200:]}, {"run_id": 3}, renewed)
        found = [tuple(row) for row in connection.execute(select(ROWS.c.id, ROWS.c.named, ROWS.c.text).order_by(ROWS.c.id))]
    was = {row[1]: (row[3], row[5]) for row in expected(300)}
    wanted = [(i, None, was[i][1]) for i in ids[100:200].tolist()]
    wanted += [(i, 7 if i % 4 else was[i][0], was[i][1] if i % 4 else "new") for i in ids[200:].tolist()]
    assert found == wanted


def test_rows_belong_to_the_transaction_in_hand(way: str) -> None:
    with table_of(way) as store:
        with writing(store) as connection:
            bulk.append(connection, ROWS, columns(40))
            assert len(connection.execute(select(ROWS)).all()) == 40
            connection.rollback()
        with reading(store) as connection:
            assert connection.execute(select(ROWS)).all() == []


@pytest.mark.parametrize("count", [3, 64])
def test_a_refused_row_is_refused_in_the_same_words(tmp_path: Path, count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same key twice, and NULL where none may be."""
    said = []
    for at_least in (1, 10**9):
        monkeypatch.setattr(bulk, "NATIVE_FROM", at_least)
        with kept.open_store(str(tmp_path / f"{at_least}.db")) as store:
            run = world.begin(store)
            twice: list[Cells] = [run, np.full(count, 7), 0, 1]
            absent: list[Cells] = [run, np.arange(count), 0, Named(np.full(count, -1))]
            for rows in (twice, absent):
                with pytest.raises(StoreError) as refused, writing(store) as connection:
                    bulk.append(connection, kept.write.TABLES["member"], rows)
                said.append((str(refused.value).replace(store.where, ""), cause(refused.value)))
            with reading(store) as connection:
                assert connection.execute(select(kept.write.TABLES["member"])).all() == []
    assert said[:2] == said[2:]
    assert "UNIQUE constraint failed" in said[0][0]
    assert "NOT NULL constraint failed" in said[1][0]


def cause(error: BaseException) -> type:
    """The driver's own error."""
    of = error.__cause__
    return type(getattr(of, "orig", of))


def test_without_the_handle_tuples_are_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bulk, "NATIVE_FROM", 1)
    monkeypatch.setattr(native, "library", lambda: None)
    with table_of(str(tmp_path / "x.db")) as store, writing(store) as connection:
        bulk.append(connection, ROWS, columns(300))
        assert len(connection.execute(select(ROWS)).all()) == 300


def test_a_handle_is_believed_only_where_it_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    raw = sqlite3.connect(":memory:", isolation_level=None)
    address = native.handle(raw)
    assert address is not None
    raw.execute("BEGIN")
    assert native.handle(raw) == address
    assert native.handle(object()) is None
    closed = sqlite3.connect(":memory:")
    closed.close()
    assert native.handle(closed) is None
    monkeypatch.setattr(native, "KNOWN_LAYOUT", ())
    assert native.handle(raw) is None
    raw.close()


def test_sqlite_is_the_one_of_the_standard_library() -> None:
    found = native.library()
    assert found is not None
    found.call.sqlite3_libversion.restype = native.ctypes.c_char_p
    assert found.call.sqlite3_libversion().decode() == sqlite3.sqlite_version


def test_another_database_goes_by_its_own_way(monkeypatch: pytest.MonkeyPatch) -> None:
    """Any other dialect takes what SQLAlchemy makes; here SQLite under another name."""
    engine = create_engine("sqlite://")
    with engine.begin() as connection:
        ROWS.create(connection)
        monkeypatch.setattr(connection.dialect, "name", "other")
        ids = np.arange(4) * 2 - 2**50
        bulk.append(connection, ROWS, columns(4))
        bulk.erase(connection, ROWS, {"id": ids[:1]}, {"run_id": 3, "empty": None})
        bulk.amend(connection, ROWS, {"id": ids[1:2]}, {"run_id": 3}, {"named": 9})
        bulk.renew(connection, ROWS, {"id": ids[2:]}, {"run_id": 3}, {"named": Named(np.array([-1, 8]))})
        monkeypatch.undo()
        was = expected(4)
        assert named(connection) == [(was[1][1], 9), (was[2][1], was[2][3]), (was[3][1], 8)]


def named(connection: Connection) -> list[tuple[Any, ...]]:
    return [tuple(row) for row in connection.execute(select(ROWS.c.id, ROWS.c.named).order_by(ROWS.c.id))]


def test_a_few_rows_need_no_compiler(tmp_path: Path) -> None:
    """A process that writes little never loads numba."""
    script = (
        "import sys, numpy as np; from coastwatch.store import bulk, open_store; from coastwatch.store.opening import writing\n"
        "from coastwatch.store.tables import Base\n"
        f"with open_store({str(tmp_path / 'x.db')!r}) as store, writing(store) as c:\n"
        "    c.exec_driver_sql('PRAGMA defer_foreign_keys = ON')\n"
        "    bulk.append(c, Base.metadata.tables['member'], [1, np.arange(9), 0, 1]); c.rollback()\n"
        "print('numba' in sys.modules)"
    )
    said = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "False"
