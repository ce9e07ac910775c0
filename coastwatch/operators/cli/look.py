"""`coastwatch picture` and `coastwatch track`: what is stored, as a table or a file."""

from __future__ import annotations

import argparse
import json
from typing import Any

from coastwatch.operators.cli.arguments import add_db, add_format, add_moment, add_run, whole

NEWEST = 20


def add(commands: Any) -> None:
    """Adds `picture` and `track` to the parser."""
    text = (
        "The picture of a run: one row a vessel. Speeds in knots, courses in degrees true, times in UTC, MMSI of nine digits. "
        "A table has the main columns, the other formats have all."
    )
    picture = commands.add_parser("picture", help="show or export the picture", description=text)
    add_db(picture)
    add_run(picture)
    add_moment(picture)
    add_format(picture)
    picture.set_defaults(act=_picture)
    text = f"One vessel: what is known of it, the tracks in it and where it was (the newest {NEWEST} rows; --json has all)."
    track = commands.add_parser("track", help="show one vessel and its history", description=text)
    track.add_argument(
        "vessel", metavar="ID", type=whole, help="number of the vessel, as in `coastwatch picture` (not its MMSI)"
    )
    add_db(track)
    add_run(track)
    track.add_argument("--json", action="store_true", help="print one JSON object with the whole history")
    track.set_defaults(act=_track)


def _picture(options: argparse.Namespace) -> int:
    from coastwatch.operators import export, stored

    with stored.opened(options.db) as store:
        rows = stored.picture(store, stored.run(store, options.run)["id"], options.at, options.bbox)
    export.write(stored.shown(rows) if options.format == "table" else rows, options.format, options.output)
    return 0


def _track(options: argparse.Namespace) -> int:
    from coastwatch.operators import export, stored
    from coastwatch.operators.cli.summary import as_plain

    with stored.opened(options.db) as store:
        found = stored.vessel(store, stored.run(store, options.run)["id"], options.vessel)
    if options.json:
        print(json.dumps(as_plain(found.as_object()), allow_nan=False))
        return 0
    for name, value in found.facts.items():
        print(f"{name.replace('_', ' '):<16} {'-' if value in (None, '') else value}")
    for title, rows in found.tables.items():
        newest = type(rows)(rows.columns, rows.rows[-NEWEST:])
        print(f"\n{title}" + (f", the newest {NEWEST} of {len(rows.rows)}" if len(rows.rows) > NEWEST else ""))
        export.write(newest, "table", None)
    return 0
