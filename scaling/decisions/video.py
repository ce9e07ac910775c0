"""What extraction finds in video, what it costs, and what trackers make of it: `python -m scaling.decisions.video plots|speed|tracks`.

The question: which threshold, and do plots of video serve the trackers as they are? Scene: `heymann-table-1`, its inner half (3 NM) unless
`--whole`, as there is nothing beyond.
"""

from __future__ import annotations

import argparse
import json
from time import process_time

import numpy as np

from coastwatch.batches import Floats, Messages, RadarCorrections, RadarReports, RadarVideo, Tracks, Truth, Videos
from coastwatch.geodesy import difference_m, earth_centred, to_plane, wrap_rad
from coastwatch.plots import ExtractionInput
from coastwatch.regional import reports_of_regions, start_region, step_of_regions
from coastwatch.scenario import Scenario, load_scenario
from coastwatch.scores.gospa import gospa
from coastwatch.scores.ospa import ospa

NORTH_DEG = 6.0
NEAR_M = 250.0  # a track is right within this of its own vessel
SIZES = (4096, 1024), (4096, 2048)
INNER = {"radars.0.range_nm": "3.0", "input.cells": "512"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("plots", "speed", "tracks"))
    parser.add_argument("--seeds", default="2001-2003")
    parser.add_argument("--turns", type=int, default=50)
    parser.add_argument("--every", type=int, default=20, help="plots: only one of so many turns, so that the tugs move on")
    parser.add_argument("--whole", action="store_true", help="the whole range of the radar")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    asked = parser.parse_args()
    first, _, last = asked.seeds.partition("-")
    settings = ({} if asked.whole else INNER) | dict(text.split("=", 1) for text in asked.set)
    if asked.what == "speed":
        speed()
        return
    scenario = load_scenario(
        "heymann-table-1", settings | {"cycles": str(asked.turns * (asked.every if asked.what == "plots" else 1))}
    )
    rows = []
    for seed in range(int(first), int(last or first) + 1):
        rows.append(plots(scenario, seed, asked.turns, asked.every) if asked.what == "plots" else tracks(scenario, seed))
        print(seed, json.dumps({key: round(value, 4) for key, value in rows[-1].items()}), flush=True)
    for name, of in (("mean", np.mean), ("median", np.median), ("worst", np.max)):
        print(name, json.dumps({key: round(float(of([row[key] for row in rows])), 4) for key in rows[0]}), flush=True)


def plots(scenario: Scenario, seed: int, turns: int, every: int) -> dict[str, float]:
    """What extraction finds of each tug: P_D, bias and deviation of range and azimuth, normalised squares; and false plots a turn.

    The first two turns teach the background and do not count, nor does a tug near north: turns that are far apart are joined there.
    """
    sensors, plan = scenario.sensors(), scenario.plan()
    recording = scenario.input.load(sensors, seed, plan)
    assert recording.truth is not None
    memory, site = scenario.extraction.init(), sensors.radars.site_deg[0]
    period, vessels = plan.period_s, len(recording.truth.vessel)
    parts = []
    for turn in range(turns):
        begun_s = plan.start_s + turn * every * period
        video = recording.reports.between(begun_s, begun_s + period * (1.0 - 1e-9)).video.parts[0]
        given = Videos((_at(video, plan.start_s + turn * period - begun_s),))
        memory, found = scenario.extraction.step(memory, ExtractionInput(given, sensors))
        parts.append(found)
    every_plot = RadarReports.join(parts)
    number = np.floor((every_plot.time_s - plan.start_s) / period).astype(np.int64)
    out = {"false": float(((every_plot.origin < 0) & (number >= 2)).sum() / (turns - 2))}
    for v, name in zip(range(vessels), "AB", strict=True):
        rows, looks = [], 0
        for turn in range(2, turns - 1):
            shift_s = turn * (every - 1) * period
            at = to_plane(recording.truth.at(plan.start_s + turn * period + shift_s).position_deg[v], site)
            if abs(np.degrees(np.arctan2(at[0], at[1]))) < NORTH_DEG:
                continue
            looks += 1
            mine = every_plot.take((number == turn) & (every_plot.origin == v))
            if len(mine):
                at = to_plane(recording.truth.at(float(mine.time_s[0]) + shift_s).position_deg[v], site)
                off = mine.range_m[0] - float(np.hypot(*at))
                turned = float(wrap_rad(np.radians(mine.azimuth_deg[0]) - np.arctan2(at[0], at[1])))
                sigma = float(mine.range_sigma_m[0]), float(np.radians(mine.azimuth_sigma_deg[0]))
                apart = float(np.hypot(off, mine.range_m[0] * turned))
                rows.append((off, np.degrees(turned), (off / sigma[0]) ** 2, (turned / sigma[1]) ** 2, apart))
        e: Floats = np.array(rows or [(np.nan, np.nan, np.nan, np.nan, np.nan)])
        out |= {f"{name}_error_m": np.sqrt(np.square(e[:, 4]).mean())}
        out |= {f"{name}_detected": len(rows) / looks, f"{name}_bias_m": e[:, 0].mean(), f"{name}_sigma_m": e[:, 0].std()}
        out |= {f"{name}_bias_deg": e[:, 1].mean(), f"{name}_sigma_deg": e[:, 1].std()}
        out |= {f"{name}_square_range": e[:, 2].mean(), f"{name}_square_azimuth": e[:, 3].mean()}
    return {key: float(value) for key, value in out.items()}


