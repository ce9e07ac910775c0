"""How much a lag of some looks takes off the error of a track: `python -m scaling.decisions.corrected_past [--seeds 2001-2003]`.

The question: is the position error of the decided past at most 0.72 of what was shown at the time? The scenario is `liland-tracking`, in
which a plot and the end of a cycle have one time, so both states are of one instant. It prints root mean squares over all states of
tracks that were within 50 m of their vessel when they were shown, and the mean of the ratio over seeds with its standard error.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from coastwatch.batches import DecidedPath, Floats, Tracks
from coastwatch.geodesy import difference_m
from coastwatch.reproduction.targets import cycles
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
    instants, of_shown = np.unique(shown.time_s, return_inverse=True)
    at = np.minimum(np.searchsorted(instants, decided.time_s - 1e-3), len(instants) - 1)
    of_truth = decided.time_s >= recording.truth.time_s[0]  # before that is the lead-in of the scenario
    same = np.flatnonzero((np.abs(instants[at] - decided.time_s) < 1e-3) & of_truth)
    row = {key: k for k, key in enumerate(zip(shown.track_id.tolist(), of_shown.tolist(), strict=True))}
    keys = zip(decided.track_id[same].tolist(), at[same].tolist(), strict=True)
    pairs = [(row.get(key, -1), k) for k, key in zip(same.tolist(), keys, strict=True)]
    then, later = np.array([pair for pair in pairs if pair[0] >= 0], np.int64).reshape(-1, 2).T
    errors = []
    for k, j in zip(then.tolist(), later.tolist(), strict=True):
        truth = recording.truth.at(float(shown.time_s[k]))
        where = truth.position_deg[truth.vessel == shown.origin[k]]
        if len(where):
            both = np.stack([shown.position_deg[k], decided.position_deg[j]])
            errors.append(np.hypot(*difference_m(both, where[0]).T))
    out = np.array(errors).reshape(-1, 2)
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
