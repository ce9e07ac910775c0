"""Command-line options that the load commands share, and errors as one line."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from coastwatch.errors import StoreError
from coastwatch.operators.cli.arguments import pair, whole
from coastwatch.scenario import ScenarioError

FAILED, INTERRUPTED = 1, 130  # exit codes, the same as those of `coastwatch`; argparse uses 2


def load_parser(description: str | None) -> argparse.ArgumentParser:
    """A parser with the options of every load command."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--warmup",
        type=whole,
        default=20,
        help="cycles that do not count; windows of tracks fill in 20, those of bearings in 100",
    )
    parser.add_argument("--workers", type=whole, default=0, help="processors; 0: all")
    parser.add_argument("--store", default="none", metavar="URL", help="SQLAlchemy URL of a database, or none")
    parser.add_argument("--seed", type=whole, default=1)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", type=pair, help="a setting of the scenario")
    parser.add_argument("--json", action="store_true")
    return parser


def as_arguments(options: argparse.Namespace, *names: str) -> list[str]:
    """These options, and every `--set`, as arguments of another load command."""
    out = [part for name in names for part in (f"--{name}", str(getattr(options, name.replace("-", "_"))))]
    return out + [part for key, value in options.set for part in ("--set", f"{key}={value}")]


@contextmanager
def errors_as_one_line() -> Iterator[None]:
    """Ends the process with one line on stderr on Ctrl-C, and when the scenario or the database is refused."""
    try:
        yield
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        raise SystemExit(INTERRUPTED) from None
    except (ScenarioError, StoreError) as error:
        print("error:", "; ".join(str(error).split("\n")), file=sys.stderr)
        raise SystemExit(FAILED) from None
