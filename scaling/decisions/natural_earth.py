"""Write the land that the map and `coastwatch plot` draw, and the points that tests compare it with.

Source: Natural Earth 1:10m land (naturalearthdata.com, public domain), as in the npm package world-atlas 2.0.2. Its grid of 0.0036
degrees of longitude and 0.0017 of latitude is kept. Its rings are made for a globe: they jump by 360 degrees at the antimeridian, end
beside a pole, and 115 of 4,062 cross or touch themselves. Here they become valid polygons with holes on a plane: continuous across the
antimeridian, closed at the pole, overlaps joined, and repeated 21 degrees beyond both ends, so that any tile or view can be cut out.

    npm pack world-atlas@2.0.2 && tar xzf world-atlas-2.0.2.tgz
    npx --package topojson-client topo2geo land=land.geojson < package/land-10m.json
    python -m scaling.decisions.natural_earth land.geojson
"""

from __future__ import annotations

import argparse
import csv
import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib.path import Path as Outline
from scipy.spatial import cKDTree

from coastwatch.batches import Array
from coastwatch.formats.coastline import NATURAL_EARTH, OFFSET_DEG, SCALE_DEG, TURN_STEPS, areas

POINTS = Path(__file__).parents[2] / "tests" / "worlds" / "natural_earth_points.csv"
BEYOND_STEPS = 6000  # 21.6 degrees
LONGEST_STEPS = 30_000  # so that a change fits 16 bits
COARSE_STEPS = 8.0  # largest error of the coarse land: a third of a pixel of a tile of zoom 3
SEED = 20261124
PLACES = {
    "Barents Sea": (69.0, 78.0, 15.0, 60.0),
    "northern Norway": (66.0, 71.5, 11.0, 31.0),
    "Solent": (50.2, 51.2, -2.5, 0.0),
    "Guanabara": (-23.8, -22.4, -44.5, -42.0),
    "Singapore": (-2.5, 3.0, 101.0, 108.0),
    "Fiji": (-19.0, -15.5, 176.5, 182.0),
    "Chukotka": (62.0, 72.0, 170.0, 192.0),
    "Antarctica": (-84.8, -63.0, -180.0, 180.0),
    "Arctic": (78.0, 84.9, -180.0, 180.0),
    "world": (-60.0, 78.0, -180.0, 180.0),
}
"""South, north, west, east of the samples."""
SAMPLES = 80
CLEAR_KM = 0.8  # least distance of a sample from every shore


def continuous(ring: list[list[float]]) -> np.ndarray:
    """Latitude and continuous longitude of a ring of GeoJSON."""
    longitude, latitude = np.array(ring).T
    longitude = np.unwrap(longitude, period=360.0)
    if abs(longitude[-1] - longitude[0]) > 180.0:
        ends = longitude[-1], longitude[0], longitude[0]
        return np.stack([np.append(latitude, [-90.0, -90.0, latitude[0]]), np.append(longitude, ends)], 1)
    return np.stack([latitude, longitude], 1)


def world(rings: list[np.ndarray], water: list[bool]) -> Array:
    """Valid polygons that do not touch each other. Args: rings: whole steps of longitude, latitude."""
    made = np.array([shapely.make_valid(shapely.Polygon(ring)) for ring in rings])
    land, lakes = (shapely.set_precision(areas(made[np.array(water) == is_water]), 1.0) for is_water in (False, True))
    land = areas(land)
    land = np.concatenate([shapely.transform(land, partial(np.add, [turn * TURN_STEPS, 0])) for turn in (-1, 0, 1)])
    frame = shapely.box(-BEYOND_STEPS, -10_000, TURN_STEPS + BEYOND_STEPS, 110_000)
    land = areas(shapely.intersection(land, frame, grid_size=1.0))
    one, other = shapely.STRtree(land).query(land, predicate="intersects")
    touching = np.unique(one[one != other])
    joined = shapely.union_all(land[touching], grid_size=1.0)
    land = np.concatenate([areas(np.array([joined])), np.delete(land, touching)])
    return areas(shapely.difference(land, shapely.union_all(lakes), grid_size=1.0))


def arrays(name: str, polygons: Array) -> dict[str, np.ndarray]:
    """Polygons as whole numbers: first corner of each ring, changes from corner to corner, corners a ring, rings a polygon."""
    _, xy, (rings, owners) = shapely.to_ragged_array(shapely.segmentize(polygons, LONGEST_STEPS))
    step = np.round(xy).astype(np.int32)
    change = np.delete(np.diff(step, axis=0), rings[1:-1] - 1, axis=0)
    assert np.abs(change).max() < 2**15
    return {
        f"{name}_first": step[rings[:-1]],
        f"{name}_change": change.T.astype(np.int16),
        f"{name}_corners": np.diff(rings).astype(np.int32),
        f"{name}_rings": np.diff(owners).astype(np.int32),
    }


