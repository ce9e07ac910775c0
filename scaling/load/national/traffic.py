"""The true traffic of a national picture: slots drawn once, and where the vessel of each slot is at a given time.

A slot is a berth, an anchor position, a position in a lane, a trawler's ground or an offshore route. One vessel after another
occupies it. Slots are drawn by `draw_slots`; `true_motion` is a function of slot and time alone, without state.

No two vessels share the same water. Each kind of traffic has its own strip along the coast. Lanes are strings of ships 250 m
apart. Trawlers pass each other at 100 to 200 m. A ship at anchor swings in a circle of its own.

Three columns of a slot mean something else for each kind of traffic:

| kind      | `extent_m`                    | `lateral`                          | `period_s`                 |
|-----------|-------------------------------|------------------------------------|----------------------------|
| berth     | -                             | -                                  | -                          |
| anchorage | radius of the swing circle    | amplitude of the yaw, rad          | of the yaw                 |
| lane      | amplitude along the lane      | amplitude across the lane, m       | of both                    |
| fleet     | half of a straight leg        | radius of the turns, m             | from one halt to the next  |
| offshore  | -                             | speed away from the coast, m/s     | -                          |
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from itertools import pairwise

import numpy as np

from coastwatch.batches import Array, Batch, Bools, Floats, Ints, column
from scaling.load.national.coasts import Coasts


class Traffic(IntEnum):
    """Kind of traffic."""

    BERTH = 0
    ANCHORAGE = 1
    LANE = 2
    FLEET = 3
    OFFSHORE = 4


SHARES = (0.12, 0.20, 0.30, 0.20, 0.18)  # of the slots, by kind of traffic
VESSELS_PER_METRE = 0.02  # of coast: 20 per kilometre at any size of the picture
LIFETIME_S = 1800.0, 5400.0  # from one vessel of a slot to the next
MEAN_LIVES_PER_S = float(np.log(LIFETIME_S[1] / LIFETIME_S[0])) / (LIFETIME_S[1] - LIFETIME_S[0])
ABSENT_S = 150.0  # from the end of one vessel of a slot to the arrival of the next
PORT_SPACING_M = 3.7e4  # approximate; not a divisor of the length of a region, so region borders fall anywhere between ports
PORT_LOG_SIGMA, PORT_MAX_SIZE = 0.5, 2.5  # standard deviation of the logarithm of a port's size; limit, in mean sizes
BERTHS_PER_QUAY, QUAY_SPACING_M, BERTH_SPACING_M = 30, 400.0, (120.0, 260.0)
ANCHORAGES_PER_PORT, ANCHOR_SPACING_M, ANCHORAGE_WIDTH_M = 3, (120.0, 450.0), 5.0e3
STRINGS, STRING_SPACING_M, LANE_OFFSHORE_M = 8, 250.0, (1.1e4, 1.5e4)  # strings each way; northbound and southbound lane
LANE_SPEED_M_S = (4.0, 12.9)  # of the innermost and the outermost string: 8 to 25 kn
FLEET_ROWS, FLEET_ROW_SPACING_M, FLEET_COLUMNS = 12, 320.0, 4
FLEET_OFFSHORE_M = (2.1e4, 2.65e4)  # of every other fleet
NEAR_OFFSHORE_M, FAR_OFFSHORE_M = (3.1e4, 4.3e4), (4.6e4, 6.0e4)  # strips inside and outside radar cover
NEAR_SHARE = 0.45
HALT_S, BRAKING_S = 240.0, 30.0  # of a trawler
GOLDEN, PLASTIC = 0.6180339887498949, 0.7548776662466927  # low-discrepancy steps: successive vessels of a slot start far apart
WIND_VEER_RAD, WIND_PERIOD_S = 0.5, 2700.0  # all ships at anchor of a coast lie in the same wind


@dataclass(frozen=True, eq=False)
class Slots(Batch):
    """One row per slot, P in all; the module's docstring defines `extent_m`, `lateral` and `period_s`."""

    kind: Array = column(np.int8, "P")  # Traffic
    coast: Array = column(np.int16, "P")
    along_m: Floats = column(np.float64, "P")
    offshore_m: Array = column(np.float32, "P")
    speed_m_s: Array = column(np.float32, "P")  # along the coast, north positive; of a trawler along its path
    extent_m: Array = column(np.float32, "P")
    lateral: Array = column(np.float32, "P")
    period_s: Array = column(np.float32, "P")
    phase: Array = column(np.float32, "P")  # 0 to 1
    lifetime_s: Array = column(np.float32, "P")  # from one vessel of the slot to the next
    initial_age_s: Array = column(np.float32, "P")  # of the first vessel at the start


