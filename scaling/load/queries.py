"""How long questions take on a database with a long history: `python -m scaling.load.queries [--points N] [--database PATH]`.

Fills the database first where it is not there (scaling/load/filling.py), and keeps it only if `--keep` is given: one that is there is
asked again. Everything is asked through the public functions of the store that the command line uses. A box is 20 km by 20 km around
a vessel, so that most are in ports; a window is ten minutes. Warm: the file was read once and is in the system's memory as far as that
goes. Cold: a fresh connection, and the file dropped from that memory before each question.
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
EARLY_S = 120.0  # the first minutes are not asked about
MEASURED = ("vessel_id", "latitude_deg", "longitude_deg", "sog_kn", "cog_deg", "mmsi", "flags", "time_s", "updated_s")
MEASURED += ("major_m", "minor_m", "orientation_deg")

Ask = Callable[[Store], Any]


@dataclass(frozen=True)
class Asked:
    """The run that is asked about, and from what its questions are drawn."""

    run_id: int
    cycles: int
    from_s: float
    to_s: float
    vessel_id: Any
    place: Floats
    mmsi: Any


def look(kept: Store) -> Asked:
    """The newest run."""
    run_id = store.latest_run(kept)
    now = store.picture(kept, run_id)
    runs = store.runs(kept)
    cycles, period_s, start_s = (runs.column(name)[0] for name in ("cycles_stored", "period_s", "start_s"))
    place = np.stack([now.array("latitude_deg"), now.array("longitude_deg")], 1)
    return Asked(run_id, cycles, start_s, start_s + cycles * period_s, now.array("vessel_id"), place, now.array("mmsi"))


@dataclass(frozen=True)
class Drawn:
    """What questions are about, drawn anew for each."""

    of: Asked
    rng: np.random.Generator

    def box(self) -> list[Any]:
        middle = self.of.place[self.rng.integers(len(self.of.place))]
        south, west = offset_deg(middle, np.array([-HALF_BOX_M, -HALF_BOX_M])).tolist()
        north, east = offset_deg(middle, np.array([HALF_BOX_M, HALF_BOX_M])).tolist()
        return [(south, west, north, east)]

    def span(self) -> list[Any]:
        begin = float(self.rng.uniform(self.of.from_s + EARLY_S, self.of.to_s - WINDOW_S))
        return [begin, begin + WINDOW_S]

    def newest(self) -> list[Any]:
        return [self.of.to_s - WINDOW_S, self.of.to_s]

    def instant(self) -> list[Any]:
        return [float(self.rng.uniform(self.of.from_s + EARLY_S, self.of.to_s))]

    def vessel(self) -> list[Any]:
        return [int(self.rng.choice(self.of.vessel_id))]

    def position(self) -> list[Any]:
        latitude, longitude = self.of.place[self.rng.integers(len(self.of.place))].tolist()
        return [{"latitude_deg": latitude, "longitude_deg": longitude}]

    def sender(self) -> list[Any]:
        return [{"mmsi": int(self.rng.choice(self.of.mmsi[self.of.mmsi >= 0]))}]


def nothing() -> list[Any]:
    """An argument that is left out."""
    return [None]


def questions(of: Asked, rng: np.random.Generator) -> dict[str, Callable[[], Ask]]:
    """Each gives another question of its kind every time."""
    drawn = Drawn(of, rng)

    def asks(function: Callable[..., Any], *draw: Callable[[], list[Any]], **fixed: Any) -> Callable[[], Ask]:
        def another() -> Ask:
            given = [argument for each in draw for argument in each()]
            return lambda kept: function(kept, of.run_id, *given, **fixed)

        return another

    given = {"near_position": drawn.position, "history_of_mmsi": drawn.sender}
    return {
        "box now": asks(store.picture, nothing, drawn.box),
        "box in ten minutes of the past: points": asks(store.traffic, drawn.box, drawn.span),
        "box in the last ten minutes: points": asks(store.traffic, drawn.box, drawn.newest),
        "box in ten minutes of the past: who was near whom": asks(store.encounters, drawn.box, drawn.span),
        "one vessel through the whole span": asks(store.history, nothing, nothing, drawn.vessel),
        "one vessel, all that is stored of it": asks(store.track, drawn.vessel),
        "box at a past instant": asks(store.picture, drawn.instant, drawn.box),
        "whole picture at a past instant, measured columns": asks(store.picture, drawn.instant, nothing, columns=MEASURED),
        "whole picture at a past instant, all columns": asks(store.picture, drawn.instant),
        "whole picture now, all columns": asks(store.picture),
        **{f"question {name}": asks(_asked, given.get(name, lambda: [{}]), name=name) for name in store.operator_queries()},
    }


def _asked(kept: Store, run_id: int, parameters: dict[str, Any], name: str) -> Any:
    return store.operator_query(kept, name, {"run": run_id, **parameters})


def timed_ms(ask: Ask, kept: Store) -> tuple[float, float, int]:
    """Milliseconds by the clock and of the processor, and rows of the answer."""
    begun, used = time.perf_counter(), time.process_time()
    answer = ask(kept)
    took = 1e3 * (time.perf_counter() - begun), 1e3 * (time.process_time() - used)
    rows = answer["history"] if isinstance(answer, dict) else answer
    return *took, len(rows) if isinstance(rows, store.Table) else len(rows.rows)


def warm(url: str, ask: Callable[[], Ask], count: int) -> dict[str, float]:
    """Of so many questions after some that are not counted."""
    with store.open_store(url, create=False) as kept:
        for _ in range(max(count // 5, 3)):
            timed_ms(ask(), kept)
        found = np.array([timed_ms(ask(), kept) for _ in range(count)])
    (p50, cpu_p50), (p95, cpu_p95) = np.percentile(found[:, :2], (50, 95), axis=0)
    return {"p50_ms": p50, "p95_ms": p95, "cpu_p50_ms": cpu_p50, "cpu_p95_ms": cpu_p95, "rows": found[:, 2].mean()}


def cold(url: str, path: Path, ask: Callable[[], Ask], count: int) -> dict[str, float]:
    found = []
    for _ in range(count):
        _forget(path)
        with store.open_store(url, create=False) as kept:
            found.append(timed_ms(ask(), kept)[0])
    return {"cold_p50_ms": float(np.median(found)), "cold_longest_ms": max(found)}


def _remember(path: Path) -> None:
    """Have the system read a file into its memory."""
    with open(path, "rb") as file:
        while file.read(1 << 24):
            pass


def _forget(path: Path) -> None:
    """Drop a file from the system's memory."""
    with open(path, "rb") as file:
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=float, default=50e6, metavar="N", help="of the history (50e6)")
    parser.add_argument("--vessels", type=int, default=100_000, metavar="N", help="at any time")
    parser.add_argument("--database", type=Path, default=Path("/tmp/coastwatch-queries/queries.db"), metavar="PATH")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--ask", type=int, default=60, metavar="N", help="questions of each kind, warm; a sixth of it cold")
    parser.add_argument("--only", default="", metavar="TEXT", help="questions whose name has this in it")
    parser.add_argument("--warm", action="store_true", help="nothing cold")
    parser.add_argument("--keep", action="store_true", help="do not delete the database")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    asked.database.parent.mkdir(parents=True, exist_ok=True)
    url = f"sqlite:///{asked.database}"
    if not asked.database.exists():
        _build(asked)
    _report(url, asked)
    if not asked.keep:
        _delete(asked.database)


