"""What a ship could have done between two AIS reports: which track of an MMSI a report continues, and what in it cannot be so.

Ships with one MMSI are told apart, jumps and doubtful velocities are noticed, and late stamps are measured. Rows and settings are
those of `ais_records`, in SI and radians, but for latitudes and longitudes in degrees.
"""

import math

import numpy as np

from coastwatch.kernels.filters.ais_records import mean_of
from coastwatch.kernels.filters.kalman import EAST, EAST_RATE, NORTH, NORTH_RATE
from coastwatch.kernels.geometry.ellipsoid import SEMI_MAJOR, enu_offset, to_enu
from coastwatch.kernels.jit import jit

TOLERANCE_SIGMAS = 8.0  # of one report, between two
JITTER_SIGMAS = 3.0  # of a time, between two
WAY_SIGMAS = 4.0  # of a position, in the way that a change of velocity takes
SWINGS = 150.0  # m, of a ship at anchor from one report to the next
SPEED_MARGIN = 5.0  # m/s, change of velocity that noise alone can make
SAME_COURSE = 0.94  # cosine of the largest angle between courses that are the same
SAME_SPEED = 0.3  # largest difference of speeds that are the same, as a share
TIMED_SPEED = 5.0  # m/s, from which the way sailed tells the time
TIMED_S = 60.0  # longest time between two reports that does


@jit
def nearest_tracks(reports, tracks, time, rules):  # type: ignore[no-untyped-def]
    """The track of its MMSI that each report is nearest to, among those that a ship could have come from; -1 for none. (M,)

    Args: reports: REPORT, sorted by MMSI; tracks: MMSI (N,), sorted, time of the newest report (N,), position (N, 2) latitude, longitude,
    velocity (N, 2), these at `time`; rules: RULES.
    """
    mmsi, updated, position, velocity = tracks
    out, first = np.full(len(reports), -1, np.int64), 0
    for m in range(len(reports)):
        report, least = reports[m], np.inf
        while first < len(mmsi) and mmsi[first] < report.mmsi:
            first += 1
        n = first
        while n < len(mmsi) and mmsi[n] == report.mmsi:
            east, north = enu_offset(report.lat, report.lon, position[n, 0], position[n, 1])
            east, north = east - velocity[n, 0] * (report.time - time), north - velocity[n, 1] * (report.time - time)
            miss = math.sqrt(east * east + north * north)
            if miss < least and miss <= rules.max_speed * abs(updated[n] - report.time) + _tolerance(report, report, rules):
                out[m], least = n, miss
            n += 1
    return out


@jit
def chosen_track(vessel, report, rules):  # type: ignore[no-untyped-def]
    """The track that a ship could have come from, those not silent before the silent, then the nearest; -1 for none.

    A report too far off for that may be on the track of its vessel with a wrong stamp. Then the second number is by how much, else 0.
    The third: it is of a ship at rest, where another one with its MMSI lies still elsewhere: both are near enough for one ship, but ships
    at rest do not go to and fro. Once a second track waits there, its ship may have moved: then the next report is of the nearer.
    """
    best, best_live, best_miss, best_shift, is_elsewhere = -1, False, np.inf, 0.0, False
    for t in range(len(vessel)):
        track = vessel[t]
        if track.hits == 0:
            break
        dt, shift = report.time - track.updated, 0.0
        east, north, up = to_enu(report.lat, report.lon, track.anchor_lat, track.anchor_lon)
        east, north = east - mean_of(track, EAST), north - mean_of(track, NORTH)
        radius = rules.max_speed * dt + _tolerance(report, track, rules)
        # The plane folds the far half of the Earth onto the near one.
        if up < -SEMI_MAJOR:
            continue
        if east * east + north * north > radius * radius:
            shift = _shift(track, report, east, north, rules)
            if shift == 0.0:
                continue
        elif track.confirmed == 1 and _lies_elsewhere(track, report, east, north, rules) and not _has_followed(vessel, track):
            is_elsewhere = True
            continue
        live = dt <= track.patience
        if live:
            east, north = east - dt * mean_of(track, EAST_RATE), north - dt * mean_of(track, NORTH_RATE)
        miss = east * east + north * north
        if best < 0 or (live and not best_live) or (live == best_live and miss < best_miss):
            best, best_live, best_miss, best_shift = t, live, miss, shift
    return best, best_shift, is_elsewhere


@jit
def _lies_elsewhere(track, report, east, north, rules):  # type: ignore[no-untyped-def]
    """Whether a track and a report are of two ships at rest. Args: east, north: from the newest position of the track."""
    dt = report.time - track.updated
    if not (report.sog <= rules.still_speed and track.sog <= rules.still_speed) or dt > track.patience:
        return False
    radius = SWINGS + rules.still_speed * dt + TOLERANCE_SIGMAS * math.sqrt(max(report.ee, report.nn, track.ee, track.nn))
    return east * east + north * north > radius * radius


@jit
def _has_followed(vessel, track):  # type: ignore[no-untyped-def]
    """Whether a second track, on trial, has begun since the newest report of a track."""
    found = False
    for t in range(len(vessel)):
        found |= vessel[t].hits > 0 and vessel[t].confirmed == 0 and vessel[t].started > track.updated
    return found


@jit
def takes_place(vessel, trial, rules):  # type: ignore[no-untyped-def]
    """Whether a track on trial goes on for one that lay still and has not been heard since: their ship has moved. In place."""
    new = vessel[trial]
    for t in range(len(vessel)):
        old, dt = vessel[t], new.started - vessel[t].updated
        if old.hits == 0 or old.confirmed == 0 or not 0.0 < dt <= old.patience:
            continue
        east, north = enu_offset(new.lat, new.lon, old.lat, old.lon)
        radius = rules.max_speed * (dt + rules.stamp)
        if old.sog <= rules.still_speed and east * east + north * north <= radius * radius:
            new.number, new.started, old.hits = old.number, old.started, 0
            return True
    return False


