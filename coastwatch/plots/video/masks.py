"""Where nothing is looked for in the video of a radar: land, and sectors."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from coastwatch.batches import Array, Floats, Rings
from coastwatch.geodesy import to_plane
from coastwatch.stage import Latitude, Longitude, NotNegative, Settings

AZIMUTHS = 1024  # of a turn
TURN_RAD = 2.0 * np.pi
Degrees = Annotated[float, Field(ge=0.0, le=360.0)]


class Sector(Settings):
    """A part of a disc in which nothing is looked for."""

    radar: str = ""  # its name; empty: all radars
    from_deg: Degrees = 0.0  # clockwise from this azimuth
    to_deg: Degrees = 360.0  # to this one
    from_m: NotNegative = 0.0  # from this range
    to_m: NotNegative = 1e6  # to this one


class Masks(Settings):
    """Where nothing is looked for."""

    sectors: tuple[Sector, ...] = ()  # parts of discs
    land_deg: tuple[tuple[tuple[Latitude, Longitude], ...], ...] = ()  # rings of corners of land, latitude and longitude

    def of(self, radar: str) -> tuple[Sector, ...]:
        """The sectors of a radar."""
        return tuple(sector for sector in self.sectors if sector.radar in ("", radar))


class MaskScale(NamedTuple):
    """The cells of a spoke, and by how much land is grown."""

    first_m: float
    cell_m: float
    cells: int
    beam_rad: float
    pulse_m: float


@lru_cache(maxsize=16)
def mask_of(sectors: tuple[Sector, ...], land_deg: Rings, site_deg: tuple[float, float], scale: MaskScale) -> Array:
    """255 where nothing is looked for, else 0: (AZIMUTHS, C) uint8. Land is grown by a beam and a pulse.

    Args: sectors: of this radar; land_deg: rings of corners, latitude and longitude; site_deg: of the antenna.
    """
    azimuth = (np.arange(AZIMUTHS) + 0.5) * TURN_RAD / AZIMUTHS
    range_m = np.asarray(scale.first_m + (np.arange(scale.cells) + 0.5) * scale.cell_m, np.float64)
    masked = np.zeros((AZIMUTHS, scale.cells), np.bool_)
    for ring in land_deg:
        masked ^= _inside(to_plane(np.array(ring), np.array(site_deg)), azimuth, range_m)
    if land_deg:
        wide = int(np.ceil(scale.beam_rad / TURN_RAD * AZIMUTHS))
        long = int(np.ceil(scale.pulse_m / scale.cell_m))
        from scipy import ndimage

        masked = ndimage.maximum_filter(masked, (2 * wide + 1, 2 * long + 1), mode=("wrap", "nearest"))
    for sector in sectors:
        width = sector.to_deg - sector.from_deg
        turned = (np.degrees(azimuth) - sector.from_deg) % 360.0 < (width if width >= 0.0 else width + 360.0)
        masked |= turned[:, None] & (range_m >= sector.from_m) & (range_m <= sector.to_m)
    return np.where(masked, np.uint8(255), np.uint8(0))


def _inside(corners_m: Floats, azimuth: Floats, range_m: Floats) -> Array:
    """Whether cells are inside a ring, by the crossings of each spoke with its sides. (AZIMUTHS, C) Args: corners_m: east, north."""
    here, there = corners_m, np.roll(corners_m, -1, axis=0)
    side = there - here
    out = np.zeros((len(azimuth), len(range_m)), np.bool_)
    for k, ahead in enumerate(np.column_stack([np.sin(azimuth), np.cos(azimuth)])):
        across = here[:, 0] * ahead[1] - here[:, 1] * ahead[0]
        beyond = there[:, 0] * ahead[1] - there[:, 1] * ahead[0]
        cut = (across > 0.0) != (beyond > 0.0)
        share = across[cut] / (across - beyond)[cut]
        at_m = np.sort((here[cut] + share[:, None] * side[cut]) @ ahead)
        out[k] = (len(at_m) - np.searchsorted(at_m, range_m)) % 2 == 1
    return out
