"""Land and shore lines from a GeoJSON file or from Natural Earth, as arrays of latitude, longitude."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.path import Path as Outline
from matplotlib.transforms import Bbox

from coastwatch.batches import Floats
from coastwatch.operators.bad_input import BadInput

NATURAL_EARTH = Path(__file__).with_name("natural_earth_land.npz")
"""Land of Natural Earth 1:10m, public domain; scaling/decisions/natural_earth.py wrote it."""


@dataclass(frozen=True, eq=False)
class Shore:
    """An outline of land or of a lake, or a line along a shore."""

    position_deg: Floats  # (P, 2) latitude, longitude
    closed: bool
    water: bool = False  # a lake inside the land before it


def natural_earth(south: float, west: float, north: float, east: float) -> tuple[Shore, ...]:
    """The land of Natural Earth in a rectangle, cut at its edges; right to about 500 m.

    Args: degrees; west and east are continuous, so that 175 to 185 crosses the antimeridian.
    """
    with np.load(NATURAL_EARTH) as stored:
        position = stored["step"].T * stored["scale_deg"] + stored["offset_deg"]
        ends, water = np.cumsum(stored["points"]), stored["water"]
    starts = np.append(0, ends[:-1])
    low, high = np.minimum.reduceat(position, starts), np.maximum.reduceat(position, starts)
    found = []
    for turn in (-360.0, 0.0, 360.0):
        there = (low[:, 0] <= north) & (high[:, 0] >= south) & (low[:, 1] + turn <= east) & (high[:, 1] + turn >= west)
        for k in np.flatnonzero(there):
            ring = position[starts[k] : ends[k]] + np.array([0.0, turn])
            cut = Outline(ring, closed=True).clip_to_bbox(Bbox([[south, west], [north, east]]))
            parts = [np.asarray(part, float) for part in cut.to_polygons()]
            found += [Shore(part, True, bool(water[k])) for part in parts if len(part) > 3]
    return tuple(sorted(found, key=lambda shore: shore.water))


def read(path: str | Path) -> tuple[tuple[Shore, ...], str]:
    """The shores in a GeoJSON file and its note, e.g. "approximate, not for navigation".

    Raises: BadInput that names the file if it is not GeoJSON of lines and polygons.
    """
    try:
        text = Path(path).read_text("utf-8")
        if not text.strip():
            raise BadInput(f"{path}: got an empty file, needed GeoJSON of lines and polygons")
        document = json.loads(text)
        shores = tuple(s for g in _geometries(document) for s in _shores(g))
        note = str(document.get("note", ""))
    except (ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
        got = str(error) if isinstance(error, ValueError) else "a document without type, coordinates or features"
        raise BadInput(f"{path}: needed GeoJSON of lines and polygons, got {got}") from error
    return shores, note


def _geometries(document: dict[str, Any]) -> Iterator[dict[str, Any]]:
    if document["type"] == "FeatureCollection":
        for feature in document["features"]:
            yield from _geometries(feature)
    elif document["type"] == "Feature":
        if document["geometry"] is not None:
            yield from _geometries(document["geometry"])
    elif document["type"] == "GeometryCollection":
        for geometry in document["geometries"]:
            yield from _geometries(geometry)
    else:
        yield document


def _shores(geometry: dict[str, Any]) -> list[Shore]:
    kind, points = geometry["type"], geometry["coordinates"]
    rings: dict[str, Callable[[], list[Any]]] = {
        "LineString": lambda: [points],
        "MultiLineString": lambda: points,
        "Polygon": lambda: points[:1],  # a lake inside land is drawn as land: the picture is of the sea
        "MultiPolygon": lambda: [polygon[0] for polygon in points],
    }
    found = rings[kind]() if kind in rings else []
    return [Shore(np.array([[p[1], p[0]] for p in ring], float).reshape(-1, 2), kind.endswith("Polygon")) for ring in found]
