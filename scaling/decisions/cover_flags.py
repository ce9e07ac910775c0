"""What the learnt cover of radars changes: vessel time flagged, and what the stage costs.

    python -m scaling.decisions.cover_flags SCENARIO [--cycles N] [--seed S] [--set KEY=VALUE ...]
Each scenario runs twice, with `cover.method` disc and learnt. One line each: cycles, AIS vessel time, share of it flagged as AIS
without radar, MMSI flagged, flagged vessel time within 200 m of the true vessel, vessel time with other flags, and
milliseconds of processor a cycle of the stage `cover`.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from coastwatch.batches import Flag, Picture, Recording
from coastwatch.cycle import run_cycle, start_run
from coastwatch.geodesy import difference_m
from coastwatch.kernels.tables.match_ids import index_of
from coastwatch.operators.cli.arguments import pair
from coastwatch.scenario import Scenario, load_scenario
from coastwatch.stage import serial

OTHERS = (Flag.DARK, Flag.AIS_CONTRADICTED, Flag.MMSI_TWICE)
NEAR_M = 200.0


def measure(scenario: Scenario, seed: int) -> str:
    """One line of figures."""
    sensors, plan = scenario.sensors(), scenario.plan()
    recording = scenario.input.load(sensors, seed, plan)
    reports = recording.reports
    memory, before_s, spent_s = start_run(scenario, sensors), -np.inf, []

    @contextmanager
    def timer(stage: str) -> Iterator[None]:
        begun = time.process_time()
        yield
        if stage == "cover":
            spent_s.append(time.process_time() - begun)

    vessels, flagged, false, mmsi, others = 0, 0, 0, set(), dict.fromkeys(OTHERS, 0)
    for number in range(plan.cycles):
        now_s = plan.instant_s(number)
        part = reports.between(before_s, now_s)
        memory, cycle = run_cycle(scenario, sensors, memory, part, now_s, serial, timer)
        before_s = now_s
        with_ais = np.isin(cycle.picture.vessel_id, cycle.members.vessel_id[cycle.members.source == sensors.ais_source])
        lone = cycle.picture.flags & int(Flag.AIS_WITHOUT_RADAR) > 0
        vessels, flagged = vessels + int(with_ais.sum()), flagged + int(lone.sum())
        false += near_their_truth(cycle.picture.take(lone), recording, now_s)
        mmsi |= set(cycle.picture.mmsi[lone].tolist())
        for flag in OTHERS:
            others[flag] += int((cycle.picture.flags & int(flag) > 0).sum())
    counts = ", ".join(f"{flag.name} {count}" for flag, count in others.items())
    return (
        f"{scenario.cover.method}: {plan.cycles} cycles, AIS vessels x cycles {vessels}, AIS without radar {flagged} "
        f"({100.0 * flagged / max(vessels, 1):.2f} %) of {len(mmsi)} MMSI, {false} within 200 m of the true vessel; {counts}; "
        f"cover {1e3 * np.median(spent_s):.2f} ms"
    )


def near_their_truth(flagged: Picture, recording: Recording, now_s: float) -> int:
    """How many of these vessels are near the true vessel: the flag is false."""
    if recording.truth is None:
        return 0
    truth = recording.truth.at(now_s)
    at = index_of(truth.vessel, flagged.origin)
    known = np.flatnonzero(at >= 0)
    apart = difference_m(flagged.position_deg[known], truth.position_deg[at[known]])
    return int((np.hypot(apart[:, 0], apart[:, 1]) <= NEAR_M).sum())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario")
    parser.add_argument("--cycles", type=int)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", type=pair, help="a setting of the scenario")
    options = parser.parse_args()
    changes = dict(options.set)
    if options.cycles:
        changes["cycles"] = str(options.cycles)
    for method in ("disc", "learnt"):
        scenario = load_scenario(options.scenario, {**changes, "cover.method": method})
        print(measure(scenario, options.seed), flush=True)


if __name__ == "__main__":
    main()
