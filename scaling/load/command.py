"""What the commands of the load have in common: their options, and an end in one sentence where a user can repair what is wrong."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from coastwatch.operators.cli.arguments import pair, whole
from coastwatch.scenario import ScenarioError
from coastwatch.store import StoreError

FAILED, INTERRUPTED = 1, 130  # as `coastwatch` has them; bad options are argparse's 2


def arguments(description: str | None) -> argparse.ArgumentParser:
    """What every command of the load takes."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument(
        "--warmup", type=whole, default=20, help="cycles that do not count: windows must fill, those of bearings in 100"
    )
    parser.add_argument("--workers", type=whole, default=0, help="processors; 0: all")
    parser.add_argument("--store", default="none", metavar="URL", help="SQLAlchemy URL of a database, or none")
    parser.add_argument("--seed", type=whole, default=1)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", type=pair, help="a setting of the scenario")
    parser.add_argument("--json", action="store_true")
    return parser


def settings_of(asked: argparse.Namespace) -> dict[str, str]:
    return dict(asked.set)


@contextmanager
def one_sentence() -> Iterator[None]:
    """Ends the process with a line on stderr, and no traceback, on Ctrl-C and where the scenario or the database is refused."""
    try:
        yield
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        raise SystemExit(INTERRUPTED) from None
    except (ScenarioError, StoreError) as error:
        print("error:", "; ".join(str(error).split("\n")), file=sys.stderr)
        raise SystemExit(FAILED) from None
