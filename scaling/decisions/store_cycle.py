"""What does it cost to write a cycle of a large picture: the current picture, the history under its bound, memberships, the rest?

    python -m scaling.decisions.store_cycle [--no-picture] [--recording] [URL [VESSELS CYCLES]...]

Half of the vessels lie at anchor and wander by metres. Half go straight on and turn now and then. Of 1,000 vessels one comes or
goes and ten change a track in every cycle. Half have a radar and an AIS track, the others one of the two. Associations are left out
(`store.associations_every`): at this size they are half as many rows again. The current picture is written in every cycle.
Seconds are medians after two cycles.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "worlds"))

import store_world as world

from coastwatch import store as kept
from coastwatch.batches import (
    AisReports,
    AisStatics,
    Associations,
    BearingReports,
    FusedTracks,
    Members,
    Picture,
    RadarReports,
    Reports,
    Tracks,
)
from coastwatch.centre import Cycle
from coastwatch.geodesy import KNOT_M_S, offset_deg
from coastwatch.operators.cli.arguments import count
from coastwatch.scenario import StoreSettings
from coastwatch.store.schema.database import reading

WARM = 2
SEVERAL = ((100_000, 10), (267_000, 8))


def cycles(last: int, vessels: int) -> Iterator[Cycle]:
    """What the pipeline would yield."""
    rng = np.random.default_rng([13, vessels])
    spare = vessels // 100
    n = vessels + spare
    place = np.stack([rng.uniform(-35.0, 5.0, n), rng.uniform(-55.0, -30.0, n)], 1)
    speed = np.where(rng.random(n) < 0.5, 0.0, rng.uniform(3.0, 20.0, n)) * KNOT_M_S
    course, swing = rng.uniform(0.0, 2.0 * np.pi, n), np.zeros((n, 2))
    there, kind, regions = np.arange(n) < vessels, rng.integers(0, 4, n), rng.integers(0, 2, n)
    for number in range(last):
        turning = rng.random(n) < 0.01
        course = np.where(turning, course + rng.normal(0.0, 0.5, n), course)
        velocity = speed[:, None] * np.stack([np.sin(course), np.cos(course)], 1)
        place, fresh = offset_deg(place, velocity * world.PERIOD_S), 0.9 * swing + rng.normal(0.0, 1.3, (n, 2))
        swing = fresh
        there ^= rng.random(n) < 0.001 * np.where(there, 1.0, 0.5 * vessels / spare)
        kind = np.where(rng.random(n) < 0.01, rng.integers(0, 4, n), kind)
        k = np.flatnonzero(there)
        yield cycle_of(number, k, offset_deg(place, swing)[k], velocity[k], kind[k], regions[k])


def cycle_of(
    number: int, k: np.ndarray, place: np.ndarray, velocity: np.ndarray, kind: np.ndarray, region: np.ndarray
) -> Cycle:
    """A cycle of these vessels. Args: kind: 0 radar, 1 AIS, 2 and 3 both."""
    n, time_s = len(k), world.instant_s(number)
    covariance = np.zeros((n, 4, 4))
    covariance[:, range(4), range(4)] = (25.0, 16.0, 0.1, 0.2)
    when, mmsi = np.full(n, time_s), np.where(kind > 0, 200_000_000 + k, -1)
    picture = Picture(k + 1, when, place, velocity, covariance, when - 900.0, when - 1.0, mmsi, np.zeros(n, np.int64), mmsi)
    radar, ais = np.flatnonzero(kind != 1), np.flatnonzero(kind > 0)
    row = np.concatenate([radar, ais])
    source, track = np.concatenate([region[radar], np.full(len(ais), world.AIS)]), np.concatenate([k[radar] + 10**6, mmsi[ais]])
    order = np.lexsort((source, row))
    tracks = Tracks(
        track, source, when[row], place[row], velocity[row], covariance[row], covariance[row, :2, :2], when[row], when[row],
        np.where(source == world.AIS, mmsi[row], -1), mmsi[row],
    )  # fmt: skip
    none = np.zeros(0, np.int64)
    return replace(
        world.cycle_of(number, 2),
        tracks=tracks,
        picture=picture,
        members=Members(picture.vessel_id[row][order], track[order], source[order]),
        associations=Associations(none, none, np.zeros(0), row),
        fused=FusedTracks(when, place, velocity, covariance),
    )


def measure(url: str, vessels: int, length: int, keep: StoreSettings) -> None:
    """Write a run, print its seconds and rows."""
    said = Reports(RadarReports.empty(), AisReports.empty(), AisStatics.empty(), BearingReports.empty())
    with kept.open_store(url) as store:
        run = world.begin(store)
        wall, processor = [], []
        for number, cycle in enumerate(cycles(length, vessels)):
            begun, used = time.perf_counter(), time.process_time()
            kept.write_cycle(store, run, kept.CycleRecord(number, cycle, said, world.SECONDS), keep)
            wall.append(time.perf_counter() - begun)
            processor.append(time.process_time() - used)
        with reading(store) as connection:
            points = connection.exec_driver_sql(
                f"SELECT avg(history_points) FROM cycle WHERE number >= {WARM} AND run_id = {run}"
            )
            a_cycle = float(points.scalar_one())
        name = store.engine.dialect.name
    took, used = statistics.median(wall[WARM:]), statistics.median(processor[WARM:])
    peak_gb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(
        f"{name}, {vessels} vessels, {length} cycles: {took:.3f} s a cycle (first {wall[0]:.3f},"
        f" longest later {max(wall[WARM:]):.3f}), {used:.3f} s of this process's processor;"
        f" {a_cycle:.0f} points a cycle ({a_cycle / vessels:.1%} of the vessels); peak {peak_gb:.2f} GB"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    picture = "leave out the current picture, as three cycles of four beyond 100,000 tracks do"
    parser.add_argument("--no-picture", action="store_true", help=picture)
    parser.add_argument("--recording", action="store_true", help="add the full recording")
    parser.add_argument(
        "url", nargs="?", default="", metavar="URL", help='of an empty database (default, or "": a temporary file)'
    )
    text = f"vessels and cycles of each run (default: {SEVERAL})"
    parser.add_argument("sizes", nargs="*", type=count, metavar="VESSELS CYCLES", help=text)
    asked = parser.parse_args()
    if len(asked.sizes) % 2:
        parser.error(f"got {asked.sizes}, needed pairs of vessels and cycles")
    keep = StoreSettings(associations_every=10**9, picture_large=10**9, recording=asked.recording)
    if asked.no_picture:
        keep = keep.model_copy(update={"picture_large": 0, "picture_every_s": 1e9})
    for vessels, number in list(zip(asked.sizes[::2], asked.sizes[1::2], strict=True)) or SEVERAL:
        with tempfile.TemporaryDirectory() as folder:
            measure(asked.url or f"{folder}/x.db", vessels, number, keep)


if __name__ == "__main__":
    main()
