"""Time of queries on a database with a long history: `python -m scaling.load.queries [--points N] [--database PATH]`.

If the database does not exist, `filling` makes it first and it is deleted at the end; `--keep` keeps it for the next run. One that
exists is asked as it is, whatever its size, and stays. The queries are the public functions
of the store that the command line uses. A box is 20 km by 20 km around a vessel, so most boxes are in ports. A time window is ten
minutes. Warm: the file was read once and is in the system's page cache, as far as memory goes. Cold: the file is dropped from the
page cache and the connection is new.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from coastwatch import store
from coastwatch.batches import Floats
from coastwatch.geodesy import offset_deg
from coastwatch.store import Store
from scaling.load.filling import fill

HALF_BOX_M = 10_000.0
WINDOW_S = 600.0
SKIPPED_S = 120.0  # start of the history, not queried
FIXES = ("vessel_id", "latitude_deg", "longitude_deg", "sog_kn", "cog_deg", "mmsi", "flags", "time_s", "updated_s")
MEASURED = (*FIXES, "major_m", "minor_m", "orientation_deg")

Query = Callable[[Store], Any]


@dataclass(frozen=True)
class StoredRun:
    """A run in the database, with V vessels in its current picture."""

    run_id: int
    cycles: int
    from_s: float
    to_s: float
    vessel_id: Any  # (V,)
    position_deg: Floats  # (V, 2)
    mmsi: Any  # (V,)


def newest_run(database: Store) -> StoredRun:
    """The newest run of a database."""
    run_id = store.latest_run(database)
    now = store.picture(database, run_id)
    runs = store.runs(database)
    cycles, period_s, start_s = (runs.column(name)[0] for name in ("cycles_stored", "period_s", "start_s"))
    position = np.stack([now.array("latitude_deg"), now.array("longitude_deg")], 1)
    end_s = start_s + cycles * period_s
    return StoredRun(run_id, cycles, start_s, end_s, now.array("vessel_id"), position, now.array("mmsi"))


@dataclass(frozen=True)
class RandomArguments:
    """Random arguments of queries; each method gives the values of one or two positional arguments."""

    run: StoredRun
    rng: np.random.Generator

    def box(self) -> list[Any]:
        """South, west, north, east around a vessel, degrees."""
        middle = self.run.position_deg[self.rng.integers(len(self.run.position_deg))]
        south, west = offset_deg(middle, np.array([-HALF_BOX_M, -HALF_BOX_M])).tolist()
        north, east = offset_deg(middle, np.array([HALF_BOX_M, HALF_BOX_M])).tolist()
        return [(south, west, north, east)]

    def window(self) -> list[Any]:
        """Ten minutes of the past."""
        begin = float(self.rng.uniform(self.run.from_s + SKIPPED_S, self.run.to_s - WINDOW_S))
        return [begin, begin + WINDOW_S]

    def newest_window(self) -> list[Any]:
        """The last ten minutes."""
        return [self.run.to_s - WINDOW_S, self.run.to_s]

    def instant(self) -> list[Any]:
        """An instant of the past."""
        return [float(self.rng.uniform(self.run.from_s + SKIPPED_S, self.run.to_s))]

    def vessel(self) -> list[Any]:
        """The id of a current vessel."""
        return [int(self.rng.choice(self.run.vessel_id))]

    def position(self) -> list[Any]:
        """The position of a current vessel, as parameters of an operator query."""
        latitude, longitude = self.run.position_deg[self.rng.integers(len(self.run.position_deg))].tolist()
        return [{"latitude_deg": latitude, "longitude_deg": longitude}]

    def mmsi(self) -> list[Any]:
        """The MMSI of a current vessel, as parameters of an operator query."""
        return [{"mmsi": int(self.rng.choice(self.run.mmsi[self.run.mmsi >= 0]))}]


def omitted() -> list[Any]:
    """An optional argument that is left out."""
    return [None]


def queries(run: StoredRun, rng: np.random.Generator) -> dict[str, Callable[[], Query]]:
    """A factory per kind of query; each call gives a query with new random arguments."""
    random = RandomArguments(run, rng)

    def factory(function: Callable[..., Any], *draws: Callable[[], list[Any]], **fixed: Any) -> Callable[[], Query]:
        def new_query() -> Query:
            arguments = [argument for draw in draws for argument in draw()]
            return lambda database: function(database, run.run_id, *arguments, **fixed)

        return new_query

    parameters = {"near_position": random.position, "history_of_mmsi": random.mmsi}
    operator_queries = {
        f"question {name}": factory(_operator_query, parameters.get(name, lambda: [{}]), name=name)
        for name in store.operator_queries()
    }
    return {
        "box now": factory(store.picture, omitted, random.box),
        "box in ten minutes of the past: points": factory(store.traffic, random.box, random.window),
        "box in the last ten minutes: points": factory(store.traffic, random.box, random.newest_window),
        "box in ten minutes of the past: who was near whom": factory(store.encounters, random.box, random.window),
        "one vessel through the whole span": factory(store.history, omitted, omitted, random.vessel),
        "one vessel, all that is stored of it": factory(store.track, random.vessel),
        "box at a past instant": factory(store.picture, random.instant, random.box),
        "whole picture at a past instant, measured columns": factory(store.picture, random.instant, omitted, columns=MEASURED),
        "whole picture at a past instant, all columns": factory(store.picture, random.instant),
        "whole picture now, all columns": factory(store.picture),
        **operator_queries,
    }


def _operator_query(database: Store, run_id: int, parameters: dict[str, Any], name: str) -> Any:
    return store.operator_query(database, name, {"run": run_id, **parameters})


def timed_ms(query: Query, database: Store) -> tuple[float, float, int]:
    """Wall and processor milliseconds of a query, and the number of rows of its answer."""
    begun, cpu = time.perf_counter(), time.process_time()
    answer = query(database)
    took = 1e3 * (time.perf_counter() - begun), 1e3 * (time.process_time() - cpu)
    rows = answer["history"] if isinstance(answer, dict) else answer
    return *took, len(rows) if isinstance(rows, store.Table) else len(rows.rows)


def time_warm(url: str, new_query: Callable[[], Query], count: int) -> dict[str, float]:
    """Percentiles over this number of queries, after some that do not count."""
    with store.open_store(url, create=False) as database:
        for _ in range(max(count // 5, 3)):
            timed_ms(new_query(), database)
        found = np.array([timed_ms(new_query(), database) for _ in range(count)])
    (p50, cpu_p50), (p95, cpu_p95) = np.percentile(found[:, :2], (50, 95), axis=0)
    return {"p50_ms": p50, "p95_ms": p95, "cpu_p50_ms": cpu_p50, "cpu_p95_ms": cpu_p95, "rows": found[:, 2].mean()}


def time_cold(url: str, path: Path, new_query: Callable[[], Query], count: int) -> dict[str, float]:
    """Median and longest wall time over this number of queries, each on a cold file."""
    found = []
    for _ in range(count):
        _drop_from_page_cache(path)
        with store.open_store(url, create=False) as database:
            found.append(timed_ms(new_query(), database)[0])
    return {"cold_p50_ms": float(np.median(found)), "cold_longest_ms": max(found)}


def _read_into_page_cache(path: Path) -> None:
    with open(path, "rb") as file:
        while file.read(1 << 24):
            pass


def _drop_from_page_cache(path: Path) -> None:
    with open(path, "rb") as file:
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=float, default=50e6, metavar="N", help="of the history that is made (default: 50e6)")
    parser.add_argument("--vessels", type=int, default=100_000, metavar="N", help="at any time (default: 100,000)")
    default = Path("/tmp/coastwatch-queries/queries.db")
    parser.add_argument("--database", type=Path, default=default, metavar="PATH", help=f"default: {default}")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--ask", type=int, default=60, metavar="N", help="queries of each kind, warm; a sixth of it cold")
    parser.add_argument("--only", default="", metavar="TEXT", help="queries whose name contains this")
    parser.add_argument("--warm", action="store_true", help="nothing cold")
    parser.add_argument("--keep", action="store_true", help="do not delete the database that was made")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    options.database.parent.mkdir(parents=True, exist_ok=True)
    made = not options.database.exists()
    if made:
        _fill_database(options)
    else:
        print(f"# {options.database} exists: --points, --vessels and --keep have no effect", file=comments(options), flush=True)
    try:
        _measure(f"sqlite:///{options.database}", options)
    finally:
        if made and not options.keep:
            _delete(options.database)


def _fill_database(options: argparse.Namespace) -> None:
    """Fill a database under a temporary name, so that a file with the final name is always complete."""
    partial = options.database.with_name(options.database.name + ".part")
    _delete(partial)
    begun, cpu = time.perf_counter(), time.process_time()

    def progress(what: str) -> None:
        print(f"# {time.perf_counter() - begun:4.0f} s: {what}", file=comments(options), flush=True)

    fill(f"sqlite:///{partial}", int(options.points), options.vessels, options.seed, progress)
    partial.rename(options.database)
    progress(f"filled, processor time {time.process_time() - cpu:.0f} s, {options.database.stat().st_size / 1e9:.2f} GB")


def comments(options: argparse.Namespace) -> TextIO:
    """The stream for comments: with --json, standard output is JSON alone."""
    return sys.stderr if options.json else sys.stdout


def _delete(database: Path) -> None:
    for ending in ("", "-wal", "-shm"):
        database.with_name(database.name + ending).unlink(missing_ok=True)


def _measure(url: str, options: argparse.Namespace) -> None:
    with store.open_store(url, create=False) as database:
        run = newest_run(database)
    if run.to_s - run.from_s <= SKIPPED_S + WINDOW_S:
        least = f"needed more than {SKIPPED_S + WINDOW_S:g} s: more --points, or fewer --vessels"
        raise SystemExit(f"error: {options.database}: got {run.to_s - run.from_s:g} s of history, {least}")
    print(
        f"# {os.cpu_count()} processors, load {os.getloadavg()[0]:.2f}; {run.cycles} cycles, {len(run.vessel_id)} vessels now",
        "# history of the national picture, store settings by default, made without fusion",
        sep="\n",
        file=comments(options),
    )
    every = queries(run, np.random.default_rng([options.seed, 72]))
    wanted = {name: new_query for name, new_query in every.items() if options.only in name}
    _read_into_page_cache(options.database)
    results = {name: _print(name, time_warm(url, new_query, options.ask), options) for name, new_query in wanted.items()}
    if not options.warm:
        for name, new_query in wanted.items():
            results[name] |= _print(name, time_cold(url, options.database, new_query, max(options.ask // 6, 3)), options)
    if options.json:
        print(json.dumps(results))


def _print(name: str, figures: dict[str, float], options: argparse.Namespace) -> dict[str, float]:
    if not options.json:
        print(f"{name:<52}" + "  ".join(f"{key} {value:8.1f}" for key, value in figures.items()), flush=True)
    return figures


if __name__ == "__main__":
    main()
