"""Land of Natural Earth as vector tiles for the map. Source: Mapbox Vector Tile Specification 2.1, sections 4.1 to 4.3."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import shapely

from coastwatch.batches import Array, Floats, Ints
from coastwatch.formats.coastline import OFFSET_DEG, SCALE_DEG, TURN_STEPS, areas, polygons

MOST_ZOOM = 8
"""Tiles of the greatest zoom have corners to 19 m at the equator; the map enlarges them beyond it."""

EXTENT = 8192
"""Units of a tile along each side."""

BORDER = 128
"""Units beyond each side: the edges that the cut makes lie there, and the map does not show them."""

CLOSE = 4.0
"""Units that a shore may be moved by, a quarter of a pixel; none in tiles that the map enlarges."""

COARSE_ZOOM, QUARTER_ZOOM = 3, 4
MOVE_TO, LINE_TO, CLOSE_PATH = 1, 2, 7
LAYER = "land"


@lru_cache(maxsize=512)
def tile(zoom: int, x: int, y: int) -> bytes:
    """A vector tile with the layer `land`; empty where there is none. Args: x, y: of 2^zoom, from the antimeridian and the north."""
    if zoom <= QUARTER_ZOOM:
        whole = polygons("coarse" if zoom <= COARSE_ZOOM else "fine")
    else:
        whole = _quarter(x >> (zoom - QUARTER_ZOOM), y >> (zoom - QUARTER_ZOOM))
    land = _cut(whole, zoom, x, y)
    flat = shapely.transform(land, lambda step: _unit(step, zoom, x, y))
    bent = ~shapely.is_valid(flat)  # an edge is straight on another chart than before
    flat[bent] = shapely.make_valid(flat[bent])
    near = shapely.simplify(flat, CLOSE if zoom < MOST_ZOOM else 0.0)
    shapes = areas(shapely.set_precision(near, 1.0))
    return _encoded(shapely.orient_polygons(shapes)) if len(shapes) else b""


@lru_cache(maxsize=64)
def _quarter(x: int, y: int) -> Array:
    """The polygons of a tile of QUARTER_ZOOM, of which those of greater zoom are cut."""
    return _cut(polygons("fine"), QUARTER_ZOOM, x, y)


def _cut(land: Array, zoom: int, x: int, y: int) -> Array:
    """The polygons inside a tile and its border."""
    side = 0.5**zoom
    border = side * BORDER / EXTENT
    (west, north), (east, south) = (_step(side * (x + k) + b, side * (y + k) + b) for k, b in ((0, -border), (1, border)))
    frame = shapely.box(west, south, east, north)
    return areas(shapely.intersection(land[shapely.intersects(land, frame)], frame))


def _step(x: float, y: float) -> tuple[float, float]:
    """Steps of longitude and latitude of a point of the map. Args: x, y: 0 to 1, from the antimeridian and the north."""
    latitude = math.degrees(math.atan(math.sinh(math.pi * (1.0 - 2.0 * y))))
    return x * TURN_STEPS, float((latitude - OFFSET_DEG[0]) / SCALE_DEG[0])


def _unit(step: Floats, zoom: int, x: int, y: int) -> Floats:
    """Units of a tile from its north-western corner, to the east and south. Args: step: (P, 2) of longitude and latitude."""
    latitude = np.radians(step[:, 1] * SCALE_DEG[0] + OFFSET_DEG[0])
    turns = np.stack([step[:, 0] / TURN_STEPS, 0.5 - np.arcsinh(np.tan(latitude)) / (2.0 * np.pi)], 1)
    return np.asarray((turns * 2.0**zoom - np.array([x, y])) * EXTENT)


def _encoded(land: Array) -> bytes:
    """One feature of all polygons. Args: land: outer rings counterclockwise where y grows to the north."""
    _, unit, (begins, _) = shapely.to_ragged_array(land)
    last = begins[1:] - 1  # a ring is closed by a command
    corners = np.delete(np.round(unit).astype(np.int64), last, axis=0)
    change = np.diff(corners, axis=0, prepend=0)
    zigzag = (change << 1) ^ (change >> 63)
    parts: list[Ints] = []
    for ring in np.split(zigzag, (begins[1:-1] - np.arange(1, len(last)))):
        commands = np.array([1 << 3 | MOVE_TO, (len(ring) - 1) << 3 | LINE_TO, 1 << 3 | CLOSE_PATH])
        parts += [commands[:1], ring[0], commands[1:2], ring[1:].ravel(), commands[2:]]
    geometry = _varints(np.concatenate(parts))
    feature = _field(3, 3) + _field(4, geometry)  # a polygon
    layer = _field(15, 2) + _field(1, LAYER.encode()) + _field(2, feature) + _field(5, EXTENT)
    return _field(3, layer)


def _varints(numbers: Ints) -> bytes:
    """Numbers from 0 to 2^35 - 1 as base 128 varints of protocol buffers."""
    shift = 7 * np.arange(5)
    groups = (numbers[:, None] >> shift) & 127
    goes_on = (numbers[:, None] >> (shift + 7)) > 0
    used = np.concatenate([np.ones((len(numbers), 1), np.bool_), goes_on[:, :-1]], 1)
    return bytes((groups + 128 * goes_on)[used].astype(np.uint8).tobytes())


def _field(number: int, value: int | bytes) -> bytes:
    """A field of protocol buffers: a number, or bytes with their length."""
    if isinstance(value, int):
        return _varints(np.array([number << 3, value]))
    return _varints(np.array([number << 3 | 2, len(value)])) + value
