"""`run` and `scenarios`: run a scenario with progress on stderr, and print the result."""

from __future__ import annotations

import argparse
import json
import sys

from coastwatch import store
from coastwatch.formats.intake.accounts import LOSSES
from coastwatch.operators import tracks_csv, verdict
from coastwatch.operators.cli import DONE, FAILED, FELL, INTERRUPTED, inputs, progress, summary
from coastwatch.scenario import Scenario, load_scenario, scenario_names
from coastwatch.scores import figure_names
from coastwatch.server.run import OnCycle, RunResult, run_scenario
from coastwatch.spelling import json_value, printable, printable_lines


def run(options: argparse.Namespace) -> int:
    scenario = load_scenario(options.scenario, dict(options.settings))
    verdict.check_known(options.require, figure_names())
    if not options.tracks_csv:
        return carry_out(scenario, options, options.seed)
    origin_deg = options.tracks_origin or (scenario.area.latitude_deg, scenario.area.longitude_deg)
    with tracks_csv.written(options.tracks_csv, origin_deg) as add_cycle:
        return carry_out(scenario, options, options.seed, add_cycle)


def carry_out(scenario: Scenario, options: argparse.Namespace, seed: int | None, on_cycle: OnCycle | None = None) -> int:
    """Runs a scenario with the options of `arguments.add_running` and prints the result. Returns the exit code."""
    printed: list[str] = []  # hours before the result, if files are hours apart

    def warn(warnings: list[str]) -> None:
        for warning in warnings:
            if warning not in printed:
                print(f"coastwatch: warning: {printable(warning)}", file=sys.stderr)
        printed.extend(warnings)

    with progress.report_progress() as show:
        result = run_scenario(
            scenario,
            seed=seed,
            workers=options.workers,
            database=options.db,
            resume=options.resume,
            restart=options.restart,
            progress=show,
            on_cycle=on_cycle,
            on_input=lambda contents, faults: warn(inputs.warnings_of_files(scenario, contents, faults)),
        )
    if options.json:
        print(json.dumps(summary.as_object(scenario, result), allow_nan=False))
    else:
        print(printable_lines(summary.as_text(scenario, result)))
    warn(inputs.warnings(scenario, result))
    if result.interrupted:
        print("coastwatch: interrupted after a whole cycle; the same command with --resume continues", file=sys.stderr)
        return INTERRUPTED
    has_fallen, has_lost = fell(result, options), any(fault.kind in LOSSES for fault in result.faults)
    if getattr(options, "keep", None) is not None:
        with store.open_store(result.database) as opened, progress.report_progress("run") as show:
            store.keep_runs(opened, options.keep, result.scenario, show)
    return FAILED if has_lost else FELL if has_fallen else DONE


def fell(result: RunResult, options: argparse.Namespace) -> bool:
    """Whether a figure of a run is not as `--require` and `--compare` want it; prints and stores a sentence for each."""
    required, compare = getattr(options, "require", []), getattr(options, "compare", None)
    if not required and compare is None:
        return False
    scores = json_value(result.scores)
    sentences = verdict.below_required(scores, required)
    with store.open_store(result.database) as opened:
        if compare is not None:
            good = store.last_good_run(opened, result.scenario, result.seed, int(result.run_id))
            if good is None:
                print("coastwatch: --compare: there is no earlier good run of this scenario and seed", file=sys.stderr)
            else:
                sentences += verdict.worse_than(scores, *good, options.tolerance)
        store.set_verdict(opened, int(result.run_id), sentences)
    for sentence in sentences:
        print(f"coastwatch: {printable(sentence)}", file=sys.stderr)
    return bool(sentences)


def scenarios(options: argparse.Namespace) -> int:
    names = scenario_names()
    if options.json:
        print(json.dumps([{"name": name, "title": title} for name, title in names]))
        return 0
    width = max((len(name) for name, _ in names), default=0)
    for name, title in names:
        print(printable(f"{name:<{width}}  {title}".rstrip()))
    return 0
