"""Compute time of this checkout over that of a baseline checkout, measured in turns in one run, so that both meet the same machine.

A checkout runs its own load command. If it has none of that name, it runs the one of this checkout with its own `coastwatch`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

from coastwatch.server.timing import date_utc, machine
from scaling.load.progress import report_progress

CHECKOUT = Path(__file__).resolve().parents[2]
LEAST_S = 1e-9  # a stage may take no processor time that the clock can see
CYCLE = "scaling.load.cycle"
NOT_INHERITED = ("NUMBA_CACHE_DIR", "PYTHONPATH")  # Coastwatch sets the first, for the kernels of this checkout


def python_of(checkout: Path) -> Path:
    """The Python of a checkout's own environment; of this checkout, the running one."""
    return Path(sys.executable) if checkout.resolve() == CHECKOUT else checkout.absolute() / ".venv" / "bin" / "python"


def figures(checkout: Path, arguments: Sequence[str], module: str = CYCLE) -> dict[str, Any]:
    """The figures of a load command with the `coastwatch` of a checkout. If its process ends with an error, so does this one."""
    command = [str(python_of(checkout)), "-m", module, *arguments, "--json"]
    environment = {key: value for key, value in os.environ.items() if key not in NOT_INHERITED}
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "scaling").symlink_to(
            CHECKOUT / "scaling"
        )  # no `coastwatch` is beside it: the environment's is imported
        has_it = any((checkout / Path(*module.split("."))).with_suffix(suffix).exists() for suffix in ("", ".py"))
        where = checkout if has_it else Path(folder)
        done = subprocess.run(command, cwd=where, env=environment, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:  # the child has printed why
        raise SystemExit(done.returncode)
    return dict(json.loads(done.stdout))


def compare(baseline: Path, arguments: Sequence[str], turns: int, module: str = CYCLE) -> dict[str, Any]:
    """Times per cycle of both checkouts, seconds: each run's median, and the ratio of the medians over all runs.

    The times are compute by the clock, compute of all processors, and each stage by the clock and, if given, by processor time.
    The quality is that of the last run of each, where the command gives one.
    """
    checkouts = {"this": CHECKOUT, "baseline": baseline}
    costs: dict[str, dict[str, list[float]]] = {}
    quality: dict[str, Any] = {}
    with report_progress("turn") as progress:
        for turn in range(turns):
            progress(turn, turns, "running both checkouts")
            for name in sorted(checkouts, reverse=turn % 2 == 0):  # which of them goes first alternates
                found = figures(checkouts[name], arguments, module)
                seconds = {"compute_wall_s": found["compute_s"]["median"], "compute_cpu_s": found["compute_cpu_s"]}
                seconds |= {f"{stage}_s": times["median"] for stage, times in found["stages_s"].items()}
                seconds |= {f"{stage} cpu_s": taken_s for stage, taken_s in found.get("stages_cpu_s", {}).items()}
                quality |= {name: found["quality"]} if "quality" in found else {}
                for cost, taken_s in seconds.items():
                    costs.setdefault(cost, {key: [] for key in checkouts})[name].append(taken_s)
    costs = {cost: runs for cost, runs in costs.items() if all(runs.values())}  # a stage may be in one of them alone
    ratio = {cost: median(runs["this"]) / max(median(runs["baseline"]), LEAST_S) for cost, runs in costs.items()}
    conditions = {"date": date_utc(), "machine": machine(), "module": module, "arguments": list(arguments)}
    return {**conditions, "ratio": ratio, **costs, "quality": quality}


def table(compared: dict[str, Any]) -> list[str]:
    """One line for each time that `compare` gives."""
    command = f"{compared['module']} {' '.join(compared['arguments'])}"
    lines = [f"# {command}: median of each run, ms; ratio of the medians of all runs"]
    for cost, ratio in compared["ratio"].items():
        runs = (f"{name} {' '.join(f'{1e3 * s:.1f}' for s in compared[cost][name])}" for name in ("this", "baseline"))
        lines.append(f"{cost.removesuffix('_s'):<26} {'   '.join(runs)}   ratio {ratio:.3f}")
    return lines
