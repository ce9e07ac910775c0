"""Whether memory and time stay flat: the centre for many minutes, with its database and a console that polls it.

python -m scaling.load.soak --tracks 100000 --minutes 20 [--paced] [--store URL] [--workers W] [--set KEY=VALUE ...] [--json]
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from sqlalchemy import make_url

from coastwatch.operators.cli.arguments import count
from coastwatch.operators.cli.progress import shown
from coastwatch.server.machine import date_utc, machine
from coastwatch.server.writer import STAGE
from scaling.load.command import arguments, one_sentence, settings_of
from scaling.load.cycle import MIB, PERIOD_S
from scaling.load.running import Load, Measured, measured, said

CYCLES_A_MINUTE = 20
SETTLED_MIN = 6  # windows of five minutes are full, and one more
FIGURES = ("compute_ms", "store_ms", "memory_mib", "wal_mib", "rows")


@contextmanager
def console(url: str, told: dict[str, float]) -> Iterator[None]:
    """A process that polls the database inside the block; then what it says is in `told`."""
    command = [sys.executable, "-m", "scaling.load.polling", url]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as reader:
        try:
            yield
        finally:
            told |= json.loads(reader.communicate("")[0] or "{}")


def in_memory(url: str) -> bool:
    """Whether no other process can read what is written there."""
    address = make_url(url)
    return address.get_backend_name() == "sqlite" and address.database in (None, "", ":memory:")


def minute_of(cycles: Sequence[Measured], wal_bytes: Sequence[int]) -> dict[str, float]:
    """Medians of one minute; of the write-ahead log the largest, of rows the sum."""
    return {
        "compute_ms": 1e3 * median(c.taken.compute_s for c in cycles),
        "store_ms": 1e3 * median(c.taken.seconds.get(STAGE, 0.0) for c in cycles),
        "late": sum(c.taken.all_s > PERIOD_S for c in cycles),
        "memory_mib": median(c.taken.memory_bytes for c in cycles) / MIB,
        "wal_mib": max(wal_bytes) / MIB,
        "rows": float(sum(c.taken.rows_written for c in cycles)),
    }


def slope(values: Sequence[float]) -> dict[str, Any]:
    """Growth a minute by least squares, its standard error, and whether it is flat: no more than two of these, or 1 % in the whole.

    None of fewer than three values.
    """
    number, mean = len(values), float(np.mean(values))
    if number < 3:
        return {"a_minute": None, "error": None, "flat": None}
    x = np.arange(number) - 0.5 * (number - 1)
    growth = float(x @ np.array(values) / (x @ x))
    left = np.array(values) - mean - growth * x
    error = float(np.sqrt(left @ left / (number - 2) / (x @ x)))
    return {"a_minute": growth, "error": error, "flat": bool(abs(growth) <= max(2.0 * error, 0.01 * abs(mean) / number))}


def soak(load: Load, paced: bool) -> tuple[list[dict[str, float]], dict[str, float]]:
    """Minute by minute, and what the console waited."""
    path = make_url(load.store).database
    minutes: list[dict[str, float]] = []
    told: dict[str, float] = {}
    cycles: list[Measured] = []
    wal: list[int] = []
    with ExitStack() as open_, shown("minute") as say:
        begun = time.monotonic()
        for cycle in measured(load):
            if cycle.number == 0:
                open_.enter_context(console(load.store, told))
                begun = time.monotonic()
            cycles.append(cycle)
            wal.append(_size(Path(f"{path}-wal")))
            if len(cycles) == CYCLES_A_MINUTE:
                minutes.append(minute_of(cycles, wal))
                cycles, wal = [], []
                say(len(minutes), load.cycles // CYCLES_A_MINUTE, f"{minutes[-1]['memory_mib']:.0f} MiB{said(cycle.taken)}")
            if paced:
                time.sleep(max(begun + (cycle.number + 1) * PERIOD_S - time.monotonic(), 0.0))
    return minutes, told


def _size(path: Path) -> int:
    return path.stat().st_size if path.is_file() else 0


def text(figures: dict[str, Any]) -> str:
    """The same for people."""
    f = figures
    lines = [f"# {f['date']}, {f['machine']['processors']} x {f['machine']['processor']}, load {f['machine']['load']}"]
    heads = ("minute", "compute ms", "store ms", "late", "memory MiB", "WAL MiB", "rows")
    lines.append("".join(f"{head:>12}" for head in heads))
    for k, m in enumerate(f["minutes"]):
        values = (m[name] for name in ("compute_ms", "store_ms", "late", "memory_mib", "wal_mib", "rows"))
        lines.append(f"{k + 1:12d}" + "".join(f"{value:12.1f}" for value in values))
    for name, s in f["slopes"].items():
        growth = "too short to say" if s["flat"] is None else f"{s['a_minute']:+9.3f} +- {s['error']:.3f} a minute"
        word = {True: ": flat", False: ": NOT flat", None: ""}[s["flat"]]
        lines.append(f"  {name:<12} from minute {f['settled'] + 1} on {growth}{word}")
    lines.append(f"database {f['database_mib']:.0f} MiB at the end; console: {json.dumps(f['console'])}")
    return "\n".join(lines)


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--tracks", type=count, default=100_000)
    parser.add_argument("--minutes", type=count, default=20, help="of the picture: 20 cycles each")
    parser.add_argument("--paced", action="store_true", help="a cycle every 3 s; else one after the other")
    asked = parser.parse_args()
    with one_sentence(), tempfile.TemporaryDirectory() as folder:
        kept = str(Path(folder) / "soak.db") if asked.store == "none" else asked.store
        url = kept if "://" in kept else f"sqlite:///{kept}"
        if in_memory(url):
            parser.error(f"--store: got {asked.store!r}, needed a database that the console, another process, can read too")
        cycles, settings = asked.minutes * CYCLES_A_MINUTE, settings_of(asked)
        load = Load(asked.tracks, cycles, 0, asked.workers, url, asked.seed, settings, score=False)
        minutes, told = soak(load, asked.paced)
        settled = min(SETTLED_MIN, asked.minutes // 2)
        figures = {
            "date": date_utc(),
            "machine": machine(),
            "tracks": asked.tracks,
            "paced": asked.paced,
            "minutes": minutes,
            "settled": settled,
            "slopes": {name: slope([m[name] for m in minutes[settled:]]) for name in FIGURES},
            "database_mib": _size(Path(str(make_url(url).database))) / MIB,
            "console": told,
        }
    print(json.dumps(figures) if asked.json else text(figures))


if __name__ == "__main__":
    main()
