"""Does the deletion of old rows delay the writing of a cycle? One database of a million points, written on with and without limits.

    python -m scaling.decisions.retention [POINTS CYCLES]

A run of 270 vessels has a point of each in every cycle, until there are so many. Its file is copied three times. Then the same
cycles are written to each copy in turns: without limits; with limits so that each cycle deletes about what it adds; with limits so
low that all cycles delete a backlog. Milliseconds until the cycle is in the database, and of the deletion after that.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "worlds"))

import store_world as world

from coastwatch import store as kept
from coastwatch.operators.cli.arguments import count
from coastwatch.scenario import StoreSettings
from coastwatch.store import CycleRecord, Store, write_cycle
from coastwatch.store.schema.database import reading

module = import_module("coastwatch.store.write.write_cycle")
VESSELS = 270
POINTS, CYCLES = 1_000_000, 400
EVERY_POINT = {"history_max_s": 0.0}


def write(store: Store, number: int, keep: StoreSettings) -> tuple[float, float]:
    """Write a cycle. Returns: milliseconds until it is there, and of the deletion of old rows."""
    record = CycleRecord(number, world.cycle_of(number, VESSELS), world.reports_of(number, VESSELS), world.SECONDS)
    begun_s = time.perf_counter()
    write_cycle(store, 1, record, keep)
    ended_s, deleted_s = time.perf_counter(), sum(DELETED_S)
    DELETED_S.clear()
    return 1e3 * (ended_s - begun_s - deleted_s), 1e3 * deleted_s


DELETED_S: list[float] = []


def timed(delete: Callable[..., None]) -> Callable[..., None]:
    """The deletion of old rows, which notes how long it takes."""

    def made(*given: Any) -> None:
        begun_s = time.perf_counter()
        delete(*given)
        DELETED_S.append(time.perf_counter() - begun_s)

    return made


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
        vars(module)["_delete_old"] = timed(vars(module)["_delete_old"])
        took: dict[str, list[tuple[float, float]]] = {name: [] for name in kinds}
        for number in range(filled, filled + cycles):
            for name, keep in kinds.items():
                took[name].append(write(stores[name], number, keep))
        for name, values in took.items():
            for what, column in zip(("written", "deleted"), zip(*values[5:], strict=True), strict=True):
                ordered = sorted(column)
                figures = statistics.median(ordered), ordered[int(0.95 * len(ordered))], ordered[-1]
                print(f"{name}, {what}: median {figures[0]:.1f}, p95 {figures[1]:.1f}, longest {figures[2]:.1f} ms")
            print(f"{name}: {rows(stores[name], 'history')} points and {rows(stores[name], 'cycle')} cycles are left")
        for store in stores.values():
            store.close()


if __name__ == "__main__":
    main()
