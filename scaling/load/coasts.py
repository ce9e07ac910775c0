"""Coast lines of a national picture: metres along and off a coast to latitude and longitude, and the radar regions beside it.

A place is `along` metres from the southern end of a coast and `off` metres to the east of it, where the water is. Coasts run north
and swing to both sides; they lie in three bands of latitude, far from each other, one of them on the antimeridian.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Array, Floats, Ints, Struct, column
from coastwatch.geodesy import ECCENTRICITY2, scale_m_deg, wrap_deg

LONGEST_M = 3.0e6  # 27 degrees of latitude
BANDS_DEG = (-40.5, -13.5, 13.5)  # southern ends
FIRST_DEG, APART_DEG = -60.2, 24.0  # longitude of the first coast of a band, and from one to the next; the eleventh is at 179.8
BEND_M, BEND_LENGTH_M = (
    8.0e3,
    2.0e5,
)  # how far a coast swings to each side of its meridian, and in what length: up to 14 degrees
REGION_M = 2.0e5  # of coast that one region watches, about; at least two regions a coast
OVERLAP = 0.1  # share of a region's length that its neighbour watches as well
RADAR_M, INLAND_M = 4.0e4, 500.0  # of coast that one radar of a region watches, about; from the shore


@dataclass(frozen=True, eq=False)
class Coasts(Struct):
    """Coasts of one length; regions are numbered along the first coast, then the next."""

    length_m: float
    regions: int  # of each coast
    latitude_deg: Floats = column(np.float64, "C")  # of the southern end
    longitude_deg: Floats = column(np.float64, "C")  # of the meridian about which the coast swings

    @property
    def region_m(self) -> float:
        return self.length_m / self.regions

    @property
    def radars(self) -> int:
        """Of each region."""
        return max(1, round(self.region_m / RADAR_M))


def lay(total_m: float) -> Coasts:
    """As few coasts of equal length as make up this total."""
    count = max(1, int(np.ceil(total_m / LONGEST_M)))
    number, length_m = np.arange(count), total_m / count
    longitude = wrap_deg(FIRST_DEG + APART_DEG * (number // len(BANDS_DEG)))
    regions = max(2, round(length_m / REGION_M))
    return Coasts(length_m, regions, np.array(BANDS_DEG)[number % len(BANDS_DEG)], np.asarray(longitude))


def geodetic(
    coasts: Coasts, coast: Array, along_m: Floats, off_m: Floats, along_m_s: Floats, off_m_s: Floats
) -> tuple[Floats, Floats]:
    """Latitude and longitude (n, 2) and velocity east and north (n, 2), of which the one is the exact rate of the other.

    Args: each (n,): number of the coast, place in metres along and off it, and how these change a second.
    """
    south = coasts.latitude_deg[coast]
    per_degree, _ = scale_m_deg(coasts.latitude_deg + 13.5)
    latitude = south + along_m / per_degree[coast]
    latitude_rate = along_m_s / per_degree[coast]
    north, east = scale_m_deg(latitude)
    turn = 2.0 * np.pi / BEND_LENGTH_M
    from_meridian = BEND_M * np.sin(turn * along_m) + off_m
    rate = BEND_M * turn * np.cos(turn * along_m) * along_m_s + off_m_s
    phi = np.radians(latitude)
    shrink = -np.radians(np.tan(phi) * (1.0 - ECCENTRICITY2 * np.cos(phi) ** 2 / (1.0 - ECCENTRICITY2 * np.sin(phi) ** 2)))
    longitude = wrap_deg(coasts.longitude_deg[coast] + from_meridian / east)
    # the last term: going north a degree of longitude becomes shorter
    velocity = np.stack([rate - from_meridian * shrink * latitude_rate, latitude_rate * north], axis=-1)
    return np.stack([latitude, longitude], axis=-1), velocity


def watched_by(coasts: Coasts, coast: Array, along_m: Floats) -> tuple[Ints, Ints]:
    """The region with an even and that with an odd place on its coast that watch each point; -1: none. Args: (n,). Returns: (n,), (n,).

    Only neighbours overlap, so that no point has two of one parity.
    """
    place = along_m / coasts.region_m
    own = np.clip(np.floor(place), 0, coasts.regions - 1).astype(np.int64)
    share = place - own
    other = np.where(share < OVERLAP / 2.0, own - 1, np.where(share > 1.0 - OVERLAP / 2.0, own + 1, -1))
    other = np.where(other < coasts.regions, other, -1)
    first, odd = coast.astype(np.int64) * coasts.regions, own % 2 == 1
    shared = np.where(other >= 0, first + other, -1)
    return np.where(odd, shared, first + own), np.where(odd, first + own, shared)


def radar_sites(coasts: Coasts) -> Floats:
    """Latitude and longitude of every radar, region by region, on the shore. Returns: (regions * radars, 2)."""
    apart = coasts.region_m / coasts.radars
    number = np.arange(len(coasts.latitude_deg) * coasts.regions * coasts.radars)
    coast, place = np.divmod(number, coasts.regions * coasts.radars)
    still = np.zeros(len(number))
    return geodetic(coasts, coast, (place + 0.5) * apart, still - INLAND_M, still, still)[0]


def radar_near(coasts: Coasts, region: Ints, along_m: Floats) -> Ints:
    """The radar of a region that is nearest to each point, as numbered in `radar_sites`. Args: (n,), (n,). Returns: (n,)."""
    begins = (region % coasts.regions) * coasts.region_m
    number = np.clip(np.floor((along_m - begins) / (coasts.region_m / coasts.radars)), 0, coasts.radars - 1)
    return region * coasts.radars + number.astype(np.int64)
