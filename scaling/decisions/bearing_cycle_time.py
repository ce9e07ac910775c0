"""Seconds a cycle of bearing tracks, octants and bearing association, with 100 sonars of 100 contacts each on a long coast.

    python -m scaling.decisions.bearing_cycle_time [VESSELS [CYCLES]]

Sonars stand every 20 km. Each hears about 100 vessels within 10 km, of which the picture has 75. The other vessels sail out of reach.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "worlds"))

import bearing_world as bw

from coastwatch.associations import BearingAssociationInput
from coastwatch.associations.bearing_likelihood import BearingLikelihood
from coastwatch.associations.bearing_literal import BearingWindowedCovariance
from coastwatch.batches import AisStatics, BearingReports, Floats, Ints, Picture, Sensors
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.operators.cli.arguments import count
from coastwatch.spots import OctantInput
from coastwatch.spots.octants import OctantSpots
from coastwatch.tracks import BearingInput
from coastwatch.tracks.bearing import BearingWindow

SONARS, HEARD, RANGE_M, APART_M = 100, 100, 10_000.0, 20_000.0


def picture_at(seconds: float, start_deg: Floats, velocity: Floats, rows: Ints) -> Picture:
    """The vessels of these rows, where they are after a time."""
    n = len(rows)
    covariance = np.broadcast_to(np.diag([100.0, 100.0, 1.0, 1.0]), (n, 4, 4)).copy()
    stamp, none = np.full(n, bw.START_S + seconds), np.full(n, -1)
    where = offset_deg(start_deg[rows], seconds * velocity[rows])
    return Picture(rows, stamp, where, velocity[rows], covariance, stamp, stamp, none, none * 0, rows)


def reports_at(
    seconds: float, start_deg: Floats, velocity: Floats, home: Ints, sensors: Sensors, rng: np.random.Generator
) -> BearingReports:
    """What each sonar hears of its vessels in range. Args: home: sonar of each of the first vessels."""
    off = difference_m(offset_deg(start_deg[: len(home)], seconds * velocity[: len(home)]), sensors.sonars.site_deg[home])
    rows = np.flatnonzero(np.hypot(*off.T) <= RANGE_M)
    said = np.degrees(np.arctan2(off[rows, 0], off[rows, 1])) + rng.normal(size=len(rows))
    stamp = np.full(len(rows), bw.START_S + seconds)
    return BearingReports(home[rows], stamp, stamp, said % 360.0, rows, sensors.sonars.site_deg[home[rows]], rows * 0 - 1, rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("vessels", nargs="?", type=count, default=100_000, help="default: 100,000; at least 12,700")
    parser.add_argument("cycles", nargs="?", type=count, default=110, help="default: 110; windows are full after 100")
    asked = parser.parse_args()
    vessels, cycles = asked.vessels, asked.cycles
    rng = np.random.default_rng([7, 3])
    sites = np.column_stack([np.zeros(SONARS), (np.arange(SONARS) - SONARS / 2) * APART_M])
    sensors = bw.sensors_of(sites / 8.0, RANGE_M, (0.0, 360.0))
    sensors.sonars.site_deg[:] = np.column_stack([-22.0 + np.arange(SONARS) * APART_M / 111e3, np.full(SONARS, -40.0)])
    home = np.repeat(np.arange(SONARS), int(HEARD * 4.0 / np.pi))
    near = offset_deg(sensors.sonars.site_deg[home], rng.uniform(-RANGE_M, RANGE_M, (len(home), 2)))
    far = np.column_stack([rng.uniform(-22.0, -4.0, vessels - len(home)), rng.uniform(-39.5, -35.0, vessels - len(home))])
    start, velocity = np.concatenate([near, far]), rng.normal(0.0, 3.0, (vessels, 2))
    known = np.flatnonzero(rng.uniform(size=vessels) < 0.75)
    tracker, spots = BearingWindow(), OctantSpots()
    methods: list[BearingLikelihood | BearingWindowedCovariance] = [BearingLikelihood(), BearingWindowedCovariance()]
    tm, sm = tracker.init(), spots.init()
    am: list[Any] = [m.init() for m in methods]
    spent = []
    for cycle in range(1, cycles + 1):
        now = 3.0 * cycle
        picture = picture_at(now, start, velocity, known)
        reports = reports_at(now, start, velocity, home, sensors, rng)
        marks = [time.perf_counter()]
        tm, tracks = tracker.step(tm, BearingInput(reports, bw.START_S + now, sensors))
        marks.append(time.perf_counter())
        sm, octants = spots.step(sm, OctantInput(tracks, picture, sensors))
        marks.append(time.perf_counter())
        for k, method in enumerate(methods):
            given = BearingAssociationInput(tracks, picture, octants, bw.START_S + now, sensors, AisStatics.empty())
            am[k], found = method.step(am[k], given)
            marks.append(time.perf_counter())
            if k == 0:
                score = bw.f1(bw.count(found.bearing_row, found.vessel_row, tracks.origin, picture.origin))
        spent.append(np.diff(marks))
        if cycle % 20 == 0 or cycle == cycles:
            tail = np.median(spent[-10:], axis=0) * 1e3
            print(
                f"{len(tracks)} tracks, {len(octants.bearing_row)} pairs, cycle {cycle}: ms tracks, octants, "
                f"likelihood, literal {np.round(tail, 1)}; F1 {100 * score:.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
