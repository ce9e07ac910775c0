"""A killed writer, a locked database, a full disk, a file that is no database: whole cycles stay, and the message says what is wrong."""

from __future__ import annotations

import multiprocessing
import resource
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import store_world as world
from sqlalchemy import event

from coastwatch import store as kept
from coastwatch.errors import StoreError
from coastwatch.store import Store
from coastwatch.store.schema import database
from coastwatch.store.schema.migrate import check

pytestmark = pytest.mark.contract

KILLS = 4
VESSELS = 600
"""Enough that a writer in a loop is inside a transaction most of the time."""

SOON_S = 0.2
PATIENCE_S = 60.0


def write_for_ever(url: str, run_id: int, number: int, begun: Any) -> None:
    """What the killed process does."""
    with kept.open_store(url) as store:
        while True:
            world.write(store, run_id, number, VESSELS)
            begun.set()
            number += 1


def test_killed_at_any_moment_it_holds_whole_cycles_and_goes_on(url: str) -> None:
    rng = np.random.default_rng([2, 1])
    with kept.open_store(url) as store:
        run = world.begin(store)
        world.write(store, run, 0, VESSELS)
    newest = 0
    for _ in range(KILLS):
        fork = multiprocessing.get_context("fork")
        begun = fork.Event()
        writer = fork.Process(target=write_for_ever, args=(url, run, newest + 1, begun))
        writer.start()
        assert begun.wait(PATIENCE_S)
        time.sleep(0.1 * rng.random())
        writer.kill()
        writer.join()
        assert writer.exitcode == -9
        assert check(url) == []
        with kept.open_store(url, create=False) as store:
            (point,) = kept.unfinished_runs(store, "sea", 1)
            assert point.cycle > newest
            newest = point.cycle
            assert (point.run_id, kept.read_checkpoint(store, run)) == (run, b"memory %d" % newest)
            assert kept.runs(store).column("cycles_stored") == [newest + 1]
            assert kept.picture(store, run).column("time_s")[0] == world.instant_s(newest)
    with kept.open_store(url) as store:
        world.write(store, run, newest + 1, VESSELS)
    assert check(url) == []


def test_a_locked_database_is_said_to_be_locked_and_loses_nothing(url: str) -> None:
    with kept.open_store(url, wait_s=SOON_S) as store:
        run = world.begin(store)
        world.write(store, run, 0)
        with locked(url):
            with pytest.raises(StoreError, match=r"database is locked by another process: .*\(waited 0.2 s\)"):
                world.write(store, run, 1)
            assert len(kept.picture(store, run, world.instant_s(0)).rows) == 28
        world.write(store, run, 1)
    assert check(url) == []


@contextmanager
def locked(url: str) -> Iterator[None]:
    """Another program holds the lock that a writer needs."""
    if url.startswith("sqlite"):
        raw: Any = sqlite3.connect(url.removeprefix("sqlite:///"), isolation_level=None)
        raw.execute("BEGIN IMMEDIATE")
    else:
        import psycopg

        raw = psycopg.connect(url.replace("+psycopg", ""))
        raw.execute("LOCK TABLE vessel IN SHARE ROW EXCLUSIVE MODE")
    yield
    raw.rollback()
    raw.close()


DISK_FULL = "disk full", "MB free"


def fill(store: Store, run: int, wanted: tuple[str, ...] = DISK_FULL) -> int:
    """Write cycles until there is no room, which is said in these words; returns how many stand."""
    for number in range(500):
        try:
            world.write(store, run, number)
        except StoreError as refused:
            said = str(refused)
            break
    for part in (*wanted, store.where, "every whole cycle stored so far is kept"):
        assert part in said
    return number


def test_a_full_database_keeps_what_it_has_and_goes_on_when_there_is_room(tmp_path: Path) -> None:
    path = tmp_path / "small.db"
    with kept.open_store(str(path)) as store:
        run = world.begin(store)
        pages = {"most": 100}

        @event.listens_for(store.engine, "begin")
        def limit(connection: Any) -> None:
            connection.exec_driver_sql(f"PRAGMA max_page_count = {pages['most']}")

        number = fill(store, run)
        assert number > 3
        assert kept.picture(store, run).column("time_s")[0] == world.instant_s(number - 1)
        pages["most"] = 100_000
        world.write(store, run, number)
    assert check(str(path)) == []


def test_files_that_may_not_grow_are_not_called_a_full_disk(tmp_path: Path) -> None:
    path, (soft, hard) = tmp_path / "x.db", resource.getrlimit(resource.RLIMIT_FSIZE)
    with kept.open_store(str(path)) as store:
        run = world.begin(store)
        resource.setrlimit(resource.RLIMIT_FSIZE, (3_000_000, hard))
        try:
            number = fill(store, run, ("file cannot grow: ", "this process may write files of 3.0 MB at most (ulimit -f)"))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        assert kept.picture(store, run).column("time_s")[0] == world.instant_s(number - 1)
        world.write(store, run, number)
    assert check(str(path)) == []


