"""With which run of a database a new one goes on: what may differ, and what is said where none will do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text

from coastwatch import store
from coastwatch.batches.plain_data import FORMER_NAMES, TreeError, from_tree
from coastwatch.scenario import load_scenario
from coastwatch.scenario.model import Scenario
from coastwatch.server.checkpoint import classes
from coastwatch.server.resuming import former_run
from coastwatch.server.run import run_scenario, version
from coastwatch.store.schema.database import Store, as_json, writing

pytestmark = pytest.mark.contract

SEED = 3


def sea(**changes: str) -> Scenario:
    small = {"cycles": "4", "input.count": "20", "store.checkpoint_every": "2"}
    return load_scenario("hem-figure-2", small | {key.replace("__", "."): value for key, value in changes.items()})


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A database with a run that failed after its checkpoint of the second cycle."""
    url = f"sqlite:///{tmp_path_factory.mktemp('runs') / 'x.db'}"

    def fails(cycle: Any) -> None:
        if cycle.time_s >= third_s:
            raise RuntimeError("mast down")

    times: list[float] = []
    run_scenario(sea(cycles="3"), seed=SEED + 1, database="sqlite://", on_cycle=lambda cycle: times.append(cycle.time_s))
    third_s = times[2]
    with pytest.raises(RuntimeError):
        run_scenario(sea(), seed=SEED, database=url, on_cycle=fails)
    return url


@pytest.fixture
def opened(stopped: str, tmp_path: Path) -> Any:
    copy = tmp_path / "copy.db"
    copy.write_bytes(Path(stopped.removeprefix("sqlite:///")).read_bytes())
    with store.open_store(f"sqlite:///{copy}", create=False) as kept:
        yield kept


def change(kept: Store, assignment: str, **values: object) -> None:
    with writing(kept) as connection:
        connection.execute(text(f"UPDATE run SET {assignment}").bindparams(**values))


@pytest.mark.parametrize("live", [False, True])
def test_what_is_stored_and_how_the_work_is_shared_may_change(opened: Store, live: bool) -> None:
    scenario = sea(store__history_hours="720", store__recording="true", workers__method="threads", title="The sea")
    before, why = former_run(opened, scenario, SEED, version(), live=live)
    assert before is not None
    assert (before.run_id, before.cycle, before.point.cycle, before.said, why) == (1, 1, 2, None, None)


@pytest.mark.parametrize("live", [False, True])
def test_what_shapes_the_memory_may_not(opened: Store, live: bool) -> None:
    found = former_run(opened, sea(spots__count="2", store__event_gap_s="30"), SEED, version(), live=live)
    assert found == (None, "run 1 had other settings: spots.count, store.event_gap_s")
    assert former_run(opened, sea(), SEED + 1, version(), live=live) == (None, None)


def test_a_live_run_goes_on_under_another_version_and_says_so(opened: Store) -> None:
    change(opened, "version = '0.0.9'")
    before, why = former_run(opened, sea(), SEED, version(), live=True)
    assert before is not None
    assert why is None
    assert before.said == f"run 1 goes on: it was of version 0.0.9, this is {version()}"
    assert former_run(opened, sea(), SEED, version(), live=False) == (None, f"run 1 is of version 0.0.9, this is {version()}")


def test_a_memory_that_another_version_cannot_read_begins_a_new_run(opened: Store) -> None:
    change(opened, "version = '0.0.9'")
    with writing(opened) as connection:
        connection.execute(text("UPDATE checkpoint SET memory = :memory").bindparams(memory=b"of another format"))
    before, why = former_run(opened, sea(), SEED, version(), live=True)
    assert before is None
    assert why is not None
    assert why.startswith(f"run 1 is of version 0.0.9, this is {version()}: ")


def test_a_setting_that_the_former_version_had_not_counts_as_its_default(opened: Store) -> None:
    settings = store.run(opened, 1)["settings"]
    without = {name: value for name, value in settings.items() if name != "registration"}
    change(opened, "settings = :settings", settings=as_json(without))
    assert former_run(opened, sea(), SEED, version(), live=True)[0] is not None
    change(opened, "settings = :settings", settings=as_json({**settings, "propeller": 3}))
    assert former_run(opened, sea(), SEED, version(), live=True) == (None, "run 1 had other settings: propeller")


def test_a_class_of_a_checkpoint_that_is_renamed_is_still_known_by_its_former_name() -> None:
    """The file has every class that a checkpoint of any version named. A new one is a line more; none goes."""
    known = set(Path(__file__).with_name("classes_of_checkpoints.txt").read_text("utf-8").split())
    now = {f"{kind.__module__}.{kind.__qualname__}" for kind in classes()}
    assert now <= known
    assert {FORMER_NAMES.get(name, name) for name in known} == now


def test_a_checkpoint_with_a_former_name_is_read() -> None:
    (former, name), *_ = FORMER_NAMES.items()
    (kind,) = (one for one in classes() if f"{one.__module__}.{one.__qualname__}" == name)
    tree = {"class": former, "fields": {}}
    with pytest.raises(TreeError, match=f"{former}: got the fields , needed "):
        from_tree(tree, [], frozenset([kind]))
