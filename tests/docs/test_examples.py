"""Every command line that the documentation shows is one that the parser takes, and the systemd unit starts one of them."""

import argparse
import ast
import importlib
import importlib.util
import re
import shlex
import sys
from functools import cache
from pathlib import Path
from typing import Any, NoReturn

import pytest

from coastwatch.errors import InputError
from coastwatch.operators import presentation
from coastwatch.operators.cli import make_parser
from coastwatch.reproduction import published
from coastwatch.scenario import ScenarioError, load_scenario

HOUSE = Path(__file__).parents[2]
PAGES = [
    HOUSE / "README.md",
    *(p for top in ("coastwatch", "db", "ops", "scenarios", "scaling") for p in (HOUSE / top).rglob("*.md")),
]
SHOWN = re.compile(
    r"`(?:\.venv/bin/)?(coastwatch [a-z][^`]*)`|^(?:    |\$ )(?:\.venv/bin/)?(coastwatch [a-z].*)$", re.MULTILINE
)
STAND_INS = {"N": "1", "ID": "1", "UTC": "2026-07-01T12:00:00Z", "S,W,N,E": "-23,-44,-22,-43", "KEY=VALUE": "seed=1"}


@cache
def parser() -> argparse.ArgumentParser:
    return make_parser()


@cache
def shown() -> list[tuple[str, str]]:
    """Page and command line of every example; a sketch with dots or brackets, or a bare name, is none."""
    found = []
    for page in PAGES:
        for match in SHOWN.finditer(page.read_text("utf-8")):
            line = (match[1] or match[2]).partition("  #")[0].strip()
            if not re.search(r"\.\.\.|[\[\]|<>{}]", line) and len(line.split()) > 2:
                found.append((str(page.relative_to(HOUSE)), " ".join(line.split())))
    return found


def test_the_parser_takes_every_example() -> None:
    refused = []
    for page, line in shown():
        words = [STAND_INS.get(word, word) for word in shlex.split(line)]
        try:
            parser().parse_args(words[1:])
        except InputError as error:
            refused.append(f"{page}: {line}: {error}")
    assert len(shown()) >= 20
    assert refused == []


def test_every_example_names_scenarios_settings_and_questions_that_there_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(published, "read", cache(published.read))
    taken, wrong = 0, []
    questions = {row[0] for row in presentation.questions().rows}
    for line, page in {line: page for page, line in shown()}.items():
        if {"SCENARIO", "NAME", "PAPER"} & set(line.split()):
            continue
        options = parser().parse_args([STAND_INS.get(word, word) for word in shlex.split(line)][1:])
        try:
            if options.command == "coastwatch reproduce":
                published.chosen(options.paper, tuple(options.only))
            elif options.command == "coastwatch query":
                assert options.name in questions, f"got {options.name}, needed a file of db/operator"
            elif options.command == "coastwatch run":
                load_scenario(options.scenario, dict(options.settings))
            else:
                continue
            taken += 1
        except (AssertionError, InputError, ScenarioError) as error:
            wrong.append(f"{page}: {line}: {error}")
    assert taken >= 40
    assert wrong == []


MEASURED = re.compile(r"`python -m (scaling\.[^`]*)`|^ *(?:Run: )?(?:\.venv/bin/)?python -m (scaling\..*)$", re.MULTILINE)
OF_OPTION = {"--case": "three", "--part": "stages", "--peer": "scipy", "--task": "imm"}
STAND_INS_OF_MEASUREMENTS = {
    "SCENARIO": "solent", "NAME": "solent", "M": "1", "FIRST-LAST": "1-2", "WIDTHxHEIGHT": "800x600", "METHOD": "threads",
    "SETTING=VALUE": "seed=1", "N,N": "1,1",
}  # fmt: skip
"""Of words in capitals; any other stands for a number."""


