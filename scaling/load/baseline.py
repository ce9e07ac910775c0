"""Compute time of this checkout over that of a baseline checkout, measured in turns in one run, so that both meet the same machine."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

from coastwatch.operators.cli.progress import shown
from coastwatch.server.machine import date_utc, machine

CHECKOUT = Path(__file__).resolve().parents[2]
NOT_INHERITED = ("NUMBA_CACHE_DIR", "PYTHONPATH")  # Coastwatch sets the first, for the kernels of this checkout


def python_of(checkout: Path) -> Path:
    """The Python of a checkout's own environment; of this checkout, the running one."""
    return Path(sys.executable) if checkout.resolve() == CHECKOUT else checkout.absolute() / ".venv" / "bin" / "python"


def cycle_figures(checkout: Path, arguments: Sequence[str]) -> dict[str, Any]:
    """The figures of `scaling.load.cycle` in a process of a checkout. If that ends with an error, so does this process."""
    command = [str(python_of(checkout)), "-m", "scaling.load.cycle", *arguments, "--json"]
    environment = {key: value for key, value in os.environ.items() if key not in NOT_INHERITED}
    done = subprocess.run(command, cwd=checkout, env=environment, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:  # the child has printed why
        raise SystemExit(done.returncode)
    return dict(json.loads(done.stdout))


def compare(baseline: Path, arguments: Sequence[str], turns: int) -> dict[str, Any]:
    """Times per cycle of both checkouts, seconds: each run's median, and the ratio of the medians over all runs.

    The times are compute by the clock, compute of all processors, and each stage by the clock.
    """
    checkouts = {"this": CHECKOUT, "baseline": baseline}
    costs: dict[str, dict[str, list[float]]] = {}
    with shown("turn") as progress:
        for turn in range(turns):
            progress(turn, turns, "running both checkouts")
            for name in sorted(checkouts, reverse=turn % 2 == 0):  # which of them goes first alternates
                figures = cycle_figures(checkouts[name], arguments)
                seconds = {"compute_wall_s": figures["compute_s"]["median"], "compute_cpu_s": figures["compute_cpu_s"]}
                seconds |= {f"{stage}_s": times["median"] for stage, times in figures["stages_s"].items()}
                for cost, taken_s in seconds.items():
                    costs.setdefault(cost, {key: [] for key in checkouts})[name].append(taken_s)
    ratio = {cost: median(runs["this"]) / median(runs["baseline"]) for cost, runs in costs.items()}
    return {"date": date_utc(), "machine": machine(), "arguments": list(arguments), "ratio": ratio, **costs}


def table(figures: dict[str, Any]) -> list[str]:
    """One line for each time that `compare` gives."""
    lines = [f"# scaling.load.cycle {' '.join(figures['arguments'])}: median of each run, ms; ratio of the medians of all runs"]
    for cost, ratio in figures["ratio"].items():
        runs = (f"{name} {' '.join(f'{1e3 * s:.1f}' for s in figures[cost][name])}" for name in ("this", "baseline"))
        lines.append(f"{cost.removesuffix('_s'):<20} {'   '.join(runs)}   ratio {ratio:.3f}")
    return lines
