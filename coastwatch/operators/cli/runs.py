"""`coastwatch run` and `coastwatch scenarios`: start a run, show how it comes along and what came out."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

from coastwatch.operators.cli import progress
from coastwatch.operators.cli.arguments import add_db, add_set, count, place, whole

INTERRUPTED = 130


def add(commands: Any) -> None:
    """Adds `run` and `scenarios` to the parser."""
    text = (
        "Run a scenario: input through every stage to a stored picture. Ctrl-C ends it after a whole cycle; --resume goes on."
    )
    run = commands.add_parser("run", help="run a scenario to a stored picture", description=text)
    run.add_argument(
        "scenario", metavar="SCENARIO", help="name (see `coastwatch scenarios`), or path of a folder or .toml file"
    )
    run.add_argument("--seed", metavar="N", type=whole, help="seed of all randomness (default: the scenario's)")
    add_set(run, "override a setting, dotted, value as in TOML: radars.0.rpm=20, tracks.method=imm; repeatable")
    add_running(run)
    run.add_argument(
        "--tracks-csv",
        metavar="FILE",
        help="write the picture of every cycle of this run: time (unix s), track_id, north, east (m), vn, ve (m/s), latitude, longitude",
    )
    run.add_argument(
        "--tracks-origin",
        metavar="LAT,LON",
        type=place,
        help="where north and east are 0 (default: the centre of the scenario's area)",
    )
    run.set_defaults(act=_run)
    listing = commands.add_parser("scenarios", help="list the scenarios", description="List the scenarios that are shipped.")
    listing.add_argument("--json", action="store_true", help="print a JSON list of name and title")
    listing.set_defaults(act=_scenarios)


def add_running(parser: argparse.ArgumentParser) -> None:
    """Adds the options that every command has that makes a run."""
    parser.add_argument(
        "--workers", metavar="N", type=count, help="processors that share the work (default: the scenario's; see its [workers])"
    )
    add_db(parser)
    again = parser.add_mutually_exclusive_group()
    again.add_argument("--resume", action="store_true", help="go on with the newest unfinished run of this scenario and seed")
    again.add_argument("--restart", action="store_true", help="delete earlier runs of this scenario and seed, then start")
    parser.add_argument("--json", action="store_true", help="print one JSON object: scores, timings_s, database and more")


def carry_out(scenario: Any, options: argparse.Namespace, seed: int | None, on_cycle: Any = None) -> int:
    """Runs a scenario with the options of `add_running` and prints what came out: the exit code."""
    from coastwatch.operators.cli import summary
    from coastwatch.server.run import run_scenario

    with progress.shown() as show:
        result = run_scenario(
            scenario,
            seed=seed,
            workers=options.workers,
            database=options.db,
            resume=options.resume,
            restart=options.restart,
            progress=show,
            on_cycle=on_cycle,
        )
    if options.json:
        print(json.dumps(summary.as_object(scenario, result), allow_nan=False))
    else:
        print(summary.as_text(scenario, result))
    if result.interrupted:
        print("coastwatch: interrupted after a whole cycle; the same command with --resume goes on", file=sys.stderr)
    return INTERRUPTED if result.interrupted else 0


def _run(options: argparse.Namespace) -> int:
    from coastwatch.scenario import load_scenario

    scenario = load_scenario(options.scenario, dict(options.settings))
    if not options.tracks_csv:
        return carry_out(scenario, options, options.seed)
    from coastwatch.operators import tracks_csv

    origin_deg = options.tracks_origin or (scenario.area.latitude_deg, scenario.area.longitude_deg)
    with tracks_csv.written(options.tracks_csv, origin_deg) as add_cycle:
        return carry_out(scenario, options, options.seed, add_cycle)


def _scenarios(options: argparse.Namespace) -> int:
    from coastwatch.scenario import scenario_names

    found = scenario_names()
    if options.json:
        print(json.dumps([{"name": name, "title": title} for name, title in found]))
        return 0
    width = max((len(name) for name, _ in found), default=0)
    for name, title in found:
        print(f"{name:<{width}}  {title}".rstrip())
    return 0
