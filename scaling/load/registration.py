"""Registration in simulated harbours where few vessels are seen: when a bias is found, how wrong it is, and false alarms.

    python -m scaling.load.registration --case three --seeds 101-120 [--minutes 16] [--json]

A harbour is drawn for each seed. It has 30 to 100 AIS vessels, of which 6 to 22 % are seen in a turn. 75 to 95 % of plots are of nobody
with AIS.
Its reports go through the stages plots, ais_tracks and registration of the scenario busy-harbour. A line a seed, then a summary.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from coastwatch.batches import (
    BearingAssociations,
    BearingTracks,
    Floats,
    Measurements,
    Members,
    Picture,
    RadarCorrections,
    RegistrationState,
)
from coastwatch.geodesy import from_plane
from coastwatch.registration import OnlineRegistration, RegistrationInput
from coastwatch.scenario import Scenario, load_scenario
from coastwatch.sensors import Simulated
from coastwatch.sensors.simulated.harbour import Row
from coastwatch.sensors.simulated.radar import RadarTruth
from coastwatch.tracks import AisInput
from scaling.load.options import errors_as_one_line
from scaling.load.seeds import seed_range

SCENARIO = "busy-harbour"
TURN_S = 2.5
SEEN_IN_VIEW = 0.7  # probability of detection of a vessel that is in view
UNSEEN = 0.5  # share of the AIS vessels that no radar ever sees
MOORED = 0.2  # share of the AIS vessels that are moored in shadow, beside standing echoes
FOUND = (RegistrationState.FOUND, RegistrationState.SETTLED, RegistrationState.DOUBTFUL)
MARKS_MIN = (5, 15, 30)


class Case(NamedTuple):
    """What is wrong with the radars of a harbour, and what is odd about its vessels."""

    errors: tuple[tuple[float, float, float], ...] = ((3.0, 20.0, 1.0),)  # azimuth deg, range m, lag s of each radar
    worst: bool = False  # 30 vessels, 6 % seen, 95 % of plots of nobody
    noise_factor: float = 1.0  # true noise over that of the specification
    speed_kn: float = 0.0  # of the radar's platform
    step_deg: float = 0.0  # by which the bias jumps after STEP_S
    drift_deg_h: float = 0.0
    ais: str = (
        "seen"  # "unseen": no AIS vessel is ever seen; "other": besides, as many vessels without AIS are seen in their lanes
    )
    site_m: tuple[float, float] = (0.0, 0.0)  # how far the stated site is east and north of the true one
    minutes: float = 16.0


WRONG_SITE_M = 15.0
STEP_S = 900.0
ZERO = ((0.0, 0.0, 0.0),)
CASES = {
    "three": Case(),
    "fifteen": Case(errors=((-15.0, 40.0, 2.0),)),
    "moving": Case(speed_kn=7.0),
    "noise-2": Case(noise_factor=2.0 / 1.3),
    "noise-1": Case(noise_factor=1.0 / 1.3),
    "worst": Case(worst=True, minutes=30.0),
    "zero": Case(errors=ZERO, minutes=60.0),
    "other": Case(errors=ZERO, ais="other", minutes=60.0),
    "unseen": Case(errors=ZERO, ais="unseen", minutes=60.0),
    "two": Case(errors=((3.0, 20.0, 1.0), (-15.0, 40.0, 2.0))),
    "step-4": Case(step_deg=4.0, minutes=25.0),
    "step-10": Case(step_deg=-10.0, minutes=25.0),
    "site": Case(site_m=(50.0, -30.0)),
    "site-alone": Case(errors=ZERO, site_m=(-60.0, 0.0)),
    "drift": Case(errors=((1.0, 20.0, 1.0),), drift_deg_h=6.0, minutes=31.0),
}


@dataclass
class Course:
    """What was found of one radar in one harbour."""

    seed: int
    radar: int
    shares: tuple[float, ...]  # AIS vessels, share of them seen in a turn, share of plots of nobody with AIS
    found_s: float = np.inf
    found_off_deg: float = np.nan
    most_odds: float = 0.0  # while no bias was found
    wrong_s: float = 0.0  # with an applied error over 1 deg
    late_wrong_deg: float = 0.0  # greatest applied error after 5 minutes
    right_again_s: float = np.inf  # after the step
    site_found_s: float = np.inf  # from when on the site is right to 15 m
    site_wrong_s: float = 0.0  # with an error of the site applied that is wrong by over 15 m
    states: list[int] = field(default_factory=list)
    marks: dict[int, tuple[float, ...]] = field(default_factory=dict)  # minute: applied less true errors, and their sigmas
    reference_cells: int = 0
    corrections: list[tuple[float, ...]] = field(default_factory=list)


def harbour(case: Case, seed: int, minutes: float | None = None) -> tuple[Scenario, tuple[float, ...]]:
    """The scenario of a harbour, and what was drawn for it: AIS vessels, share of them that is seen, share of plots of nobody."""
    rng = np.random.default_rng([seed, 101])
    vessels, seen, nobody = int(rng.integers(30, 101)), float(rng.uniform(0.06, 0.22)), float(rng.uniform(0.75, 0.95))
    if case.worst:
        vessels, seen, nobody = 30, 0.06, 0.95
    others = max(int(vessels * rng.uniform(0.5, 1.2)), 5)
    visible = min(seen / SEEN_IN_VIEW / (1.0 - UNSEEN), 1.0)
    base = load_scenario(SCENARIO)
    assert isinstance(base.input, Simulated)
    site = np.array([base.radars[0].latitude_deg, base.radars[0].longitude_deg])
    azimuth, distance = rng.uniform(-0.7, 0.7), rng.uniform(2500.0, 5000.0)
    beside = azimuth + np.radians(rng.choice([-1.0, 1.0]) * rng.uniform(6.0, 16.0))
    moored = round(MOORED * vessels)
    shadow = _row(site, azimuth, distance, moored)
    standing = _row(site, beside, distance, 3 * moored)
    doubled = vessels if case.ais == "other" else 0
    count = vessels + others + doubled
    # Expected plots a turn: of AIS vessels, of other vessels, and of what stands still or is clutter.
    echoes = vessels * seen
    rest = max(echoes * nobody / (1.0 - nobody) - (others + doubled) * seen, 5.0)
    unseen = range(moored) if case.ais == "seen" else range(vessels)
    truth = {
        "detection_probability": SEEN_IN_VIEW,
        "unseen": tuple(unseen),
        "unseen_share": UNSEEN,
        "visible_share": visible,
        "clutter_per_m2": 0.2 * rest / (0.5 * np.pi * base.radars[0].range_nm ** 2 * 1852.0**2),
        "noise_factor": case.noise_factor,
        "azimuth_drift_deg_h": case.drift_deg_h,
        "azimuth_step_deg": case.step_deg,
        "azimuth_step_s": STEP_S,
        "speed_kn": case.speed_kn,
        "course_deg": 60.0,
        "site_error_m": case.site_m,
    }
    radars = base.radars[: len(case.errors)]
    truths = [
        RadarTruth(name=r.name, azimuth_bias_deg=a, range_bias_m=m, time_bias_s=s, **truth)
        for r, (a, m, s) in zip(radars, case.errors, strict=True)
    ]
    feed = base.input.model_copy(
        update={
            "count": count,
            "moored": (shadow,),
            "standing": base.input.standing.model_copy(update={"count": round(0.8 * rest / 0.6), "rows": (standing,)}),
            "radars": tuple(truths),
            "ais": base.input.ais.model_copy(update={"carried_by": tuple(range(vessels))}),
        }
    )
    cycles = int(60.0 * (minutes or case.minutes) / base.period_s)
    change = {"input": feed, "radars": radars, "cycles": cycles, "warmup_s": 0.0}
    return base.model_copy(update=change), (vessels, seen, nobody)


def _row(site_deg: Floats, azimuth: float, distance_m: float, count: int) -> Row:
    """A row along the beam of the radar."""
    at = from_plane(distance_m * np.array([np.sin(azimuth), np.cos(azimuth)]), site_deg)
    bearing = float(np.degrees(azimuth) % 360.0)
    place = {"latitude_deg": float(at[0]), "longitude_deg": float(at[1])}
    return Row(**place, count=count, bearing_deg=bearing, length_m=350.0, width_m=0.052 * distance_m)


def run(case: Case, seed: int, minutes: float | None = None, method: OnlineRegistration | None = None) -> list[Course]:
    """What registration finds of each radar of one harbour."""
    scenario, shares = harbour(case, seed, minutes)
    sensors, plan = scenario.sensors(), scenario.plan()
    reports = scenario.input.load(sensors, seed, plan).reports
    chosen = method or scenario.registration
    assert isinstance(chosen, OnlineRegistration)
    courses = [Course(seed, r, shares) for r in range(len(sensors.radars))]
    plots_memory, ais_memory, memory = scenario.plots.init(), scenario.ais_tracks.init(), chosen.init()
    given, before, none = RadarCorrections.empty(R=len(sensors.radars)), -np.inf, np.zeros(0, np.int64)
    bearings = BearingTracks.empty(), BearingAssociations(none, none, np.zeros(0), np.zeros(0))
    rest = Measurements.empty(), Picture.empty(), Members.empty(), *bearings  # there is no bearing sensor
    for number in range(plan.cycles):
        now = plan.instant_s(number)
        arrived = reports.between(before, now)
        before = now
        plots_memory, plots = scenario.plots.step(plots_memory, arrived.radar, sensors, given)
        ais_memory, (tracks, alarms, _) = scenario.ais_tracks.step(ais_memory, AisInput(arrived.ais, now, sensors))
        memory, given = chosen.step(memory, RegistrationInput(plots, tracks, alarms, *rest, now, sensors, given))
        for course, errors in zip(courses, case.errors, strict=True):
            _note(course, case, errors, given, now - plan.start_s, plan.period_s)
            course.reference_cells = max(course.reference_cells, len(memory.reference_cells[course.radar]))
    return courses


def _note(course: Course, case: Case, errors: tuple[float, float, float], given: RadarCorrections, t: float, dt: float) -> None:
    """Add one cycle to the course."""
    r = course.radar
    found = int(given.state[r]) in FOUND
    true_deg = errors[0] + case.drift_deg_h * t / 3600.0 + (case.step_deg if t >= STEP_S else 0.0)
    off = np.array([np.degrees(given.azimuth_bias_rad[r]) - true_deg, given.range_bias_m[r] - errors[1]])
    site_off_m = float(np.hypot(*(given.site_error_m[r] - case.site_m)))
    course.site_wrong_s += dt * bool(given.site_error_m[r].any() and site_off_m > WRONG_SITE_M)
    if site_off_m > WRONG_SITE_M or not given.site_error_m[r].any():
        course.site_found_s = np.inf
    elif not np.isfinite(course.site_found_s):
        course.site_found_s = t
    course.states.append(int(given.state[r]))
    course.corrections.append((given.azimuth_bias_rad[r], given.range_bias_m[r], given.time_lag_s[r], given.odds[r]))
    if found and not np.isfinite(course.found_s):
        course.found_s, course.found_off_deg = t, float(off[0])
    if not found and np.isfinite(given.odds[r]):
        course.most_odds = max(course.most_odds, float(given.odds[r]))
    if found and (case.step_deg == 0.0 or t < STEP_S):
        course.wrong_s += dt * bool(abs(off[0]) > 1.0)
        if t > 300.0:
            course.late_wrong_deg = max(course.late_wrong_deg, abs(float(off[0])))
    if case.step_deg and t >= STEP_S and found and abs(off[0]) <= 1.0:
        course.right_again_s = min(course.right_again_s, t - STEP_S)
    for minute in MARKS_MIN:
        if found and abs(t - 60.0 * minute) < 0.5 * dt + 1e-6:
            lag = given.estimated_lag_s[r] - errors[2]
            sigma = np.degrees(given.azimuth_sigma_rad[r]), given.range_sigma_m[r], given.lag_sigma_s[r]
            course.marks[minute] = (*off.tolist(), float(lag), *map(float, sigma))


def told(course: Course) -> str:
    """One line."""
    vessels, seen, nobody = course.shares
    found = f"{course.found_s:.0f} s, off by {course.found_off_deg:.2f} deg" if np.isfinite(course.found_s) else "never"
    marks = "; ".join(
        f"{k} min {v[0]:.2f}+-{v[3]:.2f} deg {v[1]:.1f}+-{v[4]:.1f} m {v[2]:.1f}+-{v[5]:.1f} s" for k, v in course.marks.items()
    )
    site = f", site {course.site_found_s:.0f} s, wrong for {course.site_wrong_s:.0f} s"
    again = f", right again after {course.right_again_s:.0f} s" if np.isfinite(course.right_again_s) else ""
    return (
        f"seed {course.seed} radar {course.radar}, {vessels:.0f} vessels, {100 * seen:.0f} % seen, {100 * nobody:.0f} % of nobody: found "
        f"{found}{again}{site}; wrong for {course.wrong_s:.0f} s; most odds {course.most_odds:.2g}; {course.reference_cells} cells; {marks}"
    )


def summary(courses: list[Course]) -> dict[str, Any]:
    """The figures of a case over its seeds."""
    found = np.array([c.found_s for c in courses])
    n = int(np.isfinite(found).sum())
    out: dict[str, Any] = {"found": n, "of": len(courses)}
    if n:
        out["found_s"] = [float(v) for v in np.percentile(found, [50, 90, 100], method="nearest")]
        out["wrong_when_found"] = sum(abs(c.found_off_deg) > 1.0 for c in courses if np.isfinite(c.found_s))
        out["most_wrong_when_found_deg"] = max(abs(c.found_off_deg) for c in courses if np.isfinite(c.found_s))
        out["wrong_s"] = sum(c.wrong_s for c in courses)
        out["late_wrong_deg"] = max(c.late_wrong_deg for c in courses)
    out["site_found"] = int(np.isfinite([c.site_found_s for c in courses]).sum())
    out["site_found_s"] = sorted(c.site_found_s for c in courses)
    out["site_wrong_s"] = sum(c.site_wrong_s for c in courses)
    out["most_odds_unfound"] = max(c.most_odds for c in courses)
    out["reference_cells"] = max(c.reference_cells for c in courses)
    if any(np.isfinite(c.right_again_s) for c in courses):
        out["right_again_s"] = sorted(c.right_again_s for c in courses)
    for minute in MARKS_MIN:
        marks = np.array([c.marks[minute] for c in courses if minute in c.marks])
        if len(marks):
            rms, nees = np.sqrt((marks[:, :3] ** 2).mean(axis=0)), ((marks[:, :3] / marks[:, 3:]) ** 2).mean(axis=0)
            out[f"at_{minute}_min"] = {
                "found": len(marks),
                "rms": rms.tolist(),
                "worst_deg": float(np.abs(marks[:, 0]).max()),
                "squared_over_variance": nees.tolist(),
            }
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", default="three", choices=CASES)
    parser.add_argument("--seeds", default="101-103", help="first-last")
    parser.add_argument("--minutes", type=float, help="instead of those of the case")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    seeds = seed_range(options.seeds)
    courses, begun = [], time.process_time()
    with errors_as_one_line():
        for seed in seeds:
            for course in run(CASES[options.case], seed, options.minutes):
                courses.append(course)
                print(told(course), file=sys.stderr if options.json else sys.stdout, flush=True)
    figures = {"case": options.case, **summary(courses), "processor_s": round(time.process_time() - begun, 1)}
    print(json.dumps(figures) if options.json else "\n".join(f"{key}: {value}" for key, value in figures.items()))


if __name__ == "__main__":
    main()
