"""Times and quality of Coastwatch and its peers on the same input: `python -m scaling.peers.run [--peer NAME] [--size N] [--json]`."""

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

from coastwatch.server.timing import date_utc, machine
from scaling.peers.environment import peers, prepare, run_command
from scaling.peers.exchange import PlotHistory, TaskResult, TrackHistory, input_of, load, save
from scaling.peers.input import make_history
from scaling.peers.plots import make_plots
from scaling.peers.quality import quality, track_figures


class Comparison(NamedTuple):
    """A task of a peer's adapter, and its default input."""

    peer: str
    task: str
    tracks: int  # of the input; vessels, where the input is plots
    cycles: int
    measured: int
    product: bool = False  # the peer is a method of Coastwatch with the peer inside: `method.py`, in the project's environment


COMPARISONS = (
    Comparison("stonesoup", "tracking", 100, 20, 6),
    Comparison("stonesoup", "tracking_jpda", 100, 20, 6),
    Comparison("filterpy", "tracking", 100, 20, 6, product=True),
    Comparison("stonesoup", "association", 200, 40, 20),
    Comparison("stonesoup", "counting", 200, 40, 20),
    Comparison("filterpy", "imm", 600, 20, 10),
    Comparison("scipy", "association", 10_000, 25, 5),
    Comparison("scipy", "association_batched", 10_000, 25, 5),
    Comparison("scipy", "imm", 20_000, 12, 6),
    Comparison("scipy", "fusion", 100_000, 6, 5),
    Comparison("scipy", "spots", 100_000, 7, 5),
)
SETTINGS = (
    "ours: default settings of SidedImm (tracking), KMeansSpots, WindowedCovariance, ImmOfTracks (imm) and Convex (fusion); "
    "one thread"
)
HEADS = "peer", "task", "size", "peer, ms", "ours, ms", "ratio", "peer us each", "of", "figure", "peer", "ours"
WIDTHS = 10, 20, 8, 10, 9, 8, 13, 32, 16, 8, 8
LEFT = {0, 1, 7, 8}


class AdapterError(RuntimeError):
    """An adapter ended with an error."""


class SharedInput(NamedTuple):
    """An input and the result of Coastwatch, shared by all comparisons on this input."""

    folder: Path
    history: TrackHistory | PlotHistory
    ours: TaskResult


def prepare_input(wanted: Comparison, seed: int, folder: Path) -> SharedInput:
    """The input of a comparison, and the result of Coastwatch from a process of its own. Raises: AdapterError."""
    make = make_plots if input_of(wanted.task) is PlotHistory else make_history
    history = make(wanted.tracks, wanted.cycles, wanted.measured, seed)
    save(folder / "input.npz", history)
    return SharedInput(folder, history, _run_adapter(Path(sys.executable), "scaling.peers.ours", kind_of(wanted.task), folder))


def kind_of(task: str) -> str:
    """The kind of a task: a peer may have several implementations of one kind."""
    return task.partition("_")[0]


def compare(wanted: Comparison, python: Path, shared: SharedInput, clock: str) -> dict[str, Any]:
    """One row of the table: the peer in a process of its own, and Coastwatch on the same file. Raises: AdapterError."""
    module = "method" if wanted.product else "adapter"
    theirs = _run_adapter(python, f"scaling.peers.{wanted.peer}.{module}", wanted.task, shared.folder)
    figure, their_value = quality(kind_of(wanted.task), shared.history, theirs)
    theirs_s, ours_s = (float(np.median(getattr(a, f"{clock}_s"))) for a in (theirs, shared.ours))
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
        "ours_quality": quality(kind_of(wanted.task), shared.history, shared.ours)[1],
        "size_of": "tracks",
        **_of_tracks(shared, theirs),
    }


def _of_tracks(shared: SharedInput, theirs: TaskResult) -> dict[str, Any]:
    """More figures of both, where the input is plots."""
    if not isinstance(shared.history, PlotHistory):
        return {}
    peer, ours = (track_figures(shared.history, made) for made in (theirs, shared.ours))
    return {"size_of": "vessels", "peer_figures": peer, "ours_figures": ours}


def _run_adapter(python: Path, module: str, task: str, folder: Path) -> TaskResult:
    why = run_command([str(python), "-m", module, task, str(folder / "input.npz"), str(folder / "result.npz")])
    if why:
        raise AdapterError(f"{module} {task}: {why}")
    result: TaskResult = load(folder / "result.npz", TaskResult)
    return result


