"""No question reads a large table from end to end: every statement of every public reading function is explained.

SQLite says how it looks up each table; PostgreSQL is told not to read any table in sequence where it can help it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import past_world
import pytest
import store_world as world
from past_world import BOXES
from sqlalchemy import Engine, event, text

from coastwatch import store as kept
from coastwatch.store import Store
from coastwatch.store.read.questions import Question
from coastwatch.store.schema.database import reading

pytestmark = pytest.mark.contract

CYCLES = 30
SPAN = world.instant_s(8), world.instant_s(20)

LARGE = ("history", "recording", "association", "bearing_association", "spot", "stage_timing")
"""Tables that grow with every cycle. Of each at least the cycle must be given beside the run."""

BY_CYCLE = r"SEARCH \w+ USING (COVERING INDEX \w+|INDEX sqlite_autoindex_recording_1|PRIMARY KEY) \(run_id=\? AND cycle[=<>]"

ASKED: dict[str, Callable[[Store, int], Any]] = {
    "picture now": lambda s, run: kept.picture(s, run),
    "box now": lambda s, run: kept.picture(s, run, bbox=BOXES[0]),
    "picture then": lambda s, run: kept.picture(s, run, SPAN[0]),
    "box then": lambda s, run: kept.picture(s, run, SPAN[0], BOXES[0]),
    "replay": lambda s, run: list(kept.replay(s, run, *SPAN)),
    "replay of a box": lambda s, run: list(kept.replay(s, run, *SPAN, bbox=BOXES[0])),
    "traffic": lambda s, run: kept.traffic(s, run, BOXES[0], *SPAN),
    "encounters": lambda s, run: kept.encounters(s, run, BOXES[0], *SPAN, within_m=2000.0, min_sog_kn=0.0),
    "history of a vessel": lambda s, run: kept.history(s, run, vessel_id=5),
    "history of a span": lambda s, run: kept.history(s, run, *SPAN),
    "track": lambda s, run: kept.track(s, run, 5),
    "track of one that left": lambda s, run: kept.track(s, run, _left(s)),
    "sensors": lambda s, run: kept.sensor_states(s, run),
    **{
        f"question {name}": lambda s, run, name=name, q=q: kept.operator_query(s, name, _parameters(q))
        for name, q in kept.operator_queries().items()
        if name != "load"  # it is of the timings of the newest cycles, and says so
    },
}


def _parameters(question: Question) -> dict[str, Any]:
    known = {"mmsi": 710_000_001, "latitude_deg": -22.9, "longitude_deg": -43.2}
    return {name: known[name] for name, parameter in question.parameters.items() if parameter.default is None}


def _left(store: Store) -> int:
    with reading(store) as connection:
        gone = text("SELECT min(vessel_id) FROM presence p WHERE to_cycle IS NOT NULL AND NOT EXISTS"
                    " (SELECT 1 FROM vessel v WHERE v.vessel_id = p.vessel_id)")  # fmt: skip
        return int(connection.execute(gone).scalar_one())


@contextmanager
def written(url: str) -> Iterator[tuple[Store, int]]:
    """A store with a recorded run of the sea with a past, and the number of the run."""
    with kept.open_store(url) as store:
        run = world.begin(store)
        keep = past_world.KEEP.model_copy(update={"recording": True})
        past_world.write(store, run, past_world.pictures(9, CYCLES), keep=keep)
        if store.engine.dialect.name == "postgresql":
            with store.engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
                connection.execute(text("ANALYZE"))
        yield store, run


@pytest.fixture(scope="module")
def filled(shared_url: str) -> Iterator[tuple[Store, int]]:
    with written(shared_url) as made:
        yield made


@pytest.fixture
def sqlite(filled: tuple[Store, int]) -> tuple[Store, int]:
    if filled[0].engine.dialect.name != "sqlite":
        pytest.skip("the test reads SQLite's query plan")
    return filled


@contextmanager
def said(engine: Engine) -> Iterator[list[tuple[str, Any]]]:
    """Every SELECT that is carried out meanwhile, with its parameters."""
    out: list[tuple[str, Any]] = []

    def note(connection: Any, cursor: Any, statement: str, parameters: Any, *unused: Any) -> None:
        if statement.lstrip().upper().startswith(("SELECT", "WITH", "--")):
            out.append((statement, parameters))

    event.listen(engine, "before_cursor_execute", note)
    try:
        yield out
    finally:
        event.remove(engine, "before_cursor_execute", note)


def plans(store: Store, statements: list[tuple[str, Any]]) -> Iterator[tuple[str, str]]:
    """Each statement and the text of its plan."""
    sqlite = store.engine.dialect.name == "sqlite"
    with store.engine.connect() as connection:
        if not sqlite:
            connection.exec_driver_sql("SET enable_seqscan = off")
        for statement, parameters in statements:
            verb = "EXPLAIN QUERY PLAN " if sqlite else "EXPLAIN "
            rows = connection.exec_driver_sql(verb + statement, parameters).all()
            yield statement, "\n".join(str(row[-1]) for row in rows)


def test_no_large_table_is_read_from_end_to_end(filled: tuple[Store, int]) -> None:
    store, run = filled
    for name, ask in ASKED.items():
        with said(store.engine) as statements:
            ask(store, run)
        assert statements, name
        for statement, plan in plans(store, statements):
            for table in LARGE:
                if re.search(rf"\b{table}\b", statement):
                    _by_cycle(table, statement, plan, store.engine.dialect.name)


def _by_cycle(table: str, statement: str, plan: str, dialect: str) -> None:
    """The table is looked up by its key, as far as the cycle at least."""
    if dialect == "postgresql":
        assert f"Seq Scan on {table} " not in plan, f"{statement}\n{plan}"
        return
    alias = {
        m[1] or m[0] for m in re.findall(rf"\b({table})\b(?: AS)?(?: (?!WHERE|CROSS|JOIN|ON|LEFT|ORDER)(\w+))?", statement)
    }
    steps = [
        line for line in plan.splitlines() if re.match(r"(SCAN|SEARCH) (\w+)", line) and line.split()[1] in {table, *alias}
    ]
    assert steps, f"{statement}\n{plan}"
    for step in steps:
        assert re.search(
            r"SEARCH \w+ USING (COVERING INDEX \w+|INDEX sqlite_autoindex_recording_1|PRIMARY KEY) \(run_id=\? AND cycle[=<>]",
            step,
        ), f"{statement}\n{plan}"


def test_one_vessel_is_found_by_its_whole_key(sqlite: tuple[Store, int]) -> None:
    store, run = sqlite
    with said(store.engine) as statements:
        kept.history(store, run, vessel_id=5)
    of_history = [plan for statement, plan in plans(store, statements) if "history" in statement and "vessel_id" in statement]
    assert len(of_history) == 2  # the chain, and the rows
    assert all("(run_id=? AND cycle=? AND vessel_id=?)" in plan for plan in of_history)
    assert all("SCAN history" not in plan and "SCAN h" not in plan for plan in of_history)


FOUND_BY = {
    "box now": {"vessel_static": "(run_id=? AND mmsi=?)"},
    "box then": {"member_history": "(run_id=? AND vessel_id=?"},
    "question history_of_mmsi": {"identity": "(run_id=? AND mmsi=?)", "presence": "(run_id=? AND vessel_id=?)"},
    "question source_changes": {"member_history": "_cycle=?)", "presence": "(run_id=? AND vessel_id=? AND from_cycle<?)"},
    "question new_vessels": {"presence": "from_cycle=?)"},
    "question lost_vessels": {"presence": "_cycle"},
}
"""By what tables that hold all vessels of a run are looked up."""


def test_no_table_of_vessels_is_read_from_end_to_end(sqlite: tuple[Store, int]) -> None:
    store, run = sqlite
    for name, tables in FOUND_BY.items():
        with said(store.engine) as statements:
            ASKED[name](store, run)
        looked = set()
        for statement, plan in plans(store, statements):
            for table, by in tables.items():
                steps = _steps(table, statement, plan)
                assert all(line.startswith("SEARCH") and by in line for line in steps), f"{name}\n{statement}\n{plan}"
                looked |= {table} if steps else set()
        assert looked == set(tables), name


def _steps(table: str, statement: str, plan: str) -> list[str]:
    """How each use of a table in a statement looks it up."""
    out = []
    for alias in set(re.findall(rf"(?:FROM|JOIN) {table}\b(?: (?!WHERE|CROSS|LEFT|ON|AS)(\w+))?", statement)):
        steps = [line for line in plan.splitlines() if re.match(rf"(SCAN|SEARCH) {alias or table}\b", line)]
        assert steps, f"{statement}\n{plan}"
        out += steps
    return out


def test_a_box_of_the_past_is_found_by_its_index(tmp_path: Path) -> None:
    with written(str(tmp_path / "x.db")) as (store, run):
        with store.engine.begin() as connection:
            connection.exec_driver_sql("UPDATE cycle SET recorded = 0")  # else a box then is of the recording
        _found_by_the_index(store, run)


def _found_by_the_index(store: Store, run: int) -> None:
    for name in ("box then", "traffic", "encounters"):
        with said(store.engine) as statements:
            ASKED[name](store, run)
        (plan,) = [plan for statement, plan in plans(store, statements) if "history near" in statement]
        assert (
            "SEARCH near USING COVERING INDEX history_box (run_id=? AND cycle=? AND latitude_deg>? AND latitude_deg<?)" in plan
        )
        assert "SEARCH h USING PRIMARY KEY (run_id=? AND cycle=? AND vessel_id=?)" in plan