@dataclass(frozen=True, eq=False)
class TrueMotion(Batch):
    """True state of R vessels in shore coordinates."""

    along_m: Floats = column(np.float64, "R")
    offshore_m: Floats = column(np.float64, "R")
    along_m_s: Floats = column(np.float64, "R")
    offshore_m_s: Floats = column(np.float64, "R")
    region_along_m: Floats = column(np.float64, "R")  # position along the coast that decides the radar region; does not swing
    generation: Ints = column(np.int64, "R")  # number of vessels that occupied the slot before
    present: Bools = column(np.bool_, "R")


def draw_slots(coasts: Coasts, count: int, seed: int) -> Slots:
    """This number of slots, spread evenly over the coasts."""
    parts = []
    for coast, rows in enumerate(np.array_split(np.arange(count), len(coasts.latitude_deg))):
        rng = np.random.Generator(np.random.SFC64([seed, coast]))
        edge = np.round(np.cumsum((0.0, *SHARES)) * len(rows)).astype(np.int64)
        berths, anchored, in_lanes, fishing, offshore = np.diff(edge).tolist()
        parts += [
            _complete(rng, coast, *drawn)
            for drawn in (
                *_draw_ports(rng, coasts.length_m, berths, anchored),
                (Traffic.LANE, *_draw_lanes(rng, coasts.length_m, in_lanes)),
                (Traffic.FLEET, *_draw_fleets(rng, coasts.length_m, fishing)),
                (Traffic.OFFSHORE, *_draw_offshore(rng, coasts.length_m, offshore)),
            )
        ]
    return Slots.join(parts)


def true_motion(slots: Slots, coasts: Coasts, rows: Array, elapsed_s: Floats) -> TrueMotion:
    """The vessel of each of these slots at a time. Args: rows: (R,) of slots; elapsed_s: (R,) since the start."""
    lives = (elapsed_s + slots.initial_age_s[rows]) / slots.lifetime_s[rows]
    generation = np.floor(lives)
    age_s = (lives - generation) * slots.lifetime_s[rows]
    along_m, offshore_m, along_m_s, offshore_m_s, region_along_m = np.zeros((5, len(rows)))
    moving = along_m, offshore_m, along_m_s, offshore_m_s, region_along_m
    out = TrueMotion(*moving, generation.astype(np.int64), age_s >= ABSENT_S)
    kinds = slots.kind[rows]
    for kind, move in MOTION_OF.items():
        at = np.flatnonzero(kinds == kind)
        if len(at):
            move(slots.take(rows[at]), coasts, elapsed_s[at], age_s[at], out, at)
    return out


Drawn = tuple[Floats, Floats, Floats, Floats, Floats, Floats]
"""along_m, offshore_m, speed_m_s, extent_m, lateral, period_s of slots of one kind."""


def _complete(rng: np.random.Generator, coast: int, kind: Traffic, *drawn: Floats) -> Slots:
    """The slots of one kind of traffic, with phase, lifetime and initial age. Args: drawn: as `Drawn`."""
    along, *rest = drawn
    count = len(along)
    lifetime = rng.uniform(*LIFETIME_S, count)
    rows = (*rest, rng.uniform(0.0, 1.0, count), lifetime, rng.uniform(0.0, 1.0, count) * lifetime)
    single = [np.asarray(values, np.float32) for values in rows]
    return Slots(np.full(count, kind, np.int8), np.full(count, coast, np.int16), along, *single)


