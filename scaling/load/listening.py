"""Passive sonars of a national picture: where they lie, what they hear, and the bearings that they report."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import BearingReports, Floats, Ints, Struct, column
from coastwatch.geodesy import difference_m, to_plane
from scaling.load.coasts import Coasts, geodetic
from scaling.load.motion import GOLDEN, courses
from scaling.load.waters import Places, Water

TRACKS_A_SONAR = 4000  # of the picture, for one sonar
CONTACTS = 100  # of each sonar, about
HEARD, MISSED = 0.95, 0.05  # share of the vessels in range; of the looks at one of them
OFF_M = 9.0e3  # from the coast, between the anchorages and the lanes
FARTHEST_M = 1.5e4
SIGMA_RAD, BIAS_RAD = np.radians(1.0), np.radians(0.2)  # of one bearing; standard deviation of a sonar's bias
NOWHERE_NEAR_M = 1.0e9  # between the ends of two coasts, when they are laid end to end


@dataclass(frozen=True, eq=False)
class Sonars(Struct):
    """By their place along the coasts, and the places that do not move near each of them."""

    end_to_end_m: Floats = column(np.float64, "S")  # place along all coasts, increasing
    site_deg: Floats = column(np.float64, "S", 2)
    range_m: Floats = column(np.float64, "S")
    bias_rad: Floats = column(np.float64, "S")
    delay_s: Floats = column(np.float64, "S")  # of its look, before the end of the cycle
    still: Ints = column(np.int64, "Q")  # places that stay where they are and are near one


def lay_out(places: Places, coasts: Coasts, tracks: int, after_s: float, period_s: float, seed: int) -> Sonars:
    """A sonar for so many tracks, each with the range in which it hears about `CONTACTS` vessels at this time."""
    rng = np.random.Generator(np.random.SFC64([seed, 1 << 21]))
    count = max(1, tracks // TRACKS_A_SONAR)
    along = (np.arange(count) + rng.uniform(0.3, 0.7, count)) / count * len(coasts.latitude_deg) * coasts.length_m
    coast = np.floor(along / coasts.length_m).astype(np.int64)
    along = along - coast * coasts.length_m
    zero = np.zeros(count)
    site, _ = geodetic(coasts, coast, along, zero + OFF_M, zero, zero)
    blind = Sonars(
        along + NOWHERE_NEAR_M * coast,
        site,
        zero + FARTHEST_M,
        BIAS_RAD * rng.standard_normal(count),
        rng.uniform(0.0, 1.0, count) * period_s,
        np.zeros(0, np.int64),
    )
    moving = np.isin(places.water, (Water.LANE, Water.OFFSHORE))
    every = np.arange(len(places))
    _, gap = _nearest(blind, places.coast, places.along_m)
    still = every[~moving & (gap < 1.1 * FARTHEST_M)]
    near = Sonars(blind.end_to_end_m, site, blind.range_m, blind.bias_rad, blind.delay_s, still)
    sonar, _, place, _ = _in_range(near, places, coasts, after_s)
    east_north = difference_m(place, site[sonar])
    distance = np.hypot(east_north[:, 0], east_north[:, 1])
    order = np.lexsort((distance, sonar))
    last = np.searchsorted(sonar[order], np.arange(count)) + round(CONTACTS / HEARD)
    enough = np.append(sonar[order], -1)[np.minimum(last, len(order))] == np.arange(count)
    reach = np.where(enough, distance[order[np.minimum(last, len(order) - 1)]], FARTHEST_M)
    return Sonars(near.end_to_end_m, site, reach, near.bias_rad, near.delay_s, still)


def listen(
    sonars: Sonars, places: Places, coasts: Coasts, after_s: float, start_s: float, rng: np.random.Generator
) -> BearingReports:
    """One look of every sonar at what it hears; contacts keep their number. Args: after_s: end of the cycle, since the start."""
    sonar, rows, place, vessel = _in_range(sonars, places, coasts, after_s)
    east_north = to_plane(place, sonars.site_deg[sonar])
    within = np.hypot(east_north[:, 0], east_north[:, 1]) <= sonars.range_m[sonar]
    seen = within & (rows * GOLDEN % 1.0 < HEARD) & (rng.uniform(0.0, 1.0, len(rows)) >= MISSED)
    sonar, rows, vessel, east_north = sonar[seen], rows[seen], vessel[seen], east_north[seen]
    error = sonars.bias_rad[sonar] + SIGMA_RAD * rng.standard_normal(len(rows))
    bearing = np.degrees(np.arctan2(east_north[:, 0], east_north[:, 1]) + error) % 360.0
    time_s = start_s + after_s - sonars.delay_s[sonar]
    origin = vessel * len(places) + rows
    none = np.full(len(rows), -1, np.int64)
    return BearingReports(sonar, time_s, time_s, bearing, origin, sonars.site_deg[sonar], none, origin)


def _in_range(sonars: Sonars, places: Places, coasts: Coasts, after_s: float) -> tuple[Ints, Ints, Floats, Ints]:
    """Vessels that may be in range: the sonar, the place, latitude and longitude (Q, 2), which vessel of its place.

    Only berths, anchorages, fleets and lanes are asked: what is offshore is farther than any sonar hears.
    """
    sailing = np.flatnonzero(places.water == Water.LANE)
    along = courses(places, coasts, sailing, np.full(len(sailing), after_s)).along_m
    _, gap = _nearest(sonars, places.coast[sailing], along)
    rows = np.concatenate([sonars.still, sailing[gap < 1.1 * FARTHEST_M]])
    sonar, _ = _nearest(sonars, places.coast[rows], places.along_m[rows])
    moved = slice(len(sonars.still), None)
    sonar[moved], _ = _nearest(sonars, places.coast[rows[moved]], along[gap < 1.1 * FARTHEST_M])
    true = courses(places, coasts, rows, after_s - sonars.delay_s[sonar])
    sonar, rows, true = sonar[true.there], rows[true.there], true.take(true.there)
    place, _ = geodetic(coasts, places.coast[rows], true.along_m, true.off_m, true.along_m_s, true.off_m_s)
    return sonar, rows, place, true.vessel


def _nearest(sonars: Sonars, coast: Ints, along_m: Floats) -> tuple[Ints, Floats]:
    """The sonar that is nearest along the coast to each point, and how far it is along it. Args: (n,), (n,). Returns: (n,), (n,)."""
    wanted = along_m + NOWHERE_NEAR_M * coast
    after = np.minimum(np.searchsorted(sonars.end_to_end_m, wanted), len(sonars.end_to_end_m) - 1)
    before = np.maximum(after - 1, 0)
    ahead, behind = (np.abs(sonars.end_to_end_m[k] - wanted) for k in (after, before))
    return np.where(ahead <= behind, after, before), np.minimum(ahead, behind)
