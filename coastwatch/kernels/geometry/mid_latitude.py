"""Metres between two points and the point at so many metres, by mid-latitude radii: scalar twins of `coastwatch.geodesy`.

`difference` and `offset` take sine and cosine of the latitude that they start from, so that a point which many are compared with is
turned into them once; those of latitudes close by follow from a series.
"""

from __future__ import annotations

import math

from coastwatch.kernels.geometry.tangent import DEGREE, ECCENTRICITY2, SEMI_MAJOR
from coastwatch.kernels.jit import jit

CLOSE = 1e-2  # rad: below it the series are exact to rounding
NEAR_M = 1000.0  # north: below it two rounds find the latitude to rounding, three do up to 100 km


@jit
def scales(sine, cosine):  # type: ignore[no-untyped-def]
    """Metres a degree of latitude and of longitude. Args: sine, cosine: of the latitude."""
    w2 = 1.0 - ECCENTRICITY2 * sine * sine
    parallel = SEMI_MAJOR * DEGREE / math.sqrt(w2)
    return parallel * (1.0 - ECCENTRICITY2) / w2, parallel * cosine


@jit
def farther(lat, sine, cosine, degrees):  # type: ignore[no-untyped-def]
    """Sine and cosine of a latitude so many degrees farther north."""
    a = degrees * DEGREE
    if abs(a) > CLOSE:
        return math.sin((lat + degrees) * DEGREE), math.cos((lat + degrees) * DEGREE)
    a2 = a * a
    s = a * (1.0 - a2 / 6.0 * (1.0 - a2 / 20.0 * (1.0 - a2 / 42.0)))
    c = 1.0 - 0.5 * a2 * (1.0 - a2 / 12.0 * (1.0 - a2 / 30.0))
    return sine * c + cosine * s, cosine * c - sine * s


@jit
def wrapped(lon):  # type: ignore[no-untyped-def]
    """A longitude, or the difference of two, in (-180, 180]."""
    if lon > 180.0:
        return lon - 360.0
    return lon + 360.0 if lon <= -180.0 else lon


@jit
def difference(lat, lon, from_lat, from_lon, sine, cosine):  # type: ignore[no-untyped-def]
    """East and north metres to a point from another. Args: degrees; sine, cosine: of from_lat."""
    further = lat - from_lat
    north, east = scales(*farther(from_lat, sine, cosine, 0.5 * further))
    return wrapped(lon - from_lon) * east, further * north


@jit
def offset(lat, lon, sine, cosine, east_m, north_m):  # type: ignore[no-untyped-def]
    """Latitude and longitude of the point that lies so many metres east and north. Args: degrees; sine, cosine: of lat."""
    north, _ = scales(sine, cosine)
    further = north_m / north
    for _ in range(1 if abs(north_m) < NEAR_M else 2):
        north, _ = scales(*farther(lat, sine, cosine, 0.5 * further))
        further = north_m / north
    _, east = scales(*farther(lat, sine, cosine, 0.5 * further))
    return lat + further, wrapped(lon + east_m / east)
