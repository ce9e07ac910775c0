"""AIS falls silent in a run: the alarm of it is stored, kept in the book of alarms, and answered with its evidence."""

from __future__ import annotations

from pathlib import Path

import pytest
from run_world import SEED, url

from coastwatch import store
from coastwatch.centre import Cycle
from coastwatch.scenario import load_scenario
from coastwatch.server.alarm_book import AlarmBook, key_of
from coastwatch.server.run import run_scenario
from coastwatch.store import Asked, open_store, operator_query

pytestmark = pytest.mark.contract

SETTINGS = {"input.count": "60", "cycles": "40", "input.ais.silent_share": "1.0", "input.ais.silent_from_s": "60"}


def test_the_alarm_is_stored_asked_for_and_in_the_book(tmp_path: Path) -> None:
    """All transponders are switched off after 60 s of 180 s: that is a receiver, not a fleet of dark vessels."""
    book = AlarmBook()
    book.begin(1)

    def take(cycle: Cycle) -> None:
        book.apply(cycle.events)

    made = run_scenario(
        load_scenario("guanabara", SETTINGS), seed=SEED, database=url(tmp_path / "silent.db"), workers=1, on_cycle=take
    )
    with open_store(made.database) as opened:
        answer = operator_query(opened, "alarms", {"run": made.run_id, "kind": "ais_silent"})
        first, _ = store.alarms(opened, made.run_id, Asked(state="unacknowledged"))
    (row,) = (dict(zip(answer.columns, found, strict=True)) for found in answer.rows)
    assert (row["vessel_id"], row["subject"], row["mmsi"], row["end_s"]) == (0, 0, None, None)
    assert row["evidence"].startswith("AIS station corcovado is silent: no AIS report for 3")
    assert first.rows[0][first.columns.index("kind")] == "ais_silent", "before the alarms of vessels"
    alarm = next(alarm for alarm in book.alarms() if alarm.kind == "ais_silent")
    assert (alarm.vessel_id, alarm.evidence, alarm.lasts) == (0, row["evidence"], True)
    key = key_of(alarm.alarm_id)
    assert key is not None
    assert key[:3] == (0, "ais_silent", 0)
