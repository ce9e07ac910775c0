"""AIS reports into the filters of vessels: one vessel after the other, its reports in order of time, compiled by numba.

A track is a row of TRACK (made by `track_dtype`); the tracks of one vessel (one MMSI) stand in consecutive rows, its slots,
filled from the first; an empty slot has hits 0. A report is a row of REPORT. Everything here depends on the rows it is
given and on nothing else, so that reports played again from an earlier state give the same bits.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from coastwatch.kernels.imm import imm_estimate, imm_predict, imm_update
from coastwatch.kernels.tangent import SEMI_MAJOR, from_tangent, to_tangent, turn_to

REPORT = np.dtype(
    [("time", "f8"), ("mmsi", "i8"), ("lat", "f8"), ("lon", "f8"), ("sog", "f8"), ("cog", "f8"), ("class_b", "i8"), ("origin", "i8")]
)  # sog in m/s, cog in radians clockwise from north, NaN where not available
TAKEN, REPEAT, IMPOSSIBLE, CROWDED = 0, 1, 2, 3


class Rules(NamedTuple):
    """Settings of the filter, SI and radians. Letters J: models."""

    kind: np.ndarray  # (J,) 0 constant velocity, 1 coordinated turn
    noise: np.ndarray  # (J,)
    turn_noise: np.ndarray  # (J,)
    turn_sigma: np.ndarray  # (J,)
    sojourn: np.ndarray  # (J,)
    share: np.ndarray  # (J,) of time spent in each model
    position_variance: float
    sog_variance: float
    cog_variance: float
    still_speed: float  # under which a report without COG says that the vessel stands
    polar_speed: float  # at which COG begins to mean something
    jitter: float
    start_speed_variance: float
    max_speed: float
    tolerance: float  # added to the way that max_speed allows
    repeat: float
    patience_least: float
    patience_factor: float
    moving_a: float  # nominal intervals
    moving_b: float
    slow: float
    slow_speed: float
    forget: float  # after which an MMSI is a new vessel
    alarm: float
    reach: float  # from the anchor, before a new one is taken


def track_dtype(models: int) -> np.dtype:  # type: ignore[type-arg]
    """The row of a track whose IMM has so many models: state (J, 5) and covariance (J, 5, 5) in the plane at the anchor."""
    words = ["mmsi", "number", "confirmed", "hits", "class_b", "origin"]
    times = ["updated", "started", "heard", "interval", "expected", "patience", "alarm", "lat", "lon", "anchor_lat", "anchor_lon"]
    arrays = [("mode", "f8", (models,)), ("state", "f8", (models, 5)), ("covariance", "f8", (models, 5, 5))]
    return np.dtype([*((w, "i8") for w in words), *((t, "f8") for t in times), *arrays])


@njit(cache=True)
def absorb(tracks, first, slots, reports, begin, end, rules, stuck, verdict):  # type: ignore[no-untyped-def]
    """Each vessel's reports into its tracks, in place; what became of each report into `verdict`.

    Args: tracks: TRACK rows; first: (V,) first slot of each vessel; slots: of each vessel; reports: REPORT rows, each vessel's
        in order of time; begin, end: (V,) its rows; stuck: (V,) set where the slots did not suffice (its rows are then
        spoilt: start again from the former ones, with more); verdict: (M,) TAKEN, REPEAT, IMPOSSIBLE or CROWDED.
    """
    z, noise, moving = np.zeros((1, 4)), np.zeros((1, 4, 4)), np.zeros(1, np.bool_)
    for v in range(len(first)):
        stuck[v] = False
        for m in range(begin[v], end[v]):
            _expire(tracks, first[v], slots, reports[m].time, rules)
            verdict[m] = _hear(tracks, first[v], slots, reports[m], rules, z, noise, moving)
            if verdict[m] == CROWDED and slots == 1:
                stuck[v] = True
                break
            for t in range(first[v], first[v] + slots):
                if tracks[t].hits > 0:
                    tracks[t].heard = reports[m].time


@njit(cache=True)
def _expire(tracks, first, slots, time, rules):  # type: ignore[no-untyped-def]
    """Slots emptied of tracks too old to come back and of second tracks never confirmed; the others move up."""
    kept = first
    for t in range(first, first + slots):
        age = time - tracks[t].updated
        if tracks[t].hits == 0 or age > rules.forget or (tracks[t].confirmed == 0 and age > tracks[t].patience):
            continue
        if kept != t:
            tracks[kept] = tracks[t]
        kept += 1
    for t in range(kept, first + slots):
        tracks[t].hits = 0


@njit(cache=True)
def _hear(tracks, first, slots, report, rules, z, noise, moving):  # type: ignore[no-untyped-def]
    """The verdict on a report, which goes to the track it fits, or opens one."""
    best = _choose(tracks, first, slots, report, rules)
    if best >= 0:
        return _continue(tracks[best], report, rules, z, noise, moving)
    place, known = -1, False
    for t in range(first, first + slots):
        if tracks[t].hits > 0 and tracks[t].confirmed == 1:
            known = True
            tracks[t].alarm = report.time + rules.alarm
        elif place < 0:
            place = t
    if place < 0:
        return CROWDED
    outlier = known or tracks[place].hits > 0
    tracks[place].number = -1
    tracks[place].started = report.time
    tracks[place].hits = 0
    tracks[place].interval = 0.0
    tracks[place].alarm = -np.inf
    tracks[place].confirmed = 0 if known else 1
    _restart(tracks[place], report, rules, z, noise, moving)
    _book(tracks[place], report, rules)
    return IMPOSSIBLE if outlier else TAKEN


@njit(cache=True)
def _mean(track, k):  # type: ignore[no-untyped-def]
    """Element k of the state, averaged over the models."""
    total = 0.0
    for j in range(track.mode.shape[0]):
        total += track.mode[j] * track.state[j, k]
    return total


@njit(cache=True)
def _choose(tracks, first, slots, report, rules):  # type: ignore[no-untyped-def]
    """The row of the track that a ship could have come from, the live before the lost, then the nearest; -1 for none."""
    best, best_live, best_miss = -1, False, np.inf
    for t in range(first, first + slots):
        if tracks[t].hits == 0:
            break
        dt = report.time - tracks[t].updated
        east, north, up = to_tangent(report.lat, report.lon, tracks[t].anchor_lat, tracks[t].anchor_lon)
        de, dn = east - _mean(tracks[t], 0), north - _mean(tracks[t], 1)
        way = rules.max_speed * dt + rules.tolerance
        # The plane folds the far half of the Earth onto the near one.
        if up < -SEMI_MAJOR or de * de + dn * dn > way * way:
            continue
        live = dt <= tracks[t].patience
        if live:
            de, dn = de - dt * _mean(tracks[t], 2), dn - dt * _mean(tracks[t], 3)
        miss = de * de + dn * dn
        if best < 0 or (live and not best_live) or (live == best_live and miss < best_miss):
            best, best_live, best_miss = t, live, miss
    return best


@njit(cache=True)
def _continue(track, report, rules, z, noise, moving):  # type: ignore[no-untyped-def]
    """The report into its own track: the verdict on it."""
    dt = report.time - track.updated
    if 0.0 < dt <= rules.repeat and report.lat == track.lat and report.lon == track.lon:
        return REPEAT
    if dt > track.patience:
        _restart(track, report, rules, z, noise, moving)
    else:
        if dt > 0.0:
            _predict(track, dt, rules)
        _anchor_near(track, rules)
        _measure(track, report, rules, z, noise, moving)
        _update(track, z, noise, moving)
        if dt > 0.0:
            track.interval = dt if dt > track.interval else track.interval + 0.1 * (dt - track.interval)
    track.confirmed = 1
    _book(track, report, rules)
    return TAKEN


@njit(cache=True)
def _predict(track, dt, rules):  # type: ignore[no-untyped-def]
    models = track.mode.shape[0]
    state, covariance, mode = imm_predict(
        track.state.reshape((1, models, 5)),
        track.covariance.reshape((1, models, 5, 5)),
        track.mode.reshape((1, models)),
        np.full(1, dt),
        rules.kind,
        rules.noise,
        rules.turn_noise,
        rules.turn_sigma,
        rules.sojourn,
    )
    track.state[:] = state[0]
    track.covariance[:] = covariance[0]
    track.mode[:] = mode[0]


@njit(cache=True)
def _update(track, z, noise, moving):  # type: ignore[no-untyped-def]
    models = track.mode.shape[0]
    state, covariance, mode, _ = imm_update(
        track.state.reshape((1, models, 5)),
        track.covariance.reshape((1, models, 5, 5)),
        track.mode.reshape((1, models)),
        z,
        noise,
        moving,
    )
    track.state[:] = state[0]
    track.covariance[:] = covariance[0]
    track.mode[:] = mode[0]


@njit(cache=True)
def _measure(track, report, rules, z, noise, moving):  # type: ignore[no-untyped-def]
    """What a report measures in the track's plane, into z (1, 4), noise (1, 4, 4) and moving (1,): has it a velocity."""
    z[0, 0], z[0, 1], _ = to_tangent(report.lat, report.lon, track.anchor_lat, track.anchor_lon)
    noise[:] = 0.0
    noise[0, 0, 0] = noise[0, 1, 1] = rules.position_variance
    speed, course = report.sog, report.cog
    heading = not math.isnan(course)
    moving[0] = not math.isnan(speed) and (heading or speed < rules.still_speed)
    if not moving[0]:
        z[0, 2] = z[0, 3] = 0.0
        return
    if not heading:
        z[0, 2] = z[0, 3] = 0.0
        noise[0, 2, 2] = noise[0, 3, 3] = rules.sog_variance + 0.5 * speed * speed
        return
    ee, en, ne, nn = turn_to(report.lat, report.lon, track.anchor_lat, track.anchor_lon)
    c = ee * math.sin(course) + en * math.cos(course)
    s = ne * math.sin(course) + nn * math.cos(course)
    z[0, 2], z[0, 3] = speed * c, speed * s
    along, across = rules.sog_variance, speed * speed * rules.cog_variance
    # Below a speed the receiver's velocity noise is as wide across as along, and COG says little.
    across += rules.sog_variance / (1.0 + (speed / rules.polar_speed) ** 2)
    late = (speed * rules.jitter) ** 2
    noise[0, 0, 0] += late * c * c
    noise[0, 1, 1] += late * s * s
    noise[0, 0, 1] = noise[0, 1, 0] = late * c * s
    noise[0, 2, 2] = along * c * c + across * s * s
    noise[0, 3, 3] = along * s * s + across * c * c
    noise[0, 2, 3] = noise[0, 3, 2] = (along - across) * c * s


