"""Small runs into a database of SQLite, and what it then holds, for tests of what is promised of a run."""

from __future__ import annotations

import sqlite3
import subprocess
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from coastwatch.scenario import Scenario, load_scenario
from coastwatch.server.run import RunResult, run_scenario

SEED = 2001
STATE = (
    "vessel",
    "history",
    "member",
    "member_history",
    "presence",
    "association",
    "bearing_association",
    "bearing_track",
    "spot",
    "sensor_registration",
    "event",
    "identity",
)


Start = Callable[..., "subprocess.Popen[str]"]
"""Starts the command line with some arguments in a process of its own."""


@dataclass(frozen=True)
class FinishedRun:
    """A finished run of guanabara: URL of its database, what the command printed, its tracks as CSV."""

    url: str
    printed: dict[str, Any]
    tracks_csv: Path


def rows(path: Path, run_id: int | None = None, tables: tuple[str, ...] = STATE) -> dict[str, list[tuple[Any, ...]]]:
    """What a run (the newest) says of the sea, to the bit, with the number of the run left out."""
    with closing(sqlite3.connect(path)) as raw:
        (newest,) = raw.execute("SELECT max(id) FROM run").fetchone()
        asked = ((t, raw.execute(f"SELECT * FROM {t} WHERE run_id = ?", (run_id or newest,)).fetchall()) for t in tables)
        return {table: sorted((row[1:] for row in found), key=repr) for table, found in asked}


def column(path: Path, query: str) -> list[Any]:
    with closing(sqlite3.connect(path)) as raw:
        return [row[0] for row in raw.execute(query)]


def url(path: Path) -> str:
    return f"sqlite:///{path}"


def small(**settings: str) -> Scenario:
    """context-driven-100 for 10 cycles, in three spots so that there is something to spread."""
    given = {"cycles": "10", "warmup_s": "0.0", "spots.count": "3"}
    return load_scenario("context-driven-100", given | {k.replace("__", "."): v for k, v in settings.items()})


def run(path: Path, scenario: Scenario, **given: Any) -> RunResult:
    return run_scenario(scenario, seed=SEED, database=url(path), **given)


def stored(path: Path) -> int:
    """Cycles stored; 0 while there is no database."""
    try:
        return int(column(path, "SELECT count(*) FROM cycle")[0])
    except sqlite3.OperationalError:
        return 0
