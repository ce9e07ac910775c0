"""AIS that plots contradict, and AIS that only seems so: `python -m scaling.decisions.contradicted_ais [--periods 3 4] [--seeds 1-2]`.

The question: after how long should a track leave messages that contradict its plots? Too soon, and vessels lose their honest AIS while
they turn, brake, or are in radar shadow, where a filter of plots alone lags behind. Too late, and an AIS that drifts away takes the track
along. Twenty vessels of 12 knots a seed, radars of 10 m and 0.3 deg with P_D 0.9 that turn once in `--periods` seconds, messages each 6 s
that err by 3 m. The last radar of `--far` sees no vessel: what it cannot see must not delay what the others see. It prints how many
honest vessels have left their MMSI at some time, how long an AIS that drifts is kept, and how far it takes the track along.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from coastwatch.batches import Floats, Messages, Plots, Radars, Sensors, Sonars, Stations
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M, from_plane, to_plane
from coastwatch.tracks import RegionInput, TableTracker
from scaling.load.seeds import seed_range

VESSELS = 20
CYCLE_S, SPAN_S, STEP_S = 3.0, 260.0, 0.25
BEGIN_S, SPREAD_S = 80.0, 40.0  # when it happens: the first vessel, and how much later the last one
SHADOW_S = 80.0
AIS_S, AIS_SIGMA_M = 6.0, 3.0
RANGE_SIGMA_M, AZIMUTH_SIGMA_DEG, DETECTION = 10.0, 0.3, 0.9
ORIGIN_DEG = np.array([50.0, -1.0])
SITES_NM = np.array([[-4.0, 2.0], [-4.0, -2.0], [4.0, 0.0], [0.0, 4.0]])
MMSI = 219_003_000


@dataclass(frozen=True)
class Scene:
    """What vessels do from their time on."""

    turn_deg_s: float = 0.0  # for a quarter of a circle
    brake_s: float = 0.0  # until they are at rest; 0: they do not
    shadow: bool = False  # no radar sees them, from 5 s before
    drift_m_s: float = 0.0  # of the position that their AIS states


SCENES = {
    "turn": Scene(turn_deg_s=1.5),
    "turn in shadow": Scene(turn_deg_s=1.5, shadow=True),
    "brake": Scene(brake_s=60.0),
    "brake in shadow": Scene(brake_s=60.0, shadow=True),
    "drift of 1 m/s": Scene(drift_m_s=1.0),
    "drift of 5 m/s": Scene(drift_m_s=5.0),
}


@dataclass(frozen=True)
class Paths:
    """Vessels, sampled each STEP_S from time 0 on."""

    position_m: Floats  # (V, T, 2)
    begin_s: Floats  # (V,)

    def at(self, vessel: Any, time_s: Floats) -> Floats:
        """Positions of these vessels, each at its own time. (N, 2)"""
        at = np.clip(time_s / STEP_S, 0.0, self.position_m.shape[1] - 1.001)
        row, part = at.astype(np.int64), (at % 1.0)[:, None]
        out: Floats = (1.0 - part) * self.position_m[vessel, row] + part * self.position_m[vessel, row + 1]
        return out


def paths(scene: Scene, seed: int) -> Paths:
    """The vessels of a scene, in a square of 5 nautical miles."""
    rng = np.random.default_rng([seed, 1])
    begin_s = BEGIN_S + SPREAD_S * np.arange(VESSELS) / VESSELS
    since_s = np.maximum(np.arange(0.0, SPAN_S + 10.0, STEP_S) - begin_s[:, None], 0.0)
    course = rng.uniform(0.0, 2.0 * math.pi, (VESSELS, 1)) + np.minimum(np.radians(scene.turn_deg_s) * since_s, math.pi / 2.0)
    speed = 12.0 * KNOT_M_S * (np.maximum(1.0 - since_s / scene.brake_s, 0.0) if scene.brake_s else np.ones_like(since_s))
    step_m = STEP_S * speed[:, :, None] * np.stack([np.sin(course), np.cos(course)], axis=2)
    start_m = rng.uniform(-2.5, 2.5, (VESSELS, 1, 2)) * NAUTICAL_MILE_M
    return Paths(start_m + np.cumsum(step_m, axis=1) - step_m[:, :1], begin_s)


def sensors_of(periods_s: list[float], far_s: float) -> Sensors:
    """Radars that turn once in so many seconds, and one that is 60 nautical miles away. Args: far_s: its period; 0: none."""
    sites_nm = np.concatenate([SITES_NM[: len(periods_s)], [[60.0, 0.0]]])[: len(periods_s) + (far_s > 0.0)]
    count = len(sites_nm)
    radars = Radars(
        name=np.array([f"radar {k}" for k in range(count)]),
        region=np.zeros(count, np.int64),
        site_deg=from_plane(sites_nm * NAUTICAL_MILE_M, ORIGIN_DEG),
        range_m=np.full(count, 12.0 * NAUTICAL_MILE_M),
        period_s=np.array([*periods_s, far_s][:count]),
        range_sigma_m=np.full(count, RANGE_SIGMA_M),
        azimuth_sigma_rad=np.full(count, math.radians(AZIMUTH_SIGMA_DEG)),
    )
    return Sensors(radars, Stations.empty(), Sonars.empty(), ("region",), ORIGIN_DEG[None])


def plots_of(scene: Scene, truth: Paths, sensors: Sensors, seed: int) -> Plots:
    """The plots of all turns, sorted by time."""
    parts, radars = [], sensors.radars
    for radar in range(len(radars)):
        rng = np.random.default_rng([seed, 2, radar])
        period_s, site_m = float(radars.period_s[radar]), to_plane(radars.site_deg[radar], ORIGIN_DEG)
        turns = int(SPAN_S // period_s)
        vessel, turn_s = np.tile(np.arange(VESSELS), turns), period_s * np.repeat(np.arange(turns), VESSELS)
        time_s = np.asarray(turn_s + 0.5 * period_s, np.float64)
        for _ in range(3):
            off_m = truth.at(vessel, time_s) - site_m
            time_s = turn_s + np.arctan2(off_m[:, 0], off_m[:, 1]) % (2.0 * math.pi) / (2.0 * math.pi) * period_s
        off_m = truth.at(vessel, time_s) - site_m
        since_s = time_s - truth.begin_s[vessel] + 5.0
        seen = (np.hypot(*off_m.T) < radars.range_m[radar]) & (rng.random(len(vessel)) < DETECTION)
        if scene.shadow:
            seen &= (since_s < 0.0) | (since_s > SHADOW_S)
        along = off_m[seen] / np.hypot(*off_m[seen].T)[:, None]
        across = along @ np.array([[0.0, 1.0], [-1.0, 0.0]])
        spread_m = np.column_stack(
            [np.full(len(along), RANGE_SIGMA_M), np.hypot(*off_m[seen].T) * radars.azimuth_sigma_rad[radar]]
        )
        noise_m = spread_m * rng.standard_normal(spread_m.shape)
        axes = np.stack([along, across], axis=2)
        measured_m = off_m[seen] + (axes @ noise_m[:, :, None])[:, :, 0]
        parts.append(
            Plots(
                sensor=np.full(len(along), radar),
                region=np.zeros(len(along), np.int64),
                time_s=time_s[seen],
                position_m=site_m + measured_m,
                covariance=(axes * spread_m[:, None, :] ** 2) @ axes.transpose(0, 2, 1),
                site_m=np.tile(site_m, (len(along), 1)),
                range_m=np.hypot(*measured_m.T),
                azimuth_rad=np.arctan2(measured_m[:, 0], measured_m[:, 1]),
                origin=vessel[seen],
            )
        )
    every = Plots.join(parts)
    return every.take(np.argsort(every.time_s, kind="stable"))


def messages_of(scene: Scene, truth: Paths, seed: int) -> Messages:
    """The messages of all vessels, sorted by time."""
    rng = np.random.default_rng([seed, 3])
    time_s = (np.arange(0.0, SPAN_S - AIS_S, AIS_S) + rng.uniform(0.0, AIS_S, (VESSELS, 1))).ravel()
    vessel = np.repeat(np.arange(VESSELS), len(time_s) // VESSELS)
    drift_m = scene.drift_m_s * np.maximum(time_s - truth.begin_s[vessel], 0.0)
    position_m = truth.at(vessel, time_s) + AIS_SIGMA_M * rng.standard_normal((len(time_s), 2)) + drift_m[:, None] * [1.0, 0.0]
    covariance = np.tile(AIS_SIGMA_M**2 * np.eye(2), (len(time_s), 1, 1))
    every = Messages(time_s, position_m, covariance, MMSI + vessel, vessel)
    return every.take(np.argsort(time_s, kind="stable"))


def measure(scene: Scene, method: TableTracker, sensors: Sensors, seed: int) -> tuple[Floats, Floats]:
    """When each vessel's MMSI was left first, s after it began (V,), NaN: never; and the largest error of a track that has it (V,), m."""
    truth = paths(scene, seed)
    plots, messages = plots_of(scene, truth, sensors, seed), messages_of(scene, truth, seed)
    memory, left_s, worst_m = method.init(), np.full(VESSELS, np.nan), np.zeros(VESSELS)
    for end_s in np.arange(CYCLE_S, SPAN_S, CYCLE_S).tolist():
        seen, heard = ((part.time_s > end_s - CYCLE_S) & (part.time_s <= end_s) for part in (plots, messages))
        given = RegionInput.of_plots(plots.take(seen), end_s, sensors)
        memory, (tracks, *_) = method.step(memory, given._replace(messages=messages.take(heard)))
        left = memory.plots_alone.left_mmsi[memory.table.live] - MMSI
        left = np.unique(left[(left >= 0) & (left < VESSELS)])
        left_s[left] = np.where(np.isnan(left_s[left]), end_s - truth.begin_s[left], left_s[left])
        held = tracks.take((tracks.held_mmsi >= MMSI) & (end_s > BEGIN_S))
        vessel = held.held_mmsi - MMSI
        error_m = np.hypot(*(to_plane(held.position_deg, ORIGIN_DEG) - truth.at(vessel, held.time_s)).T)
        np.maximum.at(worst_m, vessel, error_m)
    return left_s, worst_m


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=seed_range, default=range(1, 3), help="first-last")
    parser.add_argument("--periods", nargs="+", type=float, default=[3.0, 4.0], help="of the radars, s; four at most")
    parser.add_argument("--far", type=float, default=0.0, help="period of a radar that sees no vessel, s; 0: there is none")
    parser.add_argument("--methods", nargs="+", default=["guided_vimmjipda", "vimmjipda_sequential", "multi_hypothesis"])
    parser.add_argument("--scenes", nargs="+", default=list(SCENES), choices=SCENES)
    asked = parser.parse_args()
    if len(asked.periods) > len(SITES_NM):
        parser.error(f"--periods: got {len(asked.periods)}, needed {len(SITES_NM)} at most")
    sensors = sensors_of(asked.periods, asked.far)
    print(
        f"{'scene':<16}  {'method':<22}  left, of {VESSELS * len(asked.seeds)}   kept, s: median, most   track off, m: median, most"
    )
    for name in asked.scenes:
        for method in asked.methods:
            found = [measure(SCENES[name], TableTracker(method=method), sensors, seed) for seed in asked.seeds]
            left_s, worst_m = (np.concatenate(column) for column in zip(*found, strict=True))
            gone = np.isfinite(left_s)
            kept = f"{np.median(left_s[gone]):13.0f}{left_s[gone].max():6.0f}" if gone.any() else " " * 19
            print(f"{name:<16}  {method:<22}{gone.sum():12}{kept}{np.median(worst_m):27.0f}{worst_m.max():6.0f}", flush=True)


if __name__ == "__main__":
    main()
