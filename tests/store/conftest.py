"""The same tests over SQLite and PostgreSQL: `url` is an empty database of each."""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterator
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


@pytest.fixture
def postgresql_url(postgresql: str) -> Iterator[str]:
    """An empty schema, dropped afterwards."""
    import psycopg

    name = f"coastwatch_{uuid.uuid4().hex}"
    with psycopg.connect(postgresql, autocommit=True) as server:
        server.execute(f"CREATE SCHEMA {name}")
        joint = "&" if "?" in postgresql else "?"
        options = f"options=-csearch_path%3D{name}%20-csynchronous_commit%3Doff"  # no test ends the database itself
        yield f"{postgresql.replace('postgresql://', 'postgresql+psycopg://')}{joint}{options}"
        server.execute(f"DROP SCHEMA {name} CASCADE")


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """An empty database: a file that is not there yet, or an empty schema."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'coastwatch.db'}"
    return str(request.getfixturevalue("postgresql_url"))
