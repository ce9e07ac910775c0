"""What does `central_imm` cost a vessel, what would late reports gain in their places, and does earlier AIS help after silence?

    python -m scaling.decisions.central_imm [--seed 2]

Forward: the method as it is. A report older than the filter is brought forward by the filter's velocity. In place: the same filter is
given all reports that had arrived at an instant at once, in order of measurement. Going back and playing again would give the same.
The bound is that of the scores, which has every report from its measurement on. The causal bound has it from its arrival on.

After silence: all AIS ends at one instant. The filters that go on with plots alone are compared with the radar tracks.
"""

from __future__ import annotations

import argparse
import time
from contextlib import nullcontext
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from coastwatch.batches import Associations, Floats, FusedTracks, Ints, Measurements, Recording, Tracks, Trajectories
from coastwatch.cycle import run_cycle, start_run
from coastwatch.fused_tracks import CentralImm, FusionInput
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.kernels.tables.lookup import row_of
from coastwatch.scenario import load_scenario
from coastwatch.scores.bound import bound
from coastwatch.scores.rmse import fusion_errors
from coastwatch.scores.tally import rows_of_vessels
from coastwatch.stage import serial

LATENCIES: dict[str, dict[str, str]] = {
    "AIS every 3 s, 2 s late and 2 s more in the mean": {},
    "the same with the intervals of class A": {"input.ais.intervals": "itu"},
}
LATE = {"input.ais.latency_s": "2", "input.ais.latency_spread_s": "2"}
CIRCLING = {"input.motion.linear_weight": "0", "input.motion.circular_weight": "1"}
FIRST, EVERY = 25, 5  # cycle from which both run, and how often they are compared after two minutes
VESSELS, PERIOD_S = 100_000, 3.0


@dataclass
class Heard:
    """A fuser that only keeps what it is given."""

    steps: list[tuple[Tracks, Measurements, Associations, float]] = field(default_factory=list)

    def init(self) -> None:
        """Nothing."""

    def step(self, memory: None, given: FusionInput) -> Any:
        """The first track of each vessel."""
        self.steps.append((given.tracks, given.measurements, given.associations, given.time_s))
        lead = np.unique(given.associations.vessel, return_index=True)[1]
        t = given.tracks.take(lead)
        return None, FusedTracks(t.time_s, t.position_deg, t.velocity_m_s, t.covariance)


def heard_in(overrides: dict[str, str], seed: int) -> tuple[Heard, Recording, Ints, int]:
    """What the fuser is given in a run of the base scenario; its recording, the kinds of its sources, and its cycles of warm-up."""
    scenario = load_scenario("context-driven-1000", {**overrides, "cycles": "40"})
    sensors, plan, heard = scenario.sensors(), scenario.plan(), Heard()
    recording = scenario.input.load(sensors, seed, plan)
    spied = scenario.model_copy(update={"fused_tracks": heard})
    memory, before = start_run(spied, sensors), -np.inf
    for cycle in range(plan.cycles):
        now = plan.instant_s(cycle)
        reports = recording.reports.between(before, now)
        memory, _ = run_cycle(spied, sensors, memory, reports, now, serial, lambda name: nullcontext())
        before = now
    return heard, recording, sensors.source_kinds, scenario.warmup_cycles


def late_reports(overrides: dict[str, str], seed: int) -> dict[str, float]:
    """RMSE in metres, over the instants compared, of each way."""
    heard, recording, kinds, warmup = heard_in({**LATE, **overrides}, seed)
    return _compared(heard.steps, recording, kinds, warmup)


def after_silence(overrides: dict[str, str], seed: int) -> list[str]:
    """RMSE in metres of filter and radar track, of vessels that had AIS until the warm-up was over."""
    heard, recording, kinds, warmup = heard_in(overrides, seed)
    method, truth, lines, had = CentralImm(), recording.truth, [], np.zeros(0, np.int64)
    assert truth is not None
    memory, none = method.init(), np.zeros(0, np.int64)
    for number, (tracks, measured, joined, now) in enumerate(heard.steps):
        if number < warmup:
            radar, ais = (np.isin(tracks.source, np.flatnonzero(kinds == kind)) for kind in (0, 1))
            had = tracks.track_id[radar & np.isin(joined.vessel, joined.vessel[ais])]
        else:
            radar = kinds[tracks.source] == 0
            tracks, measured = tracks.take(radar), measured.take(measured.sensor >= 0)
            joined = Associations(none, none, np.zeros(0), np.unique(joined.vessel[radar], return_inverse=True)[1])
        memory, fused = method.step(memory, FusionInput(tracks, measured, joined, now, kinds))
        silent_s = PERIOD_S * (number - warmup + 1)
        if silent_s in (3.0, 30.0, 60.0, 120.0):
            row = np.flatnonzero(np.isin(tracks.track_id, had))
            true = truth.at(now)
            place = true.position_deg[row_of(true.vessel, tracks.origin[row])]
            both = fused.position_deg[joined.vessel[row]], tracks.position_deg[row]
            here, there = (float(np.sqrt((difference_m(p, place) ** 2).sum(axis=1).mean())) for p in both)
            lines.append(f"{silent_s:.0f} s {here:.1f} and {there:.1f} m")
    return lines


