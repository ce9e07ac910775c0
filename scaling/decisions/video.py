"""What extraction finds in video, what it costs, and what trackers make of it.

The question: which threshold, and do plots of video serve the trackers as they are? Scene: `heymann-table-1`, its inner half (3 NM) unless
`--whole`, as there is nothing beyond.

    python -m scaling.decisions.video plots     P_D, errors and false plots
    python -m scaling.decisions.video speed     processor time of extraction, beside the prototype and the oracle of the tests
    python -m scaling.decisions.video tracks    what the scenario's tracker makes of the plots
    python -m scaling.decisions.video beside    the same beside plots of a simulated radar with the same P_D, noise and false plots
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import json
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import process_time
from types import SimpleNamespace
from typing import Any

import numpy as np

from coastwatch.batches import (
    Floats,
    Ints,
    Messages,
    RadarCorrections,
    RadarReports,
    RadarVideo,
    Reports,
    Sensors,
    Tracks,
    Trajectories,
    Truth,
    Videos,
)
from coastwatch.geodesy import difference_m, earth_centred, to_plane, wrap_rad
from coastwatch.plots import CfarExtraction, ExtractionInput
from coastwatch.plots.video.spokes import VideoRadar
from coastwatch.regional import reports_of_regions, start_region, step_of_regions
from coastwatch.scenario import Scenario, load_scenario
from coastwatch.scores.ospa import gospa, ospa
from coastwatch.sensors.simulated.radar import Antenna, RadarTruth
from coastwatch.sensors.simulated.video import SimulatedVideo, motion_of
from coastwatch.stage import Plan

NORTH_DEG = 6.0
OUTLIERS, MEDIAN_TO_SIGMA = 4.0, 1.4826  # deviations beyond which an error does not count; of normal errors, over their median
NEAR_M = 250.0  # a track is right within this of its own vessel
SIZES = {(4096, 1024): 20, (4096, 2048): 16, (4096, 4096): 8, (4096, 8192): 4}
"""Spokes and cells, and how many times real time is wanted."""
ORACLES = Path(__file__).parents[2] / "tests" / "oracles"
PROTOTYPE = Path(__file__).parents[3] / "shared" / "prototypes" / "radar_image" / "fast.py"
INNER = {"radars.0.range_nm": "3.0", "input.cells": "512"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("plots", "speed", "tracks", "beside"))
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
        if asked.what == "plots":
            rows.append(plots(scenario, seed, asked.turns, asked.every))
        else:
            rows.append(tracks(scenario, seed) if asked.what == "tracks" else beside(scenario, seed))
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
        memory, (found, _) = scenario.extraction.step(memory, ExtractionInput(given, sensors))
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
    return replace(video, time_s=video.time_s + shift_s, received_s=video.received_s + shift_s)


def speed() -> None:
    """Processor time of extraction, beside the time in which the radar turns at 25 turns a minute, the prototype and the oracle."""
    with tempfile.TemporaryDirectory() as folder:
        prototype = _prototype(Path(folder))
        if prototype is None:
            print(f"the prototype is not beside it, as {PROTOTYPE} is absent")
        _at_each_size(prototype)
    _beside_oracle()


def _at_each_size(prototype: Any) -> None:
    """Args: prototype: its module, or None."""
    for (spokes, cells), wanted in SIZES.items():
        scenario = load_scenario("heymann-table-1", {"cycles": "5", "input.cells": str(cells), "input.spokes": str(spokes)})
        sensors, plan = scenario.sensors(), scenario.plan()
        stream, memory, theirs = scenario.input.load(sensors, 1, plan).reports, scenario.extraction.init(), None
        took_s: dict[str, list[float]] = {"ours": [], "prototype": []}
        for turn in range(plan.cycles):
            video = _of_cycle(plan, stream.between, turn).video
            begun = process_time()
            memory, _ = scenario.extraction.step(memory, ExtractionInput(video, sensors))
            took_s["ours"].append(process_time() - begun)
            if prototype is not None:
                theirs = theirs or _extractor(prototype, video.parts[0], sensors)
                begun = process_time()
                theirs(video.parts[0].level)
                took_s["prototype"].append(process_time() - begun)
        ours, other = (float(np.median(seconds[1:] or [np.nan])) for seconds in took_s.values())  # the first turn compiles
        against = "" if prototype is None else f", {ours / other:.2f} times the prototype (wanted 1.5)"
        print(
            f"{spokes} x {cells}: {1e3 * ours:.0f} ms a turn, {1e9 * ours / spokes / cells:.1f} ns a cell, "
            f"{plan.period_s / ours:.1f} times real time (wanted {wanted}){against}",
            flush=True,
        )


def _prototype(folder: Path) -> Any:
    """The module of the prototype's extraction; None: it is absent. Args: folder: for a copy, as compiled functions lie beside it."""
    if not PROTOTYPE.exists():
        return None
    copy = shutil.copy(PROTOTYPE, folder)
    spec = importlib.util.spec_from_file_location("radar_image_prototype", copy)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def _extractor(prototype: Any, video: RadarVideo, sensors: Sensors) -> Any:
    """The prototype's extraction with windows as wide as ours. It has looked at a turn, and is compiled."""
    spokes, cells = video.level.shape
    radar = SimpleNamespace(
        spokes=spokes, cells=cells, dr=video.cell_m, beam=sensors.radars.beam_rad[0], pulse_m=sensors.radars.pulse_m[0]
    )
    wide, long = spokes / 1024, 10.85 / video.cell_m
    window, guard = ((round(a * wide), round(c * long)) for a, c in ((16, 24), (6, 8)))
    made = prototype.Extractor(radar, threshold_db=9.0, window=window, guard=guard)
    made(video.level)
    return made


