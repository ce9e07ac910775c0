"""Options of the commands that keep a database: upgrade, check, copy, prune."""

from __future__ import annotations

from coastwatch.operators.cli.arguments import (
    Parser,
    add_db,
    age,
    completed_by,
    count,
)
from coastwatch.operators.cli.commands import Commands

COMMANDS = Commands()


@COMMANDS.command("db upgrade", "database:upgrade", "create a database or upgrade it to this version")
def db_upgrade(parser: Parser) -> None:
    """Create the database, or upgrade an old one to this version's schema. Its content is kept."""
    add_db(parser)


@COMMANDS.command("db check", "database:check", "compare a database with this version's schema")
def db_check(parser: Parser) -> None:
    """Compare the database with this version's schema. Exit code 0: they agree; 1: one line per difference."""
    add_db(parser)


@COMMANDS.command("db backup", "database:backup", "copy a database while it is in use")
def db_backup(parser: Parser) -> None:
    """Copy an SQLite database to a new file while others read and write it: the state of one moment, with whole cycles. Into a
    folder, the copy is named after the database and the time. PostgreSQL: pg_dump.
    """
    completed_by(parser.add_argument("target", metavar="FILE|FOLDER", help="a new file, or a folder of copies"))
    add_db(parser)
    text = "then delete all but the newest N copies of this database in the folder"
    parser.add_argument("--keep", metavar="N", type=count, help=text)


@COMMANDS.command("db restore", "database:restore", "bring a backup back")
def db_restore(parser: Parser) -> None:
    """Copy a backup to where there is no database. Then `coastwatch db upgrade` brings an old one to this version."""
    completed_by(parser.add_argument("source", metavar="FILE", help="a file that `db backup` wrote"))
    add_db(parser)


@COMMANDS.command("db prune", "database:prune", "delete what is old")
def db_prune(parser: Parser) -> None:
    """Delete what is old, also beside a run that goes on: runs that ended so long ago, and of the others history, details
    (associations, spots, timings, registrations), events and recording that are so much older than the newest cycle. The
    current picture stays. An SQLite file does not shrink; backup and restore make a smaller one. Settings `store.history_hours`
    and the like do it in every cycle.
    """
    add_db(parser)
    text = "how old: a whole number with h, d or w, such as 12h, 30d or 8w"
    parser.add_argument("--older-than", metavar="AGE", type=age, required=True, help=text)
    text = "only this, of all runs: history, details, events, recording or audit (who changed what); repeatable"
    kinds = ("history", "details", "events", "recording", "audit")
    parser.add_argument("--only", metavar="KIND", choices=kinds, action="append", default=[], help=text)
