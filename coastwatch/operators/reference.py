"""REFERENCE.md, made from the code: commands, scenario settings, methods, questions. `make docs` runs this module, which writes
it and the generated schemas of db/schema again."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from coastwatch.operators import settings, stored
from coastwatch.operators.cli.parser import EPILOG, make_parser
from coastwatch.scenario import Scenario, scenario_names
from coastwatch.store.migrate import write_schemas

FILE = Path(__file__).with_name("REFERENCE.md")
HEAD = """\
# Reference

Made by `make docs` from the code (coastwatch/operators/reference.py); a test keeps it current. Do not edit it.
"""


def text() -> str:
    """The whole reference as Markdown."""
    parts = [HEAD, *_commands(), *_questions(), *_scenarios(), *_settings()]
    return "\n".join(parts).rstrip() + "\n"


def _cell(value: object) -> str:
    return str(value).replace("|", "\\|").replace("\n", " ")


def _rows(head: tuple[str, ...], rows: list[tuple[object, ...]]) -> Iterator[str]:
    yield "| " + " | ".join(head) + " |"
    yield "|" + "---|" * len(head)
    for row in rows:
        yield "| " + " | ".join(_cell(value) for value in row) + " |"
    yield ""


def commands(parser: argparse.ArgumentParser, name: str) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Name and parser of this command and of those below it that can be run."""
    below = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    if not below:
        yield name, parser
    for action in below:
        for word, inner in action.choices.items():
            yield from commands(inner, f"{name} {word}")


def arguments(parser: argparse.ArgumentParser) -> Iterator[tuple[str, str]]:
    """How each argument is written, and what it means."""
    for action in parser._actions:
        if action.dest == "help" or isinstance(action, argparse._SubParsersAction):
            continue
        value = action.metavar or ("|".join(action.choices) if action.choices else "")
        takes = "" if action.nargs == 0 else f" {value}" if action.option_strings else str(value)
        yield ", ".join(action.option_strings) + takes, str(action.help or "")


def _commands() -> Iterator[str]:
    yield "## Commands\n"
    for name, parser in commands(make_parser(), "coastwatch"):
        yield f"### {name}\n\n{parser.description}\n"
        yield from _rows(("argument", "meaning"), [(f"`{how}`", what) for how, what in arguments(parser)])
    yield "`coastwatch --version` prints the version. " + " ".join(EPILOG.split()).replace("The whole", "\nThe whole") + "\n"


def _questions() -> Iterator[str]:
    rows = stored.questions()
    yield "## Questions of `coastwatch query`\n"
    yield from _rows(tuple(rows.columns), [(f"`{row[0]}`", *row[1:]) for row in rows.rows])


def _scenarios() -> Iterator[str]:
    yield "## Scenarios\n"
    yield from _rows(("name", "title"), [(f"`{name}`", title) for name, title in scenario_names()])


def _settings() -> Iterator[str]:
    yield (
        "## Settings of a scenario\n\nA scenario is one TOML file. Every setting can be overridden with `--set KEY=VALUE`, the key being\n"
        "the table and the setting with dots between (`tracks.method=imm`), a number naming an item of a list (`radars.0.rpm=20`).\n"
        '`extends = "NAME"` at the top of the file takes over what another scenario says: see coastwatch/scenario/README.md.\n'
    )
    for table in settings.tables(Scenario):
        yield from _table(table)


def _table(table: settings.Table) -> Iterator[str]:
    header = table.header if table.header.startswith("[") else f"[{table.header}]" if table.header else "top of the file"
    choice = f' `method = "{table.method}"`' if table.method else ""
    default = " (default)" if table.method and table.chosen else ""
    folder = "/".join(table.model.__module__.split(".")[1:-1])
    more = f"\n\nMore: [coastwatch/{folder}/README.md](../{folder}/README.md)" if folder else ""
    yield f"### {header}{choice}{default}\n\n{table.meaning}{more}\n"
    rows: list[tuple[Any, ...]] = [(f"`{s.key}`", s.kind, s.unit, f"`{s.default}`", s.meaning) for s in table.settings]
    if rows:
        yield from _rows(("setting", "kind", "unit", "default", "meaning"), rows)


if __name__ == "__main__":
    FILE.write_text(text(), "utf-8")
    write_schemas()
