"""Tracks as regions and AIS receivers hand them to the centre: each at the time of its own newest report, with errors that last."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Array, Bools, Floats, Ints, Struct, Tracks, column
from coastwatch.geodesy import difference_m, scale_m_deg, wrap_deg
from scaling.load.carriers import AIS_GAP_S, RADAR_GAP_S, Kind, Posts
from scaling.load.coasts import Coasts, geodetic, radar_near, radar_sites, watched_by
from scaling.load.motion import Courses, courses
from scaling.load.waters import Places

ID_STEP = 2**40  # a track's id is its source times this and a number of its own
FIRST_MMSI, MMSIS = 201_000_000, 570_000_000
ROWS = 1 << 16  # worked on at a time, so that what is in between stays in cache
RANGE_SIGMA_M, AZIMUTH_SIGMA_RAD = 15.0, np.radians(0.1)  # of one report of a radar
SMOOTHED, SIGMA_M = (
    0.4,
    (10.0, 25.0),
)  # of that what is left in a track, across the beam; not outside these, along the beam the lesser
SPEED_SHARE = 0.03  # standard deviation of a velocity, a second of that of the position
ALIKE = 0.5  # correlation of the errors of position and velocity


@dataclass(frozen=True, eq=False)
class Journal(Struct):
    """What must be known of the last cycle, a row a post: errors in standard deviations, the track, its first and newest report."""

    error: Array = column(np.float32, "R", 4)
    track_id: Ints = column(np.int64, "R")  # -1: there was none
    started_s: Floats = column(np.float64, "R")
    updated_s: Floats = column(np.float64, "R")

    @staticmethod
    def blank(count: int) -> Journal:
        never = np.full(count, -np.inf)
        return Journal(np.zeros((count, 4), np.float32), np.full(count, -1, np.int64), never, never)


def report(
    places: Places, posts: Posts, coasts: Coasts, journal: Journal, after_s: float, start_s: float, rng: np.random.Generator
) -> tuple[Journal, Tracks]:
    """The journal after this cycle, and the tracks that there are, radar before AIS.

    Args: after_s: time of the cycle, since the start; start_s: of the picture, since the Unix epoch.
    """
    count, sites = len(posts), radar_sites(coasts)
    after = Journal(*(np.empty_like(a) for a in (journal.error, journal.track_id, journal.started_s, journal.updated_s)))
    out = _room(count)
    done = 0
    for lo in range(0, count, ROWS):
        mine = slice(lo, min(lo + ROWS, count))
        room = {name: values[done:] for name, values in out.items()}
        done += _block(places, posts.take(mine), coasts, sites, journal, after, mine=mine, after_s=after_s, rng=rng, out=room)
    rows = slice(0, done)
    out["updated_s"][rows] += start_s
    out["started_s"][rows] += start_s
    out["time_s"][rows] = out["updated_s"][rows]
    return after, Tracks(**{name: values[rows] for name, values in out.items()})


def _room(count: int) -> dict[str, Array]:
    """Room for as many tracks; what is not used is never touched, and so takes no memory."""
    shapes = {"position_deg": (2,), "velocity_m_s": (2,), "covariance": (4, 4), "report_covariance": (2, 2)}
    numbers, times = ("track_id", "source", "mmsi", "origin"), ("time_s", "updated_s", "started_s")
    out: dict[str, Array] = {name: np.empty(count, np.int64) for name in numbers}
    out |= {name: np.empty(count) for name in times}
    return out | {name: np.empty((count, *shape)) for name, shape in shapes.items()}


def _block(
    places: Places,
    posts: Posts,
    coasts: Coasts,
    sites: Floats,
    journal: Journal,
    after: Journal,
    *,
    mine: slice,
    after_s: float,
    rng: np.random.Generator,
    out: dict[str, Array],
) -> int:
    """How many tracks some posts have, which stand in the rows `mine` of the journals. Their rows of `after` and `out` are written."""
    time_s = (np.floor(after_s / posts.interval_s + posts.phase) - posts.phase) * posts.interval_s
    true = courses(places, coasts, posts.place, time_s)
    source, number, name = _named(places, posts, coasts, true, time_s)
    track_id = np.where(source >= 0, source * ID_STEP + number, -1)
    fresh = track_id != journal.track_id[mine]
    after.track_id[mine], after.updated_s[mine] = track_id, np.where(source >= 0, time_s, -np.inf)
    after.started_s[mine] = np.where(fresh, time_s, journal.started_s[mine])
    keep = np.where(fresh, 0.0, np.exp((journal.updated_s[mine] - time_s) / posts.memory_s))[:, None]
    normal = rng.standard_normal((len(posts), 4), np.float32)
    after.error[mine] = keep * journal.error[mine] + np.sqrt(1.0 - keep * keep) * normal
    rows = np.flatnonzero(source >= 0)
    place = (a[rows] for a in (true.along_m, true.off_m, true.along_m_s, true.off_m_s))
    position, velocity = geodetic(coasts, places.coast[posts.place[rows]], *place)
    radar = np.where(posts.kind[rows] == Kind.AIS, 0, source[rows])
    site = sites[radar_near(coasts, radar, true.along_m[rows])]
    spread = out["covariance"][: len(rows)]
    error, reported = _misplaced(posts, rows, difference_m(position, site), after.error[mine][rows], spread)
    north, east = scale_m_deg(position[:, 0])
    longitude = wrap_deg(position[:, 1] + error[:, 0] / east)
    columns = {
        "track_id": track_id[rows],
        "source": source[rows],
        "position_deg": np.stack([position[:, 0] + error[:, 1] / north, longitude], axis=-1),
        "velocity_m_s": velocity + error[:, 2:],
        "report_covariance": reported,
        "updated_s": time_s[rows],
        "started_s": after.started_s[mine][rows],
        "mmsi": name[rows],
        "origin": (true.vessel * len(places) + posts.place)[rows],
    }
    for key, values in columns.items():
        out[key][: len(rows)] = values
    return len(rows)


def _named(places: Places, posts: Posts, coasts: Coasts, true: Courses, time_s: Floats) -> tuple[Ints, Ints, Ints]:
    """The source of each post's track, -1 where there is none; its number, never given twice by a source; its MMSI or -1."""
    of_ais, count = posts.kind == Kind.AIS, len(posts)
    regions = np.stack(watched_by(coasts, places.coast[posts.place], true.home_m))
    ais_source = len(coasts.latitude_deg) * coasts.regions
    source = np.where(of_ais, ais_source, regions[np.minimum(posts.kind, Kind.ODD), np.arange(count)])
    breaks = time_s / posts.break_s + posts.phase
    begun = np.floor(breaks)
    silent: Bools = (breaks - begun) * posts.break_s < np.where(of_ais, AIS_GAP_S, RADAR_GAP_S)
    names = true.vessel + np.floor(time_s / posts.named_s + posts.phase).astype(np.int64)
    number = len(places) * (np.where(of_ais, names, true.vessel) + begun.astype(np.int64)) + posts.place
    mmsi = np.where(of_ais, FIRST_MMSI + (len(places) * names + posts.place) % MMSIS, -1)
    return np.where(true.there & ~silent, source, -1), number, mmsi


