"""What REFERENCE.md, and PAPERS.md of the methods of papers, say of commands, settings, methods and questions."""

import re
from functools import cache
from pathlib import Path

import pytest

from coastwatch.operators import presentation, reference, settings
from coastwatch.operators.cli.parser import make_parsers
from coastwatch.scenario import Scenario, scenario_names

HOUSE = Path(__file__).parents[2]
AREA = {"latitude_deg": 55.0, "longitude_deg": 12.0, "width_nm": 20.0, "height_nm": 20.0}
WRITTEN, PAPERS = reference.FILE.read_text("utf-8"), reference.PAPERS.read_text("utf-8")


@cache
def tables() -> list[settings.Table]:
    return list(settings.tables(Scenario))


def test_the_file_is_current() -> None:
    assert reference.text() == WRITTEN, "run `make docs`"
    assert reference.papers() == PAPERS, "run `make docs`"


def test_a_method_is_on_one_page() -> None:
    """Methods of papers, for comparison, are on a page of their own; the default of each stage is not."""
    heads = [set(re.findall(r"^### (\[.*method = \"\w+\"`)", page, re.M)) for page in (WRITTEN, PAPERS)]
    assert heads[1]
    assert not heads[0] & heads[1]
    assert not any("(default)" in line for line in PAPERS.splitlines())


def test_every_command_and_argument_has_a_meaning() -> None:
    commands = {name: parser for name, parser in make_parsers().items() if name}
    missing = [name for name, parser in commands.items() if not parser.description.endswith(".")]
    for name, parser in commands.items():
        missing += [f"{name} {how}" for how, what in reference.arguments(parser) if len(what) <= 3]
    assert missing == []


def readme_of(model: type) -> str:
    """The README of the folder in which a setting's model is declared."""
    module = Path(*model.__module__.split("."))
    readme = HOUSE / module.parent / "README.md"
    return readme.read_text("utf-8") if readme.is_file() else ""


def test_every_setting_has_a_meaning() -> None:
    """In its comment, in the text of its model, or as a row of the folder's README."""
    bare = [table.model.__name__ for table in tables() if not table.meaning]
    for table in tables():
        told = table.meaning + readme_of(table.model)
        named = set(re.findall(r"\w+", " ".join(re.findall(r"`([^`\n]+)`", told))))
        unsaid = (s for s in table.settings if not s.meaning and not s.unit and s.key not in named)
        bare += [f"{table.model.__module__}.{table.model.__name__}.{s.key}" for s in unsaid]
    assert bare == []


def test_every_method_is_in_the_readme_of_its_folder() -> None:
    methods = [table for table in tables() if table.method]
    assert len(methods) >= 20
    assert [f"{t.header} {t.method}" for t in methods if t.method not in readme_of(t.model)] == []


def test_the_default_method_of_a_table_is_the_one_that_a_scenario_without_it_runs() -> None:
    scenario = Scenario.model_validate({"name": "a", "title": "a", "start_utc": "2025-06-01T12:00:00Z", "area": AREA})
    chosen = {table.header: table.method for table in tables() if table.chosen and table.method}
    assert chosen["tracks"] == scenario.tracks.method == "guided_vimmjipda"
    for part in ("association", "messages", "bank", "upkeep"):
        assert chosen[f"tracks.{part}"] == getattr(scenario.tracks, part).method
    for stage in ("ais_tracks", "bearing_tracks", "fused_tracks", "associations"):
        assert chosen[stage] == getattr(scenario, stage).method


def test_every_stage_is_reached() -> None:
    stages = {"input", "plots", "tracks", "ais_tracks", "bearing_tracks", "spots", "octants", "associations"}
    stages |= {"bearing_associations", "fused_tracks", "picture"}
    assert stages <= {t.header for t in tables()}


def test_every_question_of_a_file_is_one_of_the_program() -> None:
    names = {row[0] for row in presentation.questions().rows}
    assert names == {p.stem for p in (HOUSE / "db" / "operator").glob("*.sql")}
    assert len(names) >= 8


def test_every_scenario_is_documented() -> None:
    folders = {p.name for p in (HOUSE / "scenarios").iterdir() if (p / "scenario.toml").is_file()}
    assert folders == {name for name, _ in scenario_names()}
    for name in folders:
        readme = HOUSE / "scenarios" / name / "README.md"
        assert readme.is_file(), f"scenarios/{name} has no README.md"
        assert len(readme.read_text("utf-8").split()) > 20


@pytest.mark.parametrize(
    "key", ["azimuth_bias_deg", "range_bias_m", "time_lag_s", "time_format", "separator", "speed_unit", "inflation"]
)
def test_a_setting_that_is_easily_misread_has_an_example(key: str) -> None:
    """Its unit, sign or form cannot be guessed from the name."""
    meanings = [s.meaning for table in tables() for s in table.settings if s.key == key]
    assert meanings
    assert [m for m in meanings if "e.g." not in m.lower()] == []


@cache
def numbers() -> dict[tuple[str, str], settings.Setting]:
    return {(t.model.__name__, s.key): s for t in tables() for s in t.settings if "number" in s.kind and "mmsi" not in s.key}


COUNTED = re.compile(
    r"\b(cycles?|slots?|turns?|tracks?|vessels?|pairs?|spots?|processors?|entries|(?:whole )?number|share|probability|ratio|factor"
    r"|log odds|differences|steps)\b"
)
"""What a number without a physical unit counts or compares."""

SIGN = re.compile(r"positive|latitude|log odds below|1 \+ look_slack|density|mean time")
"""Of what may be negative, or has no limits because it is a list of quantities that are positive."""


def test_every_numeric_setting_has_a_unit() -> None:
    """In its name, which gives the column `unit`, or in its meaning."""
    assert len(numbers()) > 100
    assert [key for key, s in numbers().items() if not s.unit and not COUNTED.search(s.meaning)] == []


def test_every_setting_that_may_be_negative_says_what_positive_means() -> None:
    negative = {key: s for key, s in numbers().items() if not re.search(r"number (>=? [0-9]|< 0)", s.kind)}
    assert negative
    assert [key for key, s in negative.items() if not SIGN.search(f"{s.unit} {s.meaning} {s.key}")] == []
