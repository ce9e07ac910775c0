"""`db upgrade` and `db check`: bring a database to this version's schema, or list the differences."""

from __future__ import annotations

import argparse
import sys

from coastwatch.store import migrate


def upgrade(options: argparse.Namespace) -> int:
    done = migrate.upgrade(options.db)
    runs = f"{done.runs} run{'' if done.runs == 1 else 's'} kept"
    if done.before == done.after:
        print(f"{options.db}: up to date at schema {done.after}, {runs}")
    elif done.before is None:
        print(f"{options.db}: made with schema {done.after}")
    else:
        print(f"{options.db}: upgraded from schema {done.before} to {done.after}, {runs}")
    return 0


def check(options: argparse.Namespace) -> int:
    differences = migrate.check(options.db)
    for line in differences:
        print(f"{options.db}: {line}", file=sys.stderr)
    if differences:
        return 1
    print(f"{options.db}: as this version needs it")
    return 0
