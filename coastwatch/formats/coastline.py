"""Land and shore lines from a GeoJSON file or from Natural Earth, as arrays of latitude, longitude."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
import shapely

from coastwatch.batches import Array, Floats, Rings
from coastwatch.errors import InputError

NATURAL_EARTH = Path(__file__).with_name("natural_earth_land.npz")
"""Land of Natural Earth 1:10m, public domain; scaling/decisions/natural_earth.py wrote it."""

SCALE_DEG, OFFSET_DEG = np.array([0.0016885772698826986, 0.0036000360003600037]), np.array([-85.22193775799991, -180.0])
"""Degrees of latitude and longitude of a step, and of step 0."""

NATURAL = "natural_earth"
"""In place of a file: the land of Natural Earth."""

TURN_STEPS = 99_999
"""Steps of longitude around the globe."""


@dataclass(frozen=True, eq=False)
class Shore:
    """An outline of land with the lakes in it, or a line along a shore."""

    position_deg: Floats  # (P, 2) latitude, longitude; continuous across the antimeridian where it is drawn
    closed: bool
    lakes_deg: tuple[Floats, ...] = ()


@cache
def polygons(level: str) -> Array:
    """Valid polygons of shapely in steps of longitude and latitude, from 21 degrees before to 21 degrees after one turn.

    Args: level: fine, or coarse, for tiles up to zoom 3.
    """
    with np.load(NATURAL_EARTH) as stored:
        first, change, corners, rings = (stored[f"{level}_{name}"] for name in ("first", "change", "corners", "rings"))
    begins = np.cumsum(corners) - corners
    step = np.zeros((corners.sum(), 2))
    step[np.delete(np.arange(len(step)), begins)] = change.T
    step = np.cumsum(step, axis=0)
    step += np.repeat(first - step[begins], corners, axis=0)
    offsets = tuple(np.append(0, np.cumsum(count)) for count in (corners, rings))
    return np.asarray(shapely.from_ragged_array(shapely.GeometryType.POLYGON, step, offsets))


def natural_earth(south: float, west: float, north: float, east: float) -> tuple[Shore, ...]:
    """The land of Natural Earth in a rectangle, cut at its edges; right to about 500 m.

    Args: degrees; west and east are continuous, so that 175 to 185 crosses the antimeridian.
    """
    (low_y, low_x), (high_y, high_x) = (np.array([[south, west], [north, east]]) - OFFSET_DEG) / SCALE_DEG
    land, cuts, seams = polygons("fine"), [], []
    for turn in range(int(low_x // TURN_STEPS), int(high_x // TURN_STEPS) + 1):
        start = turn * TURN_STEPS
        frame = shapely.box(max(low_x - start, 0.0), low_y, min(high_x - start, float(TURN_STEPS)), high_y)
        cut = shapely.intersection(land[shapely.intersects(land, frame)], frame)
        west_x, _, east_x, _ = shapely.bounds(cut).T
        seams.append(((west_x == 0.0) & (start > low_x)) | ((east_x == TURN_STEPS) & (start + TURN_STEPS < high_x)))
        cuts.append(shapely.transform(cut, partial(np.add, [start, 0.0])))
    every, at_seam = np.concatenate(cuts), np.concatenate(seams)
    joined = np.concatenate([every[~at_seam], np.array([shapely.union_all(every[at_seam])], object)])
    return tuple(
        Shore(outline, True, tuple(lakes))
        for outline, *lakes in (
            [shapely.get_coordinates(ring)[:, ::-1] * SCALE_DEG + OFFSET_DEG for ring in shapely.get_rings(part)]
            for part in areas(joined)
        )
    )


def rings_within(path: str | Path, south_west_north_east: tuple[float, float, float, float]) -> Rings:
    """Rings of land and of lakes in it that reach into a rectangle, as corners of latitude and longitude, for masks.

    Args: path: a GeoJSON file, or NATURAL; degrees, west and east continuous. Raises: InputError that names the file.
    """
    south, west, north, east = south_west_north_east
    shores = natural_earth(south, west, north, east) if str(path) == NATURAL else read(path)[0]
    rings = []
    for corners in (ring for shore in shores if shore.closed for ring in (shore.position_deg, *shore.lakes_deg)):
        low, high = corners.min(axis=0), corners.max(axis=0)
        if low[0] <= north and high[0] >= south and low[1] <= east and high[1] >= west:
            rings.append(tuple((float(latitude), float(longitude)) for latitude, longitude in corners.tolist()))
    return tuple(rings)


def areas(geometries: Array) -> Array:
    """The polygons in geometries of shapely, without points and lines, as a cut along a shore leaves them."""
    parts = shapely.get_parts(shapely.get_parts(geometries))
    return np.asarray(parts[(shapely.get_type_id(parts) == shapely.GeometryType.POLYGON) & ~shapely.is_empty(parts)])


def read(path: str | Path) -> tuple[tuple[Shore, ...], str]:
    """The shores in a GeoJSON file and its note, e.g. "approximate, not for navigation".

    Raises: InputError that names the file if it is not GeoJSON of lines and polygons.
    """
    try:
        text = Path(path).read_text("utf-8")
        if not text.strip():
            raise InputError(f"{path}: got an empty file, needed GeoJSON of lines and polygons")
        document = json.loads(text)
        shores = tuple(s for g in _geometries(document) for s in _shores(g))
        note = str(document.get("note", ""))
    except InputError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
        got = str(error) if isinstance(error, ValueError) else "a document without type, coordinates or features"
        raise InputError(f"{path}: needed GeoJSON of lines and polygons, got {got}") from error
    return shores, note


class _Document(TypedDict):
    """GeoJSON: a geometry, a feature or a collection."""

    type: str
    features: list[_Document]
    geometry: _Document | None
    geometries: list[_Document]
    coordinates: list[Any]  # numbers in lists as deep as the type has them


def _geometries(document: _Document) -> Iterator[_Document]:
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


def _shores(geometry: _Document) -> list[Shore]:
    kind, points = geometry["type"], geometry["coordinates"]
    rings: dict[str, Callable[[], list[list[Any]]]] = {
        "LineString": lambda: [[points]],
        "MultiLineString": lambda: [[line] for line in points],
        "Polygon": lambda: [points],
        "MultiPolygon": lambda: points,
    }
    parts = rings[kind]() if kind in rings else []
    made = [[np.array([[p[1], p[0]] for p in ring], float).reshape(-1, 2) for ring in part] for part in parts if part]
    return [Shore(outer, kind.endswith("Polygon"), tuple(lakes)) for outer, *lakes in made]
