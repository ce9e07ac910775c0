"""The places of a national picture and who is in them: berths, anchorages, lanes, fishing fleets and thin traffic offshore.

A place is where one vessel after the other is seen. What it holds is drawn once; where its vessel is at a time follows from that
(`motion`). No two vessels are in the same water: the kinds keep to strips off the coast of their own, lanes to strings that overtake
each other at 250 m, trawlers to tracks that pass each other at 100 to 200 m, ships at anchor to the circles in which they swing.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from itertools import pairwise

import numpy as np

from coastwatch.batches import Array, Batch, Floats, Ints, column
from scaling.load.coasts import Coasts


class Water(IntEnum):
    BERTH = 0
    ANCHORAGE = 1
    LANE = 2
    FLEET = 3
    OFFSHORE = 4


SHARES = (0.12, 0.20, 0.30, 0.20, 0.18)  # of the places
VESSELS_A_METRE = 0.02  # of coast: 20 a kilometre, whatever the size of the picture
LIFE_S = 1800.0, 5400.0  # from one vessel of a place to the next
LIVES_A_SECOND = float(np.log(LIFE_S[1] / LIFE_S[0])) / (LIFE_S[1] - LIFE_S[0])
PORT_M = 3.7e4  # of coast for one port, about; regions do not end between the same ports everywhere
PORT_SPREAD, PORT_MOST = 0.5, 2.5  # of the logarithm of a port's size; times the mean
BERTHS_A_QUAY, QUAY_APART_M, BERTH_M = 30, 400.0, (120.0, 260.0)  # from one berth to the next: a ship and what it needs
ANCHORAGES, ANCHOR_M, ANCHORAGE_WIDE_M = 3, (120.0, 450.0), 5.0e3  # a port; between anchors; off the coast
STRINGS, STRING_M, LANE_OFF_M = 8, 250.0, (1.1e4, 1.5e4)  # each way; north- and southbound
LANE_SPEED_M_S = (4.0, 12.9)  # of the innermost and the outermost string: 8 to 25 kn
ROWS, ROW_M, COLUMNS = 12, 320.0, 4  # of a fleet
FLEET_OFF_M = (2.1e4, 2.65e4)  # every other fleet
NEAR_OFF_M, FAR_OFF_M = (3.1e4, 4.3e4), (4.6e4, 6.0e4)  # offshore, inside and outside radar cover
NEAR_SHARE = 0.45


@dataclass(frozen=True, eq=False)
class Places(Batch):
    """One row a place. What `reach_m`, `aside` and `period_s` are in each water is said in `motion`."""

    water: Array = column(np.int8, "P")
    coast: Array = column(np.int16, "P")
    along_m: Floats = column(np.float64, "P")
    off_m: Array = column(np.float32, "P")
    speed_m_s: Array = column(np.float32, "P")  # along the coast, north positive; of a trawler along its track
    reach_m: Array = column(np.float32, "P")
    aside: Array = column(np.float32, "P")
    period_s: Array = column(np.float32, "P")
    phase: Array = column(np.float32, "P")  # 0 to 1
    life_s: Array = column(np.float32, "P")  # from one vessel of the place to the next
    born_s: Array = column(np.float32, "P")  # how long before the start the first one came


def settle(coasts: Coasts, count: int, seed: int) -> Places:
    """So many places, spread evenly over the coasts."""
    parts = []
    shares = np.array_split(np.arange(count), len(coasts.latitude_deg))
    for coast, mine in enumerate(shares):
        rng = np.random.Generator(np.random.SFC64([seed, coast]))
        edge = np.round(np.cumsum((0.0, *SHARES)) * len(mine)).astype(np.int64)
        berths, anchored, under_way, fishing, offshore = np.diff(edge).tolist()
        parts += [
            _complete(rng, coast, *made)
            for made in (
                *_ports(rng, coasts.length_m, berths, anchored),
                (Water.LANE, *_lanes(rng, coasts.length_m, under_way)),
                (Water.FLEET, *_fleets(rng, coasts.length_m, fishing)),
                (Water.OFFSHORE, *_offshore(rng, coasts.length_m, offshore)),
            )
        ]
    return Places.join(parts)


def _complete(rng: np.random.Generator, coast: int, water: Water, *drawn: Floats) -> Places:
    """The places of one water. Args: drawn: along, off, speed, reach, aside, period."""
    along, *rest = drawn
    count = len(along)
    life = rng.uniform(*LIFE_S, count)
    rows = (*rest, rng.uniform(0.0, 1.0, count), life, rng.uniform(0.0, 1.0, count) * life)
    single = [np.asarray(values, np.float32) for values in rows]
    return Places(np.full(count, water, np.int8), np.full(count, coast, np.int16), along, *single)


Drawn = tuple[Floats, Floats, Floats, Floats, Floats, Floats]


def _ports(rng: np.random.Generator, length_m: float, berths: int, anchored: int) -> list[tuple[Water, *Drawn]]:
    """The berths and the anchorages of every port of a coast."""
    ports = max(1, round(length_m / PORT_M))
    size = np.minimum(np.exp(PORT_SPREAD * rng.standard_normal(ports)), PORT_MOST)
    middle = (np.arange(ports) + rng.uniform(0.3, 0.7, ports)) * length_m / ports
    moored, at_anchor = (_shared_out(total, size) for total in (berths, anchored))
    made: list[tuple[Water, *Drawn]] = []
    for k in range(ports):
        made.append((Water.BERTH, *_berths(rng, middle[k], int(moored[k]))))
        made.append((Water.ANCHORAGE, *_anchorages(rng, middle[k], int(at_anchor[k]))))
    return made


def _shared_out(total: int, weight: Floats) -> Ints:
    return np.diff(np.round(np.cumsum(np.r_[0.0, weight]) / weight.sum() * total)).astype(np.int64)


def _berths(rng: np.random.Generator, middle_m: float, count: int) -> Drawn:
    """Quays one behind the other, ships along them."""
    quay, number = np.divmod(np.arange(count), BERTHS_A_QUAY)
    gap = np.where(number == 0, 0.0, rng.uniform(*BERTH_M, count))
    run = np.cumsum(gap)
    along = run - run[quay * BERTHS_A_QUAY] if count else run
    still = np.zeros(count)
    return middle_m - 0.5 * BERTHS_A_QUAY * sum(BERTH_M) / 2.0 + along, 300.0 + QUAY_APART_M * quay, still, still, still, still


def _anchorages(rng: np.random.Generator, middle_m: float, count: int) -> Drawn:
    """Anchorages side by side, each a lattice of triangles of its own width, every anchor dropped a little off its point."""
    along, off, apart = np.zeros(count), np.zeros(count), np.zeros(count)
    edge = np.round(np.linspace(0, count, ANCHORAGES + 1)).astype(np.int64)
    begins = 0.0
    for first, last in pairwise(edge.tolist()):
        width = float(np.exp(rng.uniform(*np.log(ANCHOR_M))))
        rows = max(1, int(ANCHORAGE_WIDE_M / (0.866 * width)))
        column_, row = np.divmod(np.arange(last - first), rows)
        along[first:last] = begins + width * (column_ + 0.5 * (row % 2))
        off[first:last] = 3.0e3 + 0.866 * width * row
        apart[first:last] = width
        begins = float(along[first:last].max(initial=begins)) + 1.5 * width
    along, off = (values + 0.08 * apart * rng.standard_normal(count) for values in (along, off))
    swing, yaw = apart * rng.uniform(0.2, 0.3, count), rng.uniform(0.15, 0.35, count)
    return middle_m - 0.5 * begins + along, off, np.zeros(count), swing, yaw, rng.uniform(400.0, 900.0, count)


def _lanes(rng: np.random.Generator, length_m: float, count: int) -> Drawn:
    """Strings of ships that keep their distance from the one ahead, each string faster than the one inside it."""
    string = np.arange(count) * 2 * STRINGS // max(count, 1)
    each = np.bincount(string, minlength=2 * STRINGS)
    number = np.arange(count) - np.concatenate([[0], np.cumsum(each)])[string]
    along = (number + rng.uniform(-0.4, 0.4, count)) % each[string] * length_m / each[string]
    way, place = np.divmod(string, STRINGS)
    speed = LANE_SPEED_M_S[0] + (LANE_SPEED_M_S[1] - LANE_SPEED_M_S[0]) * place / (STRINGS - 1)
    off = np.array(LANE_OFF_M)[way] + STRING_M * place
    wander = rng.uniform(10.0, 30.0, count), rng.uniform(10.0, 30.0, count)
    return along, off, np.where(way == 0, speed, -speed), *wander, rng.uniform(400.0, 900.0, count)


def _fleets(rng: np.random.Generator, length_m: float, count: int) -> Drawn:
    """Trawlers that tow to and fro beside each other, by fleets; fleets keep to two strips in turn."""
    fleet, number = np.divmod(np.arange(count), ROWS * COLUMNS)
    fleets = -(-count // (ROWS * COLUMNS))
    column_, row = np.divmod(number, ROWS)
    radius, half = rng.uniform(60.0, 110.0, count), rng.uniform(500.0, 1200.0, count)
    pitch = 2.0 * (1200.0 + 110.0) + 250.0
    along = (fleet + 0.5) * length_m / max(fleets, 1) + pitch * (column_ - 0.5 * (COLUMNS - 1))
    off = np.array(FLEET_OFF_M)[fleet % 2] + ROW_M * row
    speed = rng.uniform(1.5, 2.5, count)
    return along, off, speed, half, radius, rng.uniform(1200.0, 2400.0, count)


def _offshore(rng: np.random.Generator, length_m: float, count: int) -> Drawn:
    """Ships anywhere, northbound and southbound, on straight courses a little off the coast's."""
    near = np.arange(count) < round(NEAR_SHARE * count)
    low, high = (np.where(near, NEAR_OFF_M[k], FAR_OFF_M[k]) for k in range(2))
    off = low + (high - low) * rng.uniform(0.0, 1.0, count)
    speed = rng.uniform(5.0, 9.0, count) * rng.choice([-1.0, 1.0], count)
    along = rng.uniform(0.0, length_m, count)
    return along, off, speed, np.zeros(count), rng.uniform(-0.2, 0.2, count), np.zeros(count)
