"""Coast lines of a national picture, the conversion from shore coordinates to latitude and longitude, and the radar regions.

Shore coordinates of a point are its distance along the coast from the southern end, and its distance offshore, to the east,
both in metres. Coasts run north and swing to both sides of a meridian. They lie in three bands of latitude, far apart; one of
them is on the antimeridian.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Array, Floats, Ints, Struct, column
from coastwatch.geodesy import ECCENTRICITY2, scale_m_deg, wrap_deg

MAX_COAST_M = 3.0e6  # 27 degrees of latitude
SOUTHERN_END_DEG = (-40.5, -13.5, 13.5)  # latitude where the coasts of each band begin
FIRST_MERIDIAN_DEG, MERIDIAN_SPACING_DEG = -60.2, 24.0  # the eleventh coast of the first band is at 179.8
BEND_AMPLITUDE_M, BEND_LENGTH_M = 8.0e3, 2.0e5  # swing to each side of the meridian, up to 14 degrees of course; its period
REGION_LENGTH_M = 2.0e5  # approximate length of coast in one radar region; a coast has at least two regions
REGION_OVERLAP = 0.1  # share of a region's length that a neighbouring region also covers
RADAR_SPACING_M, RADAR_INLAND_M = 4.0e4, 500.0  # approximate; distance of a radar from the shore


@dataclass(frozen=True, eq=False)
class Coasts(Struct):
    """Coasts of equal length. Regions are numbered along the first coast, then along the next."""

    length_m: float
    regions: int  # of each coast
    latitude_deg: Floats = column(np.float64, "C")  # of the southern end
    longitude_deg: Floats = column(np.float64, "C")  # of the meridian about which the coast swings

    @property
    def region_length_m(self) -> float:
        """Length of coast in one region, without its overlaps."""
        return self.length_m / self.regions

    @property
    def radars(self) -> int:
        """Number of radars in each region."""
        return max(1, round(self.region_length_m / RADAR_SPACING_M))


def build_coasts(total_m: float) -> Coasts:
    """The smallest number of coasts of equal length with this total length."""
    count = max(1, int(np.ceil(total_m / MAX_COAST_M)))
    number, length_m = np.arange(count), total_m / count
    bands = len(SOUTHERN_END_DEG)
    longitude = wrap_deg(FIRST_MERIDIAN_DEG + MERIDIAN_SPACING_DEG * (number // bands))
    regions = max(2, round(length_m / REGION_LENGTH_M))
    return Coasts(length_m, regions, np.array(SOUTHERN_END_DEG)[number % bands], np.asarray(longitude))


def to_geodetic(
    coasts: Coasts, coast: Array, along_m: Floats, offshore_m: Floats, along_m_s: Floats, offshore_m_s: Floats
) -> tuple[Floats, Floats]:
    """Latitude and longitude (n, 2), degrees, and velocity east and north (n, 2), m/s; the velocity is the exact rate.

    Args: each (n,): number of the coast, shore coordinates in metres, and their rates in m/s.
    """
    south = coasts.latitude_deg[coast]
    per_degree, _ = scale_m_deg(coasts.latitude_deg + 13.5)
    latitude = south + along_m / per_degree[coast]
    latitude_rate = along_m_s / per_degree[coast]
    north, east = scale_m_deg(latitude)
    turn = 2.0 * np.pi / BEND_LENGTH_M
    from_meridian = BEND_AMPLITUDE_M * np.sin(turn * along_m) + offshore_m
    rate = BEND_AMPLITUDE_M * turn * np.cos(turn * along_m) * along_m_s + offshore_m_s
    phi = np.radians(latitude)
    shrink = -np.radians(np.tan(phi) * (1.0 - ECCENTRICITY2 * np.cos(phi) ** 2 / (1.0 - ECCENTRICITY2 * np.sin(phi) ** 2)))
    longitude = wrap_deg(coasts.longitude_deg[coast] + from_meridian / east)
    # the last term: going north a degree of longitude becomes shorter
    velocity = np.stack([rate - from_meridian * shrink * latitude_rate, latitude_rate * north], axis=-1)
    return np.stack([latitude, longitude], axis=-1), velocity


def covering_regions(coasts: Coasts, coast: Array, along_m: Floats) -> tuple[Ints, Ints]:
    """The even and the odd region on its coast that cover each point, -1 for none. Args: (n,), (n,). Returns: (n,), (n,).

    Only neighbouring regions overlap, so at most one region of each parity covers a point.
    """
    position = along_m / coasts.region_length_m
    own = np.clip(np.floor(position), 0, coasts.regions - 1).astype(np.int64)
    share = position - own
    other = np.where(share < REGION_OVERLAP / 2.0, own - 1, np.where(share > 1.0 - REGION_OVERLAP / 2.0, own + 1, -1))
    other = np.where(other < coasts.regions, other, -1)
    first, odd = coast.astype(np.int64) * coasts.regions, own % 2 == 1
    shared = np.where(other >= 0, first + other, -1)
    return np.where(odd, shared, first + own), np.where(odd, first + own, shared)


def radar_sites(coasts: Coasts) -> Floats:
    """Latitude and longitude of every radar, degrees, region by region, on the shore. Returns: (regions * radars, 2)."""
    spacing = coasts.region_length_m / coasts.radars
    number = np.arange(len(coasts.latitude_deg) * coasts.regions * coasts.radars)
    coast, position = np.divmod(number, coasts.regions * coasts.radars)
    zero = np.zeros(len(number))
    return to_geodetic(coasts, coast, (position + 0.5) * spacing, zero - RADAR_INLAND_M, zero, zero)[0]


def nearest_radar(coasts: Coasts, region: Ints, along_m: Floats) -> Ints:
    """The radar of a region nearest to each point, numbered as in `radar_sites`. Args: (n,), (n,). Returns: (n,)."""
    begins = (region % coasts.regions) * coasts.region_length_m
    number = np.clip(np.floor((along_m - begins) / (coasts.region_length_m / coasts.radars)), 0, coasts.radars - 1)
    return region * coasts.radars + number.astype(np.int64)