def _misplaced(posts: Posts, rows: Ints, from_site_m: Floats, error: Array, covariance: Floats) -> tuple[Floats, Floats]:
    """Errors (R, 4) of the tracks of these rows, and covariances (R, 2, 2) of one report; those of the tracks (R, 4, 4) are written.

    Args: from_site_m: (R, 2) from the radar; error: (R, 4) in standard deviations, along and across the beam, then of the velocity
    what does not follow from the position.
    """
    of_ais, distance = posts.kind[rows] == Kind.AIS, np.hypot(from_site_m[:, 0], from_site_m[:, 1])
    beam = from_site_m / distance[:, None]
    plot = AZIMUTH_SIGMA_RAD * distance
    along = np.where(of_ais, posts.sigma_m[rows], SIGMA_M[0])
    across = np.where(of_ais, posts.sigma_m[rows], np.clip(SMOOTHED * plot, *SIGMA_M))
    off = _turned(beam, along * error[:, 0], across * error[:, 1])
    own = _turned(beam, along * error[:, 2], across * error[:, 3])
    speed = SPEED_SHARE * (ALIKE * off + np.sqrt(1.0 - ALIKE**2) * own)
    block = _ellipse(beam, along, across)
    covariance[:, :2, :2] = block
    covariance[:, 2:, 2:] = SPEED_SHARE**2 * block
    covariance[:, :2, 2:] = covariance[:, 2:, :2] = ALIKE * SPEED_SHARE * block
    covariance[~posts.known[rows]] = np.nan
    reported = _ellipse(beam, np.where(of_ais, along, RANGE_SIGMA_M), np.where(of_ais, across, plot))
    return np.concatenate([off, speed], axis=1), reported


def _turned(beam: Floats, along: Floats, across: Floats) -> Floats:
    """East and north of what lies along and across the beam. (R, 2)"""
    return np.stack([beam[:, 0] * along - beam[:, 1] * across, beam[:, 1] * along + beam[:, 0] * across], axis=-1)


def _ellipse(beam: Floats, along: Floats, across: Floats) -> Floats:
    """Covariance east and north of standard deviations along and across the beam. (R, 2, 2)"""
    a, b = along**2, across**2
    both = (a - b) * beam[:, 0] * beam[:, 1]
    east, north = a * beam[:, 0] ** 2 + b * beam[:, 1] ** 2, a * beam[:, 1] ** 2 + b * beam[:, 0] ** 2
    return np.stack([east, both, both, north], axis=-1).reshape(-1, 2, 2)