def _beside_oracle() -> None:
    """Two turns of a small radar, from the first spoke on, by extraction and by the textbook with scipy."""
    sys.path.insert(0, str(ORACLES))
    textbook: Any = importlib.import_module("video_textbook")
    scenario = load_scenario("heymann-table-1", INNER | {"cycles": "2"})
    sensors, plan = scenario.sensors(), scenario.plan()
    assert isinstance(scenario.extraction, CfarExtraction)
    stream = scenario.input.load(sensors, 1, plan).reports
    videos = stream.between(plan.start_s, plan.instant_s(1)).video
    level, azimuth_rad = (np.concatenate([getattr(part, name) for part in videos.parts]) for name in ("level", "azimuth_rad"))
    radar = VideoRadar.of(sensors, 0)
    begun = process_time()
    _, (found, _) = scenario.extraction.step(scenario.extraction.init(), ExtractionInput(videos, sensors))
    ours = process_time() - begun
    begun = process_time()
    rules = scenario.extraction._detection(radar, videos.parts[0]).rules
    on, db, looked = textbook.excesses(level, np.zeros(level.shape, np.bool_), azimuth_rad, rules)
    echoes = textbook.echoes(on, db, azimuth_rad, radar.beam_rad)
    oracle = process_time() - begun
    count = int(((echoes[:, 0] >= scenario.extraction.least_cells) & (echoes[:, 7] < looked - 1)).sum())
    print(
        f"{level.shape[0]} spokes x {level.shape[1]}: {1e3 * ours:.0f} ms, the scipy oracle {oracle:.1f} s, "
        f"{oracle / ours:.0f} times as long (wanted 30); plots: {len(found)}, {count}"
    )


def tracks(scenario: Scenario, seed: int) -> dict[str, float]:
    """What the scenario's tracker makes of the plots, at the end of each turn."""
    recording = scenario.input.load(scenario.sensors(), seed, scenario.plan())
    assert recording.truth is not None
    return _followed(scenario, recording.reports.between, recording.truth)


