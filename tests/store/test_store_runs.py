"""Runs: they are listed, their cycles come in order, one resumed equals one that never stopped, and discarded ones leave nothing."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import store_world as world
from sqlalchemy import select, text, update

from coastwatch import store as kept
from coastwatch.errors import InputError, StoreError
from coastwatch.store import Store
from coastwatch.store.schema.database import reading, writing
from coastwatch.store.schema.migrate import check
from coastwatch.store.schema.tables import METADATA, RUN, STAGE_TIMING

pytestmark = pytest.mark.contract


def everything(store: Store) -> dict[str, list[str]]:
    """All rows of all tables but the run itself, sorted."""
    tables = {name: table for name, table in METADATA.tables.items() if name != "run"}
    with reading(store) as connection:
        return {name: sorted(map(repr, map(tuple, connection.execute(table.select())))) for name, table in tables.items()}


def test_runs(url: str) -> None:
    with kept.open_store(url) as store:
        with pytest.raises(StoreError, match="holds no run"):
            kept.latest_run(store)
        one = world.begin(store, "sea", settings={"a": [1, float("nan")], "b": np.float64(2.0)})
        two = world.begin(store, "lake", 7)
        assert (kept.latest_run(store), kept.latest_run(store, "sea")) == (two, one)
        world.write(store, one, 0)
        kept.finish_run(store, one, "finished", {"f1": 0.5, "mcc": float("nan")})
        stored = kept.run(store, one)
        assert (stored["status"], stored["scores"], stored["settings"]) == (
            "finished", {"f1": 0.5, "mcc": None}, {"a": [1, None], "b": 2.0}
        )  # fmt: skip
        assert stored["started_utc"] <= stored["finished_utc"] < "2200"
        assert stored["finished_utc"].endswith("Z")
        listed = kept.runs(store)
        assert listed.column("id") == [two, one]
        assert listed.column("cycles_stored") == [0, 1]
        with pytest.raises(ValueError, match="status: got 'done'"):
            kept.finish_run(store, one, "done")
        with pytest.raises(StoreError, match="no run of pond"):
            kept.latest_run(store, "pond")
        found = kept.sensors(store, one)
        assert [row[:3] for row in found.rows] == [
            ("ais", 0, "hill"), ("bearing", 0, "mouth"), ("radar", 0, "fort"), ("radar", 1, "island")
        ]  # fmt: skip
        assert found.rows[1][-1]["arc_from_deg"] == 90.0
        assert found.column("region") == [None, None, "guanabara", "ilha"]
        assert kept.sources(store, one).column("kind") == ["radar", "radar", "ais", "bearing"]


def test_timings(url: str) -> None:
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number in range(4):
            world.write(store, run, number)
        with reading(store) as connection:
            query = select(STAGE_TIMING.c.stage, STAGE_TIMING.c.seconds, STAGE_TIMING.c.rows)
            found = connection.execute(query.order_by(STAGE_TIMING.c.cycle, STAGE_TIMING.c.number)).all()
        assert [row.stage for row in found] == list(world.SECONDS) * 4
        assert [row.seconds for row in found] == pytest.approx(list(world.SECONDS.values()) * 4)
        present = [world.present(number, 30).sum() for number in range(4)]
        assert [row.rows for row in found[1 :: len(world.SECONDS)]] == present


def test_cycles_come_in_order(url: str) -> None:
    with kept.open_store(url) as store:
        run = world.begin(store)
        world.write(store, run, 0)
        with pytest.raises(StoreError, match="got cycle 2, needed 1"):
            world.write(store, run, 2)
        with pytest.raises(StoreError, match="no run 99"):
            world.write(store, 99, 0)
        world.write(store, run, 1)
    assert check(url) == []


@pytest.fixture(scope="module")
def straight() -> dict[str, dict[str, list[str]]]:
    """The rows of a run that never stopped, by the kind of database; the first test of a kind writes them."""
    return {}


@pytest.mark.parametrize("again_from", [0, 4, 9, 10])
def test_a_run_that_goes_on_from_a_checkpoint_ends_as_one_that_never_stopped(
    url: str, again_from: int, straight: dict[str, dict[str, list[str]]]
) -> None:
    kind = url.partition(":")[0]
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number in range(10):
            world.write(store, run, number, checkpoint=b"x" * 100_000 if number == again_from - 1 else None)
        kept.finish_run(store, run, "interrupted")
    with kept.open_store(url) as store:
        found = [(one.run_id, one.cycle) for one in kept.unfinished_runs(store, "sea", 1)]
        assert found == ([(run, again_from - 1)] if again_from else [])
        assert not again_from or kept.read_checkpoint(store, run) == b"x" * 100_000
        for number in range(again_from, 14):
            world.write(store, run, number)
            assert number > again_from or check(url) == []
        assert kept.run(store, run)["status"] == "running"
        resumed = everything(store)
        kept.discard_runs(store, "sea")
        assert all(rows == [] for rows in everything(store).values())
        again = world.begin(store)
        assert again == run + 1
        if kind not in straight:
            for number in range(14):
                world.write(store, again, number)
            found = everything(store)
            straight[kind] = {name: [row.replace(f"({again},", f"({run},", 1) for row in rows] for name, rows in found.items()}
    assert {name: len(rows) for name, rows in resumed.items()} == {name: len(rows) for name, rows in straight[kind].items()}
    assert resumed == straight[kind]


def test_a_checkpoint_larger_than_a_piece_comes_back_whole(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(import_module("coastwatch.store.write.write_cycle"), "PIECE_BYTES", 1000)
    memory = np.random.default_rng(1).bytes(3500)
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number, said in enumerate((memory, memory[:1000], b"", memory[::-1])):
            world.write(store, run, number, checkpoint=said)
            assert kept.unfinished_runs(store, "sea", 1)[0].cycle == number
            assert kept.read_checkpoint(store, run) == said
        with reading(store) as connection:
            assert connection.execute(text("SELECT count(*) FROM checkpoint")).scalar_one() == 4
    assert check(url) == []


def test_unfinished_runs_are_those_of_a_scenario_and_seed_with_a_checkpoint(url: str) -> None:
    with kept.open_store(url) as store:
        run = world.begin(store)
        assert kept.unfinished_runs(store, "sea", 1) == []
        world.write(store, run, 0)
        (found,) = kept.unfinished_runs(store, "sea", 1)
        assert found == (run, "0.1.0", {"period_s": world.PERIOD_S}, 0)
        assert kept.read_checkpoint(store, run) == b"memory 0"
        assert kept.unfinished_runs(store, "sea", 2) == kept.unfinished_runs(store, "lake", 1) == []
        later = world.begin(store)
        world.write(store, later, 0)
        assert [one.run_id for one in kept.unfinished_runs(store, "sea", 1)] == [later, run]
        kept.finish_run(store, later, "finished")
        kept.finish_run(store, run, "finished")
        assert kept.unfinished_runs(store, "sea", 1) == []


def test_discarded_runs_leave_nothing_and_others_stay(url: str) -> None:
    with kept.open_store(url) as store:
        one, two, other = world.begin(store, seed=1), world.begin(store, seed=2), world.begin(store, "lake")
        for run in (one, two, other):
            world.write(store, run, 0)
        assert kept.discard_runs(store, "sea", 1) == [one]
        assert kept.runs(store).column("id") == [other, two]
        assert kept.discard_runs(store, "sea") == [two]
        assert len(kept.picture(store, other).rows) == len(world.picture_of(0, 30))
    assert check(url) == []


PROCESS = (
    "import json; from coastwatch.store.processes import this_process; print(json.dumps(this_process()), flush=True); input()"
)


@contextmanager
def another_process() -> Iterator[tuple[subprocess.Popen[str], dict[str, Any]]]:
    """A process that does nothing, and how a run says that it writes it."""
    line = [sys.executable, "-c", PROCESS]
    with subprocess.Popen(line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as made:
        assert made.stdout
        machine, process = json.loads(made.stdout.readline())
        yield made, {"machine": machine, "process": process}
        made.kill()


ENDS_LOCK = """
    SELECT pg_terminate_backend(pid) FROM pg_locks
    WHERE locktype = 'advisory' AND objid::bigint = hashtext(current_schema())::bigint & 4294967295
