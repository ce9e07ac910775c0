"""Every command line that the documentation shows is one that the parser takes, and the systemd unit starts one of them."""

import re
import shlex
from pathlib import Path

from coastwatch.operators.bad_input import BadInput
from coastwatch.operators.cli import make_parser

HOUSE = Path(__file__).parents[2]
PAGES = [
    HOUSE / "README.md",
    *(p for top in ("coastwatch", "db", "ops", "scenarios", "scaling") for p in (HOUSE / top).rglob("*.md")),
]
SHOWN = re.compile(
    r"`(?:\.venv/bin/)?(coastwatch [a-z][^`]*)`|^(?:    |\$ )(?:\.venv/bin/)?(coastwatch [a-z].*)$", re.MULTILINE
)
STAND_INS = {"N": "1", "ID": "1", "UTC": "2026-07-01T12:00:00Z", "S,W,N,E": "-23,-44,-22,-43", "KEY=VALUE": "seed=1"}


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
            make_parser().parse_args(words[1:])
        except BadInput as error:
            refused.append(f"{page}: {line}: {error}")
    assert len(shown()) >= 20
    assert refused == []


def test_the_systemd_unit_starts_a_command_that_there_is() -> None:
    unit = (HOUSE / "ops" / "systemd" / "coastwatch-scenario@.service").read_text("utf-8")
    (line,) = re.findall(r"^ExecStart=(.*)$", unit, re.MULTILINE)
    words = shlex.split(
        line.replace("%i", "guanabara").replace("${COASTWATCH_DB}", "sqlite:////var/lib/coastwatch/guanabara.db")
    )
    assert words[0].endswith("/.venv/bin/coastwatch")
    options = make_parser().parse_args(words[1:])
    assert (options.scenario, options.resume) == ("guanabara", True)


def test_the_units_of_server_and_copies_start_commands_that_there_are() -> None:
    units = HOUSE / "ops" / "systemd"
    (given,) = re.findall(r"^COASTWATCH_SERVE=(.*)$", (units / "serve.env").read_text("utf-8"), re.MULTILINE)
    found = []
    for name in ("serve", "backup"):
        text = (units / f"coastwatch-{name}.service").read_text("utf-8").replace("$COASTWATCH_SERVE", given)
        for line in re.findall(r"^ExecStart=\S+/coastwatch (.*)$", text, re.MULTILINE):
            found.append(make_parser().parse_args(shlex.split(line)))
    assert [options.db for options in found] == ["/var/lib/coastwatch/watch.db"] * 3
    assert len(found[0].feed) == 2


def test_the_makefile_calls_commands_that_there_are() -> None:
    calls = re.findall(r"^\t\$\(BIN\)/coastwatch (.*)$", (HOUSE / "Makefile").read_text("utf-8"), re.MULTILINE)
    assert len(calls) >= 2
    for call in calls:
        make_parser().parse_args(shlex.split(call))


def test_a_node_of_ray_is_stopped_by_its_first_process() -> None:
    """To which alone SIGTERM goes: where all have it, the node waits in vain for those that are gone already."""
    unit = (HOUSE / "ops" / "ray" / "coastwatch-ray@.service").read_text("utf-8")
    assert {"KillMode=mixed", "KillSignal=SIGTERM"} <= set(unit.splitlines())
