"""Where the vessels of places are at given times, and which vessel of its place each one is: functions of time alone.

| water     | `reach_m`                  | `aside`                        | `period_s`                    |
|-----------|----------------------------|--------------------------------|-------------------------------|
| berth     | -                          | -                              | -                             |
| anchorage | radius of the swing        | rad it sheers to each side     | of the sheering               |
| lane      | it runs ahead and falls back | m it wanders to each side    | of both                       |
| fleet     | half of a straight         | radius of the turns, m         | from one halt to the next     |
| offshore  | -                          | m/s away from the coast        | -                             |
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Array, Batch, Bools, Floats, Ints, column
from scaling.load.coasts import Coasts
from scaling.load.waters import FAR_OFF_M, NEAR_OFF_M, Places, Water

ABSENT_S = 150.0  # from the end of one vessel of a place to the coming of the next
HALT_S, BRAKING_S = 240.0, 30.0  # of a trawler
GOLDEN, PLASTIC = 0.6180339887498949, 0.7548776662466927  # steps that leave no two vessels of a place near each other
VEER_RAD, VEER_S = 0.5, 2700.0  # the wind, in which all ships at anchor lie


@dataclass(frozen=True, eq=False)
class Courses(Batch):
    """What is true of a vessel, in metres along and off its coast."""

    along_m: Floats = column(np.float64, "R")
    off_m: Floats = column(np.float64, "R")
    along_m_s: Floats = column(np.float64, "R")
    off_m_s: Floats = column(np.float64, "R")
    home_m: Floats = column(np.float64, "R")  # along the coast, by which it belongs to a region: does not swing
    vessel: Ints = column(np.int64, "R")  # how many vessels of the place came before
    there: Bools = column(np.bool_, "R")


def courses(places: Places, coasts: Coasts, rows: Array, after_s: Floats) -> Courses:
    """The vessel of each of these places at a time. Args: rows: (R,) of places; after_s: (R,) since the start."""
    lives = (after_s + places.born_s[rows]) / places.life_s[rows]
    vessel = np.floor(lives)
    age_s = (lives - vessel) * places.life_s[rows]
    out = Courses(*(np.zeros(len(rows)) for _ in range(5)), vessel.astype(np.int64), age_s >= ABSENT_S)
    water = places.water[rows]
    for kind, move in MOVES.items():
        at = np.flatnonzero(water == kind)
        if len(at):
            move(places.take(rows[at]), coasts, after_s[at], age_s[at], out, at)
    return out


Move = Callable[[Places, Coasts, Floats, Floats, Courses, Ints], None]


def _write(out: Courses, at: Ints, *values: Array) -> None:
    """Args: values: along, off, how they change, home."""
    columns = out.along_m, out.off_m, out.along_m_s, out.off_m_s, out.home_m
    for values_of, value in zip(columns, values, strict=True):
        values_of[at] = value


def _moored(mine: Places, coasts: Coasts, after_s: Floats, age_s: Floats, out: Courses, at: Ints) -> None:
    _write(out, at, mine.along_m, mine.off_m, np.zeros(len(at)), np.zeros(len(at)), mine.along_m)


def _swinging(mine: Places, coasts: Coasts, after_s: Floats, age_s: Floats, out: Courses, at: Ints) -> None:
    """On a circle about the anchor, down the wind, which is that of the whole coast, sheering to and fro."""
    beat, veer = 2.0 * np.pi / mine.period_s, 2.0 * np.pi / VEER_S
    own = beat * after_s + 2.0 * np.pi * mine.phase
    angle = mine.coast + VEER_RAD * np.sin(veer * after_s) + mine.aside * np.sin(own)
    rate = VEER_RAD * veer * np.cos(veer * after_s) + mine.aside * beat * np.cos(own)
    cos, sin = mine.reach_m * np.cos(angle), mine.reach_m * np.sin(angle)
    _write(out, at, mine.along_m + cos, mine.off_m + sin, -rate * sin, rate * cos, mine.along_m)


def _in_lane(mine: Places, coasts: Coasts, after_s: Floats, age_s: Floats, out: Courses, at: Ints) -> None:
    """Along the coast to its end, where another comes in at the other."""
    rounds = (mine.along_m + mine.speed_m_s * after_s) / coasts.length_m
    begun = np.floor(rounds)
    beat = 2.0 * np.pi / mine.period_s
    angle = beat * after_s + 2.0 * np.pi * mine.phase
    along = (rounds - begun) * coasts.length_m + mine.reach_m * np.sin(angle)
    along_m_s = mine.speed_m_s + mine.reach_m * beat * np.cos(angle)
    off, off_m_s = mine.off_m + mine.aside * np.sin(angle + 1.0), mine.aside * beat * np.cos(angle + 1.0)
    _write(out, at, along, off, along_m_s, off_m_s, along)
    out.vessel[at] += np.abs(begun).astype(np.int64)


def _fishing(mine: Places, coasts: Coasts, after_s: Floats, age_s: Floats, out: Courses, at: Ints) -> None:
    """To and fro between two half circles; it halts now and then."""
    gone, share = _towed(mine, after_s)
    straight, bend = 2.0 * mine.reach_m, np.pi * mine.aside
    place = (gone + mine.phase * 2.0 * (straight + bend)) % (2.0 * (straight + bend))
    back = place >= straight + bend
    place = np.where(back, place - straight - bend, place)
    angle = np.maximum(place - straight, 0.0) / mine.aside  # in the turn
    along = -mine.reach_m + np.minimum(place, straight) + mine.aside * np.sin(angle)
    off = -mine.aside * np.cos(angle)
    way, speed = np.where(back, -1.0, 1.0), mine.speed_m_s * share
    _write(
        out,
        at,
        mine.along_m + way * along,
        mine.off_m + way * off,
        way * speed * np.cos(angle),
        way * speed * np.sin(angle),
        mine.along_m,
    )


def _towed(mine: Places, after_s: Floats) -> tuple[Floats, Floats]:
    """Metres along the track, and the share of its speed: 1, 0 at a halt, between while it brakes and gathers way."""
    under_way = mine.period_s - HALT_S
    rounds = after_s / mine.period_s + mine.phase
    begun = np.floor(rounds)
    x = (rounds - begun) * mine.period_s
    first, last = np.minimum(x, BRAKING_S), np.clip(x - (under_way - BRAKING_S), 0.0, BRAKING_S)
    steady = np.clip(x - BRAKING_S, 0.0, under_way - 2.0 * BRAKING_S)
    gone = first**2 / (2.0 * BRAKING_S) + steady + last - last**2 / (2.0 * BRAKING_S)
    return mine.speed_m_s * (begun * (under_way - BRAKING_S) + gone), (first - last) / BRAKING_S


def _offshore(mine: Places, coasts: Coasts, after_s: Floats, age_s: Floats, out: Courses, at: Ints) -> None:
    """Straight on, each vessel of a place from a point of its own, all on the same side of the edge of radar cover."""
    vessel = out.vessel[at]
    far = mine.off_m >= FAR_OFF_M[0]
    low, high = (np.where(far, FAR_OFF_M[k], NEAR_OFF_M[k]) for k in range(2))
    begin = (mine.along_m / coasts.length_m + GOLDEN * vessel) % 1.0 * coasts.length_m
    begin_off = low + ((mine.off_m - low) / (high - low) + PLASTIC * vessel) % 1.0 * (high - low)
    along = begin + mine.speed_m_s * age_s
    _write(out, at, along, begin_off + mine.aside * age_s, mine.speed_m_s, mine.aside, along)


MOVES: dict[Water, Move] = {
    Water.BERTH: _moored,
    Water.ANCHORAGE: _swinging,
    Water.LANE: _in_lane,
    Water.FLEET: _fishing,
    Water.OFFSHORE: _offshore,
}
