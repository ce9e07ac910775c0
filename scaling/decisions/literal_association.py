"""F1 of the paper's association as it stands: which window p, confidence and choice give the published figures?

    python -m scaling.decisions.literal_association [FIRST_SEED [NUMBER_OF_SEEDS [sweep | cases | all]]]

`context-driven-1000` with the paper's AIS tracks (dead reckoning) and one decision a radar track and cycle, over 40 cycles. `sweep` is
the base case over p, confidence and choice. `cases` has a few of these methods, and the default with filtered AIS, under the
conditions of the specification. Published (Tables I and II): F1 99.53 %, specificity 99.45 %; p and the confidence are not.
"""

from __future__ import annotations

import argparse
from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import ValidationError

from coastwatch.associations import AssociationInput, WindowedCovariance, WindowedCovarianceLiteral
from coastwatch.batches import Ints, RadarCorrections, Spots, Tracks, Trajectories
from coastwatch.geodesy import NAUTICAL_MILE_M, scale_m_deg
from coastwatch.operators.cli.arguments import count, whole
from coastwatch.scenario import load_scenario
from coastwatch.scores.confusion import Confusion, association
from coastwatch.sensors import Simulated
from coastwatch.stage import Running, serial
from coastwatch.tracks import AisInput, RegionInput

Threshold = Literal["chi_square", "hotelling"]
WINDOWS = (3, 5, 8, 10, 15, 20, 30, 40)
CONFIDENCES = (0.95, 0.99, 0.999, 0.9999)
# The radars 18 NM from the middle less a little, so that the union of two discs of 18 NM is still half of the area.
FAR_LONGITUDE = -43.10 - 17.95 * NAUTICAL_MILE_M / float(scale_m_deg(np.array(-23.05))[1])
FAR = {
    f"radars.{k}.{name}": str(value) for k in (0, 1) for name, value in (("longitude_deg", FAR_LONGITUDE), ("range_nm", 18.0))
}
CASES: dict[str, dict[str, str]] = {
    "base": {},
    "base, restless radar filter": {"tracks.motion.kind": "imm", "tracks.motion.quiet_noise_m2_s3": "0.02"},
    "exact AIS": {"input.ais.position_sigma_m": "0", "input.ais.velocity_sigma_kn": "0"},
    "class A": {"input.ais.intervals": "itu"},
    "far": FAR,
    "far + class A": FAR | {"input.ais.intervals": "itu"},
    "azimuth bias 0.3": {"input.radar.azimuth_bias_deg": "0.3"},
    "10 % AIS without radar": {},
}
DEAD_RECKONING = {"tracks.method": "imm", "ais_tracks.method": "dead_reckoning"}  # the tracks that the paper has
METHODS = {
    "literal p=10 .95 nearest": WindowedCovarianceLiteral(),
    "literal p=10 .9999 one-to-one": WindowedCovarianceLiteral(confidence=0.9999, one_to_one=True),
    "literal p=10 Hotelling .999 one-to-one": WindowedCovarianceLiteral(
        confidence=0.999, one_to_one=True, threshold="hotelling"
    ),
}


class Cycles(NamedTuple):
    """One run up to its spots."""

    made: list[tuple[Tracks, Spots]]  # of every cycle
    warm: int  # number of the first cycle that counts
    kinds: Ints  # SourceKind of each source
    truth: Trajectories


