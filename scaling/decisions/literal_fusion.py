"""Position, course and speed RMSE of the paper's fusion as it stands: which reading of the paper gives its figures?

    python -m scaling.decisions.literal_fusion [FIRST_SEED [NUMBER_OF_SEEDS [VESSELS]]]

`context-driven-1000` with raw AIS (dead reckoning) and association by the true vessel, so that fusion alone is judged. A row is one
reading of what the paper leaves open, a column one method: m / deg / kn. Published, Tables V and VI: weighted average
10.56/5.38/0.93, IMM 5.79/4.37/0.74 straight; 11.06/1.09/0.97 and 6.11/3.47/0.15 in circles.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from coastwatch.batches import Associations, Measurements, Tracks
from coastwatch.fused_tracks import CovarianceIntersection, FusionInput, ImmOfTracks, ImmOfTracksLiteral, WeightedAverage
from coastwatch.operators.cli.arguments import count, whole
from coastwatch.scores.rmse import Errors, fusion_errors
from scaling.decisions.literal_association import DEAD_RECKONING, Cycles, cycles_of

CIRCLES = {"input.motion.linear_weight": "0", "input.motion.circular_weight": "1"}
STALE = {"ais_tracks.aligned": "false"}
READINGS: dict[str, dict[str, str]] = {
    "base": {},
    "sea conditions f = 0.3": {"input.motion.process_noise_fraction": "0.3"},
    "a kick every second (rw1)": {"input.motion.process_noise": "rw1"},
    "AIS sigma 10 m": {"input.ais.position_sigma_m": "10", "ais_tracks.position_sigma_m": "10"},
    "AIS every 10 s": {"input.ais.interval_s": "10"},
    "AIS not extrapolated": STALE,
    "AIS not extrapolated, every 5 s": STALE | {"input.ais.interval_s": "5"},
    "the same, AIS velocity 1 kn": STALE | {"input.ais.interval_s": "5", "input.ais.velocity_sigma_kn": "1"},
    "not extrapolated, rw1": STALE | {"input.motion.process_noise": "rw1"},
    "circles": CIRCLES,
    "circles, not extrapolated, 5 s": CIRCLES | STALE | {"input.ais.interval_s": "5"},
}
Fuser = WeightedAverage | ImmOfTracks | ImmOfTracksLiteral | CovarianceIntersection
METHODS: dict[str, Fuser] = {
    "WA .2/.8": WeightedAverage(weights="fixed"),
    "WA .059/.941": WeightedAverage(weights="fixed", radar_weight=0.059, ais_weight=0.941),
    "IMM lit., p=10": ImmOfTracksLiteral(),
    "IMM lit., p=20": ImmOfTracksLiteral(window=20),
    "IMM lit., values": ImmOfTracksLiteral(scatter="values"),
    "IMM R x 4": ImmOfTracks(),
    "cov. int.": CovarianceIntersection(),
}


def known(tracks: Tracks) -> Associations:
    """The associations that the true vessels make."""
    none = np.zeros(0, np.int64)
    return Associations(none, none, np.zeros(0), np.unique(tracks.origin, return_inverse=True)[1].astype(np.int64))


def errors_of(method: Fuser, runs: list[Cycles]) -> tuple[Errors, Errors, Errors]:
    """Errors of the fused tracks, of the radar tracks in them and of the AIS tracks."""
    fused, radar, ais = Errors(), Errors(), Errors()
    for run in runs:
        memory: Any = method.init()
        for number, (tracks, _) in enumerate(run.made):
            associations, now = known(tracks), float(tracks.time_s[0])
            memory, made = method.step(memory, FusionInput(tracks, Measurements.empty(), associations, now, run.kinds))
            if number >= run.warm:
                e = fusion_errors(run.truth.at(now), tracks, associations, made, run.kinds)
                fused, radar, ais = fused + e.fused, radar + e.radar, ais + e.ais
    return fused, radar, ais


def told(errors: Errors) -> str:
    """Position, course and speed RMSE."""
    d = errors.as_dict()
    return f"{d['position_rmse_m']:5.2f}/{d['course_rmse_deg']:4.1f}/{d['speed_rmse_kn']:4.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", nargs="?", type=whole, default=1, help="first seed (default: 1)")
    parser.add_argument("number", nargs="?", type=count, default=1, help="number of seeds (default: 1)")
    parser.add_argument("vessels", nargs="?", type=count, default=400, help="default: 400")
    asked = parser.parse_args()
    seeds, vessels = range(asked.first, asked.first + asked.number), asked.vessels
    print(f"seeds {seeds[0]} to {seeds[-1]}, {vessels} vessels")
    print(" " * 32, "".join(f"{title:18s}" for title in ("radar", "AIS", *METHODS)))
    for name, overrides in READINGS.items():
        runs = [cycles_of(DEAD_RECKONING | {"input.count": str(vessels)} | overrides, seed) for seed in seeds]
        found = [errors_of(method, runs) for method in METHODS.values()]
        print(f"{name:32s}", "".join(f"{told(e):18s}" for e in (*found[0][1:], *(f for f, _, _ in found))), flush=True)


if __name__ == "__main__":
    main()
