"""Land and shore lines from a GeoJSON file, as arrays of latitude, longitude."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from coastwatch.batches import Floats
from coastwatch.operators.bad_input import BadInput


@dataclass(frozen=True, eq=False)
class Shore:
    """An outline of land, or a line along a shore."""

    position_deg: Floats  # (P, 2) latitude, longitude
    closed: bool


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
