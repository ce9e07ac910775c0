"""F1 and specificity of the paper's bearing association by p and confidence: which give its 92.26 % and 34 %?

    python -m scaling.decisions.literal_bearings [FIRST_SEED [NUMBER_OF_SEEDS]]

100 vessels, the sonar in the middle and on the coast. Decisions are taken at every cycle for half a minute after two minutes. Octants
are the published ones (no overlap, no tolerance) and ours. A decision stands once, as in Table III: a swap is an FN. `alike` is the F1
if partners existed for as many bearing tracks as in Table III (1826 of 2152). A sonar and radars over the same water would give that.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "worlds"))

import bearing_world as bw

from coastwatch.associations import BearingAssociationInput
from coastwatch.associations.bearing_literal import BearingWindowedCovariance
from coastwatch.batches import AisStatics, Floats, Sensors
from coastwatch.operators.cli.arguments import count, whole
from coastwatch.spots import OctantInput
from coastwatch.spots.octants import OctantSpots
from coastwatch.stage import NoMemory
from coastwatch.tracks import BearingInput
from coastwatch.tracks.bearing import BearingWindow

PUBLISHED_OCTANTS = OctantSpots(overlap_deg=0, position_sigmas=0, range_margin=1)
CONFIDENCES = (0.95, 0.9999)
HISTORY_S, DECISIONS_S = 120, 30
PARTNERED, ALONE = 1826.0, 326.0  # decisions in Table III


def counted(method: BearingWindowedCovariance, sensors: Sensors, seed: int, spots: OctantSpots) -> Floats:
    """Decisions (right, with a partner, refused though with a partner, taken though without one, without one), swaps once."""
    world = bw.make_world(100, HISTORY_S + DECISIONS_S, seed)
    tracker, total = BearingWindow(), np.zeros(4)
    tracks_memory, memory = tracker.init(), method.init()
    for t in range(3, HISTORY_S + DECISIONS_S, 3):
        reports = bw.hear(world, sensors, t, seed)
        tracks_memory, tracks = tracker.step(tracks_memory, BearingInput(reports, bw.START_S + t, sensors))
        picture = world.picture(t)
        _, octants = spots.step(NoMemory(), OctantInput(tracks, picture, sensors))
        memory, found = method.step(
            memory, BearingAssociationInput(tracks, picture, octants, bw.START_S + t, sensors, AisStatics.empty())
        )
        if t >= HISTORY_S:
            partner = np.full(len(tracks), -1)
            partner[found.bearing_row] = picture.origin[found.vessel_row]
            exists = np.isin(tracks.origin, picture.origin)
            right = (partner == tracks.origin).sum()
            total += [right, exists.sum(), ((partner >= 0) & ~exists).sum(), (~exists).sum()]
    return total


def told(method: BearingWindowedCovariance, sensors: Sensors, seeds: range, spots: OctantSpots) -> str:
    """F1, recall, specificity and `alike` in %."""
    right, partnered, taken, alone = np.sum([counted(method, sensors, seed, spots) for seed in seeds], axis=0)
    recall, false_rate = right / partnered, taken / alone
    f1 = 2.0 * right / (right + taken + partnered)
    alike = 2.0 * recall * PARTNERED / (recall * PARTNERED + false_rate * ALONE + PARTNERED)
    return f"{100 * f1:5.1f} {100 * recall:5.1f} {100 - 100 * false_rate:5.1f} {100 * alike:5.1f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", nargs="?", type=whole, default=1, help="first seed (default: 1)")
    parser.add_argument("number", nargs="?", type=count, default=4, help="number of seeds (default: 4)")
    asked = parser.parse_args()
    seeds = range(asked.first, asked.first + asked.number)
    print(f"seeds {seeds[0]} to {seeds[-1]}; F1, recall, specificity, alike, % at {CONFIDENCES}, nearest, then one-to-one")
    print("published                        92.3  95.7  34.4")
    for name, sensors in (("centre", bw.centre()), ("coast", bw.coast())):
        for octants, spots in (("ours", OctantSpots()), ("published octants", PUBLISHED_OCTANTS)):
            for p in (3, 5, 10, 20):
                methods = (
                    BearingWindowedCovariance(window=p, confidence=c, one_to_one=one)
                    for one in (False, True)
                    for c in CONFIDENCES
                )
                cells = "   ".join(told(m, sensors, seeds, spots) for m in methods)
                print(f"{name:7s} {octants:18s} p={p:<3} {cells}", flush=True)


if __name__ == "__main__":
    main()
