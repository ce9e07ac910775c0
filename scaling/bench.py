"""One table of what is fast and what is not: `make bench`, or `python -m scaling.bench [--part NAME] [--folder FOLDER]`.

Each part is a command of its own that speaks JSON; one that fails or is not there is a sentence under the table.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from coastwatch.server.machine import date_utc, machine
from scaling.bench_rows import HEADS, STAGE, Row, of_cycle, of_kernels, of_peers, of_stages

HOUSE = Path(__file__).parents[1]
RESULTS = HOUSE / "scaling" / "results"
PACKAGES = "numpy", "scipy", "numba", "scikit-learn", "sqlalchemy"
SCENARIO = "context-driven-1000"
KERNELS = "scaling/kernels", "--benchmark-only", "--benchmark-timer=time.process_time", "-q", "-o", "python_files=bench_*.py"
TIMEOUT_S = 600.0
TIMES = (
    "Stages and load: wall time a cycle, median. Peers: processor time a cycle, median. Kernels: processor time a row, least"
)


class Part(NamedTuple):
    """A command and what is read from it."""

    name: str
    module: str
    options: tuple[str, ...]
    read: Callable[[Any], list[Row]]


PARTS = (
    Part("stages", "scaling.load.stages", (SCENARIO, "--json"), of_stages),
    Part("load", "scaling.load.cycle", ("--tracks", "10000", "--store", "sqlite:///{folder}/load.db", "--json"), of_cycle),
    Part("load", "scaling.load.cycle", ("--tracks", "100000", "--store", "sqlite:///{folder}/load.db", "--json"), of_cycle),
    Part("peers", "scaling.peers.run", ("--json",), of_peers),
    Part("kernels", "pytest", (*KERNELS, "--benchmark-json={folder}/kernels.json"), of_kernels),
)


def measure(part: Part) -> tuple[list[Row], list[str]]:
    """The rows of a part, and a sentence for each thing that could not be had."""
    title = " ".join(["python", "-m", part.module, *part.options])
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", part.module, *(option.format(folder=folder) for option in part.options)]
        try:
            done = subprocess.run(command, cwd=HOUSE, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
        except subprocess.TimeoutExpired:
            return [], [f"{title}: not done after {TIMEOUT_S:.0f} s"]
        if done.returncode:
            return [], [f"{title}: {last_line(done.stderr or done.stdout)}"]
        kept = Path(folder) / "kernels.json"
        try:
            found = json.loads(kept.read_text("utf-8")) if kept.exists() else last_object(done.stdout)
            return part.read(found), found.get("missing", [])
        except (KeyError, ValueError) as error:
            return [], [f"{title}: what it says cannot be read: {type(error).__name__} {error}"]


def last_object(text: str) -> Any:
    """The last line that is a JSON object; other lines are comments. Raises: ValueError: there is none."""
    lines = [line for line in text.splitlines() if line.startswith("{")]
    if not lines:
        raise ValueError(f"got {text[:200]!r}, needed a line with a JSON object")
    return json.loads(lines[-1])


def last_line(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1] if lines else "no word"


def heading() -> list[str]:
    """Machine, date, versions, load."""
    m = machine()
    versions = ", ".join(f"{p} {version(p)}" for p in ("coastwatch", *PACKAGES))
    return [
        f"{m['processor']}, {m['processors']} processors, {m['system']}, load {m['load']} at the start, {date_utc()}",
        f"Python {m['python']}, {versions}",
        TIMES,
    ]


def as_text(heading: list[str], rows: list[Row], missing: list[str]) -> str:
    """The table for a terminal."""
    cells = [HEADS, *rows]
    widths = [max(len(row[k]) for row in cells) for k in range(len(HEADS))]
    body = ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in cells]
    return "\n".join([*(f"# {line}" for line in ["make bench", *heading]), *body, *(f"# {line}" for line in missing)]) + "\n"


def as_markdown(heading: list[str], rows: list[Row], missing: list[str]) -> str:
    """The table for a README, without the single stages."""
    lines = ["| " + " | ".join(row) + " |" for row in (HEADS, *(row for row in rows if row.part != STAGE))]
    lines.insert(1, "|---" * len(HEADS) + "|")
    return "\n".join(["`make bench`: " + ". ".join(heading) + ".", "", *lines, *(f"\n{line}" for line in missing)]) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--part", action="append", choices=sorted({p.name for p in PARTS}), help="only this one; repeatable")
    parser.add_argument("--folder", type=Path, default=RESULTS, help="where bench.txt and bench.md are written")
    asked = parser.parse_args()
    top, rows, missing = heading(), [], []
    for part in PARTS:
        if not asked.part or part.name in asked.part:
            print(f"{part.name}: {part.module} {' '.join(part.options)}", file=sys.stderr, flush=True)
            found, words = measure(part)
            rows += found
            missing += words
    text = as_text(top, rows, missing)
    (asked.folder / "bench.txt").write_text(text, "utf-8")
    (asked.folder / "bench.md").write_text(as_markdown(top, rows, missing), "utf-8")
    print(text, end="")


if __name__ == "__main__":
    main()
