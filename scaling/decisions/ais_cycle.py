"""What the AIS filter costs in a cycle, against another checkout in turns: processor time, from reports to tracks and alarms.

    python -m scaling.decisions.ais_cycle [--vessels 100000] [--cycles 16] [--baseline DIR] [--turns 3] [--json]

Vessels sail straight at 0 to 25 kn. Two in ten are at rest and report every 180 s, the others every 10 s, with the errors of the
specification.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from coastwatch.batches import AisReports, Radars, Sensors, Sonars, Stations
from coastwatch.geodesy import KNOT_M_S, offset_deg
from coastwatch.tracks import AisInput
from coastwatch.tracks.ais.ais_filter import AisFilter
from scaling.load.baseline import compare, table

PERIOD_S, START_S = 3.0, 1.7e9
WARMUP = 6  # cycles that do not count: every vessel under way has reported twice by then
POSITION_SIGMA_M, SOG_SIGMA_KN, COG_SIGMA_DEG = 3.33, 0.2, 2.0


def figures(vessels: int, cycles: int) -> dict[str, Any]:
    """Wall and processor time of `AisFilter.step` in a cycle, seconds."""
    rng = np.random.default_rng([vessels, 1])
    home = np.column_stack([rng.uniform(-35.0, 0.0, vessels), rng.uniform(-50.0, -40.0, vessels)])
    rest = rng.random(vessels) < 0.2
    speed, course = np.where(rest, 0.0, rng.uniform(2.0, 25.0, vessels)) * KNOT_M_S, rng.uniform(0.0, 2.0 * np.pi, vessels)
    way = speed[:, None] * np.column_stack([np.sin(course), np.cos(course)])
    interval, phase = np.where(rest, 180.0, 10.0), rng.random(vessels)
    sensors = Sensors(Radars.empty(), Stations.empty(), Sonars.empty(), (), np.zeros((0, 2)))
    method = AisFilter()
    memory, wall, cpu = method.init(), [], []
    for cycle in range(cycles):
        end = START_S + (cycle + 1) * PERIOD_S
        due = (np.floor((end - START_S) / interval + phase) + (cycle == 0)) > np.floor(
            (end - PERIOD_S - START_S) / interval + phase
        )
        who = np.flatnonzero(due)
        fix, n = end - PERIOD_S * (1.0 - rng.random(len(who))), len(who)
        place = offset_deg(home[who], way[who] * (fix - START_S)[:, None] + rng.normal(0.0, POSITION_SIGMA_M, (n, 2)))
        sog = np.abs(speed[who] / KNOT_M_S + rng.normal(0.0, SOG_SIGMA_KN, n))
        cog = np.degrees(course[who] + rng.normal(0.0, np.radians(COG_SIGMA_DEG), n)) % 360.0
        reports = AisReports(fix, fix, 201_000_000 + who, place, sog, cog, np.zeros(n, np.bool_), who)
        begun = time.perf_counter(), time.process_time()
        memory, *_ = method.step(memory, AisInput(reports, end, sensors))
        wall.append(time.perf_counter() - begun[0])
        cpu.append(time.process_time() - begun[1])
    median_s = {"wall": float(np.median(wall[WARMUP:])), "cpu": float(np.median(cpu[WARMUP:]))}
    return {"compute_s": {"median": median_s["wall"]}, "compute_cpu_s": median_s["cpu"], "stages_s": {}}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vessels", type=int, default=100_000)
    parser.add_argument("--cycles", type=int, default=16)
    parser.add_argument("--baseline", type=Path)
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    if options.baseline is None:
        found = figures(options.vessels, options.cycles)
        print(json.dumps(found) if options.json else f"processor time of a cycle: {1e3 * found['compute_cpu_s']:.1f} ms")
        return
    arguments = ["--vessels", str(options.vessels), "--cycles", str(options.cycles)]
    found = compare(options.baseline, arguments, options.turns, "scaling.decisions.ais_cycle")
    print(json.dumps(found) if options.json else "\n".join(table(found)))


if __name__ == "__main__":
    main()
