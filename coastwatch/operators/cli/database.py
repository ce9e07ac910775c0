"""`db upgrade` and `db check`: bring a database to this version's schema, or list the differences."""

from __future__ import annotations

import argparse
import sys

from coastwatch.store import migrate


def upgrade(options: argparse.Namespace) -> int:
    migrate.upgrade(options.db)
    print(f"{options.db}: up to date")
    return 0


def check(options: argparse.Namespace) -> int:
    differences = migrate.check(options.db)
    for line in differences:
        print(f"{options.db}: {line}", file=sys.stderr)
    if differences:
        return 1
    print(f"{options.db}: as this version needs it")
    return 0
