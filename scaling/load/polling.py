"""An operator's console in a process of its own: queries the database repeatedly and prints its waiting times as JSON.

    python -m scaling.load.polling URL [--every S]

It ends when its standard input is closed.
"""

from __future__ import annotations

import argparse
import json
import sys
import threading
import time

import numpy as np

from coastwatch import store
from coastwatch.batches import Floats
from coastwatch.geodesy import offset_deg

HALF_BOX_M = 10_000.0


def poll(url: str, every_s: float, stop: threading.Event) -> dict[str, float]:
    """Waiting times in milliseconds for the vessels in a box of 20 km by 20 km around one radar after the other.

    Args: every_s: pause between an answer and the next query; stop: ends the polling after at least one query.
    """
    waited_ms: list[float] = []
    rows = 0
    with store.open_store(url, create=False) as database:
        run_id = store.latest_run(database)
        sites = _radars(store.sensors(database, run_id))
        while not (waited_ms and stop.wait(every_s)):
            south, west = offset_deg(sites[len(waited_ms) % len(sites)], np.array([-HALF_BOX_M, -HALF_BOX_M])).tolist()
            north, east = offset_deg(np.array([south, west]), np.array([2.0 * HALF_BOX_M, 2.0 * HALF_BOX_M])).tolist()
            begun = time.perf_counter()
            rows += len(store.picture(database, run_id, bbox=(south, west, north, east)).rows)
            waited_ms.append(1e3 * (time.perf_counter() - begun))
    percentiles = {f"p{p}_ms": float(np.percentile(waited_ms, p)) for p in (50, 95, 99)} if waited_ms else {}
    return {"questions": len(waited_ms), "rows": rows, **percentiles, "longest_ms": max(waited_ms, default=0.0)}


def _radars(sensors: store.Rows) -> Floats:
    """Latitude and longitude of the radars, degrees. Returns: (R, 2)."""
    kind, latitude, longitude = (sensors.columns.index(name) for name in ("kind", "latitude_deg", "longitude_deg"))
    return np.array([[row[latitude], row[longitude]] for row in sensors.rows if row[kind] == "radar"])


def _stop_at_end_of_input(stop: threading.Event) -> None:
    sys.stdin.read()
    stop.set()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("url")
    parser.add_argument("--every", type=float, default=0.1, metavar="S", help="between an answer and the next query")
    options = parser.parse_args()
    stop = threading.Event()
    threading.Thread(target=_stop_at_end_of_input, args=(stop,), daemon=True).start()
    print(json.dumps(poll(options.url, options.every, stop)))


if __name__ == "__main__":
    main()
