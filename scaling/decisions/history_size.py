"""How much does the history take under which bound? Rows and bytes a vessel and hour, of a scenario or of the national load.

    python -m scaling.decisions.history_size [SCENARIO] [--set KEY=VALUE ...]
    python -m scaling.decisions.history_size --tracks N --cycles C [--set KEY=VALUE ...]

The default is the scenario solent. With `--tracks` it is the load of scaling/load, after 20 cycles that do not count. One run is
stored under its own bound, and its pictures also pass the rule under the other bounds. Bytes are the pages of table `history` in
SQLite, divided by its rows.
"""

from __future__ import annotations

import argparse
import sqlite3
import tempfile
from itertools import product

from coastwatch.centre import Cycle, run_centre, start_centre
from coastwatch.operators.cli.arguments import count, pair
from coastwatch.scenario import Scenario, load_scenario
from coastwatch.server.run import run_scenario
from coastwatch.server.timing import Stopwatch
from coastwatch.stage import Plan
from coastwatch.store import history_rule
from coastwatch.store.history_rule import Bound
from coastwatch.workers import open_workers
from scaling.load import national
from scaling.load.run import RunDatabase, statics_alone

ERRORS_M = (5.0, 10.0, 25.0, 100.0)
LONGEST_S = (60.0, 300.0, 1800.0)
WARM = 20  # cycles


class Asked:
    """The rule under one bound, asked cycle by cycle."""

    def __init__(self, bound: Bound) -> None:
        self.bound, self.rows, self._points, self._number, self._before_s = bound, 0, history_rule.no_points(), 0, float("-inf")

    def __call__(self, cycle: Cycle) -> None:
        known = self._points, self.bound, self._number, cycle.time_s, self._before_s
        self._points, added = history_rule.extend(*known, cycle.picture)
        self.rows, self._number, self._before_s = self.rows + added.points, self._number + 1, cycle.time_s


def table(name: str, scenario: Scenario, hours: float, asked: list[Asked], database: str) -> None:
    """Print what each bound costs."""
    with sqlite3.connect(database) as raw:
        rows = raw.execute("SELECT count(*) FROM history").fetchone()[0]
        a_row = raw.execute("SELECT sum(pgsize) FROM dbstat WHERE name = 'history'").fetchone()[0] / rows
    print(
        f"{name}: {hours:.1f} vessel-hours, {rows} rows stored, {a_row:.0f} bytes a row; a row a cycle: {3600.0 / scenario.period_s:.0f}"
    )
    print("off by at most | at least every | rows a vessel-hour | bytes a vessel-hour")
    for one in asked:
        a_hour = one.rows / hours
        print(f"{one.bound.error_m:>12.0f} m | {one.bound.max_s:>12.0f} s | {a_hour:>18.1f} | {a_hour * a_row:>19.0f}")


def bounds() -> list[Asked]:
    return [Asked(Bound(*of)) for of in product(ERRORS_M, LONGEST_S)]


def of_scenario(name: str, settings: dict[str, str]) -> None:
    """From start to end."""
    scenario, asked, hours = load_scenario(name, settings), bounds(), 0.0

    def on_cycle(cycle: Cycle) -> None:
        nonlocal hours
        hours += len(cycle.picture) * scenario.period_s / 3600.0
        for one in asked:
            one(cycle)

    with tempfile.TemporaryDirectory() as folder:
        run_scenario(scenario, database=f"sqlite:///{folder}/x.db", on_cycle=on_cycle)
        table(name, scenario, hours, asked, f"{folder}/x.db")


def of_load(tracks: int, cycles: int, settings: dict[str, str]) -> None:
    """The tracks of a nation; the points with which its vessels begin are not counted."""
    world = national.build_world(tracks, 1)
    scenario = national.scenario_of(world, settings)
    sensors, asked, hours, watch = scenario.sensors(), bounds(), 0.0, Stopwatch()
    plan = Plan(start_s=world.time_s(-1), period_s=world.period_s, cycles=WARM + cycles)
    state, memory = national.initial_state(world), start_centre(scenario)
    with tempfile.TemporaryDirectory() as folder, open_workers("threads", 1) as workers:
        with RunDatabase(f"sqlite:///{folder}/x.db", scenario, sensors, plan, 1) as keeper:
            for number in range(WARM + cycles):
                state, received = national.next_cycle(world, state, sensors)
                memory, cycle = run_centre(scenario, sensors, memory, received, world.time_s(number), workers.spots, watch)
                keeper.write(number, cycle, statics_alone(received.statics), watch.lap())
                for one in asked:
                    one(cycle)
                if number == WARM - 1:
                    for one in asked:
                        one.rows = 0
                hours += len(cycle.picture) * scenario.period_s / 3600.0 * (number >= WARM)
        table(f"{tracks} tracks", scenario, hours, asked, f"{folder}/x.db")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario", nargs="?", default="solent", help="default: solent")
    parser.add_argument("--tracks", type=count, help="the load of scaling/load instead of a scenario")
    parser.add_argument("--cycles", type=count, default=100, help="of the load, after 20 that do not count (default: 100)")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", type=pair, help="a setting of the scenario")
    asked = parser.parse_args()
    if asked.tracks:
        of_load(asked.tracks, asked.cycles, dict(asked.set))
    else:
        of_scenario(asked.scenario, dict(asked.set))


if __name__ == "__main__":
    main()
