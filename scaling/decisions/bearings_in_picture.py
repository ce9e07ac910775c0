"""What bearings do to the picture: position RMSE, coverage and breaks with and without them.

    python -m scaling.decisions.bearings_in_picture autoferry [SETTING=VALUE ...]
    python -m scaling.decisions.bearings_in_picture radar_off [SETTING=VALUE ...]
    python -m scaling.decisions.bearings_in_picture lidar [SETTING=VALUE ...]

`autoferry`: five recordings, by the scorer beside the data. `radar_off`: `context-driven-100` with estimated plot origin, seeds 1
and 2; the first radar is off from 150 s to 270 s. Counted are vessels without AIS inside the range of the sonar. `lidar`: the
recordings with their lidar as second radar, in the region of the radar and in one of its own.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np

from coastwatch.batches import Recording, Sensors
from coastwatch.centre import Cycle
from coastwatch.cycle import run_cycle, start_run
from coastwatch.geodesy import difference_m, to_plane, turn
from coastwatch.operators.cli.arguments import pair
from coastwatch.scenario import Scenario, load_scenario
from coastwatch.sensors.recorded.datasets.autoferry import PIREN_DEG
from coastwatch.stage import serial

SHARED = Path(__file__).parents[2].parent / "shared"
RECORDINGS = (2, 3, 6, 13, 17)
COLUMNS = ("gospa_rms", "gospa_mov_rms", "rmse", "coverage", "longest_single_id", "id_switches", "breaks", "false_tracks_per_s")
BEARINGS: dict[str, str] = {}
NONE = {"fused_tracks.bearing_probability": "1.0"}
LIDAR = {
    "name": "lidar",
    "latitude_deg": 63.4389029083,
    "longitude_deg": 10.39908278,
    "range_nm": 0.08,
    "rpm": 118.8,
    "range_noise_m": 1.5,
    "azimuth_noise_deg": 1.0,
}
OFF_S, ON_S = 150.0, 270.0  # from the start of the run
MATCHED_M = 300.0


def cycles(scenario: Scenario, recording: Recording, sensors: Sensors) -> Iterator[Cycle]:
    """Every cycle of a run on one thread, without a store."""
    plan, memory = scenario.plan(), start_run(scenario, sensors)
    reports = recording.whole()
    for cycle in range(plan.cycles):
        after_s = plan.instant_s(cycle - 1) if cycle else -np.inf
        part = reports.between(after_s, plan.instant_s(cycle))
        given = serial, lambda name: nullcontext()
        memory, made = run_cycle(scenario, sensors, memory, part, plan.instant_s(cycle), *given)
        yield made


def scores(number: int, scenario: Scenario) -> tuple[float, ...]:
    """The scores of a recording by the scorer beside the data, in order of COLUMNS. Args: scenario: of that recording."""
    sys.path.insert(0, str(SHARED / "scoring"))
    from afload import load
    from score_autoferry import evaluate

    sensors = scenario.sensors()
    rows: dict[int, list[tuple[float, ...]]] = {}
    for made in cycles(scenario, scenario.input.load(sensors, scenario.seed, scenario.plan()), sensors):
        p = made.picture
        at = to_plane(p.position_deg, PIREN_DEG)
        v = np.einsum("vij,vj->vi", turn(p.position_deg, PIREN_DEG), p.velocity_m_s)
        for k, one in enumerate(p.vessel_id.tolist()):
            rows.setdefault(one, []).append((p.time_s[k], at[k, 1], at[k, 0], v[k, 1], v[k, 0]))
    found = evaluate(load(number)[1], {k: np.array(r) for k, r in rows.items()})
    return tuple(np.nan if found[c] is None else float(found[c]) for c in COLUMNS)  # none: without a match


def autoferry(settings: dict[str, str], lidar_region: str = "") -> None:
    """Prints the scores of each recording and their mean.

    Args: lidar_region: of the lidar; empty: without it.
    """
    every = []
    for number in RECORDINGS:
        use = {"input.use_lidar": "true", "input.lidar_time_lag_s": "0.5"} if lidar_region else {}
        scenario = load_scenario(f"autoferry-{number}", {**use, **settings})
        if lidar_region:
            dumped = scenario.model_dump(mode="json")
            dumped["radars"] = [*dumped["radars"], {**dumped["radars"][0], **LIDAR, "region": lidar_region}]
            scenario = Scenario.model_validate(dumped)
        every.append(scores(number, scenario))
        print(number, " ".join(f"{x:7.3f}" for x in every[-1]), flush=True)
    print("mean", " ".join(f"{x:7.3f}" for x in np.mean(every, axis=0)), flush=True)


def radar_off(settings: dict[str, str]) -> None:
    """Prints RMSE, coverage and breaks of vessels without AIS in range of the sonar, while the first radar is off."""
    for seed in (1, 2):
        scenario = load_scenario("context-driven-100", {"tracks.plot_origin": "estimated", "cycles": "60", **settings})
        sensors, plan = scenario.sensors(), scenario.plan()
        recording = scenario.input.load(sensors, seed, plan)
        reports = recording.whole()
        since_s = reports.radar.time_s - plan.start_s
        kept = (reports.radar.sensor != 0) | (since_s < OFF_S) | (since_s > ON_S)
        recording = replace(recording, reports=replace(reports, radar=reports.radar.take(kept)))
        named = np.unique(reports.ais.origin)
        truth, square, seen, counted, breaks, swaps = recording.truth, [], 0, 0, 0, 0
        before: dict[int, bool] = {}  # whether a vessel was seen in the last cycle
        ids: dict[int, int] = {}
        assert truth is not None
        normalised = []
        for made in cycles(scenario, recording, sensors):
            if not OFF_S < made.time_s - plan.start_s <= ON_S + 30.0:
                continue
            now, p = truth.at(made.time_s), made.picture
            off = difference_m(now.position_deg, np.broadcast_to(sensors.sonars.site_deg[0], (len(now), 2)))
            near = (np.hypot(*off.T) < sensors.sonars.range_m[0]) & ~np.isin(now.vessel, named)
            away = difference_m(now.position_deg, np.broadcast_to(sensors.radars.site_deg[0], (len(now), 2)))
            near &= np.hypot(*away.T) < sensors.radars.range_m[0]
            for k in np.flatnonzero(near):
                who = int(now.vessel[k])
                rows = np.flatnonzero(p.origin == who)
                error = difference_m(p.position_deg[rows], np.broadcast_to(now.position_deg[k], (len(rows), 2)))
                good = rows[np.hypot(*error.T) < MATCHED_M]
                counted += 1
                has = len(good) > 0
                breaks += before.get(who, has) and not has
                before[who] = has
                if has:
                    seen += 1
                    best = np.argmin(np.hypot(*error.T))
                    square.append((error[best] ** 2).sum())
                    e = np.append(-error[best], now.velocity_m_s[k] - p.velocity_m_s[rows[best]])
                    normalised.append(e @ np.linalg.solve(p.covariance[rows[best]], e))
                    one = int(p.vessel_id[rows[best]])
                    swaps += ids.get(who, one) != one
                    ids[who] = one
        line = f"coverage {seen / counted:.3f}, breaks {breaks}, id switches {swaps}, RMSE {np.sqrt(np.mean(square)):.1f} m"
        print(f"seed {seed}: {counted} vessel instants, {line}, NEES {np.mean(normalised):.2f}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=("autoferry", "radar_off", "lidar"))
    parser.add_argument("further", nargs="*", type=pair, metavar="SETTING=VALUE", help="settings of the scenarios")
    asked = parser.parse_args()
    kind, settings = asked.kind, dict(asked.further)
    if kind == "lidar":
        for region in ("", "trondheim", "lidar"):
            print(f"lidar in region {region!r}", json.dumps(settings), flush=True)
            autoferry(settings, region)
        return
    for name, off in (("with bearings", BEARINGS), ("without", NONE)):
        print(kind, name, json.dumps(settings), flush=True)
        (autoferry if kind == "autoferry" else radar_off)({**settings, **off})


if __name__ == "__main__":
    main()
