"""F1 of bearing association by history, density and place of the sonar: spec section 6.

    python -m scaling.decisions.bearing_association [FIRST_SEED [NUMBER_OF_SEEDS [few] [literal] [KEY=VALUE ...]]]

KEY=VALUE is a setting of BearingLikelihood; `literal` runs the paper's method, `few` three of the cases. Histories are seconds of
bearings before the decisions. Decisions are taken at every cycle for half a minute.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "worlds"))

import bearing_world as bw

from coastwatch.associations import BearingAssociationInput
from coastwatch.associations.bearing_likelihood import BearingLikelihood
from coastwatch.associations.bearing_literal import BearingWindowedCovariance
from coastwatch.batches import AisStatics, Floats, Sensors
from coastwatch.operators.cli.arguments import count, whole
from coastwatch.spots import OctantInput
from coastwatch.spots.octants import OctantSpots
from coastwatch.tracks import BearingInput
from coastwatch.tracks.bearing import BearingWindow

HISTORIES = (30, 60, 120, 180, 300)
DECISIONS_S = 30


def run(
    associate: BearingLikelihood | BearingWindowedCovariance,
    sensors: Sensors,
    vessels: int,
    seed: int,
    *,
    bias_deg: float = 0.0,
    misses: float = 0.0,
    kick: float = 0.1,
    phase_s: float = 0.0,
    spots: OctantSpots | None = None,
    worse: float = 1.0,
    histories: tuple[int, ...] = HISTORIES,
) -> Floats:
    """Counts (histories, 4) of one seed."""
    last = max(histories) + DECISIONS_S
    world = bw.make_world(vessels, last, seed, kick)
    world = replace(world, error_m=world.error_m * worse)
    tracker, spots = BearingWindow(), spots or OctantSpots()
    tm, sm = tracker.init(), spots.init()
    am: Any = associate.init()
    counts = np.zeros((len(histories), 4))
    for t in range(3, last + 1, 3):
        tm, tracks = tracker.step(
            tm, BearingInput(bw.hear(world, sensors, t, seed, bias_deg, misses, phase_s), bw.START_S + t, sensors)
        )
        picture = world.picture(t)
        sm, octants = spots.step(sm, OctantInput(tracks, picture, sensors))
        am, found = associate.step(
            am, BearingAssociationInput(tracks, picture, octants, bw.START_S + t, sensors, AisStatics.empty())
        )
        c = bw.count(found.bearing_row, found.vessel_row, tracks.origin, picture.origin)
        for h, history in enumerate(histories):
            if history <= t < history + DECISIONS_S:
                counts[h] += c
    return counts


def _further(text: str) -> str:
    if text not in ("few", "literal") and "=" not in text:
        raise argparse.ArgumentTypeError(f"got {text!r}, needed few, literal or KEY=VALUE")
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", nargs="?", type=whole, default=1000, help="first seed (default: 1000)")
    parser.add_argument("number", nargs="?", type=count, default=4, help="number of seeds (default: 4)")
    parser.add_argument("further", nargs="*", type=_further, metavar="few | literal | KEY=VALUE")
    asked = parser.parse_args()
    settings = dict(one.split("=", 1) for one in asked.further if "=" in one)
    method = BearingWindowedCovariance if "literal" in asked.further else BearingLikelihood
    associate: BearingLikelihood | BearingWindowedCovariance = method.model_validate(settings)
    seeds = range(asked.first, asked.first + asked.number)
    cases: list[tuple[str, Sensors, int, dict[str, Any]]] = [
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
    if "few" in asked.further:
        cases = [cases[1], cases[2], cases[4]]
    print("F1 % (MCC) after", *HISTORIES, "s; seeds", seeds[0], "to", seeds[-1])
    for name, sensors, vessels, extra in cases:
        begin = time.perf_counter()
        total = np.sum([run(associate, sensors, vessels, seed, **extra) for seed in seeds], axis=0)
        line = "  ".join(f"{100 * bw.f1(c):6.2f} ({bw.mcc(c):.3f})" for c in total)
        print(f"{name:28s} {line}   {time.perf_counter() - begin:.0f} s", flush=True)


if __name__ == "__main__":
    main()
