"""Time, memory and association quality of cycles of the high-level centre under a national picture:

python -m scaling.load.cycle --tracks N --cycles C [--workers W] [--store URL|none] [--set KEY=VALUE ...] [--json]
python -m scaling.load.cycle --tracks N --baseline CHECKOUT [--turns T]     compute time over that of another checkout
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from statistics import mean, median
from typing import Any

import numpy as np

from coastwatch.operators.cli.arguments import count
from coastwatch.scores.confusion import Confusion
from coastwatch.server.timing import date_utc, machine
from coastwatch.server.writing.writer import STAGE
from scaling.load import baseline, national
from scaling.load.options import as_arguments, errors_as_one_line, load_parser
from scaling.load.progress import report_progress
from scaling.load.run import CycleResult, CycleTimes, Load, run_cycles

PERIOD_S = 3.0
MIB = 2.0**20


def run_with_progress(load: Load) -> list[CycleResult]:
    """All cycles of a run, with progress on stderr."""
    out, total = [], load.warmup + load.cycles
    with report_progress() as progress:
        progress(0, total, "building the world")
        for cycle in run_cycles(load):
            out.append(cycle)
            progress(len(out), total, f"{cycle.tracks} tracks, {1e3 * cycle.times.compute_s:.0f} ms{cycle.warning_text}")
    return out


def figures_of(load: Load, cycles: Sequence[CycleResult]) -> dict[str, Any]:
    """The figures of a run, ready for JSON: medians over the cycles after the warm-up; times in seconds."""
    counted = [c for c in cycles if c.warm]
    times, last = [c.times for c in counted], counted[-1]
    compute, whole = ([getattr(t, name) for t in times] for name in ("compute_s", "cycle_s"))
    decisions: dict[str, Confusion] = {}
    for cycle in counted:
        for part, counts in cycle.decisions.items():
            decisions[part] = decisions.get(part, Confusion()) + counts
    peak = max(c.peak_memory_bytes for c in cycles)
    return {
        "load": {"tracks": load.tracks, "cycles": load.cycles, "warmup": load.warmup, "workers": load.workers},
        "seed": load.seed,
        "input": national.INPUT,
        "settings": national.NON_DEFAULT_SETTINGS | dict(load.settings),
        "conditions": national.conditions(load.settings),
        "store": load.store.partition(":")[0],
        "date": date_utc(),
        "machine": machine(),
        "tracks": last.tracks,
        "bearing_tracks": last.bearing_tracks,
        "vessels": last.vessels,
        "stages_s": stages_of(times),
        "compute_s": summary(compute) | {"share_of_period": median(compute) / PERIOD_S},
        "compute_cpu_s": median(t.compute_cpu_s for t in times),
        "store_cpu_s": summary([t.store_cpu_s for t in times]) | {"mean": mean(t.store_cpu_s for t in times)},
        "writer_behind_cycles": writer_behind([c.times for c in counted if c.number > 0], load.store),
        "cycle_s": summary(whole) | {"mean": mean(whole), "share_of_period": median(whole) / PERIOD_S},
        "generator_s": median(t.generator_s for t in times),
        "pairs_within_gate": last.pairs_within_gate,
        "rows_written": median(c.rows_written for c in counted),
        "memory_mib": {"now": last.memory_bytes / MIB, "peak": peak / MIB},
        "decisions": {part: counts.as_dict() for part, counts in decisions.items()},
    }


def stages_of(times: Sequence[CycleTimes]) -> dict[str, dict[str, float]]:
    """The times of each stage over the cycles in which it ended: in one with the writer behind no write did."""
    stages = dict.fromkeys(stage for t in times for stage in t.stages_s)
    return {stage: summary([t.stages_s[stage] for t in times if stage in t.stages_s]) for stage in stages}


def writer_behind(times: Sequence[CycleTimes], url: str) -> int:
    """In how many cycles no write of an earlier one ended. Args: times: of cycles after the first; url: of the store, or none."""
    return 0 if url == "none" else sum(STAGE not in t.stages_s for t in times)


def summary(seconds: Sequence[float]) -> dict[str, float]:
    """Median, 99th percentile and least of times in seconds."""
    return {"median": median(seconds), "p99": float(np.percentile(seconds, 99)), "least": min(seconds)}


def heading(figures: dict[str, Any]) -> list[str]:
    """The first lines of a printed result: date, machine, input and non-default settings."""
    m = figures["machine"]
    return [f"# {figures['date']}, {m['processors']} x {m['processor']}, load {m['load']}", f"# {figures['conditions']}"]


def text(figures: dict[str, Any]) -> str:
    """The figures as a table for people."""
    f, load, memory = figures, figures["load"], figures["memory_mib"]
    lines = [
        *heading(f),
        f"{f['tracks']} tracks and {f['bearing_tracks']} bearings to {f['vessels']} vessels, {load['cycles']} cycles after "
        f"{load['warmup']}, {load['workers']} workers, store {f['store']}",
        *(time_line(stage, t) for stage, t in f["stages_s"].items()),
    ]
    for name in ("compute", "cycle"):
        lines.append(f"{time_line(name, f[f'{name}_s'])}   {100 * f[f'{name}_s']['share_of_period']:6.2f} % of the period")
    lines[-1] += f", mean {1e3 * f['cycle_s']['mean']:.2f} ms"
    lines.append(
        f"processor time of compute {1e3 * f['compute_cpu_s']:.0f} ms; generator {1e3 * f['generator_s']:.0f} ms, not counted"
    )
    if f["store"] != "none":
        lines.append("processor time of the writer: " + ", ".join(f"{k} {1e3 * s:.0f} ms" for k, s in f["store_cpu_s"].items()))
        lines.append(f"writer behind in {f['writer_behind_cycles']} of {load['cycles']} cycles")
    lines.append(f"{f['pairs_within_gate']} pairs within the gate, {f['rows_written']:.0f} rows written a cycle")
    lines.append(f"memory of all processes: {memory['now']:.0f} MiB (PSS), peak at most {memory['peak']:.0f} MiB")
    lines.append(f"{'decisions':<12}{'F1 %':>9}{'precision':>11}{'recall':>9}{'right':>10}{'missed':>8}{'false':>7}")
    for part, d in f["decisions"].items():
        rates = f"{100 * d['f1']:9.3f}{100 * d['precision']:11.3f}{100 * d['recall']:9.3f}"
        lines.append(f"{part:<12}{rates}{d['tp']:10d}{d['fn']:8d}{d['fp']:7d}")
    return "\n".join(lines)


def time_line(name: str, t: dict[str, float]) -> str:
    """A line of a table for people. Args: t: as `summary` returns it."""
    return f"  {name:<22} median {1e3 * t['median']:9.2f} ms   p99 {1e3 * t['p99']:9.2f} ms   least {1e3 * t['least']:9.2f} ms"


def main() -> None:
    parser = load_parser(__doc__)
    parser.add_argument("--tracks", type=count, default=10_000)
    parser.add_argument("--cycles", type=count, default=20)
    parser.add_argument("--no-score", action="store_true", help="time and memory alone; counting decisions takes memory")
    parser.add_argument("--baseline", type=Path, metavar="CHECKOUT", help="another checkout with its own .venv; compute only")
    parser.add_argument("--turns", type=count, default=3, help="runs of each checkout with --baseline")
    options = parser.parse_args()
    if options.baseline and (options.store != "none" or not baseline.python_of(options.baseline).exists()):
        parser.error(f"--baseline: got {options.baseline}, needed a checkout with .venv/bin/python, and no --store")
    with errors_as_one_line():
        if options.baseline:
            arguments = [*as_arguments(options, "tracks", "cycles", "warmup", "workers", "seed"), "--no-score"]
            figures = baseline.compare(options.baseline, arguments, options.turns)
            figures["conditions"] = national.conditions(dict(options.set))
            lines = [*heading(figures), *baseline.table(figures)]
        else:
            load = Load(
                options.tracks,
                options.cycles,
                options.warmup,
                options.workers,
                options.store,
                options.seed,
                dict(options.set),
                not options.no_score,
            )
            figures = figures_of(load, run_with_progress(load))
            lines = [text(figures)]
    print(json.dumps(figures) if options.json else "\n".join(lines))


if __name__ == "__main__":
    main()
