"""`plot`: the picture as a PNG."""

from __future__ import annotations

import argparse

from coastwatch.operators import scene, stored
from coastwatch.operators.plot import write


def plot(options: argparse.Namespace) -> int:
    with stored.opened(options.db) as store:
        drawn = scene.load(store, stored.run(store, options.run), options.at, options.bbox, options.coastline)
    write(drawn, options.output)
    print(options.output)
    return 0
