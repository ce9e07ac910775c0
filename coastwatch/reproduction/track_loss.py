"""Scores of the whole paths of the radar tracks of a few targets: as they were shown at the time, and with hindsight."""

from __future__ import annotations

import numpy as np

from coastwatch.batches import Floats, Ints, Reports
from coastwatch.geodesy import to_plane
from coastwatch.reproduction.published import TrackLoss
from coastwatch.reproduction.targets import cycles
from coastwatch.scenario import Scenario
from coastwatch.scores.track_loss import initiation_scores, path_scores, shadow_scores
from coastwatch.sensors import StartStates
from coastwatch.server.timing import Stopwatch


def measure(scenario: Scenario, seed: int, asked: TrackLoss) -> dict[str, float | None]:
    """The scores of the tracks of region 0 from the first instant of the truth on.

    Returns: those of `path_scores` with hindsight, and as `online_...` as shown at the time; of `initiation_scores` and `shadow_scores`
    as shown; look_s: mean time of a step of the tracker.
    """
    sensors = scenario.sensors()
    recording = scenario.input.load(sensors, seed, scenario.plan())
    assert recording.truth is not None
    assert isinstance(recording.reports, Reports)
    watch, true, shown = Stopwatch(), [], []
    site_deg = sensors.radars.site_deg[0]
    for now_s, _, found in cycles(scenario, scenario.tracks, recording, scenario.tracks.init(), watch):
        if now_s < recording.truth.time_s[0]:
            continue
        truth, tracks = recording.truth.at(now_s), found.tracks
        true.append((truth.vessel, to_plane(truth.position_deg, site_deg)))
        shown.append((tracks.track_id, to_plane(tracks.position_deg, site_deg)))
    true_m, online_m = as_paths(true), as_paths(shown)
    final_m = online_m
    hidden = np.zeros(true_m.shape[:2], np.bool_)
    if isinstance(scenario.input, StartStates):
        hidden = scenario.input.in_shadow(true_m)
    online = path_scores(online_m, true_m, asked.limit_m, asked.for_good)
    return {
        **path_scores(final_m, true_m, asked.limit_m, asked.for_good),
        **{f"online_{name}": value for name, value in online.items()},
        **initiation_scores(online_m, true_m, asked.limit_m, scenario.period_s),
        **shadow_scores(online_m, true_m, hidden, asked.near_m, asked.after_looks),
        "look_s": float(np.mean(watch.seconds["tracks"])),
    }


def as_paths(seen: list[tuple[Ints, Floats]]) -> Floats:
    """The path of each name over the instants, by name, NaN where it is absent. (N, T, 2) Args: names (n,) and positions (n, 2)."""
    names = np.unique(np.concatenate([np.zeros(0, np.int64), *(name for name, _ in seen)]))
    out = np.full((len(names), len(seen), 2), np.nan)
    for t, (name, position_m) in enumerate(seen):
        out[np.searchsorted(names, name), t] = position_m
    return out
