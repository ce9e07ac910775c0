"""Every row of the table of kinds: its number, its name, and evidence that can be written."""

from __future__ import annotations

from pathlib import Path

import pytest

from coastwatch.alarms.events import FIELDS, KEYS, field_names
from coastwatch.batches import ALARM_KINDS, AlarmKind, Flag
from coastwatch.batches.kinds import DISTRESS, EVENT_KINDS, IS_ALARM, KINDS, NOTICE, PRIORITIES, Subject
from coastwatch.server.alarm_book import AlarmKey, id_of, key_of

pytestmark = pytest.mark.contract

CHECK_SQL = Path(__file__).parents[2] / "db" / "check.sql"
EVERY = [pytest.param(number, id=EVENT_KINDS[number]) for number in KINDS]


@pytest.mark.parametrize("number", EVERY)
def test_a_kind_has_all_columns(number: int) -> None:
    kind, name = KINDS[number], EVENT_KINDS[number]
    assert 0 <= number < KEYS, "a key of an event has no room for it"
    assert name == kind.name.lower()
    assert kind.text
    assert DISTRESS <= kind.priority <= NOTICE
    assert PRIORITIES[name] == kind.priority
    assert bool(IS_ALARM[number]) == kind.is_alarm == (name in ALARM_KINDS)


@pytest.mark.parametrize("number", EVERY)
def test_its_evidence_has_known_fields_only(number: int) -> None:
    names = field_names(KINDS[number].evidence)
    assert names
    assert set(names) <= set(FIELDS)


@pytest.mark.parametrize("number", EVERY)
def test_its_alarm_is_found_by_its_id(number: int) -> None:
    key = AlarmKey(7, EVENT_KINDS[number], 3, 1000.5)
    assert key_of(id_of(key)) == (key if KINDS[number].is_alarm else None)


@pytest.mark.parametrize("number", EVERY)
def test_the_page_knows_a_zone_by_the_name_of_the_kind(number: int) -> None:
    assert EVENT_KINDS[number].startswith(("zone_", "line_")) == (KINDS[number].subject == Subject.ZONE)


def test_numbers_are_once_and_those_of_alarms_above_every_flag() -> None:
    assert len(KINDS) == len(Flag) + len(AlarmKind)
    assert min(AlarmKind) > max(flag.number for flag in Flag)


def test_the_numbers_of_databases_and_checkpoints_stay() -> None:
    """A number here is in checkpoints and in the flags of every picture that was ever stored."""
    numbers = {flag.name: int(flag) for flag in Flag} | {kind.name: int(kind) for kind in AlarmKind}
    stored = {
        "DARK": 1, "AIS_WITHOUT_RADAR": 2, "AIS_CONTRADICTED": 4, "MMSI_TWICE": 8, "IMPOSSIBLE_SPEED": 16, "COASTING": 32,
        "ODD_MMSI": 64, "AIS_SART": 128, "MAN_OVERBOARD": 256, "EPIRB": 512, "NOT_UNDER_COMMAND": 1024, "AGROUND": 2048,
        "STATIONARY": 4096, "ZONE_ENTER": 32, "ZONE_LEAVE": 33, "ZONE_DWELL": 34, "ZONE_SPEED": 35, "LINE_CROSSED": 36,
        "CLOSE_APPROACH": 37, "ANCHOR_DRAG": 38, "LOST": 39, "AIS_SILENT": 40, "RADAR_SILENT": 41, "SOURCE_SILENT": 42,
    }  # fmt: skip
    assert {name: numbers.get(name) for name in stored} == stored


def test_the_check_of_a_database_knows_every_flag() -> None:
    assert {name for name in EVENT_KINDS.values() if f"'{name}'" in CHECK_SQL.read_text("utf-8")} == {
        str(flag.name).lower() for flag in Flag
    }
