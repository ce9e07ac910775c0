"""Write coastwatch/operators/natural_earth_land.npz, the land that `coastwatch plot` draws where a scenario has no coastline.

Source: Natural Earth 1:10m land (naturalearthdata.com, public domain), as in the npm package world-atlas 2.0.2. Its grid of 0.0036
degrees of longitude and 0.0017 of latitude is kept. Rings are made continuous across the antimeridian, and the one around the pole
is closed there.

    npm pack world-atlas@2.0.2 && tar xzf world-atlas-2.0.2.tgz
    npx --package topojson-client topo2geo land=land.geojson < package/land-10m.json
    python -m scaling.decisions.natural_earth land.geojson
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from coastwatch.operators.coastline import NATURAL_EARTH

SCALE_DEG, OFFSET_DEG = np.array([0.0016885772698826986, 0.0036000360003600037]), np.array([-85.22193775799991, -180.0])


def continuous(ring: list[list[float]]) -> np.ndarray:
    """Latitude and continuous longitude of a ring of GeoJSON."""
    longitude, latitude = np.array(ring).T
    longitude = np.unwrap(longitude, period=360.0)
    if abs(longitude[-1] - longitude[0]) > 180.0:
        ends = longitude[-1], longitude[0], longitude[0]
        return np.stack([np.append(latitude, [-90.0, -90.0, latitude[0]]), np.append(longitude, ends)], 1)
    return np.stack([latitude, longitude], 1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path, help="GeoJSON of the land")
    collection = json.loads(parser.parse_args().file.read_text("utf-8"))
    features = collection.get("features", [collection])
    polygons = [polygon for feature in features for polygon in feature["geometry"]["coordinates"]]
    rings = [(continuous(ring), k > 0) for polygon in polygons for k, ring in enumerate(polygon)]
    position_deg = np.concatenate([ring for ring, _ in rings])
    step = np.round((position_deg - OFFSET_DEG) / SCALE_DEG).astype(np.int32)
    counts, water = np.array([len(ring) for ring, _ in rings], np.int32), np.array([inner for _, inner in rings])
    np.savez_compressed(NATURAL_EARTH, step=step.T, points=counts, water=water, scale_deg=SCALE_DEG, offset_deg=OFFSET_DEG)
    print(f"{NATURAL_EARTH}: {len(rings)} rings, {len(step)} points, {NATURAL_EARTH.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