@pytest.mark.parametrize(
    ("said", "free", "head"),
    [
        ("disk I/O error", 500_000_000, "cannot be written: "),
        ("disk I/O error", 900_000, "disk full: "),
        ("database or disk is full", 500_000_000, "disk full: "),
    ],
)
def test_a_disk_with_room_is_called_full_only_where_the_database_says_so(
    said: str, free: int, head: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(database.shutil, "disk_usage", lambda folder: SimpleNamespace(free=free))
    sentence = database.cannot_grow(str(tmp_path / "x.db"), said, is_file=True)
    assert sentence.startswith(head)
    assert f"{free / 1e6:.1f} MB free" in sentence


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of four megabytes: 256 pages."""
    folder = tmp_path / "disk"
    folder.mkdir()
    made = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(folder)], capture_output=True, check=False)
    if made.returncode != 0:
        pytest.skip(f"no tmpfs can be mounted here: {made.stderr.decode().strip()}")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_keeps_what_it_has(small_disk: Path) -> None:
    with kept.open_store(str(small_disk / "full.db")) as store:
        run = world.begin(store)
        number = fill(store, run)
        assert number > 3
        assert kept.picture(store, run).column("time_s")[0] == world.instant_s(number - 1)
    assert check(str(small_disk / "full.db")) == []


def test_what_is_no_database_is_said_to_be_none(tmp_path: Path) -> None:
    text = tmp_path / "notes.txt"
    text.write_text("This is not a database. " * 100)
    with pytest.raises(StoreError, match=r"notes.txt: is not an SQLite database"):
        kept.open_store(str(text))
    with pytest.raises(StoreError, match="is a folder"):
        kept.open_store(str(tmp_path))
    with pytest.raises(StoreError, match="there is no folder"):
        kept.open_store(str(tmp_path / "nowhere" / "x.db"))
    with pytest.raises(StoreError, match="there is no such database"):
        kept.open_store(str(tmp_path / "x.db"), create=False)
    assert not (tmp_path / "x.db").exists()
    with pytest.raises(StoreError, match="nonsense"):
        kept.open_store("nonsense://")
    with pytest.raises(StoreError, match=r"127\.0\.0\.1"):
        kept.open_store("postgresql+psycopg://nobody:secret@127.0.0.1:1/none")


def test_a_password_is_not_repeated() -> None:
    with pytest.raises(StoreError) as caught:
        kept.open_store("postgresql+psycopg://nobody:secret@127.0.0.1:1/none")
    assert "secret" not in str(caught.value)


def test_a_damaged_database_is_said_to_be_damaged(tmp_path: Path) -> None:
    path = tmp_path / "hurt.db"
    with kept.open_store(str(path)) as store:
        run = world.begin(store)
        for number in range(3):
            world.write(store, run, number, 300)
    whole = bytearray(path.read_bytes())
    for page in range(4, len(whole) // 4096):
        whole[page * 4096 : page * 4096 + 64] = b"\xff" * 64
    path.write_bytes(whole)
    with pytest.raises(StoreError, match=r"hurt\.db: is damaged"), kept.open_store(str(path), create=False) as store:
        kept.picture(store, run)


def test_a_database_that_may_not_be_written(tmp_path: Path) -> None:
    path = tmp_path / "locked away.db"
    with kept.open_store(str(path)) as store:
        run = world.begin(store)
        world.write(store, run, 0)
        with database.reading(store) as connection:
            connection.exec_driver_sql("PRAGMA query_only = ON")
        with pytest.raises(StoreError, match="cannot be opened or written"):
            world.write(store, run, 1)


def test_an_sqlite_without_mathematics_is_lent_some() -> None:
    class Plain(sqlite3.Connection):
        lent = False

        def execute(self, sql: str, *rest: Any) -> sqlite3.Cursor:
            if "cos" in sql and not self.lent:
                raise sqlite3.OperationalError("no such function: cos")
            return super().execute(sql, *rest)

        def create_function(self, *args: Any, **more: Any) -> None:
            self.lent = True
            super().create_function(*args, **more)

    raw = sqlite3.connect(":memory:", factory=Plain)
    database.add_math_functions(raw)
    assert raw.lent
    found = raw.execute("SELECT cos(radians(60.0)), sqrt(2.25), floor(-1.5), cos(NULL)").fetchone()
    assert found == (pytest.approx(0.5), 1.5, -2.0, None)
    raw.close()


def test_a_seed_that_no_database_holds_is_refused(url: str) -> None:
    with kept.open_store(url) as store, pytest.raises(StoreError, match="seed: got 9223372036854775808"):
        world.begin(store, seed=2**63)


def test_reading_needs_no_stage_of_the_pipeline() -> None:
    """`coastwatch picture` answers at once: neither Alembic nor anything slow is imported to read."""
    slow = ("alembic", "sklearn", "scipy.spatial", "numba", "polars", "pydantic")
    script = f"import sys, coastwatch.store; print(*[m for m in {slow} if m in sys.modules])"
    said = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == ""


def test_a_question_that_takes_too_long_is_ended_and_the_next_one_is_answered(url: str) -> None:
    endless = "WITH RECURSIVE n (x) AS (SELECT 1 UNION ALL SELECT 3 - x FROM n) SELECT max(x) FROM n"
    with kept.open_store(url) as made:
        world.begin(made)
    with kept.open_store(url, limit=kept.QueryLimit(1.5, time.monotonic)) as store:
        with pytest.raises(StoreError, match=r"took longer than 1\.5 s"), database.reading(store) as connection:
            connection.exec_driver_sql(endless).all()
        assert kept.latest_run(store) == 1
