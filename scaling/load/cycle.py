"""Time, memory and quality of whole cycles of the high-level centre under a national picture:

python -m scaling.load.cycle --tracks N --cycles C [--workers W] [--store URL|none] [--set KEY=VALUE ...] [--json]
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from statistics import mean, median
from typing import Any

import numpy as np

from coastwatch.operators.cli.arguments import count
from coastwatch.operators.cli.progress import shown
from coastwatch.scores.confusion import Confusion
from coastwatch.server.machine import date_utc, machine
from scaling.load.command import arguments, one_sentence, settings_of
from scaling.load.running import Load, Measured, measured, said

PERIOD_S = 3.0
MIB = 2.0**20


def run(load: Load) -> list[Measured]:
    """All cycles, with progress on stderr."""
    out, every = [], load.warmup + load.cycles
    with shown() as say:
        say(0, every, "laying the world")
        for cycle in measured(load):
            out.append(cycle)
            say(len(out), every, f"{cycle.tracks} tracks, {1e3 * cycle.taken.compute_s:.0f} ms{said(cycle.taken)}")
    return out


def report(load: Load, cycles: Sequence[Measured]) -> dict[str, Any]:
    """The figures of a run: medians over the cycles after the warm-up."""
    counted = [c for c in cycles if c.counts]
    taken = [c.taken for c in counted]
    stages = {stage: _spread([t.seconds[stage] for t in taken]) for stage in taken[-1].seconds}
    compute, whole = ([getattr(t, name) for t in taken] for name in ("compute_s", "all_s"))
    budget: dict[str, Confusion] = {}
    for cycle in counted:
        for part, counts in cycle.budget.items():
            budget[part] = budget.get(part, Confusion()) + counts
    last = counted[-1]
    return {
        "asked": {"tracks": load.tracks, "cycles": load.cycles, "warmup": load.warmup, "workers": load.workers},
        "seed": load.seed,
        "settings": dict(load.settings),
        "store": load.store.partition(":")[0],
        "date": date_utc(),
        "machine": machine(),
        "tracks": last.tracks,
        "bearing_tracks": last.bearing_tracks,
        "vessels": last.vessels,
        "stages_s": stages,
        "compute_s": _spread(compute) | {"share_of_period": median(compute) / PERIOD_S},
        "compute_cpu_s": median(t.compute_cpu_s for t in taken),
        "store_cpu_s": _spread([t.store_cpu_s for t in taken]) | {"mean": mean(t.store_cpu_s for t in taken)},
        "cycle_s": _spread(whole) | {"mean": mean(whole), "share_of_period": median(whole) / PERIOD_S},
        "generator_s": median(t.generator_s for t in taken),
        "pairs_tested": last.pairs_tested,
        "rows_written": median(t.rows_written for t in taken),
        "memory_mib": {"now": taken[-1].memory_bytes / MIB, "peak": max(c.taken.peak_memory_bytes for c in cycles) / MIB},
        "decisions": {part: counts.as_dict() for part, counts in budget.items()},
    }


def _spread(seconds: Sequence[float]) -> dict[str, float]:
    return {"median": median(seconds), "p99": float(np.percentile(seconds, 99)), "least": min(seconds)}


def text(figures: dict[str, Any]) -> str:
    """The same for people."""
    f, asked, machine_ = figures, figures["asked"], figures["machine"]
    lines = [
        f"# {f['date']}, {machine_['processors']} x {machine_['processor']}, load {machine_['load']}",
        f"{f['tracks']} tracks and {f['bearing_tracks']} bearings to {f['vessels']} vessels, {asked['cycles']} cycles after "
        f"{asked['warmup']}, {asked['workers']} workers, store {f['store']}, {' '.join(map('='.join, f['settings'].items()))}",
    ]
    for stage, t in f["stages_s"].items():
        lines.append(_times(stage, t))
    for name in ("compute", "cycle"):
        lines.append(f"{_times(name, f[f'{name}_s'])}   {100 * f[f'{name}_s']['share_of_period']:6.2f} % of the period")
    lines[-1] += f", mean {1e3 * f['cycle_s']['mean']:.2f} ms"
    lines.append(
        f"processor time of compute {1e3 * f['compute_cpu_s']:.0f} ms; generator {1e3 * f['generator_s']:.0f} ms, not counted"
    )
    if f["store"] != "none":
        lines.append("processor time of the writer: " + ", ".join(f"{k} {1e3 * s:.0f} ms" for k, s in f["store_cpu_s"].items()))
    memory = f["memory_mib"]
    lines.append(f"{f['pairs_tested']} pairs within the gate, {f['rows_written']:.0f} rows written a cycle")
    lines.append(f"memory of all processes: {memory['now']:.0f} MiB (PSS), peak at most {memory['peak']:.0f} MiB")
    lines.append(f"{'decisions':<12}{'F1 %':>9}{'precision':>11}{'recall':>9}{'right':>10}{'missed':>8}{'false':>7}")
    for part, d in f["decisions"].items():
        rates = f"{100 * d['f1']:9.3f}{100 * d['precision']:11.3f}{100 * d['recall']:9.3f}"
        lines.append(f"{part:<12}{rates}{d['tp']:10d}{d['fn']:8d}{d['fp']:7d}")
    return "\n".join(lines)


def _times(name: str, t: dict[str, float]) -> str:
    return f"  {name:<22} median {1e3 * t['median']:9.2f} ms   p99 {1e3 * t['p99']:9.2f} ms   least {1e3 * t['least']:9.2f} ms"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--tracks", type=count, default=10_000)
    parser.add_argument("--cycles", type=count, default=20)
    parser.add_argument(
        "--no-score", action="store_true", help="time and memory alone: counting decisions takes memory of its own"
    )
    asked = parser.parse_args()
    score, settings = not asked.no_score, settings_of(asked)
    load = Load(asked.tracks, asked.cycles, asked.warmup, asked.workers, asked.store, asked.seed, settings, score)
    with one_sentence():
        figures = report(load, run(load))
    print(json.dumps(figures) if asked.json else text(figures))


if __name__ == "__main__":
    main()
