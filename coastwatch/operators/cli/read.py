"""Commands that read a database, from `runs` to `plot`: they print, export or draw the answer."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

from coastwatch.batches import COVER_AZIMUTHS, COVER_RANGES
from coastwatch.errors import InputError
from coastwatch.operators import export, presentation, recorded_frames
from coastwatch.operators.cli.progress import report_progress
from coastwatch.operators.selection import selected
from coastwatch.spelling import printable
from coastwatch.store import Rows, Store, delete_run, keep_runs, operator_queries


@contextmanager
def _run(options: argparse.Namespace) -> Iterator[tuple[Store, presentation.Run]]:
    """The database, and the run that the options name or that holds their time. Where other runs hold some of it too it warns."""
    given = vars(options)
    with presentation.opened(options.db) as store:
        span_s = given.get("from_s"), given.get("to_s")
        run, said = presentation.run_of_time(store, options.run, given.get("at"), span_s)
        _warn(said)
        yield store, run


def _warn(text: str) -> None:
    """Prints a warning; none for an empty text."""
    if text:
        print(f"coastwatch: warning: {printable(text)}", file=sys.stderr)


def picture(options: argparse.Namespace) -> int:
    with _run(options) as (store, run):
        rows = presentation.picture(store, run["id"], options.at, options.bbox)
        warn_beyond_end(store, run, options.at)
    heading = presentation.heading(run, rows)
    main = options.format == "table" and not options.columns
    _write(rows, options, heading, presentation.MAIN_COLUMNS if main else ())
    if options.format != "table" and presentation.ending(run):
        print(f"coastwatch: warning: {printable(heading)}", file=sys.stderr)
    return 0


def warn_beyond_end(store: Store, run: presentation.Run, at_s: float | None) -> None:
    """Warns on stderr where an instant is after the end of a run. Args: as of `presentation.beyond_end`."""
    if warning := presentation.beyond_end(store, run, at_s):
        print(f"coastwatch: warning: --at: {printable(warning)}", file=sys.stderr)


def _write(rows: Rows, options: argparse.Namespace, heading: str = "", columns: Sequence[str] = ()) -> None:
    """Writes rows as the options of `arguments.add_rows` want them. Args: columns: unless the options name some."""
    chosen = selected(rows, options.sort, options.limit, options.columns or columns)
    export.write(chosen, options.format, options.output, heading)


def runs(options: argparse.Namespace) -> int:
    if (options.action is None) != (options.number is None):
        raise InputError(f"runs: got {options.action}, needed a number too: `runs delete ID`, `runs keep N`")
    if options.action == "keep" and not options.number:
        raise InputError("runs keep: got 0, needed 1 or more; `runs delete ID` deletes the last one")
    with presentation.opened(options.db) as store:
        if options.action is not None:
            with report_progress("run") as show:
                if options.action == "delete":
                    delete_run(store, options.number, show)
                else:
                    keep_runs(store, options.number, on_part=show)
        rows = presentation.runs(store)
    _write(rows if options.format == "json" else presentation.runs_table(rows), options)
    return 0


NEWEST_ROWS = 20
"""Of each table of a vessel, unless the options say."""


def track(options: argparse.Namespace) -> int:
    if options.limit is not None and options.format != "table":
        raise InputError(
            f"track --limit: got it with --format {options.format}, needed --format table: the others have all rows"
        )
    limit = NEWEST_ROWS if options.limit is None else options.limit
    with _run(options) as (store, run):
        if options.decided:
            return _decided(options, limit, presentation.decided_path(store, run["id"], options.vessel))
        vessel = presentation.vessel(store, run, options.vessel)
    if options.format == "json":
        export.write_text(json.dumps(export.as_vessel(vessel), allow_nan=False) + "\n", options.output)
    elif options.format == "gpx":
        export.write_text(export.as_gpx_track(vessel.name, vessel.paths()), options.output)
    elif options.format != "table":
        export.write(vessel.tables["history"], options.format, options.output)
    else:
        text = [f"{name.replace('_', ' '):<16} {export.cell(name, value)}\n" for name, value in vessel.details.items()]
        for title, rows in vessel.tables.items():
            left_out = f", the newest {limit} of {len(rows.rows)}" if len(rows.rows) > limit else ""
            meaning = f" (statistic: {vessel.meanings[title]})" if rows.rows and title in vessel.meanings else ""
            newest = Rows(rows.columns, rows.rows[-limit:])
            text.append(f"\n{title}{left_out}{meaning}\n{export.as_table(newest)}")
        export.write_text("".join(text), options.output)
    return 0


def _decided(options: argparse.Namespace, limit: int, rows: Rows) -> int:
    """Writes the corrected past of a vessel. Args: limit: newest rows of a table."""
    if options.format == "gpx":
        export.write_text(export.as_gpx_track(f"vessel {options.vessel}, decided", [rows] if rows.rows else []), options.output)
        return 0
    newest = Rows(rows.columns, rows.rows[-limit:]) if options.format == "table" else rows
    export.write(newest, options.format, options.output)
    return 0


def traffic(options: argparse.Namespace) -> int:
    with _run(options) as (store, run):
        rows = presentation.traffic(store, run["id"], options.bbox, (options.from_s, options.to_s))
    _write(rows, options)
    return 0


def encounters(options: argparse.Namespace) -> int:
    limits = {"within_m": options.within, "min_sog_kn": options.min_sog, "count": options.count}
    with _run(options) as (store, run):
        rows = presentation.encounters(store, run["id"], options.bbox, (options.from_s, options.to_s), **limits)
    _write(rows, options)
    return 0


def replay(options: argparse.Namespace) -> int:
    with _run(options) as (store, run):
        recorded_frames.write(
            store, run["id"], options.from_s, options.to_s, options.bbox, form=options.format, output=options.output
        )
    return 0


SCREEN_CELLS = (12, 4)
"""Sectors and rings of the cover of a radar in a table on a screen; the other formats have all cells."""


VIDEO_COLUMNS = (
    "radar", "silent_s", "turn_s", "spokes_a_turn", "lost_share", "spokes_lost", "parts_lost", "plots_a_turn", "threshold_db",
    "detection_probability", "false_plots_a_turn", "cells", "cell_m", "range_m", "bits", "text", "troubles",
)  # fmt: skip


def _health_of_video(address: str) -> Rows:
    """The radars that send video to a server. Raises: InputError: it does not answer so."""
    import httpx2 as httpx  # it takes a fifth of a second

    token = os.environ.get("COASTWATCH_TOKEN")
    headers = {} if token is None else {"Authorization": f"Bearer {token}"}
    try:
        answer = httpx.get(f"{address.rstrip('/')}/api/v1/feeds", headers=headers, timeout=10.0)
        answer.raise_for_status()
        feeds = answer.json()["feeds"]
        radars = [radar | {"radar": radar["name"]} for feed in feeds for radar in feed.get("radars", ())]
    except (httpx.HTTPError, httpx.InvalidURL, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"--video: got {address!r}: {error}; needed the address of a server, http://127.0.0.1:8100") from error
    rows = [tuple("; ".join(v) if isinstance(v := one.get(name), list) else v for name in VIDEO_COLUMNS) for one in radars]
    return Rows(VIDEO_COLUMNS, rows)


def sensors(options: argparse.Namespace) -> int:
    if options.video is not None:
        _write(_health_of_video(options.video), options)
        return 0
    with _run(options) as (store, run):
        if options.cover or options.clutter:
            coarse = SCREEN_CELLS if options.format == "table" else (COVER_AZIMUTHS, COVER_RANGES)
            _write(presentation.radar_cover(store, run["id"], options.clutter, *coarse), options)
            return 0
        if options.standing:
            _write(presentation.standing_echoes(store, run), options)
            return 0
        rows = presentation.sensors(store, run["id"], options.at)
        warn_beyond_end(store, run, options.at)
    _write(rows if options.format == "json" else presentation.registration(rows, run), options)
    return 0


def query(options: argparse.Namespace) -> int:
    if options.name is None:
        _write(presentation.questions(), options)
        return 0
    presentation.check_span(options.from_s, options.to_s)
    parameters = dict(options.settings)
    if options.run is not None and parameters.setdefault("run", str(options.run)) != str(options.run):
        raise InputError(f"query: got --run {options.run} and --set run={parameters['run']}, needed one of them")
    asked = {"from_s": ("--from", options.from_s), "to_s": ("--to", options.to_s), "kind": ("--kind", options.kind)}
    for key, (option, value) in asked.items():
        if value is not None and parameters.setdefault(key, str(value)) != str(value):
            raise InputError(f"query: got {option} {value} and --set {key}={parameters[key]}, needed one of them")
    question = operator_queries().get(options.name)
    typed = [(key, option) for key, (option, value) in asked.items() if value is not None]
    if question is not None and (unknown := [option for key, option in typed if key not in question.parameters]):
        raise InputError(f"query {options.name}: got {', '.join(unknown)}, needed {question.needed}")
    with presentation.opened(options.db) as store:
        span_s = _instant(parameters.get("from_s")), _instant(parameters.get("to_s"))
        of_time = options.at is not None or span_s != (None, None)
        if question is not None and question.of_run and "run" not in parameters and of_time:
            run, said = presentation.run_of_time(store, None, options.at, span_s)
            parameters["run"] = str(run["id"])
            _warn(said)
        rows = presentation.answer(store, options.name, parameters, options.at)
        if options.at is not None:
            warn_beyond_end(store, presentation.run(store, int(parameters["run"]) if "run" in parameters else None), options.at)
    _write(rows, options)
    return 0


def _instant(text: str | None) -> float | None:
    """The instant of a parameter; none of a text that is none: the question refuses it by its name."""
    with suppress(ValueError):
        return None if text is None else float(text)
    return None


def plot(options: argparse.Namespace) -> int:
    if options.video is not None:
        return _plot_video(options)
    of_video = {"a scenario": options.scenario, "--turn": options.turn, "--set": options.settings or None}
    for name, value in of_video.items():
        if value is not None:
            raise InputError(f"plot: got {name}, needed --video RADAR too: a turn of the radar video of a scenario")
    from coastwatch.operators import plot, scene  # matplotlib takes a second, and only a plot needs it

    with _run(options) as (store, run):
        warn_beyond_end(store, run, options.at)
        chosen = {"names": options.names, "vessels": options.vessel, "cover": options.cover}
        drawn = scene.load(store, run, options.at, options.bbox, options.coastline, **chosen)
    plot.write(drawn, options.output)
    print(options.output)
    return 0


def _plot_video(options: argparse.Namespace) -> int:
    """Draws one turn of radar video. Raises: InputError, OSError: as of `radar_turn.load`; options that do not go together."""
    if options.scenario is None:
        raise InputError("plot --video: got no scenario, needed one: coastwatch plot SCENARIO --video RADAR")
    if options.at is not None and options.turn is not None:
        raise InputError("plot --video: got --at and --turn, needed one of them")
    of_runs = {"--run": options.run, "--bbox": options.bbox, "--coastline": options.coastline, "--cover": options.cover}
    for name, value in {**of_runs, "--vessel": options.vessel or None}.items():
        if value is not None:
            raise InputError(f"plot --video: got {name}, which is of the picture of a run, needed the command without it")
    from coastwatch.operators import radar_turn  # it imports models and matplotlib
    from coastwatch.scenario import load_scenario

    turn = radar_turn.load(load_scenario(options.scenario, dict(options.settings)), options.video, options.at, options.turn)
    radar_turn.write(turn, options.output)
    print(options.output)
    return 0
