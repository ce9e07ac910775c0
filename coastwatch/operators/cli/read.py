"""`picture`, `track`, `traffic`, `encounters`, `replay`, `sensors` and `query`: read a database, print or export the answer."""

from __future__ import annotations

import argparse
import json

from coastwatch.operators import export, recorded_frames, stored
from coastwatch.operators.bad_input import BadInput
from coastwatch.operators.cli.summary import as_plain
from coastwatch.store import delete_run, keep_runs

NEWEST = 20  # rows of a vessel's tables that `track` prints


def picture(options: argparse.Namespace) -> int:
    with stored.opened(options.db) as store:
        run = stored.run(store, options.run)
        rows = stored.picture(store, run["id"], options.at, options.bbox)
    if options.format == "table":
        export.write(stored.main_columns(rows), "table", options.output, stored.heading(run, rows))
    else:
        export.write(rows, options.format, options.output)
    return 0


def runs(options: argparse.Namespace) -> int:
    if (options.action is None) != (options.number is None):
        raise BadInput(f"runs: got {options.action}, needed a number too: `runs delete ID`, `runs keep N`")
    with stored.opened(options.db) as store:
        if options.action == "delete":
            delete_run(store, options.number)
        elif options.action == "keep":
            keep_runs(store, options.number)
        rows = stored.runs(store)
    if options.json:
        print(json.dumps(as_plain([dict(zip(rows.columns, row, strict=True)) for row in rows.rows]), allow_nan=False))
    else:
        export.write(stored.runs_table(rows), "table", None)
    return 0


def track(options: argparse.Namespace) -> int:
    with stored.opened(options.db) as store:
        found = stored.vessel(store, stored.run(store, options.run)["id"], options.vessel)
    if options.json:
        print(json.dumps(as_plain(found.as_object()), allow_nan=False))
        return 0
    for name, value in found.details.items():
        print(f"{name.replace('_', ' '):<16} {'-' if value in (None, '') else value}")
    for title, rows in found.tables.items():
        newest = type(rows)(rows.columns, rows.rows[-NEWEST:])
        print(f"\n{title}" + (f", the newest {NEWEST} of {len(rows.rows)}" if len(rows.rows) > NEWEST else ""))
        export.write(newest, "table", None)
    return 0


def traffic(options: argparse.Namespace) -> int:
    with stored.opened(options.db) as store:
        run_id = stored.run(store, options.run)["id"]
        rows = stored.traffic(store, run_id, options.bbox, (options.from_s, options.to_s))
    export.write(rows, options.format, options.output)
    return 0


def encounters(options: argparse.Namespace) -> int:
    limits = {"within_m": options.within, "min_sog_kn": options.min_sog, "count": options.count}
    with stored.opened(options.db) as store:
        run_id = stored.run(store, options.run)["id"]
        rows = stored.encounters(store, run_id, options.bbox, (options.from_s, options.to_s), limits)
    export.write(rows, options.format, options.output)
    return 0


def replay(options: argparse.Namespace) -> int:
    with stored.opened(options.db) as store:
        run_id, span = stored.run(store, options.run)["id"], (options.from_s, options.to_s)
        recorded_frames.write(store, run_id, *span, options.bbox, form=options.format, output=options.output)
    return 0


def sensors(options: argparse.Namespace) -> int:
    with stored.opened(options.db) as store:
        rows = stored.sensors(store, stored.run(store, options.run)["id"], options.at)
    if options.json:
        print(json.dumps(as_plain([dict(zip(rows.columns, row, strict=True)) for row in rows.rows]), allow_nan=False))
        return 0
    export.write(stored.registration(rows), "table", None)
    return 0


def query(options: argparse.Namespace) -> int:
    if options.name is None:
        export.write(stored.questions(), options.format, options.output)
        return 0
    parameters = dict(options.settings)
    if options.run is not None and parameters.setdefault("run", str(options.run)) != str(options.run):
        raise BadInput(f"query: got --run {options.run} and --set run={parameters['run']}, needed one of them")
    asked = {"from_s": ("--from", options.from_s), "to_s": ("--to", options.to_s), "kind": ("--kind", options.kind)}
    for key, (option, value) in asked.items():
        if value is not None and parameters.setdefault(key, str(value)) != str(value):
            raise BadInput(f"query: got {option} {value} and --set {key}={parameters[key]}, needed one of them")
    with stored.opened(options.db) as store:
        rows = stored.answer(store, options.name, parameters)
    export.write(rows, options.format, options.output)
    return 0