def _build(asked: argparse.Namespace) -> None:
    """Fill a database under another name: what has the name that was asked for is whole, and is used again."""
    growing = asked.database.with_name(asked.database.name + ".part")
    _delete(growing)
    begun, used = time.perf_counter(), time.process_time()
    say = lambda said: print(f"# {time.perf_counter() - begun:4.0f} s: {said}", file=comments(asked), flush=True)  # noqa: E731
    fill(f"sqlite:///{growing}", int(asked.points), asked.vessels, asked.seed, say)
    growing.rename(asked.database)
    say(f"filled, {time.process_time() - used:.0f} s of the processor, {asked.database.stat().st_size / 1e9:.2f} GB")


def comments(asked: argparse.Namespace) -> TextIO:
    """Where to say what is not an answer: standard output is JSON alone where that is asked for."""
    return sys.stderr if asked.json else sys.stdout


def _delete(database: Path) -> None:
    for ending in ("", "-wal", "-shm"):
        database.with_name(database.name + ending).unlink(missing_ok=True)


def _report(url: str, asked: argparse.Namespace) -> None:
    with store.open_store(url, create=False) as kept:
        of = look(kept)
    if of.to_s - of.from_s <= EARLY_S + WINDOW_S:
        least = f"needed more than {EARLY_S + WINDOW_S:g} s: more --points, or fewer --vessels"
        raise SystemExit(f"error: {asked.database}: got {of.to_s - of.from_s:g} s of history, {least}")
    print(
        f"# {os.cpu_count()} processors, load {os.getloadavg()[0]:.2f}; {of.cycles} cycles, {len(of.vessel_id)} vessels now",
        file=comments(asked),
    )
    every = questions(of, np.random.default_rng([asked.seed, 72]))
    wanted = {name: ask for name, ask in every.items() if asked.only in name}
    _remember(asked.database)
    told = {name: _told(name, warm(url, ask, asked.ask), asked) for name, ask in wanted.items()}
    if not asked.warm:
        for name, ask in wanted.items():
            told[name] |= _told(name, cold(url, asked.database, ask, max(asked.ask // 6, 3)), asked)
    if asked.json:
        print(json.dumps(told))


def _told(name: str, figures: dict[str, float], asked: argparse.Namespace) -> dict[str, float]:
    if not asked.json:
        print(f"{name:<52}" + "  ".join(f"{key} {value:8.1f}" for key, value in figures.items()), flush=True)
    return figures


if __name__ == "__main__":
    main()
