"""How is a box in a span of time, or one vessel, found among the points of the history, and what does the way cost at every write?

Run: python -m scaling.decisions.history_blocks [CYCLES [VESSELS]]

The points are those of the bounded-error rule on the national picture. Each way writes the same rows, a transaction a cycle, and is
asked the same questions: a box of 20 km around a vessel in ten minutes, and one vessel through the whole span.
"""

from __future__ import annotations

import sqlite3
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from coastwatch import store
from coastwatch.geodesy import offset_deg
from coastwatch.store import blocks
from coastwatch.store.opening import reading
from scaling.load.filling import fill

INDEXES = {
    "no index": "",
    "index (run, vessel, cycle)": "CREATE INDEX way ON history (run_id, vessel_id, cycle)",
    "index (run, cycle, latitude)": "CREATE INDEX way ON history (run_id, cycle, latitude_deg)",
}
LAST = 40
"""Cycles at the end whose cost is told: an index costs more the larger it is."""


def write(path: Path, source: Path, index: str, cycles: int) -> tuple[float, float]:
    """Milliseconds of the processor and kB of the write-ahead log a cycle, at the end."""
    raw = sqlite3.connect(path, isolation_level=None)
    raw.execute("PRAGMA journal_mode = WAL")
    raw.execute("PRAGMA synchronous = NORMAL")
    raw.execute("PRAGMA cache_size = -16384")
    raw.execute(f"ATTACH '{source}' AS source")
    (sql,) = raw.execute("SELECT sql FROM source.sqlite_master WHERE name = 'history'").fetchone()
    raw.execute(sql)
    if index:
        raw.execute(index)
    took, grown = [], []
    for number in range(cycles):
        rows = raw.execute("SELECT * FROM source.history WHERE run_id = 1 AND cycle = ?", (number,)).fetchall()
        raw.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        begun = time.process_time()
        raw.execute("BEGIN IMMEDIATE")
        raw.executemany(f"INSERT INTO history VALUES ({', '.join('?' * len(rows[0]))})", rows)
        raw.execute("COMMIT")
        took.append(1e3 * (time.process_time() - begun))
        grown.append(Path(f"{path}-wal").stat().st_size / 1e3)
    raw.close()
    return float(np.median(took[-LAST:])), float(np.median(grown[-LAST:]))


def blocks_cost(url: str, cycles: int) -> tuple[float, float, float]:
    """Milliseconds a block and a cycle, and bytes a point: blocks are made once more, in transactions that are taken back."""
    with store.open_store(url) as kept:
        with reading(kept) as connection:
            ends = connection.exec_driver_sql("SELECT from_cycle, to_cycle, points FROM history_block").all()[-8:]
            size = connection.exec_driver_sql("SELECT sum(length(data) + 12) FROM history_cell").scalar_one()
            points = connection.exec_driver_sql("SELECT sum(points) FROM history_block").scalar_one()
        took = []
        with kept.engine.connect().execution_options(writes=True) as connection:
            for first, last, count in ends:
                with connection.begin() as transaction:
                    blocks.forget_blocks(connection, 1, from_cycle=first)
                    begun = time.process_time()
                    blocks._write(connection, 1, first, last, blocks._stored(connection, 1, first, last, count))
                    took.append(1e3 * (time.process_time() - begun))
                    transaction.rollback()
        each = float(np.median(took[1:]))
        return each, each * len(ends) / (ends[-1].to_cycle + 1 - ends[0].from_cycle), size / points


def ask(name: str, act: Callable[[], int], count: int = 15) -> None:
    used, rows = [], 0
    for _ in range(count):
        begun = time.process_time()
        rows += act()
        used.append(1e3 * (time.process_time() - begun))
    print(f"  {name:<58} {np.median(used):8.1f} ms, {rows / count:.0f} rows")


def ask_raw(path: Path, index: str, cycles: int, boxes: np.ndarray, vessels: np.ndarray) -> None:
    """By plain SQL, with what the index is good for."""
    raw = sqlite3.connect(path)
    draw = np.random.default_rng(1)
    box = "h.latitude_deg BETWEEN ? AND ? AND h.longitude_deg BETWEEN ? AND ?"
    in_box = f"SELECT h.* FROM history h WHERE h.run_id = 1 AND h.cycle BETWEEN ? AND ? AND {box}"
    if "latitude" in index:
        numbers = "WITH RECURSIVE n (k) AS (SELECT ? UNION ALL SELECT k + 1 FROM n WHERE k < ?)"
        in_box = f"{numbers} SELECT h.* FROM n CROSS JOIN history h WHERE h.run_id = 1 AND h.cycle = n.k AND {box}"

    def boxed() -> int:
        south, west, north, east = boxes[draw.integers(len(boxes))]
        first = int(draw.integers(20, cycles - 200))
        return len(raw.execute(in_box, (first, first + 200, south, north, west, east)).fetchall())

    ask("box in ten minutes", boxed, 5)
    if "vessel" in index:
        of_one = "SELECT * FROM history WHERE run_id = 1 AND vessel_id = ?"
        ask("one vessel", lambda: len(raw.execute(of_one, (int(draw.choice(vessels)),)).fetchall()))


def main(cycles: int, vessels: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "source.db"
        fill(f"sqlite:///{source}", cycles * vessels // 12, vessels, 1, lambda said: None)
        with store.open_store(str(source), create=False) as kept:
            cycles = store.runs(kept).column("cycles_stored")[0]
            now = store.picture(kept, 1, columns=("vessel_id", "latitude_deg", "longitude_deg"))
            place = np.stack([now.array("latitude_deg"), now.array("longitude_deg")], 1)[:: max(len(now) // 500, 1)]
            boxes = np.concatenate([offset_deg(place, np.full((1, 2), -1e4)), offset_deg(place, np.full((1, 2), 1e4))], 1)
            for name, index in INDEXES.items():
                path = Path(folder) / "way.db"
                ms, kilobytes = write(path, source, index, cycles)
                print(f"{name}: {ms:.1f} ms of the processor and {kilobytes:.0f} kB of log a cycle")
                ask_raw(path, index, cycles, boxes, now.array("vessel_id"))
                for ending in ("", "-wal", "-shm"):
                    path.with_name(path.name + ending).unlink(missing_ok=True)
            each, a_cycle, size = blocks_cost(str(source), cycles)
            print(
                f"blocks by place, chain of points: {each:.0f} ms a block, {a_cycle:.1f} ms a cycle, {size:.0f} bytes a point"
            )
            draw = np.random.default_rng(1)
            start_s = store.runs(kept).column("start_s")[0]

            def boxed() -> int:
                from_s = start_s + 3.0 * float(draw.integers(20, cycles - 200))
                return len(store.traffic(kept, 1, tuple(boxes[draw.integers(len(boxes))].tolist()), from_s, from_s + 600.0))

            boxed()
            ask("box in ten minutes (store.traffic)", boxed)
            ask(
                "one vessel (store.history)",
                lambda: len(store.history(kept, 1, vessel_id=int(draw.choice(now.array("vessel_id"))))),
            )


if __name__ == "__main__":
    given = [int(word) for word in sys.argv[1:]]
    main(*given, *(400, 100_000)[len(given) :])
