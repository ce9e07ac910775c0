"""F1 of the paper's association as it stands: which window p, confidence and choice give the published figures?

    python scaling/decisions/literal_association.py [first seed] [number of seeds] [sweep | cases | all]

`context-driven-1000` with the paper's AIS tracks (dead reckoning) and one decision a radar track and cycle, over 40 cycles. `sweep` is
the base case over p, confidence and choice; `cases` are a few of these methods, and the default with filtered AIS, under the conditions of
the specification. Published (Tables I and II): F1 99.53 %, specificity 99.45 %; p and the confidence are not.
"""

from __future__ import annotations

import sys

import numpy as np
from pydantic import ValidationError

from coastwatch.associations import WindowedCovariance, WindowedCovarianceLiteral
from coastwatch.batches import RadarCorrections
from coastwatch.geodesy import NAUTICAL_MILE_M, scale_m_deg
from coastwatch.scenario import load_scenario
from coastwatch.scores.confusion import Confusion, association
from coastwatch.stage import serial

WINDOWS = (3, 5, 8, 10, 15, 20, 30, 40)
CONFIDENCES = (0.95, 0.99, 0.999, 0.9999)
# The radars 18 NM from the middle less a little, so that the union of two discs of 18 NM is still half of the area.
FAR_LONGITUDE = -43.10 - 17.95 * NAUTICAL_MILE_M / float(scale_m_deg(np.array(-23.05))[1])
FAR = {
    f"radars.{k}.{name}": str(value) for k in (0, 1) for name, value in (("longitude_deg", FAR_LONGITUDE), ("range_nm", 18.0))
}
CASES = {
    "base": {},
    "base, restless radar filter": {"tracks.motion.quiet_noise_m2_s3": "0.02"},
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


def cycles_of(overrides, seed, hidden_share=0.0):
    """Tracks and spots of every cycle, the number of the first that counts, the kinds of sources, the truth."""
    scenario = load_scenario("context-driven-1000", overrides)
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
    exact, out = RadarCorrections.none(len(sensors.radars)), []
    for cycle in range(plan.cycles):
        now = plan.instant_s(cycle)
        part = reports.between(plan.instant_s(cycle - 1) if cycle else -np.inf, now)
        plots_memory, plots = scenario.plots.step(plots_memory, part.radar, sensors, exact)
        radar, seen, _ = scenario.tracks.step(radar, plots, now, sensors, 0)
        ais, said, *_ = scenario.ais_tracks.step(ais, part.ais, now, sensors)
        seen = seen.take(~(np.isin(seen.origin, hidden) & np.isin(seen.origin, said.origin)))
        tracks = type(seen).join([seen, said])
        spots_memory, spots = scenario.spots.step(spots_memory, tracks)
        out.append((tracks, spots))
    return out, scenario.warmup_cycles, sensors.source_kinds, recording.truth


def decided(method, runs):
    """The decisions of a method over several runs."""
    total = Confusion()
    for cycles, warm, kinds, _ in runs:
        memory = method.init()
        for number, (tracks, spots) in enumerate(cycles):
            if number < warm - getattr(method, "window", 0):
                continue
            memory, found = method.step(memory, tracks, spots, serial)
            if number >= warm:
                total += association(tracks, found, kinds)
    return total


def told(confusion):
    """The figures of the paper's Table II that are not each other's mirror."""
    d = confusion.as_dict()
    return f"F1 {100 * d['f1']:6.2f}  recall {100 * d['recall']:6.2f}  specificity {100 * d['specificity']:6.2f}"


def sweep(seeds):
    runs = [cycles_of(DEAD_RECKONING, seed) for seed in seeds]
    for threshold in ("chi_square", "hotelling"):
        print(f"{threshold}: F1 (specificity), % at confidence {CONFIDENCES}, nearest, then one-to-one")
        for p in WINDOWS:
            print(f"p={p:<3}", "  ".join(row(p, threshold, runs)), flush=True)


def row(p, threshold, runs):
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


def cases(seeds):
    for name, overrides in CASES.items():
        hidden = 0.1 if name.startswith("10 %") else 0.0
        runs = [cycles_of(overrides | DEAD_RECKONING, seed, hidden) for seed in seeds]
        for title, method in METHODS.items():
            print(f"{name:28s} {title:40s} {told(decided(method, runs))}", flush=True)
        runs = [cycles_of(overrides, seed, hidden) for seed in seeds]
        print(f"{name:28s} {'the default, filtered AIS':40s} {told(decided(WindowedCovariance(), runs))}", flush=True)


def main() -> None:
    first, number, what = [*sys.argv[1:], *("1", "2", "all")[len(sys.argv) - 1 :]]
    seeds = range(int(first), int(first) + int(number))
    print(f"seeds {seeds[0]} to {seeds[-1]}")
    if what in ("cases", "all"):
        cases(seeds)
    if what in ("sweep", "all"):
        sweep(seeds)


if __name__ == "__main__":
    main()
