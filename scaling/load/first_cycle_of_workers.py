"""How long is the first cycle of a run beside a later one, by the kind of workers?

    python -m scaling.load.first_cycle_of_workers [METHOD ...]

METHOD is threads, processes or ray. Three radars, each a region of its own, 1,000 vessels, two workers, everything compiled. Wall
time of all stages without the store. The later cycle is the median of the last ten.
"""

from __future__ import annotations

import argparse
import sqlite3
import statistics
import tempfile
from contextlib import closing
from pathlib import Path

from coastwatch.scenario import load_scenario
from coastwatch.server.run import run_scenario
from scaling.load.stages import NOT_COMPUTE

SITES = (("north", -23.0, -43.1), ("south", -23.1, -43.1), ("west", -23.05, -43.15))
RADAR = '{{name = "{0}", region = "{0}", latitude_deg = {1}, longitude_deg = {2}, range_nm = 5.0, rpm = 20.0}}'
SETTINGS = {
    "radars": f"[{', '.join(RADAR.format(*site) for site in SITES)}]",
    "tracks.plot_origin": "estimated",
    "warmup_s": "0",
    "cycles": "20",
    "spots.count": "3",
}
LAST = 10
METHODS = "threads", "processes"


def compute_ms(method: str) -> list[float]:
    """Milliseconds of all stages in each cycle of a run."""
    left_out = ", ".join(f"'{stage}'" for stage in (*NOT_COMPUTE, "store_wait"))
    query = f"SELECT sum(seconds) FROM stage_timing WHERE stage NOT IN ({left_out}) GROUP BY cycle ORDER BY cycle"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.db"
        scenario = load_scenario("context-driven-1000", {**SETTINGS, "workers.method": method})
        run_scenario(scenario, seed=1, workers=2, database=f"sqlite:///{path}")
        with closing(sqlite3.connect(path)) as database:
            return [1e3 * row[0] for row in database.execute(query)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("methods", nargs="*", default=METHODS, metavar="METHOD", help="default: threads processes")
    methods = parser.parse_args().methods
    print(f"{'workers':12s}{'first cycle ms':>16s}{'later ms':>12s}{'ratio':>8s}")
    for method in methods:
        ms = compute_ms(method)
        later = statistics.median(ms[-LAST:])
        print(f"{method:12s}{ms[0]:16.1f}{later:12.1f}{ms[0] / later:8.1f}", flush=True)


if __name__ == "__main__":
    main()
