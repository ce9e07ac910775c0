"""`runs`, `picture`, `track`, `traffic`, `encounters`, `replay`, `sensors` and `query`: read a database, print or export the answer."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from coastwatch.batches import COVER_AZIMUTHS, COVER_RANGES
from coastwatch.errors import InputError
from coastwatch.operators import export, presentation, recorded_frames
from coastwatch.operators.selection import selected
from coastwatch.spelling import printable
from coastwatch.store import Rows, Store, delete_run, keep_runs


def picture(options: argparse.Namespace) -> int:
    with presentation.opened(options.db) as store:
        run = presentation.run(store, options.run)
        rows = presentation.picture(store, run["id"], options.at, options.bbox)
        warn_beyond_end(store, run, options.at)
    heading = presentation.heading(run, rows)
    main = options.format == "table" and not options.columns
    _write(rows, options, heading, presentation.MAIN_COLUMNS if main else ())
    if options.format != "table" and presentation.ending(run):
        print(f"coastwatch: warning: {printable(heading)}", file=sys.stderr)
    return 0


def warn_beyond_end(store: Store, run: Mapping[str, Any], at_s: float | None) -> None:
    """Warns on stderr where an instant is after the end of a run. Args: as of `presentation.beyond_end`."""
    if said := presentation.beyond_end(store, run, at_s):
        print(f"coastwatch: warning: --at: {printable(said)}", file=sys.stderr)


def _write(rows: Rows, options: argparse.Namespace, heading: str = "", columns: Sequence[str] = ()) -> None:
    """Writes rows as the options of `arguments.add_rows` want them. Args: columns: unless the options name some."""
    chosen = selected(rows, options.sort, options.limit, options.columns or columns)
    export.write(chosen, options.format, options.output, heading)


def runs(options: argparse.Namespace) -> int:
    if (options.action is None) != (options.number is None):
        raise InputError(f"runs: got {options.action}, needed a number too: `runs delete ID`, `runs keep N`")
    with presentation.opened(options.db) as store:
        if options.action == "delete":
            delete_run(store, options.number)
        elif options.action == "keep":
            keep_runs(store, options.number)
        rows = presentation.runs(store)
    _write(rows if options.format == "json" else presentation.runs_table(rows), options)
    return 0


def track(options: argparse.Namespace) -> int:
    with presentation.opened(options.db) as store:
        found = presentation.vessel(store, presentation.run(store, options.run), options.vessel)
    if options.format == "json":
        lists = {key.replace(" ", "_"): export.as_objects(rows) for key, rows in found.tables.items()}
        (details,) = export.as_objects(Rows(tuple(found.details), [tuple(found.details.values())]))
        said = {"statistics": {key.replace(" ", "_"): meaning for key, meaning in found.meanings.items()}}
        export.write_text(json.dumps({**details, **lists, **said}, allow_nan=False) + "\n", options.output)
    elif options.format == "gpx":
        export.write_text(export.as_gpx_track(found.name, found.paths()), options.output)
    elif options.format != "table":
        export.write(found.tables["history"], options.format, options.output)
    else:
        export.write_text("".join(_track_text(found, options.limit)), options.output)
    return 0


def _track_text(found: presentation.Vessel, newest: int) -> Iterator[str]:
    """Details and tables of a vessel for a terminal. Args: newest: rows of each table."""
    for name, value in found.details.items():
        yield f"{name.replace('_', ' '):<16} {export.cell(name, value)}\n"
    for title, rows in found.tables.items():
        left_out = f", the newest {newest} of {len(rows.rows)}" if len(rows.rows) > newest else ""
        meaning = f" (statistic: {found.meanings[title]})" if rows.rows and title in found.meanings else ""
        yield f"\n{title}{left_out}{meaning}\n{export.as_table(Rows(rows.columns, rows.rows[-newest:]))}"


def traffic(options: argparse.Namespace) -> int:
    with presentation.opened(options.db) as store:
        run_id = presentation.run(store, options.run)["id"]
        rows = presentation.traffic(store, run_id, options.bbox, (options.from_s, options.to_s))
    _write(rows, options)
    return 0


def encounters(options: argparse.Namespace) -> int:
    limits = {"within_m": options.within, "min_sog_kn": options.min_sog, "count": options.count}
    with presentation.opened(options.db) as store:
        run_id = presentation.run(store, options.run)["id"]
        rows = presentation.encounters(store, run_id, options.bbox, (options.from_s, options.to_s), limits)
    _write(rows, options)
    return 0


def replay(options: argparse.Namespace) -> int:
    with presentation.opened(options.db) as store:
        run_id, span = presentation.run(store, options.run)["id"], (options.from_s, options.to_s)
        recorded_frames.write(store, run_id, *span, options.bbox, form=options.format, output=options.output)
    return 0


SCREEN_CELLS = (12, 4)
"""Sectors and rings of the cover of a radar in a table on a screen; the other formats have all cells."""


def sensors(options: argparse.Namespace) -> int:
    with presentation.opened(options.db) as store:
        run = presentation.run(store, options.run)
        if options.cover or options.clutter:
            coarse = SCREEN_CELLS if options.format == "table" else (COVER_AZIMUTHS, COVER_RANGES)
            _write(presentation.radar_cover(store, run["id"], options.clutter, *coarse), options)
            return 0
        if options.standing:
            _write(presentation.standing_echoes(store, run), options)
            return 0
        rows = presentation.sensors(store, run["id"], options.at)
        warn_beyond_end(store, run, options.at)
    _write(rows if options.format == "json" else presentation.registration(rows, run["settings"]), options)
    return 0


def query(options: argparse.Namespace) -> int:
    if options.name is None:
        _write(presentation.questions(), options)
        return 0
    parameters = dict(options.settings)
    if options.run is not None and parameters.setdefault("run", str(options.run)) != str(options.run):
        raise InputError(f"query: got --run {options.run} and --set run={parameters['run']}, needed one of them")
    asked = {"from_s": ("--from", options.from_s), "to_s": ("--to", options.to_s), "kind": ("--kind", options.kind)}
    for key, (option, value) in asked.items():
        if value is not None and parameters.setdefault(key, str(value)) != str(value):
            raise InputError(f"query: got {option} {value} and --set {key}={parameters[key]}, needed one of them")
    with presentation.opened(options.db) as store:
        rows = presentation.answer(store, options.name, parameters, options.at)
        if options.at is not None:
            warn_beyond_end(store, presentation.run(store, int(parameters["run"]) if "run" in parameters else None), options.at)
    _write(rows, options)
    return 0