def _draw_ports(rng: np.random.Generator, length_m: float, berths: int, anchored: int) -> list[tuple[Traffic, *Drawn]]:
    """The berths and the anchorages of every port of a coast."""
    ports = max(1, round(length_m / PORT_SPACING_M))
    size = np.minimum(np.exp(PORT_LOG_SIGMA * rng.standard_normal(ports)), PORT_MAX_SIZE)
    middle = (np.arange(ports) + rng.uniform(0.3, 0.7, ports)) * length_m / ports
    moored, at_anchor = (_apportion(total, size) for total in (berths, anchored))
    out: list[tuple[Traffic, *Drawn]] = []
    for k in range(ports):
        out.append((Traffic.BERTH, *_draw_berths(rng, middle[k], int(moored[k]))))
        out.append((Traffic.ANCHORAGE, *_draw_anchorages(rng, middle[k], int(at_anchor[k]))))
    return out


def _apportion(total: int, weight: Floats) -> Ints:
    """Whole numbers in proportion to the weights, with this total."""
    shares: Floats = np.cumsum(np.concatenate([np.zeros(1), weight])) / weight.sum()
    return np.diff(np.round(shares * total)).astype(np.int64)


def _draw_berths(rng: np.random.Generator, middle_m: float, count: int) -> Drawn:
    """Quays one behind the other, with ships along them."""
    quay, number = np.divmod(np.arange(count), BERTHS_PER_QUAY)
    gap = np.where(number == 0, 0.0, rng.uniform(*BERTH_SPACING_M, count))
    run = np.cumsum(gap)
    along = run - run[quay * BERTHS_PER_QUAY] if count else run
    zero = np.zeros(count)
    begin = middle_m - 0.5 * BERTHS_PER_QUAY * sum(BERTH_SPACING_M) / 2.0
    return begin + along, 300.0 + QUAY_SPACING_M * quay, zero, zero, zero, zero


def _draw_anchorages(rng: np.random.Generator, middle_m: float, count: int) -> Drawn:
    """Anchorages side by side. Each is a triangular lattice of its own width, with every anchor a little off its point."""
    along, offshore, spacing = np.zeros(count), np.zeros(count), np.zeros(count)
    edge = np.round(np.linspace(0, count, ANCHORAGES_PER_PORT + 1)).astype(np.int64)
    begins = 0.0
    for first, last in pairwise(edge.tolist()):
        width = float(np.exp(rng.uniform(*np.log(ANCHOR_SPACING_M))))
        rows = max(1, int(ANCHORAGE_WIDTH_M / (0.866 * width)))
        column_, row = np.divmod(np.arange(last - first), rows)
        along[first:last] = begins + width * (column_ + 0.5 * (row % 2))
        offshore[first:last] = 3.0e3 + 0.866 * width * row
        spacing[first:last] = width
        begins = float(along[first:last].max(initial=begins)) + 1.5 * width
    along, offshore = (values + 0.08 * spacing * rng.standard_normal(count) for values in (along, offshore))
    swing, yaw = spacing * rng.uniform(0.2, 0.3, count), rng.uniform(0.15, 0.35, count)
    return middle_m - 0.5 * begins + along, offshore, np.zeros(count), swing, yaw, rng.uniform(400.0, 900.0, count)


def _draw_lanes(rng: np.random.Generator, length_m: float, count: int) -> Drawn:
    """Strings of ships at constant distance to the ship ahead; each string is faster than the next one inshore."""
    string = np.arange(count) * 2 * STRINGS // max(count, 1)
    size = np.bincount(string, minlength=2 * STRINGS)
    number = np.arange(count) - np.concatenate([[0], np.cumsum(size)])[string]
    along = (number + rng.uniform(-0.4, 0.4, count)) % size[string] * length_m / size[string]
    lane, position = np.divmod(string, STRINGS)
    speed = LANE_SPEED_M_S[0] + (LANE_SPEED_M_S[1] - LANE_SPEED_M_S[0]) * position / (STRINGS - 1)
    offshore = np.array(LANE_OFFSHORE_M)[lane] + STRING_SPACING_M * position
    wander = rng.uniform(10.0, 30.0, count), rng.uniform(10.0, 30.0, count)
    return along, offshore, np.where(lane == 0, speed, -speed), *wander, rng.uniform(400.0, 900.0, count)


