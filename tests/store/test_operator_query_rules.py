"""How a question of db/operator is written and asked: what it must say, what is refused, and that it only reads."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import store_world as world
from sqlalchemy import text

from coastwatch import store as kept
from coastwatch.errors import StoreError
from coastwatch.shipped import operator_queries_folder
from coastwatch.store.read.questions import COMPUTED, limits
from coastwatch.store.schema.database import writing

pytestmark = pytest.mark.contract


@pytest.mark.parametrize(
    ("name", "parameters", "said"),
    [
        ("darkvessels", {}, "got 'darkvessels', needed one of ais_without_radar,"),
        ("fastest", {"counts": 3}, "got counts, needed --set with count, run; did you mean 'count'?"),
        ("fastest", {"count": "many"}, "parameter count: got 'many', needed a number"),
        ("fastest", {"count": 2.5}, "parameter count: got 2.5, needed a whole number"),
        ("fastest", {"run": 99}, "there is no run 99"),
        ("fastest", {"run": "last"}, "parameter run: got 'last', needed a number"),
        ("near_position", {"latitude_deg": 1.0}, "got no longitude_deg, needed --set with"),
        ("near_position", {"latitude_deg": "nan", "longitude_deg": 0}, "parameter latitude_deg: got 'nan'"),
        ("near_position", {"latitude_deg": -91, "longitude_deg": 0}, "parameter latitude_deg: got -91, needed -90 to 90"),
        ("near_position", {"latitude_deg": 0, "longitude_deg": "181"}, "longitude_deg: got '181', needed -180 to 180"),
        ("near_position", {"latitude_deg": 0, "longitude_deg": 0, "radius_nm": -2}, "radius_nm: got -2, needed 0 or more"),
        ("fastest", {"count": 10**20}, "parameter count: got 100000000000000000000, needed 0 to 2147483647"),
        ("fastest", {"min_sog_kn": -1}, "got min_sog_kn, needed --set with count, run"),
        ("dark_vessels", {"min_sog_kn": "-0.5"}, "parameter min_sog_kn: got '-0.5', needed 0 or more"),
        ("silent", {"seconds": -1.0}, "parameter seconds: got -1.0, needed 0 or more"),
        ("alarms", {"kind": "darc"}, "parameter kind: got 'darc', needed one of alarms, dark, ais_without_radar"),
        ("alarms", {"kind": "coasting"}, "parameter kind: got 'coasting', needed one of alarms, dark"),
        ("audit", {"run": 1}, "query audit: got run 1, needed none: its rows belong to no run"),
        ("alarms", {"from_s": -1.0}, "parameter from_s: got -1.0, needed 0 to 253402300800"),
        ("history_of_mmsi", {"mmsi": "71000000"}, "parameter mmsi: got '71000000', needed nine digits"),
        ("history_of_mmsi", {"mmsi": 7_100_000_020}, "parameter mmsi: got 7100000020, needed nine digits"),
    ],
)
def test_a_wrong_question_is_answered_with_what_is_needed(
    tmp_path: Path, name: str, parameters: dict[str, Any], said: str
) -> None:
    with kept.open_store(str(tmp_path / "x.db")) as store:
        world.write(store, world.begin(store), 0)
        with pytest.raises(StoreError, match=said):
            kept.operator_query(store, name, parameters)


def test_a_run_without_cycles_has_no_answers_and_no_errors(url: str) -> None:
    given = {"latitude_deg": 0.0, "longitude_deg": 0.0, "mmsi": 710_000_001}
    with kept.open_store(url) as store:
        run = world.begin(store)
        with pytest.raises(StoreError, match="holds nothing up to 2025-06-01T00:00:00Z, it has no cycle yet"):
            kept.picture(store, run, 1_748_736_000.0)
        for name, question in kept.operator_queries().items():
            required = {key: given[key] for key, parameter in question.parameters.items() if parameter.default is None}
            found = kept.operator_query(store, name, required)
            assert found.rows == [] or name == "sensor_coverage"


def test_questions_are_written_as_questions_are_written() -> None:
    questions = kept.operator_queries()
    assert len(questions) >= 10
    assert [name for name, question in questions.items() if not question.of_run] == ["audit"]
    assert len({question.title for question in questions.values()}) == len(questions)
    for name, question in questions.items():
        written = (operator_queries_folder() / f"{name}.sql").read_text("utf-8")
        assert written.startswith(f"-- {question.title}\n")
        assert question.explanation, f"{name} does not say what it returns"
        used = set(re.findall(r"(?<![:\w]):(\w+)", question.sql))
        assert used == (set() if name in COMPUTED else set(question.parameters) | ({"run"} if question.of_run else {"to_s"})), (
            name
        )
        assert max(map(len, written.splitlines())) <= 128, name
        assert all(parameter.meaning for parameter in question.parameters.values())
        assert all(key in ("mmsi", "kind") or limits(key)[1] < float("inf") for key in question.parameters), (
            f"{name}: no limits"
        )


def test_a_question_cannot_write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, url: str) -> None:
    (tmp_path / "wreck.sql").write_text("-- Wreck\n-- Deletes the picture.\nDELETE FROM vessel WHERE run_id = :run\n")
    (tmp_path / "fire.sql").write_text(
        "-- Fire\n-- Deletes all pictures.\n-- parameter: to_s = 9.0, until then\nDELETE FROM vessel WHERE run_id < :to_s\n"
    )
    monkeypatch.setattr("coastwatch.store.read.questions.operator_queries_folder", lambda: tmp_path)
    with kept.open_store(url) as store:
        run = world.begin(store)
        world.write(store, run, 0)
        for name in ("wreck", "fire"):
            with pytest.raises(StoreError):
                kept.operator_query(store, name)
        assert len(kept.picture(store, run).rows) == 28
        with writing(store) as connection:  # and the connection can write again
            assert connection.execute(text("DELETE FROM vessel")).rowcount == 28
