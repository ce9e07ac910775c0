"""`reproduce`: every published figure of a paper, run and reported."""

from __future__ import annotations

import argparse
import sys

from coastwatch.operators.cli import DONE, FELL, INTERRUPTED, progress
from coastwatch.operators.plot import draw_run
from coastwatch.reproduction import finished_runs, planning, published, report, running


def reproduce(options: argparse.Namespace) -> int:
    """Runs what is missing and reports. Returns: 4 if a target is missed or an ordering fails."""
    folders = published.chosen(options.paper, tuple(options.only))
    plan = planning.plan(folders, options.runs, finished_runs.code(), seed=options.seed)
    kept = finished_runs.FinishedRuns(options.output or f"reproduction-{options.paper}")
    jobs = planning.unlike(plan)
    todo = running.missing(kept, jobs)
    minutes = running.estimate_s(todo, options.workers) / 60.0
    print(
        f"{len(jobs)} runs, {len(todo)} of them to do: about {max(minutes, 0.1):.1f} min with {options.workers} worker(s)",
        file=sys.stderr,
    )
    try:
        with progress.report_progress("run") as show:
            running.carry_out(kept, jobs, options.workers, show, draw_run)
    except KeyboardInterrupt:
        left = len(running.missing(kept, jobs))
        print(f"coastwatch: interrupted with {left} of {len(jobs)} runs to do; the same command continues", file=sys.stderr)
        return INTERRUPTED
    chosen = [f" --runs {options.runs}"] if options.runs else []
    chosen += [f" --seed {options.seed}"] if options.seed != planning.FIRST_SEED else []
    chosen += [f" --only {' '.join(options.only)}"] if options.only else []
    figures = report.made(options.paper, folders, plan, kept, f"coastwatch reproduce {options.paper}{''.join(chosen)}")
    for line in report.lines(figures):
        print(line)
    print(report.written_page(kept, figures))
    print(report.written_numbers(kept, figures))
    return FELL if figures.failures else DONE
