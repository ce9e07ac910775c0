"""Which models of motion should a radar filter have? `python -m scaling.decisions.turns_to_a_side [--seeds 1-2] [--kinds "rw60;circles"]`.

Radar tracks of known plot origin on every kind of simulated motion, for sets of models. It prints position RMSE (m), its ratio to the
radar-only bound, course (deg), speed (kn), and the mean NEES of position and velocity (4: consistent). What is asked:

    Is one turning model enough?          `imm`; the default set with `one turn` for all, and with `one turn a side`
    What could any filter reach that does not know the rate?  `prior of rates known`: turns in 60 narrow models, nothing else; the
        best there is on circles, since given its rate a turn is linear
    What is each other model for?         the default set without it
    How long does a motion last?          renewal_s
Figures and what followed: coastwatch/tracks/README.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np

from coastwatch.batches import Floats, RadarCorrections, Recording, Sensors, Tracks
from coastwatch.geodesy import difference_m
from coastwatch.kernels.tables.lookup import row_of
from coastwatch.scenario import Scenario, load_scenario
from coastwatch.scores.bound import bound
from coastwatch.scores.nees import nees
from coastwatch.scores.rmse import Errors, errors
from coastwatch.stage import Running
from coastwatch.tracks import RadarTracker, RegionInput, TableTracker
from coastwatch.tracks.radar.association import KnownOrigin
from coastwatch.tracks.radar.motion import AGILE, CHANGING, RESTLESS, SHARP, STEADY, TURNS, Manoeuvres, Model, Turning
from scaling.load.seeds import seed_range

CIRCLES = {"input.motion.linear_weight": "0", "input.motion.circular_weight": "1"}
KINDS = {
    "rw60": {},
    "circles": CIRCLES,
    "rw1": {"input.motion.process_noise": "rw1"},
    "ou": {"input.motion.process_noise": "ou"},
    "rw60, f .3": {"input.motion.process_noise_fraction": "0.3"},
    "no noise": {"input.motion.process_noise": "none"},
    "speeding": {"input.motion.linear_weight": "0", "input.motion.accelerated_weight": "1"},
    "stopping": {"input.motion.stopping_share": "1"},
    "circles, rw1": {**CIRCLES, "input.motion.process_noise": "rw1"},
    "circles, 1-3 deg/s": {**CIRCLES, "input.motion.turn_rate_from_deg_s": "1", "input.motion.turn_rate_to_deg_s": "3"},
}
EVERY = (STEADY, RESTLESS, AGILE, *TURNS, SHARP, CHANGING)


def sided(*models: Model, renewal_s: float = Manoeuvres().renewal_s) -> TableTracker:
    """The method with these models, their shares scaled to one."""
    total = sum(m.share for m in models)
    scaled = tuple(m.model_copy(update={"share": m.share / total}) for m in models)
    return TableTracker(method="sided_imm", association=KnownOrigin(), motion=Manoeuvres(renewal_s=renewal_s, models=scaled))


def _without(left_out: Model) -> TableTracker:
    return sided(*(m for m in EVERY if m is not left_out))


def _narrow(width_deg_s: float = 0.02) -> list[Turning]:
    middles = np.arange(0.2, 0.8, width_deg_s) + 0.5 * width_deg_s
    sigma = width_deg_s / np.sqrt(12.0)
    return [
        Turning(noise_m2_s3=1e-5, rate_deg_s=side * w, rate_sigma_deg_s=sigma, share=1.0)
        for w in middles
        for side in (-1.0, 1.0)
    ]


def _turn(rate_deg_s: float, sigma_deg_s: float, share: float) -> Turning:
    return TURNS[0].model_copy(update={"rate_deg_s": rate_deg_s, "rate_sigma_deg_s": sigma_deg_s, "share": share})


def _with_turns(*turns: Turning) -> TableTracker:
    return sided(STEADY, RESTLESS, AGILE, *turns, SHARP, CHANGING)


METHODS: dict[str, RadarTracker] = {
    "imm": TableTracker(method="imm", association=KnownOrigin()),
    "sided_imm": sided(*EVERY),
    "one turn": _with_turns(_turn(0.0, 0.54, 0.3)),
    "one turn a side": _with_turns(_turn(0.5, 0.2, 0.15), _turn(-0.5, 0.2, 0.15)),
    "prior of rates known": sided(*_narrow(), renewal_s=1e9),
    "no restless": _without(RESTLESS),
    "no agile": _without(AGILE),
    "no sharp turn": _without(SHARP),
    "no change of speed": _without(CHANGING),
    "renewal 300 s": sided(*EVERY, renewal_s=300.0),
    "renewal 3000 s": sided(*EVERY, renewal_s=3000.0),
}


def cycles(scenario: Scenario, recording: Recording, sensors: Sensors, method: RadarTracker) -> Iterator[tuple[float, Tracks]]:
    """Time and radar tracks of each cycle that is scored: plots and tracks alone, no other stage."""
    plan, memory, converted = scenario.plan(), method.init(), scenario.plots.init()
    exact = RadarCorrections.empty(R=len(sensors.radars))
    for number in range(plan.cycles):
        since = plan.instant_s(number - 1) if number else -np.inf
        reports = recording.reports.between(since, plan.instant_s(number)).radar
        converted, plots = scenario.plots.step(converted, reports, sensors, exact)
        memory, (tracks, *_) = Running(method, memory).next(RegionInput.of_plots(plots, plan.instant_s(number), sensors))
        if number >= scenario.warmup_cycles:
            yield plan.instant_s(number), tracks


def measured(kind: str, method: RadarTracker, seed: int) -> tuple[Errors, Errors, Floats]:
    """Errors of the radar tracks, of the bound over the same vessels and instants, and the NEES of the tracks."""
    scenario = load_scenario("context-driven-1000", KINDS[kind])
    sensors = scenario.sensors()
    recording = scenario.input.load(sensors, seed, scenario.plan())
    assert recording.truth is not None
    assert recording.noise is not None
    out = list(cycles(scenario, recording, sensors, method))
    reports = recording.whole()
    no_ais = reports.ais.take(np.zeros(0, np.int64))
    times = np.array([time_s for time_s, _ in out])
    best = bound(recording.truth, reports.radar, no_ais, recording.noise, times)
    own, least, squares = Errors(), Errors(), []
    for t, (time_s, tracks) in enumerate(out):
        truth = recording.truth.at(time_s)
        at, row = row_of(truth.vessel, tracks.origin), row_of(recording.truth.vessel, tracks.origin)
        true = truth.position_deg[at], truth.velocity_m_s[at]
        own += errors(tracks.position_deg, tracks.velocity_m_s, *true)
        known = np.isfinite(best.position_deg[row, t, 0])
        least += errors(best.position_deg[row, t][known], best.velocity_m_s[row, t][known], *(part[known] for part in true))
        off = np.column_stack([difference_m(tracks.position_deg, true[0]), tracks.velocity_m_s - true[1]])
        squares.append(nees(off, tracks.covariance))
    return own, least, np.concatenate(squares)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="1-2", help="first-last")
    parser.add_argument("--kinds", default=";".join(KINDS), help="separated by ;")
    parser.add_argument("--methods", default=";".join(METHODS), help="separated by ;")
    asked = parser.parse_args()
    kinds, methods, seeds = asked.kinds.split(";"), asked.methods.split(";"), seed_range(asked.seeds)
    for option, given, known in (("--kinds", kinds, KINDS), ("--methods", methods, METHODS)):
        if not set(given) <= set(known):
            parser.error(f"{option}: got {given}, needed some of {list(known)}")
    for kind in kinds:
        print(f"{kind:<24} position   / bound  course  speed   NEES")
        for name in methods:
            own, least, squares = Errors(), Errors(), []
            for seed in seeds:
                done = measured(kind, METHODS[name], seed)
                own, least = own + done[0], least + done[1]
                squares.append(done[2])
            here, there = own.as_dict()["position_rmse_m"], least.as_dict()["position_rmse_m"]
            ratio = here / there if here and there else float("nan")
            rest = " ".join(f"{own.as_dict()[key] or np.nan:7.3f}" for key in ("course_rmse_deg", "speed_rmse_kn"))
            print(f"  {name:<22} {here or np.nan:7.2f} {ratio:8.3f} {rest} {np.concatenate(squares).mean():7.2f}", flush=True)


if __name__ == "__main__":
    main()
