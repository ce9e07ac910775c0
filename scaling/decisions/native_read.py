"""What does it cost to read many rows as arrays: by tuples, by SQLite's functions from compiled code a value, by a compiled aggregate?

Run: python -m scaling.decisions.native_read [ROWS]     (the middle way was measured once, by a throw-away loop over sqlite3_step and
sqlite3_column_*: 0.5 us a row of 13 columns where the aggregate took 0.28 and tuples 2.7, each call taking the connection's lock)
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from sqlalchemy import insert, select

from coastwatch import store
from coastwatch.store.bulk import append
from coastwatch.store.collect import arrays, collected
from coastwatch.store.opening import reading, writing
from coastwatch.store.tables import Base, History

ROUNDS = 7


def least_us(act: Callable[[], Any], rows: int) -> float:
    """Microseconds of the processor a row, the least of some rounds."""
    used = []
    for _ in range(ROUNDS):
        begun = time.process_time()
        act()
        used.append(time.process_time() - begun)
    return 1e6 * min(used) / rows


def main(rows: int) -> None:
    rng = np.random.default_rng(1)
    with tempfile.TemporaryDirectory() as folder, store.open_store(str(Path(folder) / "x.db")) as kept:
        with writing(kept) as connection:
            connection.exec_driver_sql("PRAGMA foreign_keys = OFF")
            run = {"id": 1, "settings": {}, "faults": []}
            texts = dict.fromkeys(("scenario", "title", "version", "command", "started_utc", "status"), "")
            numbers = dict.fromkeys(("seed", "period_s", "cycles", "warmup_cycles", "start_s", "workers"), 0)
            connection.execute(insert(Base.metadata.tables["run"]), [{**run, **texts, **numbers}])
            real = rng.uniform(0.0, 90.0, (9, rows))
            whole = np.zeros(rows, np.int64)
            moved = [*real[:8], whole + 710_000_000, whole, whole, whole.astype(bool)]
            append(connection, Base.metadata.tables["history"], [1, 1, np.arange(rows), *moved])
        columns = [c for c in History.__table__.columns if c.name not in ("run_id", "previous_cycle")]
        query = select(*columns).where(History.run_id == 1, History.cycle == 1)
        with reading(kept) as connection:
            ways = {
                "tuples": lambda: connection.execute(query).all(),
                "tuples into arrays": lambda: arrays(connection.execute(query).all(), [c.type for c in columns]),
                "compiled aggregate": lambda: collected(connection, query, rows),
            }
            for name, act in ways.items():
                print(f"{name:<20} {least_us(act, rows):.2f} us a row of {len(columns)} columns")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200_000)
