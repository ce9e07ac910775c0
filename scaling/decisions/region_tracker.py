"""What the radar tracker of a region costs and yields at a size: `python -m scaling.decisions.region_tracker [--vessels 16000] [--json]`.

The question: may a track be gated by the combined estimate of its models, and only the plot that it takes touch its models?
Run it in two checkouts on the same arguments: the plots are the same. Vessels keep their density (10 a square nautical mile), so the
ranges of the two radars grow with their number. Plots are made before the timed part. Processor time of the stage `tracks` alone.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
from time import process_time

import numpy as np

from coastwatch.batches import RadarCorrections
from coastwatch.geodesy import to_plane
from coastwatch.kernels.tables.lookup import row_of
from coastwatch.scenario import load_scenario
from coastwatch.scores.purity import Identities
from coastwatch.stage import Running
from coastwatch.tracks import RegionInput

LAST = 8  # cycles that are scored and timed
NEAR_M = 1000.0  # a track farther from its vessel is no track of it


def settings(vessels: int, clutter: str, method: str, cycles: int) -> dict[str, str]:
    """Overrides of the scenario for so many vessels."""
    side = math.sqrt(vessels / 10.0)
    sides = {f"{area}.{name}": str(side) for area, name in (("area", "width_nm"), ("area", "height_nm"))}
    sides |= {f"input.area_{name}_nm": str(side) for name in ("width", "height")}
    ranges = {f"radars.{k}.range_nm": str(0.6 * side) for k in (0, 1)}
    made = {"input.count": str(vessels), "input.ais.share": "0", "sonars": "[]", "warmup_s": "30", "cycles": str(cycles)}
    radar = {"input.radar.detection_probability": "0.9", "input.radar.clutter_per_m2": clutter}
    return {**sides, **ranges, **made, **radar, "tracks": f'{{method = "{method}"}}'}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vessels", type=int, default=16_000)
    parser.add_argument("--clutter", default="0", help="false plots per m2 and turn")
    parser.add_argument("--method", default="sided_imm")
    parser.add_argument("--cycles", type=int, default=12, help="after the warm-up of 30 s")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    scenario = load_scenario("context-driven-1000", settings(asked.vessels, asked.clutter, asked.method, asked.cycles))
    sensors, plan = scenario.sensors(), scenario.plan()
    recording, none = scenario.input.load(sensors, asked.seed, plan), RadarCorrections.empty(R=len(sensors.radars))
    assert recording.truth is not None
    origin = sensors.region_origin_deg[0]
    site = to_plane(sensors.radars.site_deg, origin)
    memory, converted, ids = scenario.tracks.init(), scenario.plots.init(), Identities.empty()
    cost_ms, rows = [], []
    for cycle in range(plan.cycles):
        now_s = plan.instant_s(cycle)
        since_s = plan.instant_s(cycle - 1) if cycle else -math.inf
        converted, plots = scenario.plots.step(converted, recording.reports.between(since_s, now_s).radar, sensors, none)
        begin = process_time()
        memory, (tracks, *_) = Running(scenario.tracks, memory).next(RegionInput.of_plots(plots, now_s, sensors))
        cost_ms.append(1e3 * (process_time() - begin))
        if cycle < plan.cycles - LAST:
            continue
        truth = recording.truth.at(now_s)
        place = to_plane(truth.position_deg, origin)
        seen = (np.linalg.norm(place[:, None] - site, axis=2) < sensors.radars.range_m - 300.0).any(axis=1)
        own = tracks.take(tracks.origin >= 0)
        at = row_of(truth.vessel, own.origin)
        off = np.linalg.norm(to_plane(own.position_deg, origin) - place[at], axis=1)
        vessels, first = np.unique(at[off < NEAR_M], return_index=True)
        off = off[off < NEAR_M][first]
        complete = np.isin(np.flatnonzero(seen), vessels).mean()
        rows.append((len(plots), len(tracks), complete, len(tracks) - len(vessels), math.sqrt((off**2).mean())))
        ids = ids.seen(tracks.track_id, tracks.origin)
    names = "plots", "tracks", "completeness", "false_tracks", "rmse_m"
    figures = dict(zip(names, np.mean(rows, axis=0).tolist(), strict=True))
    peak_gb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    figures |= {"ms": float(np.median(cost_ms[-LAST:])), "id_switches": ids.switches, "peak_gb": peak_gb}
    if asked.json:
        print(json.dumps(figures))
    else:
        print("   ".join(f"{name} {value:.4g}" for name, value in figures.items()))


if __name__ == "__main__":
    main()
