"""`coastwatch traffic`, `coastwatch encounters` and `coastwatch replay`: what was in a box, who was near whom, and recorded pictures."""

from __future__ import annotations

import argparse
from typing import Any

from coastwatch.operators.cli.arguments import add_db, add_format, add_run, box, count, utc


def add(commands: Any) -> None:
    """Adds `traffic`, `encounters` and `replay` to the parser."""
    text = (
        "What was in a box between two instants: the points from which vessels were there, by vessel and time. Until `to_utc` a "
        "vessel went on from a point at its course and speed, within `store.history_error_m`. Places to 0.2 m."
    )
    traffic = commands.add_parser("traffic", help="show what was in a box in a span of time", description=text)
    _add_span(traffic)
    add_format(traffic)
    traffic.set_defaults(act=_traffic)
    text = (
        "Pairs of vessels that came close to each other in a box between two instants, the closest first, and when and where."
    )
    encounters = commands.add_parser("encounters", help="show who was near whom in a span of time", description=text)
    _add_span(encounters)
    encounters.add_argument("--within", metavar="M", type=float, default=500.0, help="metres at the closest (default: 500)")
    encounters.add_argument(
        "--min-sog", metavar="KN", type=float, default=1.0, help="knots that at least one of the two makes (default: 1)"
    )
    encounters.add_argument("--count", metavar="N", type=count, default=100, help="pairs at most (default: 100)")
    add_format(encounters)
    encounters.set_defaults(act=_encounters)
    text = (
        "The pictures of a run that was recorded (`store.recording`), one row a vessel and cycle, every column as it was computed: "
        "velocity in metres a second east and north, the covariance of both with the position, times in seconds since 1970, "
        "members as source:track."
    )
    replay = commands.add_parser("replay", help="export recorded pictures", description=text)
    add_db(replay)
    add_run(replay)
    replay.add_argument(
        "--from", metavar="UTC", type=utc, dest="from_s", help="first instant (default: the first recorded cycle)"
    )
    replay.add_argument("--to", metavar="UTC", type=utc, dest="to_s", help="last instant (default: the last recorded cycle)")
    replay.add_argument("--bbox", metavar="S,W,N,E", type=box, help="only vessels in this box, degrees")
    replay.add_argument("--format", choices=("csv", "parquet"), default="csv", help="default: csv")
    replay.add_argument("--output", metavar="FILE", help="write here, not to the terminal; Parquet needs it")
    replay.set_defaults(act=_replay)


def _add_span(parser: argparse.ArgumentParser) -> None:
    add_db(parser)
    add_run(parser)
    parser.add_argument(
        "--bbox", metavar="S,W,N,E", type=box, required=True, help="the box, degrees; W > E crosses the antimeridian"
    )
    parser.add_argument("--from", metavar="UTC", type=utc, dest="from_s", required=True, help="first instant, ISO 8601")
    parser.add_argument("--to", metavar="UTC", type=utc, dest="to_s", required=True, help="last instant, ISO 8601")


def _traffic(options: argparse.Namespace) -> int:
    from coastwatch.operators import export, stored

    with stored.opened(options.db) as store:
        run_id = stored.run(store, options.run)["id"]
        rows = stored.traffic(store, run_id, options.bbox, (options.from_s, options.to_s))
    export.write(rows, options.format, options.output)
    return 0


def _encounters(options: argparse.Namespace) -> int:
    from coastwatch.operators import export, stored

    limits = {"within_m": options.within, "min_sog_kn": options.min_sog, "count": options.count}
    with stored.opened(options.db) as store:
        run_id = stored.run(store, options.run)["id"]
        rows = stored.encounters(store, run_id, options.bbox, (options.from_s, options.to_s), limits)
    export.write(rows, options.format, options.output)
    return 0


def _replay(options: argparse.Namespace) -> int:
    from coastwatch.operators import recorded_frames, stored

    with stored.opened(options.db) as store:
        run_id = stored.run(store, options.run)["id"]
        recorded_frames.write(
            store, run_id, options.from_s, options.to_s, options.bbox, form=options.format, output=options.output
        )
    return 0
