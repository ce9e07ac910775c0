"""`coastwatch sensors`: the radars, AIS receivers and sonars of a run, when they were heard, and what is known of their errors."""

from __future__ import annotations

import argparse
import json
from typing import Any

from coastwatch.operators.cli.arguments import add_db, add_run, utc


def add(commands: Any) -> None:
    """Adds `sensors` to the parser."""
    text = (
        "The sensors of a run: specification, when each was heard last, and its registration: the azimuth bias, range bias and time "
        "lag that are taken out of a radar's reports, one standard deviation behind +-, and how well they are known (unknown, "
        "acquiring, settled); the estimate of the lag, which is taken out only once it is known well; of a sonar the bias of its "
        "bearings. Degrees clockwise, metres too long, seconds too late. AIS reports do not say which receiver heard them: of each "
        "the newest is shown."
    )
    sensors = commands.add_parser("sensors", help="show sensors and their registration", description=text)
    add_db(sensors)
    add_run(sensors)
    sensors.add_argument(
        "--at", metavar="UTC", type=utc, help="instant, ISO 8601, e.g. 2026-07-01T12:00:00Z (default: the last cycle)"
    )
    sensors.add_argument("--json", action="store_true", help="print one JSON list, a sensor an object, with all columns")
    sensors.set_defaults(act=_sensors)


def _sensors(options: argparse.Namespace) -> int:
    from coastwatch.operators import export, stored
    from coastwatch.operators.cli.summary import as_plain

    with stored.opened(options.db) as store:
        rows = stored.sensors(store, stored.run(store, options.run)["id"], options.at)
    if options.json:
        print(json.dumps(as_plain([dict(zip(rows.columns, row, strict=True)) for row in rows.rows]), allow_nan=False))
        return 0
    export.write(stored.registration(rows), "table", None)
    return 0
