"""A database that Coastwatch wrote with schema 0006, as text, and the pictures that were written into it.

`old_database.sql.gz` was made in a checkout of commit 4cba02e with this file and `past_world.py` copied to its tests/store:
`.venv/bin/python tests/store/old_database.py`. It has blocks of the history, and a recording over two key cycles.
"""

from __future__ import annotations

import gzip
import sqlite3
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import past_world
import store_world as world

from coastwatch import store as kept
from coastwatch.batches import Picture

CYCLES, VESSELS = 30, 16
DUMP = Path(__file__).with_name("old_database.sql.gz")


def pictures() -> list[Picture]:
    """What was written, a picture a cycle. Covariances are of every size and not symmetric, so that each number shows."""
    out = []
    for number, picture in enumerate(past_world.pictures(23, CYCLES, VESSELS, jumps=0.02)):
        rng = np.random.default_rng(24)
        covariance = rng.normal(0.0, 1.0, (len(picture), 4, 4)) * 10.0 ** rng.integers(-20, 20, (len(picture), 1, 1))
        covariance[:2] = np.eye(4) * (1.0 + 1e-13 * number)
        covariance[2:3] = np.nan
        out.append(replace(picture, covariance=covariance))
    return out


def unpack(path: Path) -> None:
    """Write the database to an SQLite file."""
    with sqlite3.connect(path) as raw:
        raw.executescript(gzip.decompress(DUMP.read_bytes()).decode())
        raw.execute("PRAGMA journal_mode = WAL")


def _make(path: Path) -> None:
    from coastwatch.store import blocks  # type: ignore[attr-defined]

    blocks.BLOCK_POINTS = 30
    every = {"recording": True, "associations_every": 10, "spots_every": 10, "registration_every": 10}
    with kept.open_store(str(path)) as store:
        run = world.begin(store)
        past_world.write(store, run, pictures(), keep=past_world.KEEP.model_copy(update=every))
    with sqlite3.connect(path) as raw:
        DUMP.write_bytes(gzip.compress("\n".join(raw.iterdump()).encode(), 9, mtime=0))


if __name__ == "__main__":
    _make(Path(sys.argv[1] if len(sys.argv) > 1 else "old.db"))
