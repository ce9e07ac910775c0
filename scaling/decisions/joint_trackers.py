"""What a turn of JPDA takes, and whether it parts close vessels better: `python -m scaling.decisions.joint_trackers turn|close|video`.

The questions: may `imm_jpda` be chosen for a busy radar (200 vessels in 6 NM, P_D 0.95, and false plots up to 400 plots a turn), and what
is gained: two vessels 20 m apart for three minutes of nine, at 1 NM. And what a turn of `repulsive_particles` takes on video.
"""

from __future__ import annotations

import argparse
from time import process_time

import numpy as np

from coastwatch.batches import Floats, Plots, Radars, Sensors, Sonars, Stations, Tracks
from coastwatch.geodesy import to_plane
from coastwatch.reproduction.region_inputs import cycle_inputs
from coastwatch.scenario import load_scenario
from coastwatch.stage import Running
from coastwatch.tracks import ImmJpdaLiteral, RadarTracker, RegionInput, RepulsiveParticles, TableTracker

PERIOD_S, RANGE_M, VESSELS, PLOTS, DETECTION = 2.4, 11112.0, 200, 400, 0.95
SITE_DEG, NEAR_M = (54.3, 12.0), 60.0
SIGMA_M, SIGMA_RAD = 8.0, np.radians(0.2)
TRACKERS: dict[str, RadarTracker] = {
    "imm_jpda": TableTracker(method="imm_jpda"),
    "imm_jpda, three models": TableTracker(method="imm_jpda", motion={"kind": "imm"}),
    "sided_imm": TableTracker(method="sided_imm"),
    "vimmjipda": TableTracker(method="vimmjipda"),
    "imm_jpda_literal": ImmJpdaLiteral(),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("turn", "close", "video"))
    parser.add_argument("--turns", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    if asked.what == "video":
        print("repulsive_particles", *video_turns(asked.turns, asked.seed))
        return
    for name, tracker in TRACKERS.items():
        said = (
            turns(tracker, asked.turns, asked.seed)
            if asked.what == "turn"
            else close(tracker, range(asked.seed, asked.seed + 10))
        )
        print(name, *said, flush=True)


def turns(tracker: RadarTracker, count: int, seed: int) -> tuple[str, ...]:
    """Median and largest time of the later half of the turns, and the tracks in the last."""
    random, sensors, memory = np.random.default_rng([seed, 61]), _one_radar(), tracker.init()
    position = _places(random, VESSELS)
    velocity = random.normal(0.0, 4.0, (VESSELS, 2))
    took = []
    for turn in range(count):
        seen = np.flatnonzero(random.random(VESSELS) < DETECTION)
        places = np.vstack([position[seen] + turn * PERIOD_S * velocity[seen], _places(random, PLOTS - len(seen))])
        given = RegionInput.of_plots(_plots(places, turn, random), (turn + 1) * PERIOD_S, sensors)
        begun = process_time()
        memory, found = Running(tracker, memory).next(given)
        took.append(1e3 * (process_time() - begun))
    late = took[count // 2 :]
    return f"median {np.median(late):.1f} ms", f"largest {max(late):.1f} ms", f"{len(found.tracks)} tracks"


def video_turns(count: int, seed: int) -> tuple[str, ...]:
    """Median and largest time of the later half of the turns of `heymann-table-1`, and the tracks in the last. No extraction."""
    scenario = load_scenario("heymann-table-1", {"cycles": str(count)})
    tracker, sensors, took = RepulsiveParticles(), scenario.sensors(), list[float]()
    memory, recording = tracker.init(), scenario.input.load(sensors, seed, scenario.plan())
    for now_s, plots, _, video in cycle_inputs(scenario, recording, 0, video=True):
        given = RegionInput.of_plots(plots, now_s, sensors)._replace(video=video)
        begun = process_time()
        memory, found = Running(tracker, memory).next(given)
        took.append(1e3 * (process_time() - begun))
    late = took[count // 2 :]
    return f"median {np.median(late):.1f} ms", f"largest {max(late):.1f} ms", f"{len(found.tracks)} tracks"


def close(tracker: RadarTracker, seeds: range) -> tuple[str, ...]:
    """Share of the instants of the close minutes, and after them, without its own track near each vessel; identities a run.

    Plots never merge.
    """
    near, after, names = list[bool](), list[bool](), list[int]()
    for seed in seeds:
        random, sensors, memory, seen = np.random.default_rng([seed, 62]), _one_radar(), tracker.init(), set[int]()
        for turn in range(225):
            now_s = (turn + 1) * PERIOD_S
            apart = 20.0 + 3.0 * max(180.0 - now_s, now_s - 360.0, 0.0)
            places = np.array([[-1100.0 + 4.0 * now_s, 1852.0], [-1100.0 + 4.0 * now_s, 1852.0 + apart]])
            detected = places[random.random(2) < DETECTION]
            given = RegionInput.of_plots(_plots(detected, turn, random), now_s, sensors)
            memory, found = Running(tracker, memory).next(given)
            seen |= set(found.tracks.track_id.tolist())
            if now_s > 180.0:
                (near if now_s <= 360.0 else after).append(not _right(found.tracks, places))
        names.append(len(seen))
    return (
        f"without both {100 * np.mean(near):.1f} %, after {100 * np.mean(after):.1f} %",
        f"identities {np.mean(names):.1f}",
    )


def _right(tracks: Tracks, places: Floats) -> bool:
    """Whether two tracks are near a vessel each."""
    if len(tracks) != 2:
        return False
    found = to_plane(tracks.position_deg, np.array(SITE_DEG))
    return min(float(np.hypot(*(found[order] - places).T).max()) for order in ([0, 1], [1, 0])) < NEAR_M


def _places(random: np.random.Generator, count: int) -> Floats:
    """Even over the disc."""
    angle, away = random.uniform(0.0, 2.0 * np.pi, count), RANGE_M * np.sqrt(random.uniform(0.001, 0.8, count))
    return np.asarray(away[:, None] * np.column_stack([np.sin(angle), np.cos(angle)]))


def _plots(places: Floats, turn: int, random: np.random.Generator) -> Plots:
    away, angle = np.hypot(*places.T), np.arctan2(places[:, 0], places[:, 1])
    time = (turn + angle % (2.0 * np.pi) / (2.0 * np.pi)) * PERIOD_S
    away = away + SIGMA_M * random.standard_normal(len(away))
    angle = angle + SIGMA_RAD * random.standard_normal(len(away))
    along = np.column_stack([np.sin(angle), np.cos(angle)])
    across = np.column_stack([along[:, 1], -along[:, 0]])
    wide = (away * SIGMA_RAD) ** 2
    covariance = SIGMA_M**2 * along[:, :, None] * along[:, None] + wide[:, None, None] * across[:, :, None] * across[:, None]
    none = np.zeros(len(away), np.int64)
    return Plots(none, none, time, away[:, None] * along, covariance, np.zeros((len(away), 2)), away, angle, none - 1)


def _one_radar() -> Sensors:
    site = np.array([SITE_DEG])
    radars = Radars(
        name=np.array(["radar"]),
        region=np.zeros(1, np.int64),
        site_deg=site,
        range_m=np.array([RANGE_M]),
        period_s=np.array([PERIOD_S]),
        range_sigma_m=np.array([SIGMA_M]),
        azimuth_sigma_rad=np.array([SIGMA_RAD]),
    )
    return Sensors(radars, Stations.empty(), Sonars.empty(), ("region",), site)


if __name__ == "__main__":
    main()
