"""Who sees the places of a national picture: the posts that radars and AIS keep for them, a row a track that there may be.

Every place seen by radar has two posts, one of the regions with even and one of those with odd places on their coast, so that a vessel
where two regions overlap has a track in both. What is drawn here is drawn once; `reporting` makes tracks of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from coastwatch.batches import Array, Batch, Bools, Floats, Ints, column
from scaling.load.coasts import LONGEST_M, OVERLAP, REGION_M, Coasts, watched_by
from scaling.load.motion import ABSENT_S
from scaling.load.waters import FAR_OFF_M, LIVES_A_SECOND, VESSELS_A_METRE, Places, Water

BOTH = 0.514  # of the places, so that, with tracks that break, half of the vessels are in both at a time
UNBROKEN = 0.986  # of the time a post has a track while its vessel is there
MASKED = 0.6  # of the berths: no radar sees ships between buildings
STEADY_M_S = 14.0 * 1852.0 / 3600.0, 23.0 * 1852.0 / 3600.0  # at which the interval of AIS class A steps down
AIS_INTERVAL_S = 10.0, 6.0, 2.0
RADAR_BREAK_S, RADAR_GAP_S = (600.0, 1800.0), 20.0  # from the end of one track to that of the next, and between
AIS_BREAK_S, AIS_GAP_S = (1800.0, 5400.0), 40.0
RENAMED, RENAMED_EACH_S = 0.03, 900.0  # share of AIS tracks whose vessel changes its MMSI
NAMELESS = 0.2  # share of AIS tracks without covariance
AIS_SIGMA_M = (5.0, 10.0)  # of positions, a axis
MEMORY_S = (10.0, 20.0)  # time constant of the errors of a track
RADAR_PERIOD_S = (2.0, 4.0)  # between reports


class Kind(IntEnum):
    EVEN = 0
    ODD = 1
    AIS = 2


@dataclass(frozen=True, eq=False)
class Posts(Batch):
    """One row a track that there may be: radar before AIS, in no other order."""

    place: Array = column(np.int32, "R")
    kind: Array = column(np.int8, "R")
    interval_s: Floats = column(np.float64, "R")  # between reports
    phase: Array = column(np.float32, "R")  # 0 to 1, of the reports
    sigma_m: Array = column(np.float32, "R")  # of AIS positions, a axis
    memory_s: Array = column(np.float32, "R")
    break_s: Array = column(np.float32, "R")  # from one track to the next
    named_s: Array = column(np.float32, "R")  # from one MMSI to the next, inf: for ever
    known: Bools = column(np.bool_, "R")  # whether a track has a covariance


def places_for(tracks: int) -> int:
    """How many places have so many tracks, on average.

    With V vessels, half of them seen by both, a share r by radar and a by AIS alone, r + a = 1/2, and a share o of what radar sees in
    two regions, (1/2 + r)(1 + o) V = (1/2 + a) V are the tracks of either kind: V = 0.64 N at o = 0.1, 2 N / 3 without overlap. Some are
    absent between two vessels, or two tracks.
    """
    regions = max(2, round(0.64 * tracks / VESSELS_A_METRE / REGION_M))
    overlap = OVERLAP * (1.0 - 1.0 / min(regions, LONGEST_M / REGION_M))
    alone = (1.0 + overlap - BOTH) / (2.0 + overlap)  # share of vessels seen by AIS alone
    there = 1.0 - ABSENT_S * LIVES_A_SECOND
    return max(20, round(tracks / (2.0 * (BOTH + alone) * there * UNBROKEN)))


def appoint(places: Places, coasts: Coasts, seed: int) -> Posts:
    """The posts of these places: half of them both, and as many tracks of radars as of AIS."""
    rng = np.random.Generator(np.random.SFC64([seed, 1 << 20]))
    radar, ais = _seen_by(places, coasts, rng)
    travels = (places.water == Water.LANE) | (places.water == Water.OFFSHORE)
    watched = [radar & (travels | (region >= 0)) for region in watched_by(coasts, places.coast, places.along_m)]
    kinds = zip(Kind, (*watched, ais), strict=True)
    return Posts.join([_posts(rng, places, rng.permutation(np.flatnonzero(wanted)), kind) for kind, wanted in kinds])


def _seen_by(places: Places, coasts: Coasts, rng: np.random.Generator) -> tuple[Bools, Bools]:
    """Which places radars see and which have AIS; every place has one of them at least."""
    count = len(places)
    masked = (places.water == Water.BERTH) & (rng.uniform(0.0, 1.0, count) < MASKED)
    masked |= (places.water == Water.OFFSHORE) & (places.off_m >= FAR_OFF_M[0])
    even, odd = watched_by(coasts, places.coast, places.along_m)
    free = rng.permutation(np.flatnonzero(~masked))
    both = round(BOTH * count)
    twice = float(((even >= 0) & (odd >= 0))[free].mean())
    radar_alone = round((count * (1.0 - BOTH * twice) - both) / (2.0 + twice))  # so that there are as many tracks of both kinds
    radar, ais = np.zeros(count, bool), np.ones(count, bool)
    radar[free[: both + radar_alone]] = True
    ais[free[both : both + radar_alone]] = False
    return radar, ais


def _posts(rng: np.random.Generator, places: Places, place: Ints, kind: int) -> Posts:
    count, of_ais = len(place), kind == Kind.AIS
    speed = np.abs(places.speed_m_s[place])
    interval = np.array(AIS_INTERVAL_S)[np.searchsorted(STEADY_M_S, speed, side="right")]
    if not of_ais:
        interval = rng.uniform(*RADAR_PERIOD_S, count)
    renamed = of_ais & (rng.uniform(0.0, 1.0, count) < RENAMED)
    columns = (
        rng.uniform(0.0, 1.0, count),
        rng.uniform(*AIS_SIGMA_M, count),
        rng.uniform(*MEMORY_S, count),
        rng.uniform(*(AIS_BREAK_S if of_ais else RADAR_BREAK_S), count),
        np.where(renamed, RENAMED_EACH_S, np.inf),
    )
    known = ~(of_ais & (rng.uniform(0.0, 1.0, count) < NAMELESS))
    single = [np.asarray(values, np.float32) for values in columns]
    return Posts(place.astype(np.int32), np.full(count, kind, np.int8), interval, *single, known)
