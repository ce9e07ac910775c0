"""`coastwatch plot`: the picture as a PNG."""

from __future__ import annotations

import argparse
from typing import Any

from coastwatch.operators.cli.arguments import add_db, add_moment, add_run


def add(commands: Any) -> None:
    """Adds `plot` to the parser."""
    text = "Draw the picture: coverage, vessels by source, bearing lines, uncertainty, trails and the coastline."
    plot = commands.add_parser("plot", help="draw the picture as a PNG", description=text)
    add_db(plot)
    add_run(plot)
    add_moment(plot)
    plot.add_argument("--output", metavar="PNG", default="picture.png", help="file to write (default: picture.png)")
    plot.add_argument(
        "--coastline", metavar="FILE", help="GeoJSON of land or shore lines (default: the scenario's, where it has one)"
    )
    plot.set_defaults(act=_plot)


def _plot(options: argparse.Namespace) -> int:
    from coastwatch.operators import plot, scene, stored

    with stored.opened(options.db) as store:
        what = scene.load(store, stored.run(store, options.run), options.at, options.bbox, options.coastline)
    plot.write(what, options.output)
    print(options.output)
    return 0
