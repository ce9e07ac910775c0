"""Scores of the radar tracks of a few targets, beside the bound: the same filters with the origin of every plot known."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from coastwatch.batches import AisReports, Messages, Plots, Recording, Sensors
from coastwatch.geodesy import difference_m, to_plane
from coastwatch.reproduction.published import Targets
from coastwatch.reproduction.region_inputs import cycle_inputs
from coastwatch.scenario import Scenario
from coastwatch.scores.targets import TargetScores
from coastwatch.server.timing import Stopwatch
from coastwatch.stage import Running
from coastwatch.tracks import (
    AisInput,
    ForestMemory,
    ImmJpdaMemory,
    ParticlesMemory,
    RadarMemory,
    RadarTracker,
    RegionInput,
    RegionOutput,
    TableTracker,
)
from coastwatch.tracks.radar.association import KnownOrigin
from coastwatch.tracks.radar.life import TrackManagement
from coastwatch.tracks.radar.messages import messages_of

AnyMemory = RadarMemory | ForestMemory | ImmJpdaMemory | ParticlesMemory
NEVER = 10**6  # turns or seconds that no run has: tracks of known origin end with their targets


def measure(scenario: Scenario, seed: int, asked: Targets) -> dict[str, float | list[float] | None]:
    """The scores of the tracks of region 0, and as `genie_...` those of the bound."""
    sensors = scenario.sensors()
    found: dict[str, float | list[float] | None] = {}
    for name, method in {"": scenario.tracks, "genie_": of_known_origin(scenario)}.items():
        recording = scenario.input.load(sensors, seed, scenario.plan())
        assert recording.truth is not None
        scores, mmsi = TargetScores(asked.cutoff_m, asked.near_m), mmsi_of_vessels(recording.for_scores().ais)
        known = knows_origin(method)
        for now_s, _, output in cycles(scenario, method, recording, method.init()):
            truth, tracks = recording.truth.at(now_s), output.tracks
            near = np.hypot(*difference_m(tracks.position_deg, sensors.radars.site_deg[0]).T) <= asked.within_m
            counted = np.isin(tracks.origin, truth.vessel) if known else near  # known: those of targets that are there
            scores = scores.seen(truth, tracks.take(counted), mmsi)
        found |= {f"{name}{key}": value for key, value in scores.as_dict().items()}
        found[f"{name}every_ospa_m"] = list(scores.every_ospa_m)
    return found


def of_known_origin(scenario: Scenario) -> TableTracker:
    """The filters of a scenario's tracker, given every plot of a target and no other. Raises: TypeError: it keeps no table of tracks."""
    if not isinstance(scenario.tracks, TableTracker):
        raise TypeError(f"targets: got tracks.method = {scenario.tracks.method!r}, needed one of a table of tracks")
    upkeep = TrackManagement(delete_misses=NEVER, misses_per_hit=NEVER, coast_s=NEVER)
    return TableTracker(association=KnownOrigin(), motion=scenario.tracks.motion, upkeep=upkeep)


def knows_origin(method: RadarTracker) -> bool:
    """Whether a tracker is given the origin of every plot."""
    return isinstance(method, TableTracker) and isinstance(method.association, KnownOrigin)


def cycles(
    scenario: Scenario,
    method: RadarTracker,
    recording: Recording,
    memory: AnyMemory,
    first: int = 0,
    watch: Stopwatch | None = None,
) -> Iterator[tuple[float, AnyMemory, RegionOutput]]:
    """Instant, memory and output of each cycle of the radar tracks of region 0: plots, AIS tracks and tracks, and no later stage.

    The memory that comes with an instant is valid until the next. Args: first: cycle; watch: measures the steps of the tracker.
    """
    sensors, ais_memory, watch = scenario.sensors(), scenario.ais_tracks.init(), watch or Stopwatch()
    known = knows_origin(method)
    echo_m = scenario.tracks.upkeep.echo_sigma_m if known and isinstance(scenario.tracks, TableTracker) else 0.0
    for now_s, plots, heard, video in cycle_inputs(scenario, recording, first, method.takes_video):
        ais_memory, (ais, alarms, taken) = scenario.ais_tracks.step(ais_memory, AisInput(heard, now_s, sensors))
        messages = Messages.empty()
        if scenario.tracks.takes_messages:
            messages = messages_of(taken, ais, sensors, 0, alarms.interval_s)
        if known:  # the bound knows all noise, and of whom each message is
            plots = replace(plots, covariance=plots.covariance + echo_m**2 * np.eye(2))
            plots = Plots.join([plots, _as_plots(messages, sensors)])
        given = RegionInput.of_plots(plots, now_s, sensors)
        with watch("tracks"):
            memory, found = Running(method, memory).next(given._replace(messages=messages, video=video))
        watch.lap()
        yield now_s, memory, found


def mmsi_of_vessels(reports: AisReports) -> dict[int, int]:
    """The MMSI that most reports of each vessel carry, by its number."""
    out = {}
    for vessel in np.unique(reports.origin).tolist():
        names, count = np.unique(reports.mmsi[reports.origin == vessel], return_counts=True)
        out[vessel] = int(names[count.argmax()])
    return out


def _as_plots(messages: Messages, sensors: Sensors) -> Plots:
    """Messages as plots of the first radar."""
    m, count = messages, len(messages)
    zero = np.zeros(count)
    site_m = np.tile(to_plane(sensors.radars.site_deg[0], sensors.region_origin_deg[0]), (count, 1))
    number = np.zeros(count, np.int64)
    return Plots(number, number, m.time_s, m.position_m, m.covariance, site_m, zero, zero, m.origin)
