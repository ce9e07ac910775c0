"""A reader that polls never holds up the writer, and reads whole cycles (test_retention has one that does not let go)."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import past_world
import pytest
import store_world as world

from coastwatch import store as kept
from coastwatch.store.schema.migrate import check

pytestmark = pytest.mark.contract

IMPATIENT_S = 0.02
"""How long the writer waits for a lock: not as long as a reader's transaction lasts, so that a reader that held one would be an error."""


def test_a_polling_reader_does_not_hold_up_the_writer(tmp_path: Path) -> None:
    path = tmp_path / "x.db"
    made = past_world.pictures(11, 40, 400)
    with kept.open_store(str(path), wait_s=IMPATIENT_S) as store:
        run = world.begin(store)
        past_world.write(store, run, made[:1])
        command = [sys.executable, str(Path(__file__).parents[1] / "worlds" / "polling_reader.py"), str(path)]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as reader:
            assert reader.stdout is not None
            assert reader.stdout.readline() == "ready\n"
            for number, picture in enumerate(made[1:], 1):
                cycle = world.cycle_of(number, 0, picture)
                world.write_and_say(store, run, number, cycle=cycle, keep=past_world.KEEP)
                time.sleep(0.01)
            said, _ = reader.communicate()
        told = json.loads(said.splitlines()[-1])
    assert told["torn"] == 0
    assert told["looks"] >= 5
    assert told["cycles"] >= 3
    assert check(str(path)) == []
