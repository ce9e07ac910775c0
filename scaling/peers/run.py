"""Coastwatch and its peers on the same tracks in one run: `python -m scaling.peers.run [--peer NAME] [--size N] [--json]`."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterable, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from coastwatch.server.machine import date_utc, machine
from scaling.peers.environment import in_shell, peers, prepare
from scaling.peers.exchange import Answer, Given, load, save
from scaling.peers.input import make
from scaling.peers.quality import quality


class Comparison(NamedTuple):
    """A peer, a task of its adapter, and the input by default."""

    peer: str
    task: str
    tracks: int
    cycles: int
    measured: int


COMPARISONS = (
    Comparison("stonesoup", "association", 200, 40, 20),
    Comparison("filterpy", "imm", 600, 20, 10),
    Comparison("scipy", "association", 10_000, 25, 5),
    Comparison("scipy", "association_batched", 10_000, 25, 5),
    Comparison("scipy", "imm", 20_000, 12, 6),
    Comparison("scipy", "fusion", 100_000, 6, 5),
    Comparison("scipy", "spots", 100_000, 7, 5),
)
HEADS = "peer", "task", "tracks", "peer, ms", "ours, ms", "ratio", "peer us each", "of", "figure", "peer", "ours"
WIDTHS = 10, 20, 8, 10, 9, 8, 13, 32, 16, 8, 8
LEFT = {0, 1, 7, 8}


class Failed(RuntimeError):
    """An adapter that ended with an error."""


class Sea(NamedTuple):
    """An input, and what Coastwatch made of it: the comparisons that share it share both."""

    folder: Path
    given: Given
    ours: Answer


def laid(wanted: Comparison, seed: int, folder: Path) -> Sea:
    """The input of a comparison, and Coastwatch on it in a process of its own. Raises: Failed."""
    given = make(wanted.tracks, wanted.cycles, wanted.measured, seed)
    save(folder / "given.npz", given)
    return Sea(folder, given, _answer(Path(sys.executable), "scaling.peers.ours", kind_of(wanted.task), folder))


def kind_of(task: str) -> str:
    """What a task is about: peers may do it in several ways."""
    return task.partition("_")[0]


def compare(wanted: Comparison, python: Path, sea: Sea, clock: str) -> dict[str, Any]:
    """One row of the table: the peer, in a process of its own, beside Coastwatch on the same file. Raises: Failed."""
    theirs = _answer(python, f"scaling.peers.{wanted.peer}.adapter", wanted.task, sea.folder)
    figure, their_value = quality(kind_of(wanted.task), sea.given, theirs)
    theirs_s, ours_s = (float(np.median(getattr(a, f"{clock}_s"))) for a in (theirs, sea.ours))
    return {
        **wanted._asdict(),
        "versions": dict(theirs.versions),
        "peer_ms": 1e3 * theirs_s,
        "ours_ms": 1e3 * ours_s,
        "ratio": theirs_s / ours_s,
        "peer_us_each": 1e6 * theirs_s / theirs.units,
        "unit": theirs.unit,
        "figure": figure,
        "peer_quality": their_value,
        "ours_quality": quality(kind_of(wanted.task), sea.given, sea.ours)[1],
    }


def _answer(python: Path, module: str, task: str, folder: Path) -> Answer:
    why = in_shell([str(python), "-m", module, task, str(folder / "given.npz"), str(folder / "answer.npz")])
    if why:
        raise Failed(f"{module} {task}: {why}")
    answer: Answer = load(folder / "answer.npz", Answer)
    return answer


def run(comparisons: Sequence[Comparison], seed: int, clock: str) -> dict[str, Any]:
    """All rows, a sentence for each environment, and one for each peer or task that could not be had."""
    places = {peer: prepare(peer) for peer in dict.fromkeys(c.peer for c in comparisons)}
    missing = [place.said for place in places.values() if place.python is None]
    rows: list[dict[str, Any]] = []
    able = [c for c in comparisons if places[c.peer].python is not None]
    for _, group in groupby(able, lambda c: (kind_of(c.task), c.tracks, c.cycles, c.measured)):
        with tempfile.TemporaryDirectory() as folder:
            sea = None
            for wanted in group:
                try:
                    sea = sea or laid(wanted, seed, Path(folder))
                    rows.append(compare(wanted, places[wanted.peer].python or Path(), sea, clock))
                except Failed as error:
                    missing.append(str(error))
    return {
        "machine": machine(),
        "date": date_utc(),
        "clock": clock,
        "seed": seed,
        "rows": rows,
        "environments": [place.said for place in places.values() if place.python is not None],
        "missing": missing,
    }


def table(result: dict[str, Any]) -> list[str]:
    """The result as text."""
    m = result["machine"]
    what = "processor time of all threads" if result["clock"] == "cpu" else "wall time"
    lines = [
        f"# {m['processor']}, {m['processors']} processors, load {m['load']}, Python {m['python']}, {result['date']}",
        f"# {what} a cycle, median of the measured cycles; ratio: how many times ours the peer takes; seed {result['seed']}",
        _line(HEADS),
    ]
    for r in result["rows"]:
        times = f"{r['peer_ms']:.2f}", f"{r['ours_ms']:.2f}", _figures(r["ratio"]), _figures(r["peer_us_each"])
        good = f"{r['peer_quality']:.2f}", f"{r['ours_quality']:.2f}"
        lines.append(_line((r["peer"], r["task"], str(r["tracks"]), *times, r["unit"], r["figure"], *good)))
    return lines + [f"# {sentence}" for sentence in [*result["environments"], *result["missing"]]]


def _figures(value: float) -> str:
    """Three of them, without an exponent."""
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.3g}"


def _line(cells: Iterable[str]) -> str:
    padded = (c.ljust(w) if k in LEFT else c.rjust(w) for k, (c, w) in enumerate(zip(cells, WIDTHS, strict=True)))
    return "  ".join(padded).rstrip()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--peer", action="append", choices=peers(), help="only this one; more than once for several")
    parser.add_argument("--task", action="append", help="only this task; more than once for several")
    parser.add_argument(
        "--size", type=int, metavar="N", help="tracks in all, instead of what each row has; half radar, half AIS"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--clock", choices=("cpu", "wall"), default="cpu", help="cpu bears other work on the machine")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    chosen = [c for c in COMPARISONS if (not asked.peer or c.peer in asked.peer) and (not asked.task or c.task in asked.task)]
    if not chosen:
        parser.error(f"--peer {asked.peer} --task {asked.task}: no such row, needed one of {[c[:2] for c in COMPARISONS]}")
    if asked.size is not None:
        if asked.size < 12:
            parser.error(f"--size: got {asked.size}, needed at least 12 tracks")
        chosen = [c._replace(tracks=asked.size) for c in chosen]
    result = run(chosen, asked.seed, asked.clock)
    print(json.dumps(result) if asked.json else "\n".join(table(result)))


if __name__ == "__main__":
    main()