def _draw_fleets(rng: np.random.Generator, length_m: float, count: int) -> Drawn:
    """Trawlers that tow to and fro beside each other, by fleets; fleets alternate between two strips."""
    fleet, number = np.divmod(np.arange(count), FLEET_ROWS * FLEET_COLUMNS)
    fleets = -(-count // (FLEET_ROWS * FLEET_COLUMNS))
    column_, row = np.divmod(number, FLEET_ROWS)
    radius, half = rng.uniform(60.0, 110.0, count), rng.uniform(500.0, 1200.0, count)
    pitch = 2.0 * (1200.0 + 110.0) + 250.0
    along = (fleet + 0.5) * length_m / max(fleets, 1) + pitch * (column_ - 0.5 * (FLEET_COLUMNS - 1))
    offshore = np.array(FLEET_OFFSHORE_M)[fleet % 2] + FLEET_ROW_SPACING_M * row
    speed = rng.uniform(1.5, 2.5, count)
    return along, offshore, speed, half, radius, rng.uniform(1200.0, 2400.0, count)


def _draw_offshore(rng: np.random.Generator, length_m: float, count: int) -> Drawn:
    """Ships anywhere, northbound and southbound, on straight courses that diverge a little from the coast."""
    near = np.arange(count) < round(NEAR_SHARE * count)
    low, high = (np.where(near, NEAR_OFFSHORE_M[k], FAR_OFFSHORE_M[k]) for k in range(2))
    offshore = low + (high - low) * rng.uniform(0.0, 1.0, count)
    speed = rng.uniform(5.0, 9.0, count) * rng.choice([-1.0, 1.0], count)
    along = rng.uniform(0.0, length_m, count)
    return along, offshore, speed, np.zeros(count), rng.uniform(-0.2, 0.2, count), np.zeros(count)


Move = Callable[[Slots, Coasts, Floats, Floats, TrueMotion, Ints], None]
"""Writes rows `at` of `out`: (slots, coasts, elapsed_s, age_s, out, at); the first four are of these rows alone."""


def _write(out: TrueMotion, at: Ints, *values: Array) -> None:
    """Args: values: along_m, offshore_m, along_m_s, offshore_m_s, region_along_m."""
    columns = out.along_m, out.offshore_m, out.along_m_s, out.offshore_m_s, out.region_along_m
    for target, value in zip(columns, values, strict=True):
        target[at] = value


def _moored(slots: Slots, coasts: Coasts, elapsed_s: Floats, age_s: Floats, out: TrueMotion, at: Ints) -> None:
    """At rest."""
    _write(out, at, slots.along_m, slots.offshore_m, np.zeros(len(at)), np.zeros(len(at)), slots.along_m)


def _at_anchor(slots: Slots, coasts: Coasts, elapsed_s: Floats, age_s: Floats, out: TrueMotion, at: Ints) -> None:
    """On a circle about the anchor: the direction is that of the wind, common to the coast, plus the ship's own yaw."""
    yaw_rate, wind_rate = 2.0 * np.pi / slots.period_s, 2.0 * np.pi / WIND_PERIOD_S
    yaw_phase = yaw_rate * elapsed_s + 2.0 * np.pi * slots.phase
    angle = slots.coast + WIND_VEER_RAD * np.sin(wind_rate * elapsed_s) + slots.lateral * np.sin(yaw_phase)
    rate = WIND_VEER_RAD * wind_rate * np.cos(wind_rate * elapsed_s) + slots.lateral * yaw_rate * np.cos(yaw_phase)
    cos, sin = slots.extent_m * np.cos(angle), slots.extent_m * np.sin(angle)
    _write(out, at, slots.along_m + cos, slots.offshore_m + sin, -rate * sin, rate * cos, slots.along_m)


def _in_lane(slots: Slots, coasts: Coasts, elapsed_s: Floats, age_s: Floats, out: TrueMotion, at: Ints) -> None:
    """Along the coast to its end, where the next vessel enters at the other end."""
    laps = (slots.along_m + slots.speed_m_s * elapsed_s) / coasts.length_m
    completed = np.floor(laps)
    frequency = 2.0 * np.pi / slots.period_s
    angle = frequency * elapsed_s + 2.0 * np.pi * slots.phase
    along = (laps - completed) * coasts.length_m + slots.extent_m * np.sin(angle)
    along_m_s = slots.speed_m_s + slots.extent_m * frequency * np.cos(angle)
    offshore = slots.offshore_m + slots.lateral * np.sin(angle + 1.0)
    offshore_m_s = slots.lateral * frequency * np.cos(angle + 1.0)
    _write(out, at, along, offshore, along_m_s, offshore_m_s, along)
    out.generation[at] += np.abs(completed).astype(np.int64)


def _fishing(slots: Slots, coasts: Coasts, elapsed_s: Floats, age_s: Floats, out: TrueMotion, at: Ints) -> None:
    """To and fro on two straight legs joined by half circles, with a halt in each period."""
    travelled_m, speed_share = _towed(slots, elapsed_s)
    straight, bend = 2.0 * slots.extent_m, np.pi * slots.lateral
    position = (travelled_m + slots.phase * 2.0 * (straight + bend)) % (2.0 * (straight + bend))
    back = position >= straight + bend
    position = np.where(back, position - straight - bend, position)
    angle = np.maximum(position - straight, 0.0) / slots.lateral  # in the turn
    along = -slots.extent_m + np.minimum(position, straight) + slots.lateral * np.sin(angle)
    offshore = -slots.lateral * np.cos(angle)
    sign, speed = np.where(back, -1.0, 1.0), slots.speed_m_s * speed_share
    _write(
        out,
        at,
        slots.along_m + sign * along,
        slots.offshore_m + sign * offshore,
        sign * speed * np.cos(angle),
        sign * speed * np.sin(angle),
        slots.along_m,
    )


def _towed(slots: Slots, elapsed_s: Floats) -> tuple[Floats, Floats]:
    """Metres along the path, and the share of its speed: 1, 0 at a halt, between while it brakes or accelerates."""
    towing_s = slots.period_s - HALT_S
    periods = elapsed_s / slots.period_s + slots.phase
    completed = np.floor(periods)
    x = (periods - completed) * slots.period_s
    first, last = np.minimum(x, BRAKING_S), np.clip(x - (towing_s - BRAKING_S), 0.0, BRAKING_S)
    steady = np.clip(x - BRAKING_S, 0.0, towing_s - 2.0 * BRAKING_S)
    gone = first**2 / (2.0 * BRAKING_S) + steady + last - last**2 / (2.0 * BRAKING_S)
    return slots.speed_m_s * (completed * (towing_s - BRAKING_S) + gone), (first - last) / BRAKING_S


def _offshore(slots: Slots, coasts: Coasts, elapsed_s: Floats, age_s: Floats, out: TrueMotion, at: Ints) -> None:
    """Straight on; each vessel of a slot starts elsewhere, on the same side of the edge of radar cover."""
    generation = out.generation[at]
    far = slots.offshore_m >= FAR_OFFSHORE_M[0]
    low, high = (np.where(far, FAR_OFFSHORE_M[k], NEAR_OFFSHORE_M[k]) for k in range(2))
    begin = (slots.along_m / coasts.length_m + GOLDEN * generation) % 1.0 * coasts.length_m
    begin_offshore = low + ((slots.offshore_m - low) / (high - low) + PLASTIC * generation) % 1.0 * (high - low)
    along = begin + slots.speed_m_s * age_s
    _write(out, at, along, begin_offshore + slots.lateral * age_s, slots.speed_m_s, slots.lateral, along)


MOTION_OF: dict[Traffic, Move] = {
    Traffic.BERTH: _moored,
    Traffic.ANCHORAGE: _at_anchor,
    Traffic.LANE: _in_lane,
    Traffic.FLEET: _fishing,
    Traffic.OFFSHORE: _offshore,
}