def samples(rings: list[np.ndarray], water: list[bool]) -> list[tuple[str, float, float, int, float]]:
    """Place, latitude, longitude, whether it is land, and km to the nearest shore, of random points beside shores.

    They come from the rings as they are, by crossing numbers of matplotlib: nothing is shared with `world`.
    """
    random = np.random.default_rng(SEED)
    position = np.concatenate(rings) * SCALE_DEG[::-1] + OFFSET_DEG[::-1]
    dense = np.concatenate([_dense(ring * SCALE_DEG[::-1] + OFFSET_DEG[::-1]) for ring in rings])
    shores = cKDTree(_unit(dense))
    outlines = [Outline(ring * SCALE_DEG[::-1] + OFFSET_DEG[::-1]) for ring in rings]
    corners = [np.asarray(outline.vertices, float) for outline in outlines]
    low, high = np.array([c.min(0) for c in corners]), np.array([c.max(0) for c in corners])
    found = []
    for place, (south, north, west, east) in PLACES.items():
        turned = position.copy()
        turned[:, 0] = west + (turned[:, 0] - west) % 360.0
        near = turned[(turned[:, 0] <= east) & (turned[:, 1] >= south) & (turned[:, 1] <= north)]
        taken = {0: 0, 1: 0}
        while sum(taken.values()) < SAMPLES:
            away_km, angle = np.exp(random.uniform(0.0, np.log(150.0))), random.uniform(0.0, 2.0 * np.pi)
            x, y = near[random.integers(len(near))]
            y += away_km / 111.2 * np.cos(angle)
            x += away_km / 111.2 * np.sin(angle) / np.cos(np.radians(y))
            clear_km = 6371.0 * float(np.ravel(shores.query(_unit(np.array([[x, y]])))[0])[0])
            if not (south <= y <= north and west <= x <= east and clear_km >= CLEAR_KM):
                continue
            over = []
            for turn in (-360.0, 0.0, 360.0):
                p = np.array([x + turn, y])
                over += [
                    water[k]
                    for k in np.flatnonzero(((low <= p) & (high >= p)).all(1))
                    if outlines[k].contains_point((p[0], p[1]))
                ]
            is_land = int(bool(over) and (over.count(False) > over.count(True)))
            if taken[is_land] < SAMPLES // 2:
                taken[is_land] += 1
                found.append(
                    (place, round(float(y), 4), round(float((x + 180.0) % 360.0 - 180.0), 4), is_land, round(clear_km, 2))
                )
    return found


def _unit(position_deg: np.ndarray) -> np.ndarray:
    longitude, latitude = np.radians(position_deg).T
    return np.stack([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)], 1)


def _dense(ring: np.ndarray, step_deg: float = 0.005) -> np.ndarray:
    """The ring with more corners; edges at the pole are no shore."""
    count = np.ceil(np.abs(np.diff(ring, axis=0)).max(1) / step_deg).astype(int).clip(1)
    count[(ring[:-1, 1] <= -89.0) | (ring[1:, 1] <= -89.0)] = 1
    share = np.concatenate([np.arange(n) / n for n in count])[:, None]
    start, change = (np.repeat(a, count, axis=0) for a in (ring[:-1], np.diff(ring, axis=0)))
    return np.asarray(start + share * change)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path, help="GeoJSON of the land")
    collection = json.loads(parser.parse_args().file.read_text("utf-8"))
    features = collection.get("features", [collection])
    polygons = [polygon for feature in features for polygon in feature["geometry"]["coordinates"]]
    rings = [np.round((continuous(ring) - OFFSET_DEG) / SCALE_DEG)[:, ::-1] for polygon in polygons for ring in polygon]
    water = [k > 0 for polygon in polygons for k in range(len(polygon))]
    with POINTS.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows(
            [("place", "latitude_deg", "longitude_deg", "is_land", "clear_km"), *samples(rings, water)]
        )
    fine = world(rings, water)
    coarse = areas(shapely.set_precision(shapely.simplify(fine, COARSE_STEPS), 1.0))
    stored: dict[str, Any] = arrays("fine", fine) | arrays("coarse", coarse)
    np.savez_compressed(NATURAL_EARTH, **stored)
    count = [int(shapely.get_num_coordinates(level).sum()) for level in (fine, coarse)]
    print(f"{NATURAL_EARTH}: {len(fine)} polygons, {count[0]} corners, coarse {count[1]}, {NATURAL_EARTH.stat().st_size} bytes")


if __name__ == "__main__":
    main()
