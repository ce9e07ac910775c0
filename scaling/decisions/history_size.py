"""How much does the history take under which bound? Rows and bytes a vessel and hour, of a scenario from start to end.

Run: .venv/bin/python scaling/decisions/history_size.py [SCENARIO] [key=value]...     (default: solent; settings as of `run --set`)
The scenario is run once with its own bound; the rule is asked on every picture under the others too. Bytes are what SQLite's pages
of table `history` take, divided by its rows.
"""

from __future__ import annotations

import sqlite3
import sys
import tempfile
from itertools import product

from coastwatch.pipeline import Cycle
from coastwatch.scenario import load_scenario
from coastwatch.server.run import run_scenario
from coastwatch.store import history_rule
from coastwatch.store.history_rule import Bound

ERRORS_M = (5.0, 10.0, 25.0, 100.0)
LONGEST_S = (60.0, 300.0, 1800.0)


class Asked:
    """The rule under one bound, asked cycle by cycle."""

    def __init__(self, bound: Bound) -> None:
        self.bound, self.rows, self._points, self._number, self._before_s = bound, 0, history_rule.none(), 0, float("-inf")

    def __call__(self, cycle: Cycle) -> None:
        known = self._points, self.bound, self._number, cycle.time_s, self._before_s
        self._points, added = history_rule.step(*known, cycle.picture)
        self.rows, self._number, self._before_s = self.rows + added.points, self._number + 1, cycle.time_s


def main(name: str, settings: dict[str, str]) -> None:
    scenario = load_scenario(name, settings)
    asked = [Asked(Bound(*of)) for of in product(ERRORS_M, LONGEST_S)]
    hours = 0.0

    def on_cycle(cycle: Cycle) -> None:
        nonlocal hours
        hours += len(cycle.picture) * scenario.period_s / 3600.0
        for one in asked:
            one(cycle)

    with tempfile.TemporaryDirectory() as folder:
        run_scenario(scenario, database=f"sqlite:///{folder}/x.db", on_cycle=on_cycle)
        with sqlite3.connect(f"{folder}/x.db") as raw:
            rows = raw.execute("SELECT count(*) FROM history").fetchone()[0]
            a_row = raw.execute("SELECT sum(pgsize) FROM dbstat WHERE name = 'history'").fetchone()[0] / rows
    print(
        f"{name}: {hours:.1f} vessel-hours, {rows} rows stored, {a_row:.0f} bytes a row; a row a cycle: {3600.0 / scenario.period_s:.0f}"
    )
    print("off by at most | at least every | rows a vessel-hour | bytes a vessel-hour")
    for one in asked:
        a_hour = one.rows / hours
        print(f"{one.bound.error_m:>11.0f} m | {one.bound.max_s:>12.0f} s | {a_hour:>18.1f} | {a_hour * a_row:>19.0f}")


if __name__ == "__main__":
    words = sys.argv[1:] or ["solent"]
    main(words[0], dict(word.split("=", 1) for word in words[1:]))