@njit(cache=True)
def _restart(track, report, rules, z, noise, moving):  # type: ignore[no-untyped-def]
    """A track's filter begun anew from one report."""
    track.anchor_lat, track.anchor_lon = report.lat, report.lon
    _measure(track, report, rules, z, noise, moving)
    for j in range(track.mode.shape[0]):
        track.mode[j] = rules.share[j]
        track.state[j, :4] = z[0]
        track.state[j, 4] = 0.0
        track.covariance[j] = 0.0
        track.covariance[j, :4, :4] = noise[0]
        track.covariance[j, 4, 4] = rules.turn_sigma[j] ** 2
        if not moving[0]:
            track.covariance[j, 2, 2] = track.covariance[j, 3, 3] = rules.start_speed_variance


@njit(cache=True)
def _book(track, report, rules):  # type: ignore[no-untyped-def]
    """What the track knows besides its filter, and how long it will wait for the next report."""
    track.mmsi, track.class_b, track.origin = report.mmsi, report.class_b, report.origin
    track.updated, track.lat, track.lon = report.time, report.lat, report.lon
    track.hits += 1
    fast = math.sqrt(_mean(track, 2) ** 2 + _mean(track, 3) ** 2) > rules.slow_speed
    nominal = (rules.moving_b if report.class_b == 1 else rules.moving_a) if fast else rules.slow
    track.expected = max(nominal, track.interval)
    track.patience = rules.patience_least + rules.patience_factor * track.expected


