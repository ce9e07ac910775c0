"""Tables, migrations and written schemas are one; an old database comes along with all its rows; a foreign one is left alone."""

from __future__ import annotations

import json
import re
import sqlite3
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import old_database
import past_world
import pytest
import store_world as world
from alembic.config import Config
from alembic.script import ScriptDirectory
from sqlalchemy import JSON, Boolean, MetaData, text
from test_recording import same

from coastwatch import store as kept
from coastwatch.errors import StoreError
from coastwatch.operators.cli import main
from coastwatch.shipped import migrations_folder, schema_folder
from coastwatch.store.bbox import inside
from coastwatch.store.schema import migrate
from coastwatch.store.schema.database import connect, reading, revision, writing
from coastwatch.store.schema.tables import HISTORY, METADATA, REVISION, REVISION_TABLE

pytestmark = pytest.mark.contract

SINCE_0001 = {
    "ais_feed",
    "track_source",
    "presence",
    "sensor_registration",
    "identity",
    "recording",
    "event",
    "event_gap",
    "sensor_cover",
    "standing_echo",
    "decided_path",
    "acknowledgement",
    "audit",
    "track_journal",
    "region_intake",
    "zone",
}
"""Tables that schema 0001 does not have."""

SINCE_0004 = (
    "picture_kept",
    "history_from",
    "history_points",
    "previous_cycle",
    "closing",
    "piece",
    "written_utc",
    "machine",
    "process",
    "verdict",
    "nav_status",
    "interval_s",
    "existence",
    "echo_length_m",
    "echo_width_m",
    "echo_axis_deg",
    "alternative_m",
)
"""Columns that it does not have; it has `cycle.history_kept`."""

LIKE_ANY_POWER = 1e-14
"""The covariances that were written are made again with powers of ten, whose last bits differ between processors."""


