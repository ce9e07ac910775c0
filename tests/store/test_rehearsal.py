"""Nothing is compiled, or fetched from the cache of what was compiled, while a process holds the write lock of a database."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import store_world as world

from coastwatch import store as kept
from coastwatch.store import StoreError, rehearsal
from coastwatch.store.opening import Store

PROGRAM = """
import json, sqlite3, sys
import store_world as world
from numba.core import event
from coastwatch.scenario import StoreSettings
from coastwatch.store import open_store

path, seen = sys.argv[1], []

class Watch(event.Listener):
    def on_start(self, what):
        other = sqlite3.connect(path, timeout=0.0, isolation_level=None)
        try:
            other.execute("BEGIN IMMEDIATE")
            seen.append("free")
        except sqlite3.OperationalError as error:
            seen.append(str(error))
        other.close()

    def on_end(self, what):
        pass

event.register("numba:compiler_lock", Watch())
keep = StoreSettings(recording=True, history_max_s=0.0)
with open_store(path) as store:
    run = world.begin(store)
    for number, vessels in enumerate((30, 30, 20_000, 20_000, 19_000, 18_000, 18_000, 18_000)):
        world.write(store, run, number, vessels=vessels, keep=keep)
    blocks = store.newest[run].tail.from_cycle
print(json.dumps([seen, blocks]))
"""


def test_no_code_is_compiled_or_loaded_under_the_write_lock(tmp_path: Path) -> None:
    command = [sys.executable, "-c", PROGRAM, str(tmp_path / "x.db")]
    where = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": where})
    assert done.returncode == 0, done.stderr
    seen, blocks = json.loads(done.stdout)
    assert blocks > 0
    assert len(seen) > 15
    assert set(seen) == {"free"}


@pytest.fixture
def anew(monkeypatch: pytest.MonkeyPatch) -> list[Store]:
    """As in a process that has written nothing; the databases that cycles are rehearsed in."""
    memories: list[Store] = []
    plain = rehearsal.connect

    def seen(*asked: object, **more: object) -> Store:
        memories.append(plain(*asked, **more))
        return memories[-1]

    monkeypatch.setattr(rehearsal, "connect", seen)
    monkeypatch.setattr(rehearsal, "_done", set())
    return memories


def test_a_process_rehearses_once_for_few_and_once_for_many_rows(tmp_path: Path, anew: list[Store]) -> None:
    for name in ("x.db", "y.db"):
        with kept.open_store(str(tmp_path / name)) as store:
            run = world.begin(store)
            for number, vessels in enumerate((0, 5, 2500, 2500)):
                world.write(store, run, number, vessels=vessels)
            assert np.array_equal(kept.picture(store, run).array("vessel_id"), world.picture_of(3, 2500).vessel_id)
    with kept.open_store("sqlite://") as store:
        world.write(store, world.begin(store), 0, vessels=5)
    assert len(anew) == 2


def test_what_is_wrong_is_said_of_the_database_that_was_asked_for(tmp_path: Path, anew: list[Store]) -> None:
    path = str(tmp_path / "x.db")
    with kept.open_store(path) as store, pytest.raises(StoreError, match=f"{path}: there is no run 7"):
        world.write(store, 7, 0)
    assert len(anew) == 1
