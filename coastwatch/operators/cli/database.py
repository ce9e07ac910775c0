"""`db`: bring a database to this version's schema, list the differences, copy it while it is in use, delete what is old."""

from __future__ import annotations

import argparse
import re
import sys
from datetime import UTC, datetime
from pathlib import Path

from coastwatch import store
from coastwatch.errors import InputError
from coastwatch.operators import presentation
from coastwatch.operators.cli.progress import report_progress
from coastwatch.store.schema import migrate

STAMP = "%Y%m%dT%H%M%SZ"


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


def backup(options: argparse.Namespace) -> int:
    target = Path(options.target)
    if options.keep is not None and not target.is_dir():
        raise InputError(f"--keep: got {target}, which is no folder, needed a folder of copies")
    with presentation.opened(options.db) as opened:
        stem = re.sub(r"[^\w.-]", "_", Path(opened.where).stem)
        path = target / f"{stem}-{datetime.now(UTC).strftime(STAMP)}.db" if target.is_dir() else target
        size = store.backup(opened, path)
    print(f"{path}: {size / 1e6:.1f} MB")
    if options.keep is not None:
        ours = re.compile(re.escape(stem) + r"-\d{8}T\d{6}Z\.db")
        for old in sorted(copy for copy in target.iterdir() if ours.fullmatch(copy.name))[: -options.keep]:
            old.unlink()
            print(f"{old}: deleted")
    return 0


def restore(options: argparse.Namespace) -> int:
    size = store.restore(Path(options.source), options.db)
    print(f"{options.db}: {size / 1e6:.1f} MB from {options.source}")
    return 0


def prune(options: argparse.Namespace) -> int:
    with presentation.opened(options.db) as opened, report_progress("run") as show:
        done = store.prune(opened, options.older_than, options.only, show)
    if not options.only:
        print(f"runs: {len(done.runs)} deleted")
    for kind, count in done.rows.items():
        print(f"{kind}: {count} {'cycles' if kind == 'recording' else 'rows'} deleted")
    return 0