def as_in_0001(table: str, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The rows of today as that schema had them: no closing points."""
    kept = {"history_kept": True} if table == "cycle" else {}
    return [
        {**{key: value for key, value in row.items() if key not in SINCE_0004}, **kept}
        for row in rows
        if not row.get("closing")
    ]


def as_one(stays: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Of every MMSI and vessel one stay: from its first cycle, and whether it lasts."""
    out: dict[tuple[int, ...], tuple[int, bool]] = {}
    for row in stays:
        pair = row["run_id"], row["mmsi"], row["vessel_id"]
        first, lasts = out.get(pair, (row["from_cycle"], False))
        out[pair] = min(first, row["from_cycle"]), lasts or row["to_cycle"] is None
    return [{"pair": pair, "stay": stay} for pair, stay in out.items()]


def test_tables_are_what_the_migrations_make(url: str) -> None:
    migrate.upgrade(url)
    with connect(url, 1.0, may_create=False) as store, reading(store) as connection:
        assert migrate.differences(connection) == []
        assert revision(connection, "") == REVISION
    assert migrate.check(url) == []


def test_a_new_database_is_what_the_migrations_make(url: str, tmp_path: Path) -> None:
    with kept.open_store(url) as made:
        where = made.where
    assert migrate.check(url) == []
    assert migrate.upgrade(url).before == REVISION
    with kept.open_store(url, create=False) as again:
        assert again.where == where
    if url.startswith("sqlite"):
        by_steps = f"sqlite:///{tmp_path / 'by_steps.db'}"
        migrate.upgrade(by_steps)
        assert _statements(url) == _statements(by_steps)


def test_processes_that_open_a_new_database_at_once_all_have_it(url: str) -> None:
    together = threading.Barrier(4)

    def opened(_: int) -> None:
        together.wait()
        kept.open_store(url).close()

    with ThreadPoolExecutor(4) as threads:
        list(threads.map(opened, range(4)))
    assert migrate.check(url) == []


def _statements(url: str) -> set[tuple[str, str, frozenset[str]]]:
    """Kind and name of each table and index of an SQLite database, and the parts of its statement in no order."""
    with connect(url, 1.0, may_create=False) as store, reading(store) as connection:
        rows = connection.execute(text("SELECT type, name, sql FROM sqlite_master WHERE sql IS NOT NULL")).all()
    return {(kind, name, frozenset(re.split(r"[\s,()]+", sql.replace('"', "")))) for kind, name, sql in rows}


def test_the_newest_migration_is_the_one_that_the_tables_name() -> None:
    config = Config()
    config.set_main_option("script_location", str(migrations_folder()))
    scripts = ScriptDirectory.from_config(config)
    assert scripts.get_heads() == [REVISION]
    assert len(list(scripts.walk_revisions())) >= 2


@pytest.mark.parametrize("dialect", migrate.DIALECTS)
def test_the_written_schema_is_current(dialect: str) -> None:
    written = (schema_folder() / f"{dialect}.sql").read_text("utf-8")
    assert written == migrate.schema(dialect), "write it again: python -m coastwatch.store.schema.migrate"


@pytest.mark.parametrize("dialect", migrate.DIALECTS)
def test_the_written_schema_makes_the_tables(dialect: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    """The schema file alone, without Alembic, makes a database that equals the tables."""
    url = str(tmp_path / "x.db") if dialect == "sqlite" else str(request.getfixturevalue("postgresql_url"))
    with connect(url, 1.0, may_create=True) as store:
        lines = (schema_folder() / f"{dialect}.sql").read_text("utf-8").splitlines()
        with writing(store) as connection:
            for statement in "\n".join(line for line in lines if not line.startswith("--")).split(";"):
                if statement.strip():
                    connection.exec_driver_sql(statement)
        with reading(store) as connection:
            assert migrate.differences(connection) == []


def test_a_database_of_the_first_schema_comes_along_with_all_its_rows(url: str, tmp_path: Path) -> None:
    """The rows of two runs are put into schema 0001; `presence`, which it does not have, is made from the history."""
    source = str(tmp_path / "today.db")
    with kept.open_store(source) as today:
        run, other = world.begin(today), world.begin(today, "lake")
        for number in range(13):
            world.write(today, run, number)
        world.write(today, other, 0)
        with reading(today) as connection:
            rows = {name: [dict(row._mapping) for row in connection.execute(t.select())] for name, t in METADATA.tables.items()}
    migrate.upgrade(url, "0001")
    with connect(url, 1.0, may_create=False) as old:
        there = MetaData()
        with writing(old) as connection:
            there.reflect(connection)
            assert set(there.tables) == set(METADATA.tables) - SINCE_0001 | {REVISION_TABLE}
            for name in (table.name for table in METADATA.sorted_tables if table.name not in SINCE_0001):
                connection.execute(there.tables[name].insert(), as_in_0001(name, rows[name]))
    with pytest.raises(StoreError, match=f"schema: got 0001, needed {REVISION}: `coastwatch db upgrade` brings it there"):
        kept.open_store(url)
    assert migrate.check(url) == [f"schema: got 0001, needed {REVISION}: `coastwatch db upgrade` brings it there"]
    migrate.upgrade(url)
    assert migrate.check(url) == []
    with kept.open_store(url) as store:
        with reading(store) as connection:
            for name, table in METADATA.tables.items():
                found = [dict(row._mapping) for row in connection.execute(table.select())]
                ours = (
                    []
                    if name
                    in (
                        "sensor_registration",
                        "sensor_cover",
                        "standing_echo",
                        "decided_path",
                        "acknowledgement",
                        "zone",
                        "region_intake",
                    )
                    else rows[name]
                )  # nothing of it then
                if name == "identity":  # all stays of an MMSI with a vessel are one, open while the last one is
                    ours, found = (as_one(of) for of in (ours, found))
                if name == "presence":  # when a vessel that has left was first seen is no longer known, but its first cycle
                    ours = [{**row, "since_s": row["since_s"] if row["to_cycle"] is None else None} for row in ours]
                    found = [{**row, "since_s": row["since_s"] if row["to_cycle"] is None else None} for row in found]
                    stays = [
                        (row["from_cycle"], row["to_cycle"]) for row in found if row["vessel_id"] == 8 and row["run_id"] == run
                    ]
                    assert sorted(stays) == [(0, 2), (4, None)]
                    returned = {row["vessel_id"] for row in ours if row["to_cycle"] is None}
                    ours = [row for row in ours if row["to_cycle"] is None or row["vessel_id"] not in returned]
                    found = [row for row in found if row["to_cycle"] is None or row["vessel_id"] not in returned]
                assert sorted(map(repr, as_in_0001(name, found))) == sorted(map(repr, as_in_0001(name, ours))), name
            left = "SELECT run_id, vessel_id, to_cycle + 1 FROM presence WHERE to_cycle < 12 ORDER BY 1, 2, 3"
            closed = "SELECT run_id, vessel_id, cycle FROM history WHERE closing ORDER BY 1, 2, 3"
            assert connection.execute(text(closed)).all() == connection.execute(text(left)).all() != []
            spans = connection.execute(text("SELECT number, history_from FROM cycle WHERE run_id = 1")).all()
            assert all(number == first for number, first in spans)
        world.write(store, run, 13)
        world.write(store, run, 14)
    assert migrate.check(url) == []


def test_a_database_of_schema_0006_comes_along(url: str, tmp_path: Path) -> None:
    """Every point is a plain row, every recorded cycle is read as it was written, and the run goes on."""
    path, made = tmp_path / "old.db", old_database.pictures()
    old_database.unpack(path)
    with sqlite3.connect(path) as raw:
        raw.row_factory = sqlite3.Row
        names = [
            row["name"]
            for row in raw.execute("SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite%'")
        ]
        rows = {name: [dict(row) for row in raw.execute(f"SELECT * FROM {name}")] for name in names}
    assert len(rows["history_block"]) > 1
    if url.startswith("sqlite"):
        url = f"sqlite:///{path}"
    else:
        _fill_0006(url, rows)
    assert migrate.check(url) == [f"schema: got 0006, needed {REVISION}: `coastwatch db upgrade` brings it there"]
    migrate.upgrade(url)
    assert migrate.check(url) == []
    with kept.open_store(url) as store:
        with reading(store) as connection:
            found = [dict(row._mapping) for row in connection.execute(HISTORY.select())]
        was = [row | {"closing": bool(row["closing"]), "nav_status": None} for row in rows["history"]]
        assert sorted(map(repr, found)) == sorted(map(repr, was))
        recorded = list(kept.replay(store, 1))
        assert len(recorded) == len(made)
        for number, (old, picture) in enumerate(zip(recorded, made, strict=True)):
            np.testing.assert_allclose(old.picture.covariance, picture.covariance, rtol=LIKE_ANY_POWER, atol=0.0)
            assert same(replace(old.picture, covariance=picture.covariance), picture)
            assert same(old.members, world.cycle_of(number, 0, picture).members)
            then = kept.picture(store, 1, world.instant_s(number), past_world.BOXES[0])
            inside_box = inside(picture.position_deg, past_world.BOXES[0])
            assert then.column("vessel_id") == picture.vessel_id[inside_box].tolist()
        world.write(store, 1, len(made), cycle=world.cycle_of(len(made), 0, made[-1]), keep=past_world.KEEP)
    assert migrate.check(url) == []


def _fill_0006(url: str, rows: dict[str, list[dict[str, Any]]]) -> None:
    """The rows of an SQLite database of schema 0006 in an empty database of another kind."""
    migrate.upgrade(url, "0006")
    with connect(url, 1.0, may_create=False) as old, writing(old) as connection:
        there = MetaData()
        there.reflect(connection)
        for table in (t for t in there.sorted_tables if t.name != REVISION_TABLE and rows[t.name]):
            texts = {column.name for column in table.columns if isinstance(column.type, JSON)}
            flags = {column.name for column in table.columns if isinstance(column.type, Boolean)}
            given = [
                {
                    name: json.loads(value) if name in texts and value else bool(value) if name in flags else value
                    for name, value in row.items()
                }
                for row in rows[table.name]
            ]
            connection.execute(table.insert(), given)


def test_an_upgrade_of_a_current_database_changes_nothing(url: str) -> None:
    with kept.open_store(url) as store:
        world.write(store, world.begin(store), 0)
    migrate.upgrade(url)
    assert migrate.check(url) == []
    with kept.open_store(url, create=False) as store:
        assert len(kept.picture(store, 1).rows) == 28


def test_an_upgrade_that_fails_leaves_the_old_database(tmp_path: Path) -> None:
    path = tmp_path / "old.db"
    migrate.upgrade(str(path), "0001")
    with sqlite3.connect(path) as raw:
        raw.execute("CREATE VIEW presence_from AS SELECT 1")  # in the way of the index that 0002 makes last
        before = list(raw.iterdump())
    with pytest.raises(StoreError, match="presence_from"):
        migrate.upgrade(str(path))
    with sqlite3.connect(path) as raw:
        assert raw.execute(f"SELECT version_num FROM {REVISION_TABLE}").fetchall() == [("0001",)]
        assert list(raw.iterdump()) == before


def test_the_database_of_another_program_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "theirs.db"
    with sqlite3.connect(path) as raw:
        raw.execute("CREATE TABLE customers (name TEXT)")
    before = path.stat().st_size
    for act in (lambda: kept.open_store(str(path)), lambda: migrate.upgrade(str(path)), lambda: migrate.check(str(path))):
        with pytest.raises(StoreError, match="not a Coastwatch database: it has customers"):
            act()
    with sqlite3.connect(path) as raw:
        assert raw.execute("SELECT name FROM sqlite_master").fetchall() == [("customers",)]
    assert path.stat().st_size == before


def test_a_schema_may_be_shared_with_tables_of_other_names(postgresql_url: str) -> None:
    with connect(postgresql_url, 1.0, may_create=True) as store, writing(store) as connection:
        connection.execute(text("CREATE TABLE customers (name TEXT)"))
    with kept.open_store(postgresql_url) as store:
        world.write(store, world.begin(store), 0)
    assert migrate.check(postgresql_url) == []
    with connect(postgresql_url, 1.0, may_create=True) as store, writing(store) as connection:
        connection.execute(text(f"DROP TABLE {REVISION_TABLE}"))
    with pytest.raises(StoreError, match="not a Coastwatch database: it has acknowledgement, ais_feed, association"):
        kept.open_store(postgresql_url)


def test_a_database_of_a_newer_version_is_left_alone(url: str) -> None:
    migrate.upgrade(url)
    with connect(url, 1.0, may_create=False) as store, writing(store) as connection:
        connection.execute(text(f"UPDATE {REVISION_TABLE} SET version_num = '9999'"))
    with pytest.raises(StoreError, match=f"schema: got 9999, needed {REVISION}: it was written by a newer Coastwatch"):
        kept.open_store(url)
    assert main(["serve", "--db", url, "--port", "0"]) == 2  # a second start would not mend it
    (found,) = migrate.check(url)
    assert "written by a newer Coastwatch" in found
    assert "upgrade" not in found
    with pytest.raises(StoreError, match="9999"):
        migrate.upgrade(url)


def test_an_empty_database_is_not_filled_by_looking_at_it(tmp_path: Path) -> None:
    path = tmp_path / "empty.db"
    path.touch()
    with pytest.raises(StoreError, match="holds no tables"):
        kept.open_store(str(path), create=False)
    assert path.stat().st_size == 0


SPOILED = {
    "DELETE FROM cycle WHERE number = 1": "numbered without a gap",
    "DELETE FROM history WHERE cycle = 1 AND vessel_id = 1": "as many rows of history as it says",
    "DELETE FROM association WHERE cycle = 1": "as many associations as pairs",
    "DELETE FROM bearing_association WHERE cycle = 1": "as many bearing associations",
    "UPDATE history SET cycle = 7 WHERE cycle = 2": "rows of history belong to a cycle",
    "UPDATE stage_timing SET cycle = 7 WHERE cycle = 2": "timings belong to a cycle",
    "DELETE FROM vessel WHERE vessel_id = 1": "the picture has the vessels of the cycle in which",
    "UPDATE vessel SET vessel_id = 99 WHERE vessel_id = 1": "are those that were present",
    "DELETE FROM presence WHERE vessel_id = 1": "as many vessels are present",
    "DELETE FROM history WHERE closing": "a vessel that has left has a closing point",
    "DELETE FROM history WHERE cycle = 2 AND vessel_id = 2": "every vessel of the newest cycle has a point",
    "DELETE FROM member WHERE vessel_id = 1": "the members are those whose stay has not ended",
    "INSERT INTO event (run_id, vessel_id, kind, subject, from_cycle, start_s, latitude_deg, longitude_deg, evidence)"
    " VALUES (1, 99, 'dark', 0, 1, 0.0, 0.0, 0.0, '')": "a flag that lasts is of a vessel that is in the picture",
    "INSERT INTO event_gap (run_id, vessel_id, kind, subject, from_cycle, cycle, last_cycle, last_s)"
    " VALUES (1, 1, 'dark', 0, 0, 2, 0, 0.0)": "a gap of an event is between cycles of the event",
    "UPDATE checkpoint SET cycle = 9": "no checkpoint is newer",
    "DELETE FROM recording WHERE cycle = 1": "a recorded cycle has all of its vessels",
    "UPDATE recording SET vessels = 1 WHERE cycle = 1": "a recorded cycle has all of its vessels",
    "DROP INDEX presence_to": "schema: .*presence_to",
    "ALTER TABLE vessel ADD COLUMN more INTEGER": "schema: .*more",
}


def test_a_check_finds_what_is_wrong(url: str) -> None:
    """Each harm is done in a transaction that is taken back."""
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number in range(3):
            world.write(store, run, number, keep=world.KEEP.model_copy(update={"recording": True}))
        for harm, said in SPOILED.items():
            with store.engine.connect() as connection, connection.begin() as transaction:
                connection.execute(text(harm))
                found = "\n".join(migrate.problems(connection))
                assert re.search(said, found), f"{harm}: {found}"
                transaction.rollback()
    assert migrate.check(url) == []


def test_a_check_finds_what_only_sqlite_can_have(tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    with kept.open_store(str(path)) as store:
        run = world.begin(store)
        world.write(store, run, 0)
    with sqlite3.connect(path) as raw:
        raw.execute("INSERT INTO vessel_static (run_id, mmsi, updated_s) VALUES (99, 1, 0)")
        raw.commit()
        raw.execute("PRAGMA journal_mode = DELETE")
    assert migrate.check(str(path)) == [
        "foreign key: a row of vessel_static names a missing run",
        "journal_mode: got delete, needed wal",
    ]