def run(comparisons: Sequence[Comparison], seed: int, clock: str) -> dict[str, Any]:
    """All rows of the table, a message for each environment, and one for each peer or task that could not run."""
    environments = {peer: prepare(peer) for peer in dict.fromkeys(c.peer for c in comparisons if not c.product)}
    missing = [e.message for e in environments.values() if e.python is None]
    rows: list[dict[str, Any]] = []
    pythons = {c: Path(sys.executable) if c.product else environments[c.peer].python for c in comparisons}
    possible = [c for c in comparisons if pythons[c] is not None]
    for _, group in groupby(possible, lambda c: (kind_of(c.task), c.tracks, c.cycles, c.measured)):
        with tempfile.TemporaryDirectory() as folder:
            shared = None
            for wanted in group:
                try:
                    shared = shared or prepare_input(wanted, seed, Path(folder))
                    rows.append(compare(wanted, pythons[wanted] or Path(), shared, clock))
                except AdapterError as error:
                    missing.append(str(error))
    return {
        "machine": machine(),
        "date": date_utc(),
        "clock": clock,
        "seed": seed,
        "settings": SETTINGS,
        "rows": rows,
        "environments": [e.message for e in environments.values() if e.python is not None],
        "missing": missing,
    }


def table(result: dict[str, Any]) -> list[str]:
    """The result as lines of text."""
    m = result["machine"]
    what = "processor time of all threads" if result["clock"] == "cpu" else "wall time"
    lines = [
        f"# {m['processor']}, {m['processors']} processors, load {m['load']}, Python {m['python']}, {result['date']}",
        f"# {what} a cycle, median of the measured cycles; ratio: how many times ours the peer takes; seed {result['seed']}",
        f"# {SETTINGS}",
        _line(HEADS),
    ]
    for r in result["rows"]:
        times = f"{r['peer_ms']:.2f}", f"{r['ours_ms']:.2f}", _figures(r["ratio"]), _figures(r["peer_us_each"])
        good = f"{r['peer_quality']:.2f}", f"{r['ours_quality']:.2f}"
        lines.append(_line((r["peer"], r["task"], str(r["tracks"]), *times, r["unit"], r["figure"], *good)))
        if "peer_figures" in r:
            lines += [f"#   {name}: {_tracks(r[key])}" for name, key in ((r["peer"], "peer_figures"), ("ours", "ours_figures"))]
    return lines + [f"# {sentence}" for sentence in [*result["environments"], *result["missing"]]]


def _tracks(figures: dict[str, float]) -> str:
    """What is known of tracks, as text."""
    share = f"completeness {figures['completeness']:.3f}, {figures['false_tracks']:.2f} false tracks a cycle"
    return f"{share}, RMSE {figures['rmse_m']:.2f} m"


def _figures(value: float) -> str:
    """A number with three significant figures, without an exponent."""
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.3g}"


def _line(cells: Iterable[str]) -> str:
    padded = (c.ljust(w) if k in LEFT else c.rjust(w) for k, (c, w) in enumerate(zip(cells, WIDTHS, strict=True)))
    return "  ".join(padded).rstrip()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--peer", action="append", choices=peers(), help="only this one; more than once for several")
    parser.add_argument("--task", action="append", help="only this task; more than once for several")
    parser.add_argument(
        "--size", type=int, metavar="N", help="tracks in all, half radar, half AIS, or vessels, instead of what each row has"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--clock", choices=("cpu", "wall"), default="cpu", help="cpu bears other work on the machine")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    chosen = [
        c for c in COMPARISONS if (not options.peer or c.peer in options.peer) and (not options.task or c.task in options.task)
    ]
    if not chosen:
        parser.error(f"--peer {options.peer} --task {options.task}: no such row, needed one of {[c[:2] for c in COMPARISONS]}")
    if options.size is not None:
        if options.size < 12:
            parser.error(f"--size: got {options.size}, needed at least 12 tracks")
        chosen = [c._replace(tracks=options.size) for c in chosen]
    result = run(chosen, options.seed, options.clock)
    print(json.dumps(result) if options.json else "\n".join(table(result)))


if __name__ == "__main__":
    main()
