"""What video says of the size of ships, and a harbour with large ones: `python -m scaling.decisions.video_extent size|harbour`.

The question: do trackers see ships of 100 to 300 m as one track each, of the right length and axis, and nothing on land? `size` is one
ship beside the radar of `heymann-table-1`, `harbour` the scenario `video-harbour` through all centres.
"""

from __future__ import annotations

import argparse
import json
from contextlib import nullcontext
from typing import NamedTuple

import numpy as np

from coastwatch.batches import Floats, Ints, Messages, RadarCorrections, Rings
from coastwatch.cycle import run_cycle, start_run
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M, difference_m, earth_centred, offset_deg, to_plane
from coastwatch.regional import reports_of_regions, start_region, step_of_regions
from coastwatch.scenario import Scenario, load_scenario
from coastwatch.scores.ospa import gospa
from coastwatch.sensors.simulated.simulation import inside
from coastwatch.sensors.simulated.video import Ship, SimulatedVideo
from coastwatch.stage import serial
from coastwatch.tracks import RadarMemory
from coastwatch.tracks.radar.extent import LEAST_PLOTS, Hulls, axes, joined

SITE_DEG = np.array([54.3, 12.0])
BEARING_DEG, SPEED_KN = 63.0, 2.0
LEARNING, EVERY = 15, 10  # turns before the first size that counts, and from one to the next
AROUND_M = 60.0  # of a hull, within which a plot is of the ship
SETTLED = 25  # turns of the harbour before the first that counts
CUTOFF_M = 100.0  # of GOSPA
LARGE_M, SMALL_M = 300.0, 25.0


class Case(NamedTuple):
    """A ship beside the radar."""

    length_m: float
    range_nm: float
    aspect_deg: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("size", "harbour"))
    parser.add_argument("--seeds", default="2001-2002")
    parser.add_argument("--turns", type=int, default=46, help="of `size`")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="of `harbour`")
    asked = parser.parse_args()
    first, _, last = asked.seeds.partition("-")
    seeds = range(int(first), int(last or first) + 1)
    if asked.what == "size":
        at = [(length, nm) for length in (100.0, 200.0, 300.0) for nm in (0.7, 1.5)] + [(300.0, 3.0)]
        for length, nm in at:
            for aspect in (10.0, 45.0, 90.0):
                case = Case(length, nm, aspect)
                print(*case, json.dumps(size(case, seeds, asked.turns)), flush=True)
        return
    scenario = load_scenario("video-harbour", dict(text.split("=", 1) for text in asked.set))
    for seed in seeds:
        print(seed, json.dumps(harbour(scenario, seed)), flush=True)