def measurements() -> list[tuple[str, list[str]]]:
    """Page and words of every `python -m scaling...` of the documentation and of the docstrings of scaling/.

    What is in brackets is taken, of A | B the first, and dots are left out.
    """
    texts = {page: re.sub(r" *\\\n *", " ", page.read_text("utf-8")) for page in PAGES}
    for module in (HOUSE / "scaling").rglob("*.py"):
        texts[module] = ast.get_docstring(ast.parse(module.read_text("utf-8")), clean=False) or ""
    found = []
    for page, text in texts.items():
        for match in MEASURED.finditer(text):
            line = re.split(r"  |#", match[1] or match[2])[0] if match[2] else " ".join(match[1].split())
            words = shlex.split(re.sub(r"([^\s|]+)(?: ?\| ?[^\s|]+)+", r"\1", re.sub(r"[\[\]]|,?\.\.\.", "", line)))
            if (
                "PEER" not in line
                and "--help" not in line
                and not words[0].endswith(("NAME", "adapter", "method", "ours", "polling"))
            ):
                found.append((str(page.relative_to(HOUSE)), words))
    return found


def stands_for(word: str, before: str) -> str:
    """The value that a word in capitals stands for; another word as it is."""
    if word.isupper() and before in OF_OPTION:
        return OF_OPTION[before]
    given = STAND_INS_OF_MEASUREMENTS.get(word, STAND_INS.get(word))
    return given or ("1" if re.fullmatch(r"[A-Z_]+", word) else word)


class Parsed(Exception):
    """The parser took the words; the measurement itself does not begin."""


class Refused(Exception):
    """The parser did not take the words."""


def refuse(_: argparse.ArgumentParser, message: str) -> NoReturn:
    raise Refused(message)


def test_the_parser_takes_every_measurement(monkeypatch: pytest.MonkeyPatch) -> None:
    take = argparse.ArgumentParser.parse_args

    def parse_only(of: argparse.ArgumentParser, *given: Any) -> NoReturn:
        take(of, *given)
        raise Parsed

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parse_only)
    monkeypatch.setattr(argparse.ArgumentParser, "error", refuse)
    refused = []
    every = measurements()
    for page, (name, *words) in every:
        try:
            spec = importlib.util.find_spec(name)
            module = importlib.import_module(f"{name}.__main__" if spec and spec.submodule_search_locations else name)
            given = [stands_for(word, before) for before, word in zip(["", *words], words, strict=False)]
            monkeypatch.setattr(sys, "argv", [name, *given])
            with pytest.raises(Parsed):
                module.main()
        except (Refused, ImportError) as error:
            refused.append(f"{page}: {name} {' '.join(words)}: {error}")
    assert len(every) >= 60
    assert refused == []


def test_the_systemd_unit_starts_a_command_that_there_is() -> None:
    unit = (HOUSE / "ops" / "systemd" / "coastwatch-scenario@.service").read_text("utf-8")
    (line,) = re.findall(r"^ExecStart=(.*)$", unit, re.MULTILINE)
    words = shlex.split(
        line.replace("%i", "guanabara").replace("${COASTWATCH_DB}", "sqlite:////var/lib/coastwatch/guanabara.db")
    )
    assert words[0].endswith("/.venv/bin/coastwatch")
    options = parser().parse_args(words[1:])
    assert (options.scenario, options.resume) == ("guanabara", True)


def test_the_units_of_server_and_copies_start_commands_that_there_are() -> None:
    units = HOUSE / "ops" / "systemd"
    (given,) = re.findall(r"^COASTWATCH_SERVE=(.*)$", (units / "serve.env").read_text("utf-8"), re.MULTILINE)
    found = []
    for name in ("serve", "backup"):
        text = (units / f"coastwatch-{name}.service").read_text("utf-8").replace("$COASTWATCH_SERVE", given)
        for line in re.findall(r"^ExecStart=\S+/coastwatch (.*)$", text, re.MULTILINE):
            found.append(parser().parse_args(shlex.split(line)))
    assert [options.db for options in found] == ["/var/lib/coastwatch/watch.db"] * 2
    assert len(found[0].feed) == 2


def test_the_makefile_calls_commands_that_there_are() -> None:
    calls = re.findall(r"^\t\$\(BIN\)/coastwatch (.*)$", (HOUSE / "Makefile").read_text("utf-8"), re.MULTILINE)
    assert len(calls) >= 2
    for call in calls:
        parser().parse_args(shlex.split(call))


def test_a_node_of_ray_is_stopped_by_its_first_process() -> None:
    """To which alone SIGTERM goes: where all have it, the node waits in vain for those that are gone already."""
    unit = (HOUSE / "ops" / "ray" / "coastwatch-ray@.service").read_text("utf-8")
    assert {"KillMode=mixed", "KillSignal=SIGTERM"} <= set(unit.splitlines())
