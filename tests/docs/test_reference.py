"""What REFERENCE.md says of commands, settings, methods, questions and scenarios."""

import re
from pathlib import Path

import pytest

from coastwatch.operators import reference, settings, stored
from coastwatch.operators.cli import make_parser
from coastwatch.scenario import Scenario, scenario_names

HOUSE = Path(__file__).parents[2]
WRITTEN = reference.FILE.read_text("utf-8")
COMMANDS = list(reference.commands(make_parser(), "coastwatch"))
TABLES = list(settings.tables(Scenario))


def test_the_file_is_current() -> None:
    assert reference.text() == WRITTEN, "run `make docs`"


@pytest.mark.parametrize(("name", "parser"), COMMANDS, ids=[name for name, _ in COMMANDS])
def test_every_command_and_argument_is_documented(name: str, parser: object) -> None:
    assert f"### {name}\n" in WRITTEN
    assert parser.description.endswith(".")
    for how, what in reference.arguments(parser):
        assert f"`{reference._cell(how)}`" in WRITTEN
        assert len(what) > 3, f"{name} {how} has no help"


def test_the_commands_of_the_contract_are_there() -> None:
    wanted = {"run", "scenarios", "fuse", "reproduce", "picture", "track", "query", "plot", "db upgrade", "db check"}
    assert {f"coastwatch {name}" for name in wanted} <= {name for name, _ in COMMANDS}


def readme_of(model: type) -> str:
    """The README of the folder in which a setting's model is declared."""
    module = Path(*model.__module__.split("."))
    readme = HOUSE / module.parent / "README.md"
    return readme.read_text("utf-8") if readme.is_file() else ""


@pytest.mark.parametrize("table", TABLES, ids=[f"{t.header or 'top'} {t.method}".strip() for t in TABLES])
def test_every_setting_has_a_meaning(table: settings.Table) -> None:
    assert table.meaning, f"{table.model.__name__} has no docstring"
    told = table.meaning + readme_of(table.model)
    named = set(re.findall(r"\w+", " ".join(re.findall(r"`([^`\n]+)`", told))))
    bare = [s.key for s in table.settings if not s.meaning and not s.unit and s.key not in named]
    assert bare == [], (
        f"{table.model.__module__}.{table.model.__name__}: settings without a comment, text or row in a README: {bare}"
    )


@pytest.mark.parametrize("table", [t for t in TABLES if t.method], ids=lambda t: f"{t.header} {t.method}")
def test_every_method_is_documented(table: settings.Table) -> None:
    assert f'`method = "{table.method}"`' in WRITTEN
    assert table.method in readme_of(table.model), f"{table.method} is not in the README of {table.model.__module__}"


def test_every_stage_is_reached() -> None:
    stages = {"input", "plots", "tracks", "ais_tracks", "bearing_tracks", "spots", "octants", "associations"}
    stages |= {"bearing_associations", "fused_tracks", "picture"}
    assert stages <= {t.header for t in TABLES}


def test_every_question_is_documented() -> None:
    names = {row[0] for row in stored.questions().rows}
    assert names == {p.stem for p in (HOUSE / "db" / "operator").glob("*.sql")}
    assert len(names) >= 8
    assert all(f"`{name}`" in WRITTEN for name in names)


def test_every_scenario_is_documented() -> None:
    folders = {p.name for p in (HOUSE / "scenarios").iterdir() if p.is_dir()}
    assert folders == {name for name, _ in scenario_names()}
    for name in folders:
        assert f"`{name}`" in WRITTEN
        readme = HOUSE / "scenarios" / name / "README.md"
        assert readme.is_file(), f"scenarios/{name} has no README.md"
        assert len(readme.read_text("utf-8").split()) > 20
