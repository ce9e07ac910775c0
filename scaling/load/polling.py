"""An operator's console in a process of its own: asks the database again and again, and says at the end how long it waited.

python -m scaling.load.polling URL [--every S]; ends, and prints JSON, when its standard input is closed.
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

BOX_M = 10_000.0  # half of the side


def poll(url: str, every_s: float, over: threading.Event) -> dict[str, float]:
    """Milliseconds that the vessels in 20 km by 20 km took to answer, around one radar after the other."""
    waited: list[float] = []
    seen = 0
    with store.open_store(url, create=False) as kept:
        run_id = store.latest_run(kept)
        sites = _radars(store.sensors(kept, run_id))
        while not (waited and over.wait(every_s)):
            south, west = offset_deg(sites[len(waited) % len(sites)], np.array([-BOX_M, -BOX_M])).tolist()
            north, east = offset_deg(np.array([south, west]), np.array([2.0 * BOX_M, 2.0 * BOX_M])).tolist()
            begun = time.perf_counter()
            seen += len(store.picture(kept, run_id, bbox=(south, west, north, east)).rows)
            waited.append(1e3 * (time.perf_counter() - begun))
    spread = {f"p{share}_ms": float(np.percentile(waited, share)) for share in (50, 95, 99)} if waited else {}
    return {"questions": len(waited), "rows": seen, **spread, "longest_ms": max(waited, default=0.0)}


def _radars(sensors: store.Rows) -> Floats:
    """Latitude and longitude of the radars. (R, 2)"""
    kind, latitude, longitude = (sensors.columns.index(name) for name in ("kind", "latitude_deg", "longitude_deg"))
    return np.array([[row[latitude], row[longitude]] for row in sensors.rows if row[kind] == "radar"])


def _wait_for_the_end(over: threading.Event) -> None:
    sys.stdin.read()
    over.set()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("url")
    parser.add_argument("--every", type=float, default=0.1, metavar="S", help="between an answer and the next question")
    asked = parser.parse_args()
    over = threading.Event()
    threading.Thread(target=_wait_for_the_end, args=(over,), daemon=True).start()
    print(json.dumps(poll(asked.url, asked.every, over)))


if __name__ == "__main__":
    main()
