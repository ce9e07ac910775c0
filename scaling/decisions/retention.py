"""Does the deletion of old rows delay the writing of a cycle? One database of a million points, written on with and without limits.

    python -m scaling.decisions.retention [POINTS CYCLES]

A run of 270 vessels has a point of each in every cycle, until there are so many. Its file is copied three times. Then the same
cycles are written to each copy in turns: without limits; with limits so that each cycle deletes about what it adds; with limits so
low that all cycles delete a backlog. Milliseconds of `write_cycle`.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "store"))

import store_world as world

from coastwatch import store as kept
from coastwatch.operators.cli.arguments import count
from coastwatch.scenario import StoreSettings
from coastwatch.store import Store, write_cycle
from coastwatch.store.schema.database import reading

VESSELS = 270
POINTS, CYCLES = 1_000_000, 400
EVERY_POINT = {"history_max_s": 0.0}


def write(store: Store, number: int, keep: StoreSettings) -> float:
    """Write a cycle. Returns: milliseconds."""
    cycle, reports = world.cycle_of(number, VESSELS), world.reports_of(number, VESSELS)
    begun_s = time.perf_counter()
    write_cycle(store, 1, number, cycle, reports, world.SECONDS, keep)
    return 1e3 * (time.perf_counter() - begun_s)


def rows(store: Store, table: str) -> int:
    with reading(store) as connection:
        return int(connection.exec_driver_sql(f"SELECT count(*) FROM {table}").scalar_one())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("points", metavar="POINTS", nargs="?", type=count, default=POINTS)
    parser.add_argument("cycles", metavar="CYCLES", nargs="?", type=count, default=CYCLES)
    options = parser.parse_args()
    cycles, filled = options.cycles, options.points // VESSELS
    hours = filled * world.PERIOD_S / 3600.0
    limits = dict.fromkeys(("history_hours", "details_hours", "event_hours", "audit_hours", "picture_hours"), hours)
    backlog = dict.fromkeys(limits, 1.0 / 3600.0) | {"event_hours": 1.0}
    kinds = {
        "without limits": StoreSettings(**EVERY_POINT),
        "steady": StoreSettings(**EVERY_POINT, **limits),
        "backlog": StoreSettings(**EVERY_POINT, **backlog),
    }
    with tempfile.TemporaryDirectory() as folder:
        first = Path(folder) / "first.db"
        with kept.open_store(str(first)) as store:
            world.begin(store)
            for number in range(filled):
                write(store, number, kinds["without limits"])
        stores = {}
        for name in kinds:
            path = Path(folder) / f"{name.split()[0]}.db"
            shutil.copy(first, path)
            stores[name] = kept.open_store(str(path))
            print(f"{name}: {rows(stores[name], 'history')} points, {rows(stores[name], 'association')} associations")
        took: dict[str, list[float]] = {name: [] for name in kinds}
        for number in range(filled, filled + cycles):
            for name, keep in kinds.items():
                took[name].append(write(stores[name], number, keep))
        for name, values in took.items():
            ordered = sorted(values[5:])
            figures = statistics.median(ordered), ordered[int(0.95 * len(ordered))], ordered[-1]
            left = rows(stores[name], "history"), rows(stores[name], "cycle")
            print(f"{name}: median {figures[0]:.1f}, p95 {figures[1]:.1f}, longest {figures[2]:.1f} ms; left {left}")
        for store in stores.values():
            store.close()


if __name__ == "__main__":
    main()