@jit
def is_alone(vessel, own):  # type: ignore[no-untyped-def]
    """Whether no other track of a vessel has had a report since one began: the vessel has jumped, or its sender is another."""
    heard = 0
    for t in range(len(vessel)):
        if t != own and vessel[t].hits > 0 and vessel[t].updated > vessel[own].started:
            heard += 1
    return heard == 0


@jit
def _shift(track, report, east, north, rules):  # type: ignore[no-untyped-def]
    """By how much the stamp of a report is late, if it is on the way of a track at the track's velocity; 0 if it is not.

    Args: east, north: from the newest position of the track.
    """
    ve, vn, dt = mean_of(track, EAST_RATE), mean_of(track, NORTH_RATE), report.time - track.updated
    speed = math.sqrt(ve * ve + vn * vn)
    if dt > track.patience or not abs(report.sog - speed) < SAME_SPEED * speed:
        return 0.0
    if not ve * math.sin(report.cog) + vn * math.cos(report.cog) > SAME_COURSE * speed:
        return 0.0
    east, north = east - dt * ve, north - dt * vn
    ahead, aside = (east * ve + north * vn) / speed, (north * ve - east * vn) / speed
    if abs(ahead) > rules.stamp_most * speed or abs(aside) > TOLERANCE_SIGMAS * math.sqrt(max(report.ee, report.nn)):
        return 0.0
    return -ahead / speed


@jit
def delay_of_stamp(track, report, rules):  # type: ignore[no-untyped-def]
    """How late a stamp is against the way sailed since the track's newest report, and the variance of that; NaN where it cannot be told.

    Both reports must say about the same speed and course, and be of a vessel fast enough.
    """
    dt, speed = report.time - track.updated, 0.5 * (report.sog + track.sog)
    fast = speed > TIMED_SPEED and dt <= TIMED_S and abs(report.sog - track.sog) < 0.1 * speed
    if not (fast and math.cos(report.cog - track.cog) > SAME_COURSE):
        return math.nan, math.nan
    se, sn = math.sin(report.cog) + math.sin(track.cog), math.cos(report.cog) + math.cos(track.cog)
    length = math.sqrt(se * se + sn * sn)
    east, north = enu_offset(report.lat, report.lon, track.lat, track.lon)
    delay = dt - (east * se + north * sn) / (length * speed)
    position = 0.5 * (report.ee + report.nn + track.ee + track.nn)
    return delay, (position + 0.5 * rules.sog_variance * dt * dt) / (speed * speed)


@jit
def is_doubtful(track, report, rules):  # type: ignore[no-untyped-def]
    """Whether no ship could have come to the velocity of a report from that of the track, and its positions do not show it either."""
    if report.sog > rules.max_speed:
        return True
    dt = report.time - track.updated
    if math.isnan(report.sog) or math.isnan(report.cog) or dt > track.patience:
        return False
    se, sn = report.sog * math.sin(report.cog), report.sog * math.cos(report.cog)
    ve, vn = mean_of(track, EAST_RATE), mean_of(track, NORTH_RATE)
    change = math.sqrt((se - ve) ** 2 + (sn - vn) ** 2)
    if change <= SPEED_MARGIN or report.sog <= SPEED_MARGIN:
        return False
    east, north = enu_offset(report.lat, report.lon, track.lat, track.lon)
    error = report.error + track.error
    way = error * max(report.sog, math.sqrt(ve * ve + vn * vn))
    # The last change of velocity takes at least this way beside the former velocity.
    needed = (change - SPEED_MARGIN) ** 2 / (2.0 * rules.acceleration)
    beside = ((east - dt * ve) * (se - ve) + (north - dt * vn) * (sn - vn)) / change
    reached = change <= SPEED_MARGIN + rules.acceleration * (dt + error)
    if reached and beside + way + WAY_SIGMAS * math.sqrt(max(report.ee, report.nn)) >= needed:
        return False
    return (east - se * dt) ** 2 + (north - sn * dt) ** 2 > (0.5 * report.sog * dt + way) ** 2


@jit
def is_jump(track, report, rules):  # type: ignore[no-untyped-def]
    """Whether a vessel could not have come to a report by the speeds that it said before its silence and says now, and a margin.

    The margin grows with the square of a long silence: a ferry that is heard at two berths has sailed in between.
    """
    dt = report.time - track.updated
    before = math.sqrt(mean_of(track, EAST_RATE) ** 2 + mean_of(track, NORTH_RATE) ** 2)
    speed = max(before, 0.0 if math.isnan(report.sog) else report.sog) + rules.jump_speed * max(dt / rules.jump_time, 1.0) ** 2
    east, north = enu_offset(report.lat, report.lon, track.lat, track.lon)
    return math.sqrt(east * east + north * north) > max(speed * dt + _tolerance(report, track, rules), rules.jump_least)


@jit
def _tolerance(report, other, rules):  # type: ignore[no-untyped-def]
    """Distance beyond what max_speed allows that errors of two positions and times can make. Args: other: a report or track."""
    variance = max(report.ee, report.nn, other.ee, other.nn)
    time = rules.stamp + JITTER_SIGMAS * report.jitter + report.error + other.error
    return TOLERANCE_SIGMAS * math.sqrt(variance) + rules.max_speed * time