def _at(video: RadarVideo, shift_s: float) -> RadarVideo:
    """The video as if it came at another time, so that turns that are far apart follow each other."""
    return RadarVideo(
        video.sensor,
        video.first_m,
        video.cell_m,
        video.time_s + shift_s,
        video.received_s + shift_s,
        video.azimuth_rad,
        video.site_deg,
        video.level,
        video.vessel_m,
    )


def speed() -> None:
    """Processor time of extraction, beside the time in which the radar turns at 25 turns a minute."""
    for spokes, cells in SIZES:
        scenario = load_scenario("heymann-table-1", {"cycles": "4", "input.cells": str(cells), "input.spokes": str(spokes)})
        sensors, plan = scenario.sensors(), scenario.plan()
        stream, memory = scenario.input.load(sensors, 1, plan).reports, scenario.extraction.init()
        for turn in range(plan.cycles):
            video = stream.between(plan.start_s + turn * plan.period_s, plan.instant_s(turn)).video
            begun = process_time()
            memory, found = scenario.extraction.step(memory, ExtractionInput(video, sensors))
            took = process_time() - begun
            print(
                f"{spokes} x {cells}, turn {turn}: {1e3 * took:.0f} ms, {1e9 * took / spokes / cells:.1f} ns a cell, "
                f"{plan.period_s / took:.1f} times real time, {len(found)} plots",
                flush=True,
            )


def tracks(scenario: Scenario, seed: int) -> dict[str, float]:
    """What the scenario's tracker makes of the plots, at the end of each turn."""
    sensors, plan = scenario.sensors(), scenario.plan()
    recording, none = scenario.input.load(sensors, seed, plan), RadarCorrections.none(len(sensors.radars))
    assert recording.truth is not None
    step, memory = step_of_regions(scenario), start_region(scenario)
    right, distances, squares, ids, false = [], [], [], set[int](), []
    for cycle in range(plan.cycles):
        now_s = plan.instant_s(cycle)
        reports = recording.reports.between(plan.instant_s(cycle - 1) if cycle else plan.start_s, now_s)
        given, _ = reports_of_regions(reports.radar, [Messages.empty()], none, now_s, sensors, reports.video)
        memory, found = step(memory, given[0])
        aligned = scenario.alignment.step(found.tracks, now_s)
        truth = recording.truth.at(now_s)
        off, pairs = _errors(aligned, truth)
        right.append(pairs == len(truth) == len(aligned))
        false.append(len(aligned) - pairs)
        squares.append(off)
        ids |= set(aligned.track_id.tolist())
        places = earth_centred(aligned.position_deg), earth_centred(truth.position_deg)
        distances.append([ospa(gospa(*places, c, 2.0), c, 2.0).total_m for c in (250.0, 500.0)])
    first = right.index(True) if any(right) else len(right)
    error = np.concatenate(squares)
    return {
        "acquisition_s": (first + 1) * plan.period_s,
        "complete": float(np.mean(right)),
        "complete_after": float(np.mean(right[first:])) if any(right) else 0.0,
        "ospa250_m": float(np.mean(distances, axis=0)[0]),
        "ospa500_m": float(np.mean(distances, axis=0)[1]),
        "position_m": float(np.sqrt(error[:, 0].mean())),
        "velocity_m_s": float(np.sqrt(error[:, 1].mean())),
        "false_tracks": float(np.mean(false)),
        "false_tracks_after_60_s": float(np.mean(false[25:])) if len(false) > 25 else 0.0,
        "ids": float(len(ids)),
    }


def _errors(found: Tracks, truth: Truth) -> tuple[np.ndarray[tuple[int, int], np.dtype[np.float64]], int]:
    """Squared errors of position and velocity of the tracks that are near their vessels, and how many those are."""
    from scipy.optimize import linear_sum_assignment

    n, v = len(found), len(truth)
    apart = np.hypot(*difference_m(np.repeat(found.position_deg, v, axis=0), np.tile(truth.position_deg, (n, 1))).T).reshape(
        n, v
    )
    row, target = linear_sum_assignment(np.minimum(apart, 1e4))
    near = apart[row, target] < NEAR_M
    row, target = row[near], target[near]
    speed_m_s = np.hypot(*(found.velocity_m_s[row] - truth.velocity_m_s[target]).T)
    return np.column_stack([apart[row, target] ** 2, speed_m_s**2]), len(row)


if __name__ == "__main__":
    main()
