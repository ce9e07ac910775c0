"""How much a lag of some looks takes off the error of a track: `python -m scaling.decisions.corrected_past [--seeds 2001-2003]`.

The question: is the position error of the decided past at most 0.72 of what was shown at the time? The scenario is `liland-tracking`.
It prints root mean squares over all instants at which a track was shown within 50 m of its vessel and its path has been decided, and
the mean of the ratio over seeds with its standard error. Looks without a plot count: the decided path passes between plots.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from coastwatch.batches import DecidedPath, Floats, Tracks
from coastwatch.geodesy import to_plane
from coastwatch.reproduction.targets import cycles
from coastwatch.reproduction.track_loss import path_between
from coastwatch.scenario import load_scenario
from scaling.load.seeds import seed_range

NEAR_M = 50.0
CELLS = (("0.5", "S0"), ("0.9", "S0"), ("0.5", "S4"), ("0.9", "S4"))
"""Detection probability, and who sends AIS: S0 nobody, S4 all."""


def errors_m(detection: str, transponders: str, window: int, seed: int) -> tuple[Floats, Floats]:
    """Position errors as shown, and as decided later, of the same tracks at the same instants."""
    chosen = {
        "tracks.method": "multi_hypothesis",
        "tracks.association.window": str(window),
        "input.transponders": transponders,
        "input.detection_probability": detection,
        "tracks.upkeep.detection.detection_probability": detection,
    }
    scenario = load_scenario("liland-tracking", chosen)
    recording = scenario.input.load(scenario.sensors(), seed, scenario.plan())
    assert recording.truth is not None
    found = [one for _, _, one in cycles(scenario, scenario.tracks, recording, scenario.tracks.init())]
    shown, decided = Tracks.join([one.tracks for one in found]), DecidedPath.join([one.decided for one in found])
    shown = shown.take(
        np.flatnonzero((shown.time_s >= recording.truth.time_s[0]) & (shown.origin >= 0))
    )  # before that is the lead-in
    errors = [np.zeros((0, 2))]
    for track in np.unique(decided.track_id):
        past, then = decided.take(decided.track_id == track), shown.take(shown.track_id == track)
        past = past.take(np.argsort(past.time_s))
        then = then.take((then.time_s >= past.time_s[0]) & (then.time_s <= past.time_s[-1]))
        origin_deg = past.position_deg[0]
        path_m = path_between(past.time_s, to_plane(past.position_deg, origin_deg), past.velocity_m_s, then.time_s)
        both_m = np.stack([to_plane(then.position_deg, origin_deg), path_m], axis=1)
        for place_m, vessel, now_s in zip(both_m, then.origin.tolist(), then.time_s.tolist(), strict=True):
            truth = recording.truth.at(now_s)
            errors.append(np.hypot(*(place_m[:, None] - to_plane(truth.position_deg[truth.vessel == vessel], origin_deg)).T))
    out = np.concatenate(errors)
    out = out[out[:, 0] <= NEAR_M]
    return out[:, 0], out[:, 1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=seed_range, default=range(2001, 2004), help="FIRST-LAST (default: 2001-2003)")
    parser.add_argument("--window", type=int, default=3, help="looks (default: 3)")
    asked = parser.parse_args()
    for detection, transponders in CELLS:
        ratios, squares = [], []
        for seed in asked.seeds:
            squares.append([math.sqrt((error**2).mean()) for error in errors_m(detection, transponders, asked.window, seed)])
            ratios.append(squares[-1][1] / squares[-1][0])
        shown, later = np.mean(squares, axis=0)
        error = np.std(ratios, ddof=1) / math.sqrt(len(ratios)) if len(ratios) > 1 else math.nan
        print(
            f"P_D {detection} {transponders}: shown {shown:.2f} m, decided {later:.2f} m, ratio {np.mean(ratios):.3f} +- {error:.3f}"
        )


if __name__ == "__main__":
    main()