"""  # of this schema alone: other tests use the same database


def test_one_server_holds_a_database_of_postgresql_until_its_connection_ends(
    postgresql_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A connection knows no machines: two of one process are as two of different ones."""
    monkeypatch.setattr(import_module("coastwatch.store.runs"), "FREED_S", 0.3)
    with kept.open_store(postgresql_url) as first, kept.open_store(postgresql_url) as second:
        for _ in range(2):
            with kept.sole_server(first):
                with (
                    pytest.raises(InputError, match="where another server is writing, needed another database"),
                    kept.sole_server(second),
                ):
                    pass
                world.begin(first, by_server=True)
            with kept.sole_server(second):
                pass
        with kept.sole_server(first):
            with writing(second) as connection:
                connection.execute(text(ENDS_LOCK))
            with kept.sole_server(second):  # as after a restart of the database
                pass


def test_a_second_writer_is_refused_while_the_process_of_the_first_lives(url: str) -> None:
    with kept.open_store(url) as store, another_process() as (made, writer):

        def says_of(number: int, **values: Any) -> None:
            with writing(store) as connection:
                connection.execute(update(RUN).where(RUN.c.id == number).values(values))

        def says(**values: Any) -> None:
            says_of(run, **values)

        job = world.begin(store)  # no server
        says_of(job, **writer)
        run = world.begin(store, by_server=True)
        kept.refuse_second_writer(store)  # this process is the writer
        says(**writer)
        said = f"where a server, process {made.pid}, is writing run {run}, needed another database, or the end of that process"
        with pytest.raises(InputError, match=said):
            kept.refuse_second_writer(store)
        with pytest.raises(InputError, match=said):
            kept.resume_run(store, run, title="", version="0.1.0", settings={}, by_server=True)
        with pytest.raises(InputError, match=said):
            world.begin(store, by_server=True)
        assert sorted(kept.runs(store).column("id")) == [job, run]
        says(status="interrupted")
        kept.refuse_second_writer(store)
        says(status="running", machine="another")
        kept.refuse_second_writer(store)  # it cannot be asked
        says(**writer)
        made.kill()
        stat = Path(f"/proc/{made.pid}/stat")
        while stat.exists() and ") Z " not in stat.read_text():  # nobody has asked how it ended
            time.sleep(0.01)
        kept.resume_run(store, run, title="", version="0.1.0", settings={}, by_server=True)
