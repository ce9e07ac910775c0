"""How many vessels carry the MMSI of another ship, by the truth of a simulation, and what lets a former MMSI go.

    python -m scaling.decisions.wrong_identities [SCENARIO ...] [--seeds 1,2] [--cycles N] [--set KEY=VALUE ...]

Without a scenario: context-driven-1000, busy-harbour, and `dense`, which is guanabara with 600 vessels in 3 by 3 NM. The scenario
`silent` is the same with 40 % of the transponders silent from 120 s on. Each seed gives one line, counted in the newest LAST cycles:

- wrong: vessels with an MMSI under which their true ship never sent; the most in a cycle, and in the last one
- without AIS: of them, vessels that have no AIS track
- former: vessels that go on under a former MMSI, in the last cycle
- doubled: MMSI of two or more vessels of a cycle, of which one has no live AIS track, or is not flagged; the most in a cycle
"""

from __future__ import annotations

import argparse
from contextlib import nullcontext
from typing import NamedTuple

import numpy as np

from coastwatch.batches import AisReports, Flag, Ints, Members, Picture, Reports
from coastwatch.cycle import run_cycle, start_run
from coastwatch.operators.cli.arguments import names, pair
from coastwatch.scenario import Scenario, load_scenario
from coastwatch.stage import serial

DENSE = {"input.count": "600", "input.area_width_nm": "3", "input.area_height_nm": "3", "cycles": "120"}
SILENT = {**DENSE, "cycles": "200", "input.ais.silent_share": "0.4", "input.ais.silent_from_s": "120"}
NAMED = {"dense": ("guanabara", DENSE), "silent": ("guanabara", SILENT)}
LAST = 30
"""Cycles at the end that count."""


class Count(NamedTuple):
    """Vessels of a cycle."""

    wrong: int
    without_ais: int
    former: int
    doubled: int


def count(picture: Picture, members: Members, ais_source: int, sent: AisReports) -> Count:
    """The counts of a cycle. Args: sent: every report of the run, with its true ship."""
    has_ais = np.isin(picture.vessel_id, members.vessel_id[members.source == ais_source])
    known = (picture.mmsi >= 0) & (picture.origin >= 0)
    wrong = known & ~np.isin(_pairs(picture.mmsi, picture.origin), np.unique(_pairs(sent.mmsi, sent.origin)))
    mmsi, group, number = np.unique(picture.mmsi, return_inverse=True, return_counts=True)
    unsaid = ~has_ais | ((picture.flags & Flag.MMSI_TWICE) == 0)
    doubled = np.unique(group[unsaid & (picture.mmsi >= 0) & (number[group] > 1)])
    former = (picture.mmsi >= 0) & ~has_ais
    return Count(int(wrong.sum()), int((wrong & ~has_ais).sum()), int(former.sum()), len(mmsi[doubled]))


def _pairs(mmsi: Ints, origin: Ints) -> Ints:
    return mmsi * 10_000_000 + origin


def counts_of(scenario: Scenario, seed: int, last: int = LAST) -> list[Count]:
    """The counts of the newest cycles of a run. Raises: TypeError: its reports come as a stream."""
    sensors, plan = scenario.sensors(), scenario.plan()
    reports = scenario.input.load(sensors, seed, plan).reports
    if not isinstance(reports, Reports):
        raise TypeError(f"reports: got a {type(reports).__name__}, needed those of a simulation")
    memory, before_s, out = start_run(scenario, sensors), -np.inf, []
    for number in range(plan.cycles):
        now_s = plan.instant_s(number)
        part = reports.between(before_s, now_s)
        memory, cycle = run_cycle(scenario, sensors, memory, part, now_s, serial, lambda _: nullcontext(), zones=())
        if number >= plan.cycles - last:
            out.append(count(cycle.picture, cycle.members, sensors.ais_source, reports.ais))
        before_s = now_s
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario", nargs="*", default=["context-driven-1000", "busy-harbour", "dense"])
    parser.add_argument("--seeds", default="1", help="with commas between them")
    parser.add_argument("--cycles", type=int)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", type=pair, help="a setting of the scenario")
    options = parser.parse_args()
    for name in options.scenario:
        of, settings = NAMED.get(name, (name, {}))
        changes = {**settings, **dict(options.set)}
        if options.cycles:
            changes["cycles"] = str(options.cycles)
        scenario = load_scenario(of, changes)
        for seed in map(int, names(options.seeds)):
            found = counts_of(scenario, seed)
            most, end = Count(*np.max(found, axis=0).tolist()), found[-1]
            print(
                f"{name}, seed {seed}: wrong {most.wrong} at most, {end.wrong} in the last cycle ({end.without_ais} without AIS); "
                f"{end.former} under a former MMSI; {most.doubled} doubled at most",
                flush=True,
            )


if __name__ == "__main__":
    main()
