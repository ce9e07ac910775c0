"""The command line: `parser` has all options, `main` runs one command and turns every error into one line and an exit code.

The module of a command is imported when the command has been chosen: `coastwatch --help` imports neither numpy nor SQLAlchemy.
"""

from __future__ import annotations

import argparse
import importlib
import os
import re
import sys
import traceback
from collections.abc import Sequence

from coastwatch.errors import ExplainedError, InputError
from coastwatch.operators.cli.arguments import FORMATS
from coastwatch.operators.cli.parser import make_parser
from coastwatch.spelling import did_you_mean, printable

VALUES = {"--bbox": r"-[\d.]", "--tracks-origin": r"-[\d.]", "--track-site": r"-[\d.]", "--sort": r"-[a-z]"}
"""How the value of an option begins that argparse would take for an option."""

REPAIRABLE = InputError, FileNotFoundError, FileExistsError, IsADirectoryError, NotADirectoryError, PermissionError
"""What the caller can repair: the errors of Coastwatch that say so, and the names of files."""

DONE, FAILED, BAD_INPUT, FELL, INTERRUPTED, PIPE_CLOSED = 0, 1, 2, 4, 130, 141


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command; returns its exit code. Args: arguments: as typed after `coastwatch` (default: of this process)."""
    try:
        options = parsed(sys.argv[1:] if arguments is None else arguments)
        module, _, function = options.act.partition(":")
        code: int = getattr(importlib.import_module(f"{__name__}.{module}"), function)(options)
        sys.stdout.flush()
    except KeyboardInterrupt:
        print("coastwatch: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        try:  # Python flushes stdout when it ends, and would print an error
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        except (OSError, ValueError):
            sys.stdout = open(os.devnull, "w")  # noqa: SIM115 (lives until the process ends)
        return PIPE_CLOSED
    except Exception as error:
        if os.environ.get("COASTWATCH_TRACEBACK") == "1":
            traceback.print_exc()
        print(f"coastwatch: error: {_one_line(error)}", file=sys.stderr)
        return BAD_INPUT if isinstance(error, REPAIRABLE) else FAILED
    return code


def parsed(words: Sequence[str]) -> argparse.Namespace:
    """The options of a command line. Raises: InputError."""
    joined: list[str] = []
    for word in words:  # argparse would take a negative position or a descending column for an option: "--bbox=-23,..."
        if joined and re.match(VALUES.get(joined[-1], r"(?!)"), word):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    options, unknown = make_parser(words[0] if words else "").parse_known_args(joined)
    if unknown:
        word = unknown[0]
        if options.command.endswith(" fuse") and not word.startswith("-"):
            hint = "; a file follows --ais, --plots, --bearings or --tracks"
        elif word[2:] in FORMATS and hasattr(options, "format"):
            hint = f"; did you mean '--format {word[2:]}'?"
        else:
            names = ["--" + name.removesuffix("_s").replace("_", "-") for name in vars(options)]
            hint = did_you_mean(word.partition("=")[0], names)
        raise InputError(
            f"{options.command}: got {' '.join(unknown)!r}, which it does not take{hint} (see {options.command} --help)"
        )
    return options


def _one_line(error: Exception) -> str:
    if isinstance(error, MemoryError):
        return f"out of memory ({error or 'no size is known'}): needed a smaller scenario or a larger machine"
    text = str(error)
    if isinstance(error, OSError) and error.strerror:
        text = error.strerror
        if error.filename:
            folder = os.path.dirname(error.filename) or "."
            absent = "there is no such file" if os.path.isdir(folder) else f"there is no folder {folder}"
            reasons = {
                FileNotFoundError: absent,
                IsADirectoryError: "got a folder, needed a file",
                PermissionError: "may not be read or written by this user",
            }
            text = f"{error.filename}: {reasons.get(type(error), text)}"
    text = "; ".join(printable(line.strip()) for line in text.split("\n") if line.strip())
    if text and isinstance(error, ExplainedError | OSError):
        return text
    return f"{type(error).__name__}: {text or 'no message'} (COASTWATCH_TRACEBACK=1 shows where)"