def size(case: Case, seeds: range, turns: int) -> dict[str, float]:
    """Mean and deviation of the length that the track of a ship has, the error of its axis, its plots a turn before and after joining."""
    course = BEARING_DEG + case.aspect_deg
    ahead = np.array([np.sin(np.radians(course)), np.cos(np.radians(course))])
    bearing = np.radians(BEARING_DEG)
    middle = case.range_nm * NAUTICAL_MILE_M * np.array([np.sin(bearing), np.cos(bearing)])
    begin = middle - ahead * SPEED_KN * KNOT_M_S * 2.4 * 0.5 * turns
    latitude, longitude = offset_deg(SITE_DEG, begin).tolist()
    width_m = max(11.0, case.length_m / 7.0)
    ship = Ship(
        latitude_deg=latitude,
        longitude_deg=longitude,
        course_deg=course,
        speed_kn=SPEED_KN,
        length_m=case.length_m,
        width_m=width_m,
    )
    reach_nm = case.range_nm + 0.7
    inner = {"radars.0.range_nm": str(reach_nm), "input.cells": str(round(reach_nm * NAUTICAL_MILE_M / 10.85))}
    scenario = load_scenario("heymann-table-1", inner | {"cycles": str(turns)})
    scenario = scenario.model_copy(update={"input": scenario.input.model_copy(update={"ships": (ship,)})})
    sensors, plan, none = scenario.sensors(), scenario.plan(), RadarCorrections.empty(R=1)
    lengths, widths, off_deg = list[float](), list[float](), list[float]()
    pieces, plots, tracks = list[float](), list[float](), list[float]()
    for seed in seeds:
        recording, step, memory = scenario.input.load(sensors, seed, plan), step_of_regions(scenario), start_region(scenario)
        assert recording.truth is not None
        for cycle in range(plan.cycles):
            now_s = plan.instant_s(cycle)
            reports = recording.reports.between(plan.instant_s(cycle - 1) if cycle else plan.start_s, now_s)
            given, _ = reports_of_regions(reports.radar, [Messages.empty()], none, now_s, sensors, reports.video)
            assert isinstance(memory.tracks, RadarMemory)
            hulls = hulls_of(memory.tracks, float(sensors.radars.beam_rad[0]))
            memory, found = step(memory, given[0])
            if cycle < LEARNING:
                continue
            at = to_plane(recording.truth.at(now_s).position_deg, SITE_DEG)[0]
            whole, _ = joined(found.plots, hulls, sensors.radars.period_s)
            for counts, some in ((pieces, found.plots), (plots, whole)):
                off = some.position_m - at
                along, across = np.abs(off @ ahead), np.abs(off @ np.array([ahead[1], -ahead[0]]))
                counts.append(int(((along < 0.5 * case.length_m + AROUND_M) & (across < 0.5 * width_m + AROUND_M)).sum()))
            own = (
                np.hypot(*difference_m(found.tracks.position_deg, offset_deg(SITE_DEG, at)).T) < 0.5 * case.length_m + AROUND_M
            )
            tracks.append(int(own.sum()))
            if own.any() and (cycle - LEARNING) % EVERY == 0:
                lengths += found.tracks.echo_length_m[own].tolist()
                widths += found.tracks.echo_width_m[own].tolist()
                turned = np.abs((found.tracks.echo_axis_deg[own] - course + 180.0) % 360.0 - 180.0)
                off_deg += turned.tolist()
    return {
        "length_m": round(float(np.nanmean(lengths)), 1),
        "deviation_m": round(float(np.nanstd(lengths)), 1),
        "width_m": round(float(np.nanmean(widths)), 1) if np.isfinite(widths).any() else float("nan"),
        "axis_deg": round(float(np.nanmean(off_deg)), 2),
        "known": round(float(np.isfinite(lengths).mean()), 3),
        "plots_a_turn": round(float(np.mean(pieces)), 2),
        "joined": round(float(np.mean(plots)), 2),
        "tracks": round(float(np.mean(tracks)), 3),
    }


def hulls_of(memory: RadarMemory, beam_rad: float) -> Hulls:
    """The tracks of known length of one radar, before a cycle."""
    table = memory.table
    rows = table.live[table.extent_plots[table.live] >= LEAST_PLOTS]
    if len(rows):
        far_m = np.hypot(*(table.combined_mean[rows, :2] - memory.site_m[0]).T)
        rows = rows[(axes(table.extent[rows])[0] > beam_rad * far_m) & (table.status[rows] == 2)]
    return Hulls(
        table.updated_s[rows], table.combined_mean[rows], table.extent[rows], table.radar_s[rows], table.extent_plots[rows]
    )


