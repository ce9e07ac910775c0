"""Create, upgrade and check the tables of a database, and write their SQL to db/schema. Migrations are in db/migrations."""

from __future__ import annotations

from typing import NamedTuple

from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.util import CommandError
from sqlalchemy import Connection, select, text
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.schema import CreateIndex, CreateTable, ExecutableDDLElement

from coastwatch.errors import StoreError
from coastwatch.shipped import folder, migrations_folder, schema_folder
from coastwatch.store.schema.database import WAIT_S, Store, connect, other_schema, reading, revision, writing
from coastwatch.store.schema.tables import DELETING, METADATA, REVISION, REVISION_TABLE, RUN

DIALECTS = {"sqlite": sqlite.dialect, "postgresql": postgresql.dialect}

for _table in METADATA.tables.values():
    for _index in _table.indexes:  # not said in `tables`: it would import the dialect of PostgreSQL for every reader of SQLite
        _index.dialect_options["postgresql"]["where"] = _index.dialect_options["sqlite"]["where"]


class Upgraded(NamedTuple):
    """What an upgrade found and made."""

    before: str | None  # schema; None: there were no tables
    after: str | None
    runs: int  # that the database holds now


def upgrade(url: str, to: str = "head", *, wait_s: float = WAIT_S) -> Upgraded:
    """Make the tables, or bring those of an older version to this one. What is stored is kept.

    Raises: StoreError where the database is another program's, of a newer version, locked or unreachable.
    """
    with connect(url, wait_s, may_create=True) as store:
        with reading(store) as connection:
            before = revision(connection, store.where)
        _migrate(store, to)
        with reading(store) as connection:
            runs = connection.scalar(text("SELECT count(*) FROM run"))
            return Upgraded(before, revision(connection, store.where), int(runs or 0))


def _migrate(store: Store, to: str) -> None:
    """Carry out the migrations up to this one, all in one transaction."""
    config = Config()
    config.set_main_option("script_location", str(migrations_folder()).replace("%", "%%"))
    with writing(store) as connection:
        stored = revision(connection, store.where)
        if stored is not None and stored > REVISION:
            raise StoreError(f"{store.where}: {other_schema(stored)}")
        config.attributes["connection"] = connection
        try:
            command.upgrade(config, to)
        except CommandError as error:
            raise StoreError(
                f"{store.where}: schema: got {stored}, needed one that this version can bring to {REVISION}"
            ) from error


def check(url: str, *, wait_s: float = WAIT_S) -> list[str]:
    """What is wrong with a database, one sentence each: schema, integrity, write-ahead log, whole cycles. Empty: nothing.

    Raises: StoreError where it is absent, unreachable or another program's.
    """
    with connect(url, wait_s, may_create=False) as store, reading(store) as connection:
        stored = revision(connection, store.where)
        if stored != REVISION:
            return [other_schema(stored)]
        return problems(connection)


def problems(connection: Connection) -> list[str]:
    """What is wrong with a database that is open and of this version, one sentence each."""
    sentences = differences(connection)
    if connection.dialect.name == "sqlite":
        lines = [row[0] for row in connection.execute(text("PRAGMA integrity_check"))]
        sentences += [f"integrity: {line}" for line in lines if line != "ok"]
        missing = connection.execute(text("PRAGMA foreign_key_check"))
        sentences += [f"foreign key: a row of {row[0]} names a missing {row[2]}" for row in missing]
        mode = connection.execute(text("PRAGMA journal_mode")).scalar_one()
        sentences += [] if mode in ("wal", "memory") else [f"journal_mode: got {mode}, needed wal"]
    halves = {str(number) for number in connection.scalars(select(RUN.c.id).where(RUN.c.status == DELETING))}
    for part in (folder("db") / "check.sql").read_text("utf-8").split("\n\n")[1:]:  # below the sentence that should hold
        sentence, _, sql = part.partition("\n")
        runs = sorted({str(row[0]) for row in connection.execute(text(sql))} - halves)
        if runs:
            sentences.append(f"whole cycles: not so in run {', '.join(runs)}: {sentence.removeprefix('-- ')}")
    return sentences


def differences(connection: Connection) -> list[str]:
    """How the tables of a database differ from `tables.py`."""

    def of_ours(name: str | None, kind: str, parents: object) -> bool:
        return kind != "table" or name in METADATA.tables

    options = {"compare_type": True, "version_table": REVISION_TABLE, "include_name": of_ours}
    context = MigrationContext.configure(connection, opts=options)
    sentences = [f"schema: {change}" for change in compare_metadata(context, METADATA)]
    if connection.dialect.name == "sqlite":
        listed = connection.execute(text("SELECT name, wr FROM pragma_table_list WHERE type = 'table'"))
        in_key_order = {row.name: bool(row.wr) for row in listed}
        for name, table in METADATA.tables.items():
            wanted = table.dialect_options["sqlite"]["with_rowid"] is False
            if in_key_order.get(name, wanted) is not wanted:
                sentences.append(f"schema: table {name}: got WITHOUT ROWID {in_key_order[name]}, needed {wanted}")
    return sentences


def schema(dialect: str) -> str:
    """The SQL that makes the tables of this version. Args: dialect: sqlite or postgresql."""
    sql_dialect = DIALECTS[dialect]()
    parts = [f"-- Generated from coastwatch/store/schema/tables.py, schema {REVISION}, by `make docs`.\n"]
    for table in METADATA.sorted_tables:
        statements: list[ExecutableDDLElement] = [
            CreateTable(table),
            *(CreateIndex(i) for i in sorted(table.indexes, key=lambda i: str(i.name))),
        ]
        parts += [f"{str(s.compile(dialect=sql_dialect)).strip()};\n" for s in statements]
    return "\n".join("\n".join(line.rstrip() for line in part.splitlines()) + "\n" for part in parts)


def write_schemas() -> None:
    """Write db/schema after a change of the tables."""
    for dialect in DIALECTS:
        (schema_folder() / f"{dialect}.sql").write_text(schema(dialect), "utf-8")


if __name__ == "__main__":
    write_schemas()
