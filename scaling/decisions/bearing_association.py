"""F1 of bearing association by history, density and place of the sonar: spec section 6.

    python scaling/decisions/bearing_association.py [first seed] [number of seeds] [KEY=VALUE ...]

Settings of BearingLikelihood may be given; `literal` runs the paper's method. Histories are seconds of bearings before the decisions,
which are taken at every cycle for half a minute.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "contracts"))

import bearing_world as bw

from coastwatch.associations.bearing_likelihood import BearingLikelihood
from coastwatch.associations.bearing_literal import BearingWindowedCovariance
from coastwatch.batches import AisStatics
from coastwatch.spots.octants import OctantSpots
from coastwatch.stage import serial
from coastwatch.tracks.bearing import BearingWindow

HISTORIES = (30, 60, 120, 180, 300)
DECISIONS_S = 30


def run(
    associate,
    sensors,
    vessels,
    seed,
    *,
    bias_deg=0.0,
    misses=0.0,
    kick=0.1,
    phase_s=0.0,
    spots=None,
    worse=1.0,
    histories=HISTORIES,
):
    """Counts (histories, 4) of one seed."""
    last = max(histories) + DECISIONS_S
    world = bw.make_world(vessels, last, seed, kick)
    world = replace(world, error_m=world.error_m * worse)
    tracker, spots = BearingWindow(), spots or OctantSpots()
    tm, sm, am = tracker.init(), spots.init(), associate.init()
    counts = np.zeros((len(histories), 4))
    for t in range(3, last + 1, 3):
        tm, tracks = tracker.step(tm, bw.hear(world, sensors, t, seed, bias_deg, misses, phase_s), bw.START_S + t, sensors)
        picture = world.picture(t)
        sm, octants = spots.step(sm, tracks, picture, sensors)
        am, found = associate.step(am, tracks, picture, octants, bw.START_S + t, sensors, serial, AisStatics.empty())
        c = bw.count(found.bearing_row, found.vessel_row, tracks.origin, picture.origin)
        for h, history in enumerate(histories):
            if history <= t < history + DECISIONS_S:
                counts[h] += c
    return counts


def main() -> None:
    first, number, *rest = sys.argv[1:] or ["1000", "4"]
    literal = "literal" in rest
    settings = dict(s.split("=") for s in rest if "=" in s)
    associate = BearingWindowedCovariance(**settings) if literal else BearingLikelihood(**settings)
    seeds = range(int(first), int(first) + int(number))
    cases = [
        *((f"{n} centre", bw.centre(), n, {}) for n in (100, 200, 500)),
        *((f"{n} coast", bw.coast(), n, {}) for n in (100, 200, 500)),
        ("200 centre, bias 0.5", bw.centre(), 200, {"bias_deg": 0.5}),
        ("200 centre, bias 1.5", bw.centre(), 200, {"bias_deg": 1.5}),
        ("200 centre, 20 % missed", bw.centre(), 200, {"misses": 0.2}),
        ("200 centre, phase 1.3", bw.centre(), 200, {"phase_s": 1.3}),
        ("200 centre, kick .3", bw.centre(), 200, {"kick": 0.3}),
        ("200 centre, position err x 3", bw.centre(), 200, {"worse": 3.0}),
        ("200 centre, position err x 6", bw.centre(), 200, {"worse": 6.0}),
        ("200 centre, no overlap", bw.centre(), 200, {"spots": OctantSpots(overlap_deg=0, position_sigmas=0, range_margin=1)}),
    ]
    if "few" in rest:
        cases = [cases[1], cases[2], cases[4]]
    print("F1 % (MCC) after", *HISTORIES, "s; seeds", seeds[0], "to", seeds[-1])
    for name, sensors, vessels, extra in cases:
        begin = time.perf_counter()
        total = sum(run(associate, sensors, vessels, seed, **extra) for seed in seeds)
        line = "  ".join(f"{100 * bw.f1(c):6.2f} ({bw.mcc(c):.3f})" for c in total)
        print(f"{name:28s} {line}   {time.perf_counter() - begin:.0f} s", flush=True)


if __name__ == "__main__":
    main()
