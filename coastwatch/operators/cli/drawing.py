"""`plot`: the picture as a PNG."""

from __future__ import annotations

import argparse

from coastwatch.operators import presentation, scene
from coastwatch.operators.cli.read import warn_beyond_end
from coastwatch.operators.plot import write


def plot(options: argparse.Namespace) -> int:
    with presentation.opened(options.db) as store:
        run = presentation.run(store, options.run)
        chosen = {"names": options.names, "vessels": options.vessel, "cover": options.cover}
        warn_beyond_end(store, run, options.at)
        drawn = scene.load(store, run, options.at, options.bbox, options.coastline, **chosen)
    write(drawn, options.output)
    print(options.output)
    return 0
