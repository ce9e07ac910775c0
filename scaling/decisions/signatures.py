"""What ship types against acoustic classes add to bearing association soon after a start: F1 of 500 vessels around a sonar.

    python -m scaling.decisions.signatures [FIRST_SEED [NUMBER_OF_SEEDS]]

Positions are as good as in bearing_association.py. Half of the vessels have AIS. Of these 5 % never set their type and 5 % send a wrong
one. The others are of types as common as in coastwatch/sensors/simulated/static_data.py. A look draws a class as SonarTruth has it.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "worlds"))

import bearing_world as bw

from coastwatch.associations import BearingAssociationInput
from coastwatch.associations.bearing_likelihood import BearingLikelihood
from coastwatch.batches import CLASS_OF_TYPE, AisStatics, Floats
from coastwatch.operators.cli.arguments import count, whole
from coastwatch.sensors.simulated.ais import TYPES
from coastwatch.sensors.simulated.sonar import SonarTruth, reported_class
from coastwatch.spots import OctantInput
from coastwatch.spots.octants import OctantSpots
from coastwatch.stage import NoMemory
from coastwatch.tracks import BearingInput
from coastwatch.tracks.bearing import BearingWindow

VESSELS = 500
HISTORIES = (30, 60)
DECISIONS_S = 30
NO_TYPE, WRONG_TYPE = 0.05, 0.05
AIS_SIGMA_M = 3.0  # of bearing_world: who has AIS
CASES = [
    ("none reported", {"signature_share": 0.0}, {}),
    *(
        (
            f"accuracy {a}, habit {h}",
            {"signature_accuracy": a, "signature_habit": h},
            {"signature_accuracy": a, "signature_habit": h},
        )
        for a in (0.5, 0.7, 0.9)
        for h in (0.0, 0.8, 0.95)
    ),
    *(
        (f"accuracy {a}, habit 0.8, settings as they come", {"signature_accuracy": a, "signature_habit": 0.8}, {})
        for a in (0.3, 0.5, 0.9)
    ),
    ("accuracy 0.7, habit 0.95, looks taken for independent", {"signature_habit": 0.95}, {"signature_habit": 0.0}),
    ("accuracy 0.5, taken for 0.9", {"signature_accuracy": 0.5}, {"signature_accuracy": 0.9}),
    ("says nothing: 1/7 right, settings as they come", {"signature_accuracy": 1.0 / 7.0}, {}),
    ("accuracy 0.7, one look in ten says a class", {"signature_share": 0.1}, {}),
]


def run(truth: SonarTruth, associate: BearingLikelihood, seed: int) -> Floats:
    """Counts (histories, 4) of one seed."""
    last, sensors = max(HISTORIES) + DECISIONS_S, bw.centre()
    world = bw.make_world(VESSELS, last, seed)
    rng = np.random.default_rng([seed, 3])
    types = TYPES[rng.choice(len(TYPES), VESSELS, p=TYPES[:, 1]), 0].astype(np.int64)
    has_ais = np.flatnonzero(world.sigma_m == AIS_SIGMA_M)
    sent = np.where(rng.random(VESSELS) < WRONG_TYPE, rng.permutation(types), types)
    sent = np.where(rng.random(VESSELS) < NO_TYPE, 0, sent)[has_ais]
    blank, none = np.full(len(has_ais), "", "U7"), np.full(len(has_ais), np.nan)
    statics = AisStatics(np.full(len(has_ais), bw.START_S), has_ais, blank.astype("U20"), blank, sent, none, none)
    rows = np.tile(np.arange(VESSELS), last // 3 + 1)
    said = reported_class(truth, CLASS_OF_TYPE[types], rows, np.random.default_rng([seed, 4])).reshape(-1, VESSELS)
    tracker, spots = BearingWindow(), OctantSpots()
    tm, am, counts = tracker.init(), associate.init(), np.zeros((len(HISTORIES), 4))
    for t in range(3, last + 1, 3):
        reports = bw.hear(world, sensors, t, seed)
        reports = replace(reports, signature=said[t // 3][reports.origin])
        tm, tracks = tracker.step(tm, BearingInput(reports, bw.START_S + t, sensors))
        picture = world.picture(t)
        picture = replace(picture, mmsi=np.where(np.isin(picture.origin, has_ais), picture.origin, -1))
        _, octants = spots.step(NoMemory(), OctantInput(tracks, picture, sensors))
        am, found = associate.step(am, BearingAssociationInput(tracks, picture, octants, bw.START_S + t, sensors, statics))
        c = bw.count(found.bearing_row, found.vessel_row, tracks.origin, picture.origin)
        for h, history in enumerate(HISTORIES):
            if history <= t < history + DECISIONS_S:
                counts[h] += c
    return counts


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", nargs="?", type=whole, default=1000, help="first seed (default: 1000)")
    parser.add_argument("number", nargs="?", type=count, default=10, help="number of seeds (default: 10)")
    asked = parser.parse_args()
    first, number = asked.first, asked.number
    print(f"F1 % (MCC) after {HISTORIES} s, {VESSELS} vessels; seeds {first} to {first + number - 1}")
    for name, truth, settings in CASES:
        associate = BearingLikelihood.model_validate(settings)
        sonar = SonarTruth.model_validate({"signature_share": 1.0, **truth})
        total = np.sum([run(sonar, associate, seed) for seed in range(first, first + number)], axis=0)
        print(f"{name:56s}" + "  ".join(f"{100 * bw.f1(c):6.2f} ({bw.mcc(c):.3f})" for c in total), flush=True)


if __name__ == "__main__":
    main()