def _compared(steps: list[Any], recording: Recording, kinds: Ints, warmup: int) -> dict[str, float]:
    truth, method = recording.truth, CentralImm()
    assert truth is not None
    squares: dict[str, list[Floats]] = {"AIS alone": [], "forward": [], "in place": [], "bound": [], "causal bound": []}
    begin, _, joined, then = steps[FIRST]
    first, _ = method.step(method.init(), FusionInput(begin, Measurements.empty(), joined, then, kinds))
    memory = first
    for number, (tracks, measured, associations, now) in enumerate(steps[FIRST + 1 :], start=FIRST + 1):
        memory, forward = method.step(memory, FusionInput(tracks, measured, associations, now, kinds))
        if number < warmup or number % EVERY:
            continue
        everything = Measurements.join([m for _, m, _, _ in steps[FIRST + 1 : number + 1]])
        _, in_place = method.step(first, FusionInput(tracks, everything, associations, now, kinds))
        true = truth.at(now)
        counted = fusion_errors(true, tracks, associations, forward, kinds)
        place = true.position_deg[row_of(true.vessel, counted.origin)]
        ais = np.flatnonzero(kinds[tracks.source] == 1)
        own = ais[row_of(tracks.origin[ais], counted.origin)]
        for name, found in (("forward", forward.position_deg[counted.row]), ("in place", in_place.position_deg[counted.row])):
            squares[name].append((difference_m(found, place) ** 2).sum(axis=1))
        squares["AIS alone"].append((difference_m(tracks.position_deg[own], place) ** 2).sum(axis=1))
        for name, until in (("bound", np.inf), ("causal bound", now)):
            squares[name].append((difference_m(_best(truth, recording, counted.origin, now, until), place) ** 2).sum(axis=1))
    return {name: float(np.sqrt(np.nanmean(np.concatenate(parts)))) for name, parts in squares.items()}


def _best(truth: Trajectories, recording: Recording, origin: Ints, now: float, until_s: float) -> Floats:
    """The exact filter's places of these vessels, of the reports that had arrived. (C, 2)"""
    few, r = rows_of_vessels(truth, row_of(truth.vessel, origin)), recording.whole()
    assert recording.noise is not None
    radar, ais = r.radar.take(r.radar.received_s <= until_s), r.ais.take(r.ais.received_s <= until_s)
    return bound(few, radar, ais, recording.noise, np.array([now])).position_deg[:, 0]


def microseconds() -> float:
    """Processor time a vessel and cycle: two radars see nine in ten and three in four, AIS comes once."""
    rng, method = np.random.default_rng(1), CentralImm()
    home = np.column_stack([rng.uniform(-60.0, 60.0, VESSELS), rng.uniform(-179.0, 179.0, VESSELS)])
    velocity, memory, spent, kinds = rng.normal(0.0, 4.0, (VESSELS, 2)), method.init(), [], np.array([0, 1])
    for cycle in range(4):
        tracks, measured, associations, now = _sea(home, velocity, PERIOD_S * cycle, rng)
        start = time.process_time()
        memory, _ = method.step(memory, FusionInput(tracks, measured, associations, now, kinds))
        spent.append(time.process_time() - start)
    return 1e6 * float(np.median(spent[1:])) / VESSELS  # the first compiles, and begins the filters


def _sea(home: Floats, velocity: Floats, now: float, rng: Any) -> tuple[Tracks, Measurements, Associations, float]:
    n, vessel, source = len(home), np.tile(np.arange(len(home)), 2), np.repeat([0, 1], len(home))
    covariance = np.zeros((2 * n, 4, 4))
    covariance[:, [0, 1], [0, 1]], covariance[:, [2, 3], [2, 3]] = np.where(source == 0, 150.0, 4.0)[:, None], 0.05
    place, quiet = offset_deg(home, velocity * now)[vessel], np.full(2 * n, now - PERIOD_S)
    ids, report, mmsi = 2**40 * source + vessel, np.tile(np.eye(2) * 100.0, (2 * n, 1, 1)), np.where(source == 1, vessel, -1)
    clock = np.full(2 * n, now)
    tracks = Tracks(ids, source, clock, place, velocity[vessel], covariance, report, quiet, quiet, mmsi, vessel)
    parts = [_measured(home, velocity, now, sensor, share, rng) for sensor, share in ((0, 0.9), (1, 0.75), (-1, 1.0))]
    measured = Measurements.join(parts)
    none = np.zeros(0, np.int64)
    order = np.lexsort((measured.time_s, measured.track_id))
    return tracks, measured.take(order), Associations(none, none, np.zeros(0), vessel), now


def _measured(home: Floats, velocity: Floats, now: float, sensor: int, share: float, rng: Any) -> Measurements:
    row = np.flatnonzero(rng.random(len(home)) < share)
    n, ais = len(row), sensor < 0
    at, sigma = now - rng.uniform(0.0, PERIOD_S, n), 3.33 if ais else 20.0
    covariance = np.full((n, 4, 4), np.nan)
    covariance[:, :2, :2] = np.eye(2) * sigma**2
    covariance[:, 2:, 2:] = np.eye(2) * (0.01 if ais else np.nan)
    speed = velocity[row] + rng.normal(0.0, 0.1, (n, 2)) if ais else np.full((n, 2), np.nan)
    place = offset_deg(home[row], velocity[row] * at[:, None] + rng.normal(0.0, sigma, (n, 2)))
    ids = row + (2**40 if ais else 0)
    return Measurements(ids, np.full(n, sensor), at, place, speed, covariance, home[row] + 0.05)


def main() -> None:
    """Print the answers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    seed = parser.parse_args().seed
    print(f"{microseconds():.1f} us of processor time a vessel and cycle, of 2.65 measurements")
    for title, overrides in LATENCIES.items():
        found = late_reports(overrides, seed)
        print(f"{title}: " + ", ".join(f"{name} {metres:.3f} m" for name, metres in found.items()))
    for title, overrides in (("straight", {}), ("circling", CIRCLING)):
        print(f"AIS silent, {title}, filter and radar track: " + ", ".join(after_silence(overrides, seed)))


if __name__ == "__main__":
    main()
