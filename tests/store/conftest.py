"""The same tests over SQLite and PostgreSQL: `url` is an empty database of each."""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

SERVERS = (
    os.environ.get("COASTWATCH_TEST_POSTGRESQL", ""),
    "postgresql://root@/test?host=/var/run/postgresql",
    "postgresql://postgres@/postgres?host=/var/run/postgresql",
    "postgresql://root@127.0.0.1:5432/test",
    "postgresql://postgres@127.0.0.1:5432/postgres",
)
"""Where a PostgreSQL may be that trusts us; the first that answers is used. Each test has a schema of its own there."""


@pytest.fixture(scope="session")
def postgresql() -> str:
    """The address of a PostgreSQL that answers."""
    psycopg = pytest.importorskip("psycopg", reason="psycopg is not installed")
    for server in filter(None, SERVERS):
        try:
            psycopg.connect(server, connect_timeout=2).close()
        except psycopg.OperationalError:
            continue
        return server
    pytest.skip("no PostgreSQL answers; COASTWATCH_TEST_POSTGRESQL may name one")


@contextmanager
def empty_schema(postgresql: str) -> Iterator[str]:
    """The address of an empty schema, dropped afterwards."""
    import psycopg

    name = f"coastwatch_{uuid.uuid4().hex}"
    with psycopg.connect(postgresql, autocommit=True) as server:
        server.execute(f"CREATE SCHEMA {name}")
        joint = "&" if "?" in postgresql else "?"
        options = f"options=-csearch_path%3D{name}%20-csynchronous_commit%3Doff"  # no test ends the database itself
        yield f"{postgresql.replace('postgresql://', 'postgresql+psycopg://')}{joint}{options}"
        server.execute(f"DROP SCHEMA {name} CASCADE")


@pytest.fixture
def postgresql_url(postgresql: str) -> Iterator[str]:
    """An empty schema of a test."""
    with empty_schema(postgresql) as address:
        yield address


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """An empty database: a file that is not there yet, or an empty schema."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'coastwatch.db'}"
    return str(request.getfixturevalue("postgresql_url"))


@pytest.fixture(scope="module", params=["sqlite", "postgresql"])
def shared_url(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """An empty database of each, for the tests of a module that fill it once and then only read."""
    if request.param == "sqlite":
        yield f"sqlite:///{tmp_path_factory.mktemp('shared') / 'coastwatch.db'}"
        return
    with empty_schema(request.getfixturevalue("postgresql")) as address:
        yield address