def cycles_of(overrides: dict[str, str], seed: int, hidden_share: float = 0.0) -> Cycles:
    """One run. Args: hidden_share: share of the vessels that lose their radar track where they have an AIS track."""
    scenario = load_scenario("context-driven-1000", overrides)
    assert isinstance(scenario.input, Simulated)
    sensors, plan = scenario.sensors(), scenario.plan()
    recording = scenario.input.load(sensors, seed, plan)
    reports = recording.reports
    hidden = np.flatnonzero(np.random.default_rng([seed, 99]).random(scenario.input.count) < hidden_share)
    plots_memory, radar, ais, spots_memory = (
        scenario.plots.init(),
        scenario.tracks.init(),
        scenario.ais_tracks.init(),
        scenario.spots.init(),
    )
    exact, out = RadarCorrections.empty(R=len(sensors.radars)), []
    for cycle in range(plan.cycles):
        now = plan.instant_s(cycle)
        part = reports.between(plan.instant_s(cycle - 1) if cycle else -np.inf, now)
        plots_memory, plots = scenario.plots.step(plots_memory, part.radar, sensors, exact)
        radar, (seen, *_) = Running(scenario.tracks, radar).next(RegionInput.of_plots(plots, now, sensors))
        ais, (said, *_) = scenario.ais_tracks.step(ais, AisInput(part.ais, now, sensors))
        seen = seen.take(~(np.isin(seen.origin, hidden) & np.isin(seen.origin, said.origin)))
        tracks = type(seen).join([seen, said])
        spots_memory, spots = scenario.spots.step(spots_memory, tracks)
        out.append((tracks, spots))
    assert recording.truth is not None
    return Cycles(out, scenario.warmup_cycles, sensors.source_kinds, recording.truth)


def decided(method: WindowedCovariance | WindowedCovarianceLiteral, runs: list[Cycles]) -> Confusion:
    """The decisions of a method over several runs."""
    total = Confusion()
    for run in runs:
        memory: Any = method.init()
        for number, (tracks, spots) in enumerate(run.made):
            if number < run.warm - method.window:
                continue
            memory, found = method.step(memory, AssociationInput(tracks, spots, serial))
            if number >= run.warm:
                total += association(tracks, found, run.kinds)
    return total


def told(confusion: Confusion) -> str:
    """The figures of the paper's Table II that are not each other's mirror."""
    d = confusion.as_dict()
    return f"F1 {100 * d['f1']:6.2f}  recall {100 * d['recall']:6.2f}  specificity {100 * d['specificity']:6.2f}"


def sweep(seeds: range) -> None:
    """Prints the base case over p, confidence and choice."""
    runs = [cycles_of(DEAD_RECKONING, seed) for seed in seeds]
    thresholds: tuple[Threshold, ...] = ("chi_square", "hotelling")
    for threshold in thresholds:
        print(f"{threshold}: F1 (specificity), % at confidence {CONFIDENCES}, nearest, then one-to-one")
        for p in WINDOWS:
            print(f"p={p:<3}", "  ".join(row(p, threshold, runs)), flush=True)


def row(p: int, threshold: Threshold, runs: list[Cycles]) -> list[str]:
    """A cell for each confidence, nearest, then one-to-one."""
    cells = []
    for one_to_one in (False, True):
        for confidence in CONFIDENCES:
            try:
                method = WindowedCovarianceLiteral(window=p, confidence=confidence, one_to_one=one_to_one, threshold=threshold)
            except ValidationError as error:
                return [f"refused, window: {error.errors()[0]['msg']}"]
            d = decided(method, runs).as_dict()
            cells.append(f"{100 * d['f1']:5.2f} ({100 * d['specificity']:6.2f})")
    return cells


def cases(seeds: range) -> None:
    """Prints a few methods under the conditions of the specification."""
    for name, overrides in CASES.items():
        hidden = 0.1 if name.startswith("10 %") else 0.0
        runs = [cycles_of(overrides | DEAD_RECKONING, seed, hidden) for seed in seeds]
        for title, method in METHODS.items():
            print(f"{name:28s} {title:40s} {told(decided(method, runs))}", flush=True)
        runs = [cycles_of(overrides, seed, hidden) for seed in seeds]
        print(f"{name:28s} {'the default, filtered AIS':40s} {told(decided(WindowedCovariance(), runs))}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", nargs="?", type=whole, default=1, help="first seed (default: 1)")
    parser.add_argument("number", nargs="?", type=count, default=2, help="number of seeds (default: 2)")
    parser.add_argument("what", nargs="?", choices=("sweep", "cases", "all"), default="all", help="default: all")
    asked = parser.parse_args()
    seeds = range(asked.first, asked.first + asked.number)
    print(f"seeds {seeds[0]} to {seeds[-1]}")
    if asked.what in ("cases", "all"):
        cases(seeds)
    if asked.what in ("sweep", "all"):
        sweep(seeds)


if __name__ == "__main__":
    main()
