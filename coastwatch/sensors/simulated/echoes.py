"""What a radar receives in one turn: noise, sea, rain, land and ships, as power of each cell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from coastwatch.batches import Array, Floats
from coastwatch.geodesy import NAUTICAL_MILE_M, wrap_rad
from coastwatch.stage import Latitude, Longitude, NotNegative, Positive, Settings

TURN_RAD = 2.0 * np.pi
SEA_M, NEAREST_M = 0.5 * NAUTICAL_MILE_M, 100.0  # range for which `sea_db` holds; nearer than this the sea is no stronger
LEAST_SEA = 0.03  # of the noise; weaker clutter is left out
PATCH = 4  # spokes and cells over which a texture is even
SHIP_M, SHIP_LENGTH_M = 2.0 * NAUTICAL_MILE_M, 32.0  # range and length for which `ship_db` holds
LEAST_SCATTERERS, SCATTERER_M = 7, 8.0  # of a hull; one for so many metres
END_ON, BROADSIDE = 0.4, 1.2  # share of the power from ahead, and what the side adds
SIDE_LOBES = 6.0  # beams to each side in which a ship is received
BEYOND_M = 50.0  # behind the middle of a nearer hull begins its shadow
SINC_WIDTH = 0.886  # of sinc at half power
LAND_SHAPE = 1.5  # of the texture of land


class Rain(Settings):
    """A shower."""

    latitude_deg: Latitude  # of the middle
    longitude_deg: Longitude
    radius_m: Positive = 1500.0
    rain_db: float = 10.0  # over the noise: positive is stronger


class Power(Settings):
    """How strong echoes are, in decibels over the noise of the receiver."""

    ship_db: Annotated[float, Field(ge=-20.0, le=80.0)] = 25.0  # of a hull of 32 m at 2 NM: positive is stronger
    sea_db: Annotated[float, Field(ge=-50.0, le=80.0)] = 18.0  # of the sea at 0.5 NM, falling with r^-3: positive is stronger
    sea_shape: Positive = 1.5  # ratio that says how even the sea is: shape of its gamma texture, 0.5 is spiky
    land_db: Annotated[float, Field(ge=0.0, le=80.0)] = 23.0  # of land
    shadow_db: NotNegative = 25.0  # lost behind a nearer hull


@dataclass(frozen=True, eq=False)
class Disc:
    """The cells of a radar, and how it receives."""

    azimuth: Floats  # (S,) rad, of the middle of each spoke
    range_m: Floats  # (C,) of the middle of each cell
    beam_rad: float
    pulse_m: float
    land: Array | None  # (S, C) whether there is land; none anywhere
    rain: Array | None  # (S, C) its mean power; none anywhere

    @property
    def cell_m(self) -> float:
        """Length of a cell."""
        return float(self.range_m[1] - self.range_m[0])


@dataclass(frozen=True, eq=False)
class Hulls:
    """Ships where the beam meets them, about the antenna."""

    east_north_m: Floats  # (V, 2); NaN: not there
    heading: Floats  # (V,) rad
    length_m: Floats  # (V,)
    width_m: Floats  # (V,)


def background(disc: Disc, power: Power, rng: np.random.Generator) -> Array:
    """Power of noise, sea (K-distributed), rain and land in each cell. (S, C) float32"""
    spokes, cells = len(disc.azimuth), len(disc.range_m)
    out = rng.standard_exponential((spokes, cells), dtype=np.float32)
    mean = np.ones((spokes, cells), np.float32)
    sea = 10.0 ** (power.sea_db / 10.0) * (SEA_M / np.maximum(disc.range_m, NEAREST_M)) ** 3
    near = int(np.searchsorted(-sea, -LEAST_SEA))
    mean[:, :near] += sea[:near].astype(np.float32) * _texture(power.sea_shape, (spokes, near), rng)
    if disc.rain is not None:
        mean += disc.rain
    if disc.land is not None:
        land = np.float32(10.0 ** (power.land_db / 10.0)) * _texture(LAND_SHAPE, (spokes, cells), rng)
        mean = np.where(disc.land, land, mean)
    out *= mean
    return out


def _texture(shape: float, size: tuple[int, int], rng: np.random.Generator) -> Array:
    """A gamma texture of mean 1, even over patches. float32"""
    patches = rng.standard_gamma(shape, (-(-size[0] // PATCH), -(-size[1] // PATCH))).astype(np.float32) / np.float32(shape)
    return np.repeat(np.repeat(patches, PATCH, axis=0), PATCH, axis=1)[: size[0], : size[1]]


def add_ships(out: Array, disc: Disc, hulls: Hulls, power: Power, rng: np.random.Generator) -> None:
    """Add each ship to the power, as a sum of fields with a random phase. Its scatterers are drawn anew each turn (Swerling 1)."""
    for ship in range(len(hulls.length_m)):
        if np.isfinite(hulls.east_north_m[ship]).all():
            _add_ship(out, disc, hulls, ship, power, rng)


def _add_ship(out: Array, disc: Disc, hulls: Hulls, ship: int, power: Power, rng: np.random.Generator) -> None:
    length, place, heading = float(hulls.length_m[ship]), hulls.east_north_m[ship], float(hulls.heading[ship])
    count, ahead = max(LEAST_SCATTERERS, int(length // SCATTERER_M)), np.array([np.sin(heading), np.cos(heading)])
    along = np.linspace(-0.5 * length, 0.5 * length, count)[:, None] * ahead
    across = 0.5 * rng.uniform(-1.0, 1.0, (count, 1)) * hulls.width_m[ship] * np.array([ahead[1], -ahead[0]])
    at = place + along + across
    distance, azimuth = np.hypot(*at.T), np.arctan2(*at.T)
    middle_m, towards = float(np.hypot(*place)), float(np.arctan2(*place))
    aspect = END_ON + BROADSIDE * abs(np.sin(heading - towards))
    gain = 10.0 ** (power.ship_db / 10.0) * (SHIP_M / middle_m) ** 4 * length / SHIP_LENGTH_M * aspect
    field = np.sqrt(0.5 * gain / count) * (rng.standard_normal(count) + 1j * rng.standard_normal(count))
    field = field * _shadow(hulls, ship, distance, azimuth, power)
    step = TURN_RAD / len(disc.azimuth)
    wide = int(np.ceil((SIDE_LOBES * disc.beam_rad + length / middle_m) / step))
    rows = np.unique((int(towards % TURN_RAD / step) + np.arange(-wide, wide + 1)) % len(disc.azimuth))
    reach = 0.5 * length + 2.5 * disc.pulse_m
    first, end = np.searchsorted(disc.range_m, [middle_m - reach, middle_m + reach])
    if first == end:
        return
    off = wrap_rad(disc.azimuth[rows][:, None] - azimuth)
    beam = np.sinc(SINC_WIDTH * off / disc.beam_rad) ** 2
    pulse = np.exp(-4.0 * np.log(2.0) * ((disc.range_m[first:end, None] - distance) / disc.pulse_m) ** 2)
    former = out[rows, first:end]
    phase = np.exp(1j * TURN_RAD * rng.random(former.shape))
    out[rows, first:end] = np.abs(np.sqrt(former) * phase + (beam * field) @ pulse.T) ** 2


def _shadow(hulls: Hulls, ship: int, distance: Floats, azimuth: Floats, power: Power) -> Floats:
    """The share of the field that nearer hulls leave of each scatterer."""
    out = np.ones(len(distance))
    for other in range(len(hulls.length_m)):
        place = hulls.east_north_m[other]
        if other == ship or not np.isfinite(place).all():
            continue
        near_m, towards = float(np.hypot(*place)), float(np.arctan2(*place))
        seen_m = hulls.length_m[other] * abs(np.sin(hulls.heading[other] - towards)) + hulls.width_m[other]
        hidden = (distance > near_m + BEYOND_M) & (np.abs(wrap_rad(azimuth - towards)) < 0.5 * seen_m / near_m)
        out[hidden] *= 10.0 ** (-power.shadow_db / 20.0)
    return out
