"""Loads the kernels that a run calls before its first cycle, here and in its workers, so that the first cycle takes no longer.

After an installation they are compiled, which takes about a minute; from then on they come from disk (`kernels/jit.py`).
A process that begins a second run of the same kind, as a server after a failure, has them all and goes on at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from coastwatch.batches import Floats, Reports, Sensors
from coastwatch.cycle import run_cycle, start_run
from coastwatch.geodesy import offset_deg
from coastwatch.scenario import Scenario
from coastwatch.sensors import has_video
from coastwatch.sensors.simulated.ais import AisTruth
from coastwatch.sensors.simulated.simulation import Simulated
from coastwatch.sensors.simulated.video import SimulatedVideo
from coastwatch.stage import Plan, serial, serial_regions
from coastwatch.workers import ThreadedRegions, Workers

CYCLES = 8  # tracks are confirmed, associated and fused by then
START_S = 1.7e9  # any time
LATE_S = 5.0  # AIS reports come, so that some of them are replayed
NEAR_M = ((400.0, 300.0), (-900.0, 500.0), (700.0, -1200.0), (-300.0, -600.0))  # of the vessels from a sensor, east and north
VIDEO_CELLS = 256  # of a spoke
MOST_SENSORS = 6  # round which vessels are put


ALONE = Workers(serial, serial_regions)

_loaded: set[object] = set()  # the kinds of runs whose kernels this process has loaded


def warm_up(
    scenario: Scenario, sensors: Sensors, report: Callable[[str], None], workers: Workers = ALONE, *, video: bool = False
) -> None:
    """Load the kernels of a run, unless this process has loaded those of a run of this kind. New worker processes have none.

    Args: as of `load_kernels`.
    """
    kind = kind_of(scenario.model_dump(exclude={"name", "title", "store"})), _with_spots(scenario).spots.count > 1, video
    is_here = workers.spots is serial and isinstance(workers.regions, ThreadedRegions)
    if is_here and kind in _loaded:
        return
    load_kernels(scenario, sensors, report, workers, video=video)
    if is_here:
        _loaded.add(kind)


def kind_of(settings: Any) -> object:
    """Settings without their numbers, which choose no kernel, but for zeros and for what is not set: a hashable value."""
    if isinstance(settings, dict):
        return tuple((name, kind_of(value)) for name, value in settings.items())
    if isinstance(settings, list | tuple | set | frozenset):
        return frozenset(map(kind_of, settings))
    if isinstance(settings, int | float) and not isinstance(settings, bool):
        return type(settings), settings != 0
    return settings


def load_kernels(
    scenario: Scenario, sensors: Sensors, report: Callable[[str], None], workers: Workers = ALONE, *, video: bool = False
) -> None:
    """Run a few cycles on a few simulated vessels, and forget them.

    Args: workers: of the run; video: some comes from live feeds.
    report: called with a text, once for each stage, when kernels of that stage have to be compiled in this process.
    """
    places = _places(scenario, sensors)
    sea = Simulated(
        area_latitude_deg=scenario.area.latitude_deg,
        area_longitude_deg=scenario.area.longitude_deg,
        count=len(places),
        ais=AisTruth(latency_spread_s=LATE_S),
        places_deg=tuple((float(lat), float(lon)) for lat, lon in places),
    )
    scenario = _with_spots(scenario, several=workers.spots is not serial)
    plan = Plan(start_s=START_S, period_s=scenario.period_s, cycles=CYCLES)
    sensors = replace(sensors, radars=replace(sensors.radars, azimuth_reference=np.zeros(len(sensors.radars), np.int64)))
    reports, memory, before_s = sea.load(sensors, 0, plan).reports, start_run(scenario, sensors), -np.inf
    of_video = scenario.input if isinstance(scenario.input, SimulatedVideo) else None
    if of_video is None and len(sensors.radars) and (video or has_video(scenario.input)):
        of_video = SimulatedVideo(cells=VIDEO_CELLS)
    if of_video is not None:  # land takes seconds, and no kernel
        of_video = of_video.model_copy(update={"land_deg": ()})
    spokes = Reports() if of_video is None else of_video.load(replace(sensors, land_deg=()), 0, plan).reports
    from coastwatch.kernels.jit import compilations  # it loads numba

    begun: list[str] = []
    announced: set[str] = set()

    @contextmanager
    def noted(stage: str) -> Iterator[None]:
        if stage not in begun:
            begun.append(stage)
        yield

    def announce() -> None:
        if begun and (stage := begun[-1]) not in announced:
            announced.add(stage)
            report(f"preparing kernels, compiled once after an installation (a minute): {stage}, stage {len(begun)}")

    with compilations(announce):
        for number in range(CYCLES):
            now_s = plan.instant_s(number)
            arrived = Reports.merged([reports.between(before_s, now_s), spokes.between(before_s, now_s)])
            memory, _ = run_cycle(scenario, sensors, memory, arrived, now_s, workers.spots, noted, workers.regions)
            before_s = now_s


def _with_spots(scenario: Scenario, several: bool = False) -> Scenario:
    """The scenario with two spots if many vessels are to come: several spots need scikit-learn, which takes a second to import.

    Args: several: also if few come, because the workers take spots.
    """
    if not several and (not isinstance(scenario.input, Simulated) or scenario.input.count <= scenario.spots.tracks_per_spot):
        return scenario
    return scenario.model_copy(update={"spots": scenario.spots.model_copy(update={"count": 2})})


def _places(scenario: Scenario, sensors: Sensors) -> Floats:
    """Where the vessels are: round the first sensors of each kind, so that each of them has something to report. (V, 2)"""
    sites = [part.site_deg[:MOST_SENSORS] for part in (sensors.radars, sensors.stations, sensors.sonars)]
    site = np.concatenate([*sites, [[scenario.area.latitude_deg, scenario.area.longitude_deg]]])
    site = site[np.isfinite(site).all(axis=1)]
    near = np.array(NEAR_M)
    return offset_deg(np.repeat(site, len(near), axis=0), np.tile(near, (len(site), 1)))
