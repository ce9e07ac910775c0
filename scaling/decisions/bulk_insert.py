"""How do rows like those of `vessel` get into the database fastest? A copy of a table made as bytes, compiled code on SQLite's handle,
executemany; and COPY.

Run: .venv/bin/python scaling/decisions/bulk_insert.py [ROWS] [URL]      (URL: of an empty PostgreSQL schema; none: SQLite only)
All ways write the same rows into the same empty table in turn, the least of a few rounds counts: seconds of the processor, so that
other work on the machine says little. The commit is not in it: it is the same for all.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "store"))

import store_world as world

from coastwatch import store as kept
from coastwatch.store import bulk, image, write_ahead
from coastwatch.store.cells import Blobs, Column, Named, Texts
from coastwatch.store.opening import Store, writing
from coastwatch.store.tables import Base

ROUNDS = 5
WAYS = {"image": (1, image.load), "compiled": (1, lambda *given: False), "executemany": (10**9, image.load)}
"""`bulk.NATIVE_FROM` and `image.load`, which make the choice."""


def rows(run_id: int, count: int) -> list[Column]:
    """Columns of table `vessel`: two numbers, ten reals, an MMSI for half of them, flags, one of three texts, ten float64 as bytes."""
    rng = np.random.default_rng([11, count])
    reals: list[Column] = [rng.uniform(-90.0, 90.0, count) for _ in range(10)]
    mmsi = np.where(rng.random(count) < 0.5, 710_000_000 + np.arange(count), -1)
    blob = rng.random((count, 10)).view(np.uint8)
    texts = Texts(rng.integers(0, 3, count), ("guanabara,ais", "ais", "ilha"))
    return [
        run_id,
        np.arange(count),
        *reals,
        Named(mmsi),
        np.zeros(count, np.int64),
        texts,
        Blobs(blob, np.ones(count, np.bool_)),
    ]


def seconds(store: Store, columns: list[Column], clock: Callable[[], float]) -> float:
    """What one round took; its rows are taken back."""
    with writing(store) as connection:
        write_ahead.fit(connection, len(columns[1]))  # type: ignore[arg-type]
        begun = clock()
        bulk.append(connection, Base.metadata.tables["vessel"], columns)
        took = clock() - begun
        connection.rollback()
    return took


def main(count: int, url: str | None) -> None:
    with tempfile.TemporaryDirectory() as folder, kept.open_store(f"{folder}/x.db") as store:
        columns = rows(world.begin(store), count)
        best = dict.fromkeys(WAYS, np.inf)
        for _ in range(ROUNDS):
            for way, choice in WAYS.items():
                bulk.NATIVE_FROM, image.load = choice
                best[way] = min(best[way], seconds(store, columns, time.process_time))
        for way, took in best.items():
            print(f"SQLite, {way:<12} {took:.3f} s of the processor, {count / took / 1e6:.2f} M rows/s")
        print(
            f"executemany {best['executemany'] / best['compiled']:.2f} of compiled, that {best['compiled'] / best['image']:.2f} of image"
        )
    if url is not None:
        with kept.open_store(url) as store:
            columns = rows(world.begin(store), count)
            took = min(seconds(store, columns, time.perf_counter) for _ in range(ROUNDS))
            print(f"PostgreSQL, COPY in binary {took:.3f} s, {count / took / 1e6:.2f} M rows/s")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200_000, sys.argv[2] if len(sys.argv) > 2 else None)