def harbour(scenario: Scenario, seed: int) -> dict[str, float]:
    """Shares of vessel time with a track by length, false and second tracks, tracks on land, GOSPA; of radar tracks and of the picture."""
    sensors, plan = scenario.sensors(), scenario.plan()
    recording, memory = scenario.input.load(sensors, seed, plan), start_run(scenario, sensors)
    assert recording.truth is not None
    assert isinstance(scenario.input, SimulatedVideo)
    length_m = np.array([ship.length_m for ship in scenario.input.ships])
    rows: dict[str, list[dict[str, float]]] = {"radar": [], "picture": []}
    names: dict[str, list[Ints]] = {"radar": [], "picture": []}  # of the nearest track of each ship at anchor, -1: none
    for cycle in range(plan.cycles):
        now_s = plan.instant_s(cycle)
        arrived = recording.reports.between(plan.instant_s(cycle - 1) if cycle else plan.start_s, now_s)
        memory, made = run_cycle(scenario, sensors, memory, arrived, now_s, serial, lambda _: nullcontext())
        if cycle < SETTLED:
            continue
        now = recording.truth.at(now_s)
        anchored = np.flatnonzero(np.hypot(*now.velocity_m_s.T) == 0.0)
        radar, vessels = made.tracks.take(made.tracks.source == 0), made.picture
        for name, found, number in (
            ("radar", radar.position_deg, radar.track_id),
            ("picture", vessels.position_deg, vessels.vessel_id),
        ):
            rows[name].append(_instant(found, now.position_deg, length_m, sensors.land_deg))
            names[name].append(_nearest(found, number, now.position_deg[anchored], length_m[anchored]))
    out: dict[str, float] = {}
    for name, of in rows.items():
        held = np.array(names[name])
        out[f"{name}_anchored"] = round(float((held >= 0).mean()), 4)
        out[f"{name}_anchored_names"] = float(np.mean([len(np.unique(one[one >= 0])) for one in held.T]))
        out |= {f"{name}_{key}": round(float(np.mean([row[key] for row in of])), 4) for key in of[0]}
    return out


def _nearest(found: Floats, number: Ints, ships: Floats, length_m: Floats) -> Ints:
    """The number of the track that is nearest to each ship, -1 where none is on it. Args: found: (N, 2) deg; ships: (V, 2) deg."""
    out = np.full(len(ships), -1)
    for k, place in enumerate(ships):
        apart = np.hypot(*difference_m(found, place).T)
        if len(found) and apart.min() < max(AROUND_M, 0.5 * length_m[k]):
            out[k] = number[apart.argmin()]
    return out


def _instant(found: Floats, truth: Floats, length_m: Floats, land_deg: Rings) -> dict[str, float]:
    """One instant of a harbour. Args: found: (N, 2) deg; truth: (V, 2) deg; length_m: (V,)."""
    from scipy.optimize import linear_sum_assignment

    n, v = len(found), len(truth)
    apart = np.hypot(*difference_m(np.repeat(found, v, axis=0), np.tile(truth, (n, 1))).T).reshape(n, v)
    limit = np.maximum(AROUND_M, 0.5 * length_m)
    cost = np.where(apart < limit, apart, 1e4)
    row, ship = linear_sum_assignment(cost)
    right = cost[row, ship] < 1e4
    row, ship = row[right], ship[right]
    held = np.isin(np.arange(v), ship)
    large, small = length_m >= LARGE_M, length_m < SMALL_M
    of_ship = np.full(n, -1)
    of_ship[row] = ship
    free = (of_ship[:, None] < 0) | (
        of_ship[:, None] == np.flatnonzero(large)
    )  # a track of another ship that passes is no second one
    on_land = [inside(found, np.array(ring)) for ring in land_deg]
    return {
        "large": float(held[large].mean()),
        "middle": float(held[~large & ~small].mean()),
        "small": float(held[small].mean()),
        "false": float(n - len(row)),
        "second": float((((apart[:, large] < limit[large] + 30.0) & free).sum(axis=0) > 1).sum()),
        "on_land": float(np.logical_xor.reduce(on_land).sum()) if on_land and n else 0.0,
        "gospa_m": gospa(earth_centred(found), earth_centred(truth), CUTOFF_M, 2.0).total_m,
        "rmse_m": float(np.sqrt(np.mean(cost[row, ship] ** 2))) if len(row) else float("nan"),
    }


if __name__ == "__main__":
    main()
