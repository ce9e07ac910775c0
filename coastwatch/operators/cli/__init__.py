"""The command line: one module a group of commands; `main` runs one command and turns every error into a line and a code.

Nothing here imports numpy or anything that does before a command runs: `coastwatch --help` answers at once.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
import traceback
from collections.abc import Sequence
from typing import Any

from coastwatch.operators.bad_input import BadInput
from coastwatch.operators.cli import database, drawing, fuse, look, past, questions, reproduce, runs, sensors

DONE, FAILED, BAD_INPUT, INTERRUPTED, PIPE_CLOSED = 0, 1, 2, 130, 141

EPILOG = """\
exit codes: 0 done, 1 failed, 2 bad input, 130 interrupted with Ctrl-C, 141 the reader of the output went away.
COASTWATCH_TRACEBACK=1 in the environment shows where an error came from.
The whole reference: coastwatch/operators/REFERENCE.md"""


class _Version(argparse.Action):
    """Looks the version up only when it is asked for: reading package metadata costs more than parsing."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any, **__: Any) -> None:
        from importlib.metadata import version

        print(f"coastwatch {version('coastwatch')}")
        parser.exit()


class _Parser(argparse.ArgumentParser):
    """A parser that answers bad input with one line, as every other error is answered."""

    def error(self, message: str) -> Any:
        raise BadInput(f"{message} (see {self.prog} --help)")


def make_parser() -> argparse.ArgumentParser:
    """The parser of all commands; each sets `act`, a function of the parsed arguments that returns an exit code."""
    parser = _Parser(
        prog="coastwatch",
        description="One picture of a coast from radars, AIS and passive sonars.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and leave")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for group in (runs, fuse, reproduce, look, past, sensors, questions, drawing, database):
        group.add(commands)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """The exit code of one command. Args: arguments: as typed after `coastwatch`; none: those of this process."""
    try:
        options = make_parser().parse_args(_joined(sys.argv[1:] if arguments is None else arguments))
        code: int = options.act(options)
        sys.stdout.flush()
    except KeyboardInterrupt:
        print("coastwatch: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        _forget_stdout()
        return PIPE_CLOSED
    except Exception as error:
        if os.environ.get("COASTWATCH_TRACEBACK") == "1":
            traceback.print_exc()
        print(f"coastwatch: error: {_one_line(error)}", file=sys.stderr)
        return BAD_INPUT if _is_bad_input(error) else FAILED
    return code


def _joined(words: Sequence[str]) -> list[str]:
    """The words with an option of places and its value in one: argparse would take a value that begins with a minus for an option."""
    out: list[str] = []
    for word in words:
        if out and out[-1] in ("--bbox", "--tracks-origin") and re.match(r"-[\d.]", word):
            out[-1] += f"={word}"
        else:
            out.append(word)
    return out


def _forget_stdout() -> None:
    """Python flushes stdout once more when it ends; into a closed pipe that would print an error of its own."""
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (OSError, ValueError):
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115 (lives until the process ends)


def _is_bad_input(error: Exception) -> bool:
    if isinstance(error, BadInput | FileNotFoundError | IsADirectoryError | NotADirectoryError | PermissionError):
        return True
    # a ScenarioError can only have been raised by a module that is already loaded; importing it here would cost a second
    scenario = sys.modules.get("coastwatch.scenario")
    if scenario is not None and isinstance(error, scenario.ScenarioError):
        return True
    return isinstance(error, OSError | ValueError) and _raised_in(error).startswith(
        ("coastwatch.sensors.", "coastwatch.scenario")
    )


def _raised_in(error: Exception) -> str:
    """The innermost module of ours that an error came through: readers of input refuse it by OSError and ValueError."""
    frames = [str(frame.f_globals.get("__name__", "")) for frame, _ in traceback.walk_tb(error.__traceback__)]
    return next((name for name in reversed(frames) if name.startswith("coastwatch.")), "")


def _one_line(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        text = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    else:
        text = str(error)
    text = "; ".join(line.strip() for line in text.splitlines() if line.strip())
    known = _is_bad_input(error) or isinstance(error, OSError) or type(error).__module__.startswith("coastwatch.")
    return text if known and text else f"{type(error).__name__}: {text or 'no message'} (COASTWATCH_TRACEBACK=1 shows where)"
