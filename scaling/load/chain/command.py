"""Time, memory and quality of the whole chain from plots, on a coast of radar regions:

python -m scaling.load.chain --vessels N --cycles C [--workers W] [--method threads|processes|ray] [--store URL] [--json]
python -m scaling.load.chain --vessels N --one-region          one region that grows by range instead of more regions
python -m scaling.load.chain --ramp N,N,...                    each size in a process of its own, with the exponent of cost
python -m scaling.load.chain --vessels N --baseline CHECKOUT [--turns T]     compute time and quality beside another checkout
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from statistics import mean, median
from typing import Any

from coastwatch.operators.cli.arguments import count
from coastwatch.server.timing import date_utc, machine
from coastwatch.server.writing.writer import STAGE
from scaling.load import baseline
from scaling.load.chain import scores as quality
from scaling.load.chain.run import CycleResult, Load, run_cycles
from scaling.load.chain.world import CLUTTER_PER_M2, Size, build_world, conditions
from scaling.load.cycle import MIB, heading, summary, time_line, writer_behind
from scaling.load.options import as_arguments, errors_as_one_line, load_parser
from scaling.load.progress import report_progress
from scaling.load.ramp import cost_of, exponents
from scaling.load.run import STORE_STAGES

MODULE = "scaling.load.chain"


def run(load: Load) -> dict[str, Any]:
    """The figures of a run, with progress on stderr."""
    done: list[CycleResult] = []
    total = load.size.cycles
    with report_progress() as progress:
        progress(0, total, "building the world")
        world = build_world(load.size, load.settings, load.seed)
        for cycle in run_cycles(load, world):
            done.append(cycle)
            warning = f"; {cycle.warning}" if cycle.warning else ""
            progress(len(done), total, f"{cycle.tracks} tracks, {1e3 * cycle.times.compute_s:.0f} ms{warning}")
        figures = figures_of(load, done, world.scenario.period_s, world.scenario.workers.method)
        tally = done[-1].tally
        if tally is not None:
            progress(len(done), total, "the bound")
            figures["quality"] = quality.result(tally, world, quality.sample_of(world))
    return figures


def figures_of(load: Load, cycles: Sequence[CycleResult], period_s: float, method: str) -> dict[str, Any]:
    """The figures of a run without its quality, ready for JSON: medians over the cycles after the warm-up; times in seconds."""
    counted = [c for c in cycles if c.warm]
    times, last, size = [c.times for c in counted], counted[-1], load.size
    stages = {stage: [t.stages_s.get(stage, 0.0) for t in times] for stage in sorted_stages(counted)}
    if STAGE in stages:  # of the cycles in which a write ended
        stages[STAGE] = [t.stages_s[STAGE] for t in times if STAGE in t.stages_s]
    compute, whole = ([getattr(t, name) for t in times] for name in ("compute_s", "cycle_s"))
    total = sum(mean(s) for stage, s in stages.items() if stage not in STORE_STAGES)
    plots = mean(c.plots for c in counted)
    return {
        "load": {
            "vessels": size.vessels,
            "regions": size.regions,
            "radars": size.regions * size.radars,
            "clutter_per_m2": size.clutter_per_m2,
            "apart": size.apart,
            "cycles": len(counted),
            "warmup": load.warmup,
            "workers": load.workers,
            "method": method,
        },
        "seed": load.seed,
        "settings": dict(load.settings),
        "conditions": conditions(size, load.settings),
        "store": load.store.partition(":")[0],
        "date": date_utc(),
        "machine": machine(),
        "plots": plots,
        "clutter": mean(c.clutter for c in counted),
        "plots_per_vessel": plots / size.vessels,
        "ais_reports": mean(c.ais_reports for c in counted),
        "bearings": mean(c.bearings for c in counted),
        "tracks": last.tracks,
        "vessels_in_picture": last.vessels,
        "pairs_tested": last.pairs_tested,
        "stages_s": {
            stage: summary(s) | {"share": mean(s) / total if stage not in STORE_STAGES else None} for stage, s in stages.items()
        },
        "stages_cpu_s": {stage: median(c.stages_cpu_s.get(stage, 0.0) for c in counted) for stage in last.stages_cpu_s},
        "compute_s": summary(compute) | {"share_of_period": median(compute) / period_s},
        "compute_cpu_s": median(t.compute_cpu_s for t in times),
        "store_cpu_s": median(t.store_cpu_s for t in times),
        "cycle_s": summary(whole) | {"mean": mean(whole), "share_of_period": median(whole) / period_s},
        "late_cycles": sum(s > period_s for s in whole),
        "writer_behind_cycles": writer_behind([c.times for c in counted if c.number > 0], load.store),
        "first_cycle_s": cycles[0].times.cycle_s,
        "generator_s": median(t.generator_s for t in times),
        "rows_written": median(c.rows_written for c in counted),
        "memory_mib": {"now": last.memory_bytes / MIB, "peak": max(c.peak_memory_bytes for c in cycles) / MIB},
    }


def sorted_stages(cycles: Sequence[CycleResult]) -> list[str]:
    """The stages of these cycles, in the order of the flow; a stage that does not run in every cycle comes last."""
    every = dict.fromkeys(stage for c in cycles for stage in c.times.stages_s)
    return sorted(every, key=lambda stage: stage in (*STORE_STAGES, "checkpoint"))


def text(figures: dict[str, Any]) -> str:
    """The figures as a table for people."""
    f, load, memory = figures, figures["load"], figures["memory_mib"]
    lines = [
        *heading(f),
        f"{load['vessels']} vessels, {load['regions']} regions, {load['radars']} radars; {load['cycles']} cycles after "
        f"{load['warmup']}, {load['workers']} workers ({load['method']}), store {f['store']}",
        f"a cycle: {f['plots']:.0f} plots ({f['clutter']:.0f} of clutter; {f['plots_per_vessel']:.2f} a vessel), "
        f"{f['ais_reports']:.0f} AIS reports, {f['bearings']:.0f} bearings; {f['tracks']} tracks, {f['pairs_tested']} pairs "
        f"tested, {f['vessels_in_picture']} vessels",
    ]
    for stage, t in f["stages_s"].items():
        cpu = f"   cpu {1e3 * f['stages_cpu_s'][stage]:9.2f} ms" if stage in f["stages_cpu_s"] else ""
        lines.append(time_line(stage, t) + cpu + ("" if t["share"] is None else f"   {100 * t['share']:5.1f} %"))
    for name in ("compute", "cycle"):
        lines.append(f"{time_line(name, f[f'{name}_s'])}   {100 * f[f'{name}_s']['share_of_period']:5.1f} % of the period")
    lines[-1] += f", mean {1e3 * f['cycle_s']['mean']:.1f} ms, {f['late_cycles']} late"
    lines.append(
        f"processor time of compute {1e3 * f['compute_cpu_s']:.0f} ms, of the writer {1e3 * f['store_cpu_s']:.0f} ms; first cycle "
        f"{1e3 * f['first_cycle_s']:.0f} ms; generator {1e3 * f['generator_s']:.0f} ms, not counted"
    )
    lines.append(f"memory of all processes: {memory['now']:.0f} MiB (PSS), peak at most {memory['peak']:.0f} MiB")
    if f["store"] != "none":
        behind = f"writer behind in {f['writer_behind_cycles']} of {load['cycles']} cycles"
        lines.append(f"{f['rows_written']:.0f} rows written a cycle, {behind}")
    return "\n".join([*lines, *quality_lines(f["quality"])] if "quality" in f else lines)


def quality_lines(q: dict[str, Any]) -> list[str]:
    """The scores as lines for people."""
    t, fused, pairs, bearings = q["tracks"], q["fused_tracks"], q["associations"], q["bearing_associations"]
    return [
        f"regional tracks: completeness {t['completeness']:.4f}, {t['false_tracks']:.1f} false, id switches {t['id_switches']}, "
        f"RMSE {_metres(t['position_rmse_m'])} and {t['velocity_rmse_m_s']:.2f} m/s, GOSPA {_metres(t['gospa_m'])} a vessel; "
        f"sample {_metres(t['sample_rmse_m'])}, its bound {_metres(t['bound_rmse_m'])}",
        f"associations: F1 {100 * pairs['f1']:.3f} % ({pairs['tp']} right, {pairs['fn']} missed, {pairs['fp']} false); "
        f"bearings: F1 {100 * bearings['f1']:.3f} %",
        f"fused: RMSE {_metres(fused['position_rmse_m'])}, of their radar tracks {_metres(fused['radar_position_rmse_m'])}; "
        f"sample {_metres(fused['sample_rmse_m'])}, its bound {_metres(fused['bound_rmse_m'])}; "
        f"picture: id switches {q['picture']['id_switches']}, purity {_share(q['picture']['purity'])}",
    ]


def _metres(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f} m"


def _share(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"


def ramp(sizes: Sequence[int], arguments: Sequence[str]) -> dict[str, Any]:
    """The figures of each size, and the exponents of each cost from one size to the next and over all."""
    runs = []
    with report_progress("size") as progress:
        for k, vessels in enumerate(sizes):
            progress(k, len(sizes), f"{vessels} vessels")
            runs.append(baseline.figures(baseline.CHECKOUT, ["--vessels", str(vessels), *arguments], MODULE))
    return {"sizes": runs, **exponents(runs, lambda f: f["load"]["vessels"], "stages_cpu_s")}


def ramp_text(made: dict[str, Any]) -> str:
    """Sizes and exponents as tables for people."""
    runs, heads = made["sizes"], ("vessels", "regions", "plots", "a vessel", "compute ms", "p99 ms", "cpu ms", "peak MiB")
    lines = [*heading(runs[0]), "".join(f"{head:>11}" for head in heads) + "  completeness   false    F1 %   RMSE m"]
    for f in runs:
        load, compute = f["load"], f["compute_s"]
        row = f"{load['vessels']:11d}{load['regions']:11d}{f['plots']:11.0f}{f['plots_per_vessel']:11.2f}"
        row += f"{1e3 * compute['median']:11.1f}{1e3 * compute['p99']:11.1f}{1e3 * f['compute_cpu_s']:11.1f}"
        row += f"{f['memory_mib']['peak']:11.0f}"
        if "quality" in f:
            t = f["quality"]["tracks"]
            row += f"{t['completeness']:14.4f}{t['false_tracks']:8.1f}{100 * f['quality']['associations']['f1']:8.3f}"
            row += f"{t['position_rmse_m']:9.1f}"
        lines.append(row)
    lines.append(
        f"{'ms; stages by processor time':<32}" + "".join(f"{f['load']['vessels']:>11d}" for f in runs) + "    exponent"
    )
    for name, power in made["exponent"].items():
        seconds = [cost_of(f, name) for f in runs]
        costs = "".join(f"{'-':>11}" if s is None else f"{1e3 * s:11.1f}" for s in seconds)
        local = " ".join("-" if p is None else f"{p:.2f}" for p in made["local"][name])
        overall = "-" if power is None else f"{power:.2f}"
        lines.append(f"  {name.removeprefix('stages_cpu_s.'):<30}{costs}    {overall} ({local})")
    return "\n".join(lines)


def sizes(text: str) -> list[int]:
    """Numbers of vessels, separated by commas."""
    return [count(part) for part in text.split(",")]


def parser() -> argparse.ArgumentParser:
    """The options of the command."""
    out = load_parser(__doc__)
    out.set_defaults(warmup=10)
    out.add_argument("--vessels", type=count, default=16_000)
    out.add_argument("--cycles", type=count, default=12, help="measured cycles")
    out.add_argument("--region-vessels", type=count, default=16_000, help="vessels of a region, at most")
    out.add_argument("--one-region", action="store_true", help="one region, whose ranges grow with the root of the vessels")
    out.add_argument("--apart", action="store_true", help="regions that do not see each other's vessels: exactly like ones")
    out.add_argument("--radars", type=int, choices=(2, 3), default=2, help="of a region")
    out.add_argument("--clutter", type=float, default=CLUTTER_PER_M2, metavar="PER_M2", help="false plots a turn; 0: none")
    out.add_argument("--method", choices=("auto", "threads", "processes", "ray"), help="the same as --set workers.method=...")
    out.add_argument("--no-score", action="store_true", help="time and memory alone; scores take memory")
    out.add_argument("--ramp", type=sizes, metavar="N,N,...", help="these numbers of vessels, each in a process of its own")
    out.add_argument(
        "--baseline", type=Path, metavar="CHECKOUT", help="another checkout with its own .venv: times and quality of both"
    )
    out.add_argument("--turns", type=count, default=3, help="runs of each checkout with --baseline")
    return out


def main() -> None:
    reader = parser()
    options = reader.parse_args()
    if options.method:
        options.set.append(("workers.method", options.method))
    if options.baseline and (options.store != "none" or not baseline.python_of(options.baseline).exists()):
        reader.error(f"--baseline: got {options.baseline}, needed a checkout with .venv/bin/python, and no --store")
    others = as_arguments(options, "cycles", "warmup", "workers", "seed", "region-vessels", "radars", "clutter", "store")
    others += [f"--{flag}" for flag in ("one-region", "apart", "no-score") if getattr(options, flag.replace("-", "_"))]
    with errors_as_one_line():
        if options.ramp:
            figures = ramp(options.ramp, others)
            lines = [ramp_text(figures)]
        elif options.baseline:
            given = ["--vessels", str(options.vessels), *others]
            figures = baseline.compare(options.baseline, given, options.turns, MODULE)
            figures["conditions"] = conditions(size_of(options), dict(options.set))
            lines = [*heading(figures), *baseline.table(figures)]
            lines += [f"{name}: {line}" for name, q in figures["quality"].items() for line in quality_lines(q)]
        else:
            score = not options.no_score
            load = Load(
                size_of(options), options.warmup, options.workers, options.store, options.seed, dict(options.set), score
            )
            figures = run(load)
            lines = [text(figures)]
    print(json.dumps(figures) if options.json else "\n".join(lines))


def size_of(options: argparse.Namespace) -> Size:
    """The size that the options ask for."""
    region = options.vessels if options.one_region else options.region_vessels
    cycles = options.warmup + options.cycles
    return Size(options.vessels, cycles, region, options.radars, options.clutter, options.apart)