@njit(cache=True)
def _anchor_near(track, rules):  # type: ignore[no-untyped-def]
    """A new anchor under the track where the former is out of reach; the filter is moved and turned into its plane."""
    east, north = _mean(track, 0), _mean(track, 1)
    if east * east + north * north < rules.reach * rules.reach:
        return
    lat, lon = from_tangent(east, north, track.anchor_lat, track.anchor_lon)
    turn = np.eye(5)
    turn[0, 0], turn[0, 1], turn[1, 0], turn[1, 1] = turn_to(track.anchor_lat, track.anchor_lon, lat, lon)
    turn[2:4, 2:4] = turn[:2, :2]
    track.anchor_lat, track.anchor_lon = lat, lon
    for j in range(track.mode.shape[0]):
        state, covariance = track.state[j].copy(), track.covariance[j].copy()
        state[0] -= east
        state[1] -= north
        for a in range(5):
            track.state[j, a] = 0.0
            for b in range(5):
                track.state[j, a] += turn[a, b] * state[b]
                track.covariance[j, a, b] = 0.0
                for c in range(5):
                    for d in range(5):
                        track.covariance[j, a, b] += turn[a, c] * covariance[c, d] * turn[b, d]


@njit(cache=True)
def foresee(tracks, rows, time, rules, position, velocity, covariance):  # type: ignore[no-untyped-def]
    """Tracks predicted to a time: degrees, and metres a second and covariance east and north there.

    Args: tracks: TRACK rows; rows: (N,) of these; time: not before their newest report; rules; position (N, 2),
        velocity (N, 2), covariance (N, 4, 4): written.
    """
    one = tracks[:1].copy()
    for i in range(len(rows)):
        one[0] = tracks[rows[i]]
        track = one[0]
        if time > track.updated:
            _predict(track, time - track.updated, rules)
        models = track.mode.shape[0]
        mean, spread = imm_estimate(
            track.state.reshape((1, models, 5)),
            track.covariance.reshape((1, models, 5, 5)),
            track.mode.reshape((1, models)),
        )
        lat, lon = from_tangent(mean[0, 0], mean[0, 1], track.anchor_lat, track.anchor_lon)
        position[i, 0], position[i, 1] = lat, lon
        ee, en, ne, nn = turn_to(track.anchor_lat, track.anchor_lon, lat, lon)
        velocity[i, 0] = ee * mean[0, 2] + en * mean[0, 3]
        velocity[i, 1] = ne * mean[0, 2] + nn * mean[0, 3]
        for a in range(0, 4, 2):
            for b in range(0, 4, 2):
                w, x, y, q = spread[0, a, b], spread[0, a, b + 1], spread[0, a + 1, b], spread[0, a + 1, b + 1]
                covariance[i, a, b] = ee * (w * ee + x * en) + en * (y * ee + q * en)
                covariance[i, a, b + 1] = ee * (w * ne + x * nn) + en * (y * ne + q * nn)
                covariance[i, a + 1, b] = ne * (w * ee + x * en) + nn * (y * ee + q * en)
                covariance[i, a + 1, b + 1] = ne * (w * ne + x * nn) + nn * (y * ne + q * nn)


@njit(cache=True)
def carry_numbers(former, former_begin, former_end, tracks, begin, end):  # type: ignore[no-untyped-def]
    """The numbers that a vessel's tracks had before its reports were played again, given to the tracks that came out.

    A track that kept its number through the play keeps it; then one that ends in the same report as a former one takes that
    number; the rest take what is left, in order.
    Args: former, tracks: TRACK rows; begin, end: (V,) the rows of each vessel in them. Writes tracks.number.
    """
    for v in range(len(begin)):
        for exact in (True, False):
            for t in range(begin[v], end[v]):
                if tracks[t].number >= 0 or tracks[t].confirmed == 0:
                    continue
                for f in range(former_begin[v], former_end[v]):
                    same = former[f].updated == tracks[t].updated and former[f].lat == tracks[t].lat
                    same = same and former[f].lon == tracks[t].lon
                    if (exact and not same) or former[f].number < 0:
                        continue
                    taken = False
                    for u in range(begin[v], end[v]):
                        taken = taken or tracks[u].number == former[f].number
                    if not taken:
                        tracks[t].number = former[f].number
                        break
