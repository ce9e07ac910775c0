"""Size and processor time of the frames that viewers get: of drawn vessels, or of the recorded pictures of a run.

python -m scaling.load.frames --vessels 100000
coastwatch run guanabara --set store.recording=true --db x.db
python -m scaling.load.frames --db x.db
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections import deque
from collections.abc import Iterator

import numpy as np

from coastwatch import store
from coastwatch.operators.api.hub import Viewer
from coastwatch.operators.api.wire import Encoder, Frame
from coastwatch.server.live_picture import OWN, LivePicture, of_store
from coastwatch.store import Table

PERIOD_S, START_S, CYCLES = 3.0, 1.75e9, 20


def drawn(vessels: int) -> Iterator[LivePicture]:
    """Pictures of vessels on steady courses with estimates that wander by metres; a third is moored, 2 % turn in a cycle."""
    g = np.random.default_rng(1)
    latitude, longitude = g.uniform(49, 61, vessels), g.uniform(-5, 12, vessels)
    sog, cog = np.where(g.random(vessels) < 0.3, 0.0, g.gamma(6, 2, vessels)), g.uniform(0, 360, vessels)
    whole = {"vessel_id": np.arange(1, vessels + 1), "mmsi": np.full(vessels, -1), "flags": np.zeros(vessels, np.int64)}
    none = np.zeros(vessels, np.int64)
    for cycle in range(CYCLES):
        cog = (cog + np.where(g.random(vessels) < 0.02, g.normal(0, 20, vessels), g.normal(0, 0.3, vessels))) % 360
        way = sog * PERIOD_S * 1852 / 3600 / 111_120
        latitude = latitude + way * np.cos(np.radians(cog))
        longitude = longitude + way * np.sin(np.radians(cog)) / np.cos(np.radians(latitude))
        time_s = START_S + PERIOD_S * cycle
        found = {name: np.full(vessels, time_s) for name in OWN} | whole | {"nav_status": none - 1}
        found |= {"latitude_deg": latitude + g.normal(0, 1.5, vessels) / 111_120, "longitude_deg": longitude, "sog_kn": sog}
        found |= {"cog_deg": cog, "major_m": np.full(vessels, 12.0), "minor_m": np.full(vessels, 6.0)}
        own = Table(OWN, tuple(found[name] for name in OWN))
        yield LivePicture(1, cycle, time_s, own, np.full(vessels, 3, np.uint8), none, [""], {})


def recorded(url: str) -> Iterator[LivePicture]:
    """The recorded pictures of the latest run."""
    with store.open_store(url, create=False) as opened:
        run_id = store.latest_run(opened)
        for cycle in store.replay(opened, run_id):
            yield of_store(opened, run_id, cycle.cycle, cycle.time_s, cycle.time_s)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vessels", type=int, default=100_000)
    parser.add_argument("--db", help="of a recorded run, instead of drawn vessels")
    options = parser.parse_args()
    encoder, viewer, frames = Encoder(1), Viewer(0, 0), deque[Frame](maxlen=41)
    seconds: dict[str, list[float]] = {"find what moved": [], "full frame": [], "delta": []}
    sizes: dict[str, list[int]] = {"full frame": [], "delta": []}
    for picture in recorded(options.db) if options.db else drawn(options.vessels):
        began = time.thread_time()
        frames.append(encoder.frame(picture))
        made = time.thread_time()
        full = frames[-1].full()
        filled = time.thread_time()
        delta = viewer.message(frames)
        seconds["find what moved"].append(made - began)
        seconds["full frame"].append(filled - made)
        sizes["full frame"].append(len(full))
        if len(frames) > 1:
            seconds["delta"].append(time.thread_time() - filled)
            sizes["delta"].append(len(delta))
    for name, taken in seconds.items():
        print(f"{name}: median {statistics.median(taken) * 1e3:.1f} ms, longest {max(taken) * 1e3:.1f} ms")
    full_bytes, delta_bytes = statistics.median(sizes["full frame"]), statistics.mean(sizes["delta"])
    print(
        f"bytes: full {full_bytes:,.0f}, delta {delta_bytes:,.0f} in the mean, {100 * delta_bytes / full_bytes:.1f} % of a full frame"
    )


if __name__ == "__main__":
    main()
