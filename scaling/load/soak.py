"""Whether memory and time stay flat over many minutes, with a database and a console that polls it:

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
from coastwatch.operators.cli.progress import report_progress
from coastwatch.server.timing import date_utc, machine
from coastwatch.server.writing.writer import STAGE
from scaling.load import national
from scaling.load.cycle import MIB, PERIOD_S, heading
from scaling.load.options import errors_as_one_line, load_parser
from scaling.load.run import CycleResult, Load, run_cycles

CYCLES_PER_MINUTE = 20
SETTLED_MIN = 6  # the windows of five minutes are full, and one minute more
FIGURES = ("compute_ms", "store_ms", "memory_mib", "wal_mib", "rows")


@contextmanager
def console(url: str, answers: dict[str, float]) -> Iterator[None]:
    """A process that polls the database inside the block; at its end, its waiting times are in `answers`."""
    command = [sys.executable, "-m", "scaling.load.polling", url]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as reader:
        try:
            yield
        finally:
            answers |= json.loads(reader.communicate("")[0] or "{}")


def in_memory(url: str) -> bool:
    """Whether the database is in memory, so that no other process can read it."""
    address = make_url(url)
    return address.get_backend_name() == "sqlite" and address.database in (None, "", ":memory:")


def minute_figures(cycles: Sequence[CycleResult], wal_bytes: Sequence[int]) -> dict[str, float]:
    """Figures of one minute: medians, but the largest write-ahead log and the sum of rows."""
    return {
        "compute_ms": 1e3 * median(c.times.compute_s for c in cycles),
        "store_ms": 1e3 * median(c.times.stages_s.get(STAGE, 0.0) for c in cycles),
        "late": sum(c.times.cycle_s > PERIOD_S for c in cycles),
        "memory_mib": median(c.memory_bytes for c in cycles) / MIB,
        "wal_mib": max(wal_bytes) / MIB,
        "rows": float(sum(c.rows_written for c in cycles)),
    }


def slope(values: Sequence[float]) -> dict[str, Any]:
    """Growth per minute by least squares, its standard error, and whether it is flat. None of fewer than three values.

    Flat: no more than two standard errors, or 1 % of the mean over the whole time.
    """
    number, mean = len(values), float(np.mean(values))
    if number < 3:
        return {"a_minute": None, "error": None, "flat": None}
    x = np.arange(number) - 0.5 * (number - 1)
    growth = float(x @ np.array(values) / (x @ x))
    residual = np.array(values) - mean - growth * x
    error = float(np.sqrt(residual @ residual / (number - 2) / (x @ x)))
    return {"a_minute": growth, "error": error, "flat": bool(abs(growth) <= max(2.0 * error, 0.01 * abs(mean) / number))}


def soak(load: Load, paced: bool) -> tuple[list[dict[str, float]], dict[str, float]]:
    """The figures of each minute, and the waiting times of the console. Args: paced: one cycle every 3 s."""
    path = make_url(load.store).database
    minutes: list[dict[str, float]] = []
    answers: dict[str, float] = {}
    cycles: list[CycleResult] = []
    wal: list[int] = []
    with ExitStack() as stack, report_progress("minute") as progress:
        begun = time.monotonic()
        for cycle in run_cycles(load):
            if cycle.number == 0:
                stack.enter_context(console(load.store, answers))
                begun = time.monotonic()
            cycles.append(cycle)
            wal.append(_size(Path(f"{path}-wal")))
            if len(cycles) == CYCLES_PER_MINUTE:
                minutes.append(minute_figures(cycles, wal))
                cycles, wal = [], []
                state = f"{minutes[-1]['memory_mib']:.0f} MiB{cycle.warning_text}"
                progress(len(minutes), load.cycles // CYCLES_PER_MINUTE, state)
            if paced:
                time.sleep(max(begun + (cycle.number + 1) * PERIOD_S - time.monotonic(), 0.0))
    return minutes, answers


def _size(path: Path) -> int:
    return path.stat().st_size if path.is_file() else 0


def text(figures: dict[str, Any]) -> str:
    """The figures as a table for people."""
    f = figures
    lines = [*heading(f), f"{f['tracks']} tracks, {'a cycle every 3 s' if f['paced'] else 'cycles without pause'}"]
    heads = ("minute", "compute ms", "store ms", "late", "memory MiB", "WAL MiB", "rows")
    lines.append("".join(f"{head:>12}" for head in heads))
    for k, m in enumerate(f["minutes"]):
        values = (m[name] for name in ("compute_ms", "store_ms", "late", "memory_mib", "wal_mib", "rows"))
        lines.append(f"{k + 1:12d}" + "".join(f"{value:12.1f}" for value in values))
    for name, s in f["slopes"].items():
        growth = "too short to say" if s["flat"] is None else f"{s['a_minute']:+9.3f} +- {s['error']:.3f} a minute"
        verdict = {True: ": flat", False: ": NOT flat", None: ""}[s["flat"]]
        lines.append(f"  {name:<12} from minute {f['settled'] + 1} on {growth}{verdict}")
    lines.append(f"database {f['database_mib']:.0f} MiB at the end; console: {json.dumps(f['console'])}")
    return "\n".join(lines)


def main() -> None:
    parser = load_parser(__doc__)
    parser.add_argument("--tracks", type=count, default=100_000)
    parser.add_argument("--minutes", type=count, default=20, help="of the picture: 20 cycles each")
    parser.add_argument("--paced", action="store_true", help="a cycle every 3 s; else one after the other")
    options = parser.parse_args()
    with errors_as_one_line(), tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "soak.db") if options.store == "none" else options.store
        url = path if "://" in path else f"sqlite:///{path}"
        if in_memory(url):
            parser.error(f"--store: got {options.store!r}, needed a database that the console, another process, can read too")
        cycles, settings = options.minutes * CYCLES_PER_MINUTE, dict(options.set)
        load = Load(options.tracks, cycles, 0, options.workers, url, options.seed, settings, score=False)
        minutes, answers = soak(load, options.paced)
        settled = min(SETTLED_MIN, options.minutes // 2)
        figures = {
            "date": date_utc(),
            "machine": machine(),
            "conditions": national.conditions(settings),
            "tracks": options.tracks,
            "paced": options.paced,
            "minutes": minutes,
            "settled": settled,
            "slopes": {name: slope([m[name] for m in minutes[settled:]]) for name in FIGURES},
            "database_mib": _size(Path(str(make_url(url).database))) / MIB,
            "console": answers,
        }
    print(json.dumps(figures) if options.json else text(figures))


if __name__ == "__main__":
    main()
