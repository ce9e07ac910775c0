"""`coastwatch db upgrade|check`: bring a database to this version's schema, or say how it differs."""

from __future__ import annotations

import argparse
import sys
from typing import Any

from coastwatch.operators.cli.arguments import add_db


def add(commands: Any) -> None:
    """Adds `db` to the parser."""
    db = commands.add_parser("db", help="upgrade or check a database", description="Upgrade or check a database.")
    verbs = db.add_subparsers(title="commands", metavar="COMMAND", required=True)
    text = "Make the database, or bring an old one to this version's schema. What is stored is kept."
    upgrade = verbs.add_parser("upgrade", help="make a database or bring it to this version", description=text)
    add_db(upgrade)
    upgrade.set_defaults(act=_upgrade)
    text = "Compare the database with this version's schema. Exit code 0: they agree; 1: each difference is a line."
    check = verbs.add_parser("check", help="say how a database differs from this version", description=text)
    add_db(check)
    check.set_defaults(act=_check)


def _upgrade(options: argparse.Namespace) -> int:
    from coastwatch.store import migrate

    migrate.upgrade(options.db)
    print(f"{options.db}: up to date")
    return 0


def _check(options: argparse.Namespace) -> int:
    from coastwatch.store import migrate

    differences = migrate.check(options.db)
    for line in differences:
        print(f"{options.db}: {line}", file=sys.stderr)
    if differences:
        print("coastwatch db upgrade brings it to this version", file=sys.stderr)
        return 1
    print(f"{options.db}: as this version needs it")
    return 0