def beside(scenario: Scenario, seed: int) -> dict[str, float]:
    """Tracks of the plots of video, and of plots of a simulated radar with the P_D, noise and false plots of the former.

    Each tug has its own P_D and noise, the antenna begins north in both. Simulated plots state their true noise, or what video states.
    """
    sensors, plan = scenario.sensors(), scenario.plan()
    recording, memory, parts = scenario.input.load(sensors, seed, plan), scenario.extraction.init(), []
    assert recording.truth is not None
    assert isinstance(scenario.input, SimulatedVideo)
    for cycle in range(plan.cycles):
        video = _of_cycle(plan, recording.reports.between, cycle).video
        memory, (found, _) = scenario.extraction.step(memory, ExtractionInput(video, sensors))
        parts.append(found)
    of_video, motion = RadarReports.join(parts), motion_of(scenario.input.ships, plan.start_s, plan.cycles * plan.period_s)
    turns, radars = np.arange(float(plan.cycles)), sensors.radars
    per_m2 = float((of_video.origin < 0).sum()) / plan.cycles / (np.pi * float(radars.range_m[0]) ** 2)
    made: dict[str, list[RadarReports]] = {"true": [], "stated": []}
    out = {"false_plots": per_m2 * np.pi * float(radars.range_m[0]) ** 2}
    for v, name in zip(range(len(recording.truth.vessel)), "AB", strict=True):
        mine = of_video.take(of_video.origin == v)
        at = to_plane(motion.position(mine.origin, mine.time_s), radars.site_deg[0])
        off_m, off_rad = mine.range_m - np.hypot(*at.T), wrap_rad(np.radians(mine.azimuth_deg) - np.arctan2(at[:, 0], at[:, 1]))
        sigma_m, sigma_rad = _deviation(off_m), _deviation(off_rad)
        seen = len(np.unique(np.floor((mine.time_s - plan.start_s) / plan.period_s))) / plan.cycles
        out |= {f"{name}_detected": seen, f"{name}_sigma_m": sigma_m, f"{name}_sigma_deg": float(np.degrees(sigma_rad))}
        noisy = replace(radars, range_sigma_m=np.array([sigma_m]), azimuth_sigma_rad=np.array([sigma_rad]))
        truth = RadarTruth(detection_probability=seen, clutter_per_m2=per_m2 if v == 0 else 0.0)
        antenna = Antenna(noisy, 0, truth, plan.start_s, plan.start_s, turns, 100 * seed + v)

        def position_at(row: Ints, time_s: Floats, vessel: int = v) -> Floats:
            return motion.position(np.full(len(row), vessel), time_s)

        echoes = antenna.echoes(position_at, np.array([v]))
        for how, (range_m, azimuth_deg) in {
            "true": (sigma_m, float(np.degrees(sigma_rad))),
            "stated": (float(np.median(mine.range_sigma_m)), float(np.median(mine.azimuth_sigma_deg))),
        }.items():
            n = len(echoes)
            made[how] += [
                replace(echoes, range_sigma_m=np.full(n, range_m), azimuth_sigma_deg=np.full(n, azimuth_deg)),
                antenna.clutter(),
            ]
    kinds = {"video": of_video, **{how: RadarReports.join(several) for how, several in made.items()}}
    for kind, plots_of_kind in kinds.items():
        arrived = plots_of_kind.take(np.argsort(plots_of_kind.received_s, kind="stable"))
        followed = _followed(scenario, _between_of(arrived), recording.truth)
        out |= {f"{kind}_{name}": followed[name] for name in ("position_m", "velocity_m_s", "complete_after", "false_tracks")}
    return out | {f"ratio_{how}": out["video_position_m"] / out[f"{how}_position_m"] for how in made}


def _deviation(off: Floats) -> float:
    """The root mean square of errors, without those of false plots that happen to be near."""
    limit = OUTLIERS * MEDIAN_TO_SIGMA * float(np.median(np.abs(off)))
    return float(np.sqrt(np.square(off[np.abs(off) < limit]).mean()))


def _between_of(plots_by_arrival: RadarReports) -> Callable[[float, float], Reports]:
    """What comes between two times, as of a stream."""

    def between(after_s: float, until_s: float) -> Reports:
        received_s = plots_by_arrival.received_s
        return Reports(radar=plots_by_arrival.take((received_s > after_s) & (received_s <= until_s)))

    return between


def _of_cycle(plan: Plan, between: Callable[[float, float], Reports], cycle: int) -> Reports:
    return between(plan.instant_s(cycle - 1) if cycle else plan.start_s, plan.instant_s(cycle))


def _followed(scenario: Scenario, between: Callable[[float, float], Reports], true: Trajectories) -> dict[str, float]:
    """What the scenario's tracker makes of what comes, at the end of each turn."""
    sensors, plan = scenario.sensors(), scenario.plan()
    none = RadarCorrections.empty(R=len(sensors.radars))
    step, memory = step_of_regions(scenario), start_region(scenario)
    right, distances, squares, ids, false = [], [], [], set[int](), []
    for cycle in range(plan.cycles):
        now_s = plan.instant_s(cycle)
        reports = _of_cycle(plan, between, cycle)
        given, _ = reports_of_regions(reports.radar, [Messages.empty()], none, now_s, sensors, reports.video)
        memory, found = step(memory, given[0])
        aligned = scenario.alignment.step(found.tracks, now_s)
        truth = true.at(now_s)
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
