"""Passive sonars of a national picture: where they are, and the bearings that they report each cycle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import BearingReports, Floats, Ints, Struct, column
from coastwatch.geodesy import difference_m, to_plane
from scaling.load.national.coasts import Coasts, to_geodetic
from scaling.load.national.traffic import GOLDEN, Slots, Traffic, true_motion

TRACKS_PER_SONAR = 4000
CONTACTS_PER_SONAR = 100  # approximate
AUDIBLE_SHARE, MISS_PROBABILITY = 0.95, 0.05  # share of the vessels in range; per contact and cycle
OFFSHORE_M = 9.0e3  # between the anchorages and the lanes
MAX_RANGE_M = 1.5e4
SIGMA_RAD, BIAS_SIGMA_RAD = np.radians(1.0), np.radians(0.2)  # of one bearing; of the constant bias of a sonar
COAST_SEPARATION_M = 1.0e9  # between coasts on the common axis `axis_m`, more than any range


@dataclass(frozen=True, eq=False)
class Sonars(Struct):
    """S sonars in order along the coasts, and the slots near them that do not travel."""

    axis_m: Floats = column(np.float64, "S")  # position along all coasts laid end to end, increasing
    site_deg: Floats = column(np.float64, "S", 2)
    range_m: Floats = column(np.float64, "S")
    bias_rad: Floats = column(np.float64, "S")
    delay_s: Floats = column(np.float64, "S")  # time of its bearings before the end of the cycle
    fixed_slots: Ints = column(np.int64, "Q")  # rows of berths, anchorages and fleets near a sonar


def place_sonars(slots: Slots, coasts: Coasts, tracks: int, elapsed_s: float, period_s: float, seed: int) -> Sonars:
    """One sonar for every `TRACKS_PER_SONAR` tracks, with the range that gives about `CONTACTS_PER_SONAR` contacts at this time."""
    rng = np.random.Generator(np.random.SFC64([seed, 1 << 21]))
    count = max(1, tracks // TRACKS_PER_SONAR)
    along = (np.arange(count) + rng.uniform(0.3, 0.7, count)) / count * len(coasts.latitude_deg) * coasts.length_m
    coast = np.floor(along / coasts.length_m).astype(np.int64)
    along = along - coast * coasts.length_m
    zero = np.zeros(count)
    site, _ = to_geodetic(coasts, coast, along, zero + OFFSHORE_M, zero, zero)
    sonars = Sonars(
        along + COAST_SEPARATION_M * coast,
        site,
        zero + MAX_RANGE_M,
        BIAS_SIGMA_RAD * rng.standard_normal(count),
        rng.uniform(0.0, 1.0, count) * period_s,
        np.zeros(0, np.int64),
    )
    travels = np.isin(slots.kind, (Traffic.LANE, Traffic.OFFSHORE))
    _, gap = _nearest(sonars, slots.coast, slots.along_m)
    fixed = np.arange(len(slots))[~travels & (gap < 1.1 * MAX_RANGE_M)]
    sonars = Sonars(sonars.axis_m, site, sonars.range_m, sonars.bias_rad, sonars.delay_s, fixed)
    sonar, _, position, _ = _candidates(sonars, slots, coasts, elapsed_s)
    east_north = difference_m(position, site[sonar])
    distance = np.hypot(east_north[:, 0], east_north[:, 1])
    order = np.lexsort((distance, sonar))
    last = np.searchsorted(sonar[order], np.arange(count)) + round(CONTACTS_PER_SONAR / AUDIBLE_SHARE)
    enough = np.append(sonar[order], -1)[np.minimum(last, len(order))] == np.arange(count)
    range_m = np.where(enough, distance[order[np.minimum(last, len(order) - 1)]], MAX_RANGE_M)
    return Sonars(sonars.axis_m, site, range_m, sonars.bias_rad, sonars.delay_s, fixed)


def bearing_reports(
    sonars: Sonars, slots: Slots, coasts: Coasts, elapsed_s: float, start_s: float, rng: np.random.Generator
) -> BearingReports:
    """The bearings of every sonar in one cycle; a contact keeps its number while its vessel stays.

    Args: elapsed_s: end of the cycle, since the start; start_s: of the picture, since the Unix epoch.
    """
    sonar, rows, position, generation = _candidates(sonars, slots, coasts, elapsed_s)
    east_north = to_plane(position, sonars.site_deg[sonar])
    in_range = np.hypot(east_north[:, 0], east_north[:, 1]) <= sonars.range_m[sonar]
    detected = in_range & (rows * GOLDEN % 1.0 < AUDIBLE_SHARE) & (rng.uniform(0.0, 1.0, len(rows)) >= MISS_PROBABILITY)
    sonar, rows, generation, east_north = sonar[detected], rows[detected], generation[detected], east_north[detected]
    error = sonars.bias_rad[sonar] + SIGMA_RAD * rng.standard_normal(len(rows))
    bearing = np.degrees(np.arctan2(east_north[:, 0], east_north[:, 1]) + error) % 360.0
    time_s = start_s + elapsed_s - sonars.delay_s[sonar]
    origin = generation * len(slots) + rows
    none = np.full(len(rows), -1, np.int64)
    return BearingReports(sonar, time_s, time_s, bearing, origin, sonars.site_deg[sonar], none, origin)


def _candidates(sonars: Sonars, slots: Slots, coasts: Coasts, elapsed_s: float) -> tuple[Ints, Ints, Floats, Ints]:
    """Vessels that may be in range: sonar, slot, latitude and longitude (Q, 2) in degrees, generation.

    Offshore traffic is left out: it is beyond the range of every sonar.
    """
    lanes = np.flatnonzero(slots.kind == Traffic.LANE)
    along = true_motion(slots, coasts, lanes, np.full(len(lanes), elapsed_s)).along_m
    _, gap = _nearest(sonars, slots.coast[lanes], along)
    rows = np.concatenate([sonars.fixed_slots, lanes[gap < 1.1 * MAX_RANGE_M]])
    sonar, _ = _nearest(sonars, slots.coast[rows], slots.along_m[rows])
    moved = slice(len(sonars.fixed_slots), None)
    sonar[moved], _ = _nearest(sonars, slots.coast[rows[moved]], along[gap < 1.1 * MAX_RANGE_M])
    true = true_motion(slots, coasts, rows, elapsed_s - sonars.delay_s[sonar])
    sonar, rows, true = sonar[true.present], rows[true.present], true.take(true.present)
    shore = true.along_m, true.offshore_m, true.along_m_s, true.offshore_m_s
    position, _ = to_geodetic(coasts, slots.coast[rows], *shore)
    return sonar, rows, position, true.generation


def _nearest(sonars: Sonars, coast: Ints, along_m: Floats) -> tuple[Ints, Floats]:
    """The sonar nearest along the coast to each point, and its distance along the coast, metres. Args: (n,). Returns: (n,)."""
    axis_m = along_m + COAST_SEPARATION_M * coast
    after = np.minimum(np.searchsorted(sonars.axis_m, axis_m), len(sonars.axis_m) - 1)
    before = np.maximum(after - 1, 0)
    ahead, behind = (np.abs(sonars.axis_m[k] - axis_m) for k in (after, before))
    return np.where(ahead <= behind, after, before), np.minimum(ahead, behind)
