"""`coastwatch reproduce`: every published figure of a paper, run and reported."""

from __future__ import annotations

import argparse
import sys
from typing import Any

from coastwatch.operators.cli import progress
from coastwatch.operators.cli.arguments import count

INTERRUPTED = 130


def add(commands: Any) -> None:
    """Adds `reproduce` to the parser."""
    text = (
        "Reproduce every published figure of a paper: runs of its methods as written and of ours, over seeds 1000, 1001, ..., then one "
        "HTML report and one JSON file. Finished runs are kept in the output folder: the same command goes on where it was "
        "interrupted, and does only what is missing."
    )
    reproduce = commands.add_parser("reproduce", help="reproduce the published figures of a paper", description=text)
    reproduce.add_argument("paper", metavar="PAPER", help="the paper: rangel")
    reproduce.add_argument(
        "--runs", metavar="N", type=count, help="runs of each variant (default: as many as the paper averages)"
    )
    reproduce.add_argument("--workers", metavar="N", type=count, default=1, help="processes that share the runs (default: 1)")
    reproduce.add_argument(
        "--output", metavar="DIR", help="folder of the report and the finished runs (default: reproduction-PAPER)"
    )
    reproduce.add_argument(
        "--only", metavar="NAME", nargs="+", default=[], help="only these scenarios, e.g. tables-1-2 figure-3 (default: all)"
    )
    reproduce.set_defaults(act=_reproduce)


def _reproduce(options: argparse.Namespace) -> int:
    from coastwatch.operators.reproduction import keeping, planning, published, report, running

    folders = published.chosen(options.paper, tuple(options.only))
    plan = planning.plan(folders, options.runs, keeping.code())
    kept = keeping.Kept(options.output or f"reproduction-{options.paper}")
    jobs = planning.unlike(plan)
    todo = running.missing(kept, jobs)
    minutes = running.estimate_s(todo, options.workers) / 60.0
    print(
        f"{len(jobs)} runs, {len(todo)} of them to do: about {max(minutes, 0.1):.1f} min with {options.workers} worker(s)",
        file=sys.stderr,
    )
    try:
        with progress.shown("run") as show:
            running.carry_out(kept, jobs, options.workers, show)
    except KeyboardInterrupt:
        left = len(running.missing(kept, jobs))
        print(f"coastwatch: interrupted with {left} of {len(jobs)} runs to do; the same command goes on", file=sys.stderr)
        return INTERRUPTED
    said = report.made(options.paper, folders, plan, kept, _command(options))
    for line in report.lines(said):
        print(line)
    print(report.written_page(kept, said))
    print(report.written_numbers(kept, said))
    return 0


def _command(options: argparse.Namespace) -> str:
    words = ["coastwatch reproduce", options.paper]
    words += [f"--runs {options.runs}"] if options.runs else []
    words += [f"--only {' '.join(options.only)}"] if options.only else []
    return " ".join(words)
