"""AIS reports into the tracks of vessels, one vessel after the other, its reports in order of time. Scalar code, compiled by numba.

The tracks of one vessel (one MMSI) stand in consecutive rows, its slots, filled from the first; an empty slot has hits 0.
The answer depends on the rows given and on nothing else, so reports played again from an earlier state give the same bits.
"""

import math

import numpy as np

from coastwatch.kernels.filters import imm
from coastwatch.kernels.filters.ais_plausibility import (
    chosen_track,
    delay_of_stamp,
    is_alone,
    is_doubtful,
    is_jump,
    takes_place,
)
from coastwatch.kernels.filters.ais_records import CROWDED, DOUBTED, IMPOSSIBLE, REPEAT, TAKEN, mean_of
from coastwatch.kernels.filters.kalman import EAST, EAST_RATE, MANOEUVRE, NORTH, NORTH_RATE, SIZE
from coastwatch.kernels.geometry.ellipsoid import ecef_and_axes, enu_rotation, from_plane, to_enu
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.copies import copy_into

AT_ANCHOR, MOORED, AGROUND = 1, 5, 6  # ITU-R M.1371-5, table 48


@jit
def update(tracks, slots, reports, begin, end, rules, models, outcome):  # type: ignore[no-untyped-def]
    """Update the tracks of vessels by their reports, in place; which vessels had too few slots. (V,)

    The rows of a vessel with too few slots are spoilt: update its former rows again, with more slots.
    Args: tracks: (V slots,) TRACK; slots: of each vessel; reports: REPORT rows, each vessel's in order of time; begin, end: (V,) its rows
    in them; rules: RULES; models: (J,) motion_models.MODEL; outcome: (M,) OUTCOME, written.
    """
    overflowed, z, noise, work = np.zeros(len(begin), np.bool_), np.zeros(4), np.zeros((4, 4)), imm.workspace(len(models))
    for v in range(len(begin)):
        vessel = tracks[v * slots : (v + 1) * slots]
        for m in range(begin[v], end[v]):
            _expire(vessel, reports[m].time, rules)
            verdict = _update_vessel(vessel, reports[m], rules, models, z, noise, work, outcome[m])
            outcome[m].verdict = verdict
            if verdict == CROWDED and slots == 1:
                overflowed[v] = True
                break
            for t in range(slots):
                if vessel[t].hits > 0:
                    vessel[t].received = reports[m].time
    return overflowed


@jit
def _expire(vessel, time, rules):  # type: ignore[no-untyped-def]
    """Empty the slots of tracks too old to come back and of second tracks never confirmed; the others move up."""
    kept = 0
    for t in range(len(vessel)):
        age = time - vessel[t].updated
        if vessel[t].hits == 0 or age > rules.forget or (vessel[t].confirmed == 0 and age > vessel[t].patience):
            continue
        if kept != t:
            vessel[kept] = vessel[t]
        kept += 1
    for t in range(kept, len(vessel)):
        vessel[t].hits = 0


@jit
def _update_vessel(vessel, report, rules, models, z, noise, work, outcome):  # type: ignore[no-untyped-def]
    """The verdict on a report, which goes to the track it fits, or opens one."""
    best, shift, is_elsewhere = chosen_track(vessel, report, rules)
    outcome.delay = math.nan
    if best >= 0:
        outcome.delay, outcome.variance = delay_of_stamp(vessel[best], report, rules)
        if vessel[best].confirmed == 0 and not takes_place(vessel, best, rules) and is_alone(vessel, best):
            vessel[best].alarm = report.time + rules.alarm
        return _update_track(vessel[best], report, shift, rules, models, (z, noise, work))
    free, known = -1, False
    for t in range(len(vessel)):
        if vessel[t].hits == 0:
            free = t
            break
        if vessel[t].confirmed == 1:
            known = True
            if not is_elsewhere:
                vessel[t].alarm = report.time + rules.alarm
    if free < 0:
        return CROWDED
    track = vessel[free]
    track.number = -1
    track.started = report.time
    track.hits = 0
    track.interval = track.gap = 0.0
    track.alarm = report.time + rules.alarm if report.sog > rules.max_speed else -np.inf
    track.confirmed = 0 if known else 1
    _initialise(track, report, rules, models, z, noise)
    _record(track, report, rules)
    return IMPOSSIBLE if known else TAKEN


@jit
def _update_track(track, report, shift, rules, models, work):  # type: ignore[no-untyped-def]
    """The verdict on a report that goes to this track. Args: shift: by which its stamp is wrong; work: z, noise, workspace of the IMM."""
    z, noise, workspace = work
    dt = report.time - track.updated
    if 0.0 < dt <= rules.repeat and report.lat == track.lat and report.lon == track.lon:
        return REPEAT
    doubtful = is_doubtful(track, report, rules)
    if doubtful or is_jump(track, report, rules):
        track.alarm = report.time + rules.alarm
    if dt > track.patience:
        _initialise(track, report, rules, models, z, noise)
    else:
        _move_anchor(track, rules, models)
        d, j = measure(track, report, rules, z, noise), len(models)
        if doubtful:
            d = 2
            noise[0, 0], noise[0, 1], noise[1, 0], noise[1, 1] = report.ee, report.en, report.en, report.nn
        elif shift != 0.0:
            _add_along(noise, shift * shift, z[2], z[3])
        state, covariance, mode = track.state[:j], track.covariance[:j], track.mode_probability[:j]
        imm.predict_filter(state, covariance, mode, models, dt, math.inf, workspace)
        imm.update_filter(state, covariance, mode, z[:d], noise, workspace)
    _learn_interval(track, dt, rules)
    track.confirmed = 1
    _record(track, report, rules)
    if doubtful:
        track.sog = track.cog = math.nan
        return DOUBTED
    return TAKEN


@jit
def _learn_interval(track, dt, rules):  # type: ignore[no-untyped-def]
    """Learn the interval of a vessel. One gap longer than its patience may be a loss of reception, two in a row are its interval."""
    if dt > track.patience:
        track.interval = max(track.interval, min(dt, track.gap, rules.slow))
    elif dt > 0.0:
        track.interval = dt if dt > track.interval else track.interval + 0.1 * (dt - track.interval)
    track.gap = dt


@jit
def _add_along(noise, variance_s2, east, north):  # type: ignore[no-untyped-def]
    """Add to the covariance of a position that of an error of time, along a velocity."""
    noise[0, 0] += variance_s2 * east * east
    noise[1, 1] += variance_s2 * north * north
    noise[0, 1] += variance_s2 * east * north
    noise[1, 0] += variance_s2 * east * north


@jit
def measure(track, report, rules, z, noise):  # type: ignore[no-untyped-def]
    """What a report measures in the plane of a track, into z (4,) and noise (4, 4); how many components: 4, or 2 without velocity."""
    z[0], z[1], _ = to_enu(report.lat, report.lon, track.anchor_lat, track.anchor_lon)
    turn = enu_rotation(report.lat, report.lon, track.anchor_lat, track.anchor_lon)
    return _measure_velocity(report, turn, rules, z, noise)


@jit
def _measure_velocity(report, turn, rules, z, noise):  # type: ignore[no-untyped-def]
    """The velocity of a report into z[2:] and the covariance of all it measures into noise (4, 4); how many components: 4 or 2.

    Args: turn: from east and north at the report to those of the plane, [[ee, en], [ne, nn]], row by row.
    """
    z[2] = z[3] = 0.0
    noise[:] = 0.0
    noise[0, 0], noise[1, 1] = report.ee, report.nn
    noise[0, 1] = noise[1, 0] = report.en
    speed, course = report.sog, report.cog
    if not speed <= rules.max_speed or (math.isnan(course) and speed >= rules.still_speed):
        return 2
    if math.isnan(course):  # at rest
        noise[2, 2] = noise[3, 3] = rules.sog_variance + 0.5 * speed * speed
        return 4
    ee, en, ne, nn = turn
    c = ee * math.sin(course) + en * math.cos(course)
    s = ne * math.sin(course) + nn * math.cos(course)
    z[2], z[3] = speed * c, speed * s
    along, across = rules.sog_variance, speed * speed * rules.cog_variance
    # Below a speed the receiver's velocity noise is as wide across as along, and COG says little.
    across += rules.sog_variance / (1.0 + (speed / rules.polar_speed) ** 2)
    _add_along(noise, report.jitter**2 + report.error**2, z[2], z[3])
    noise[2, 2] = along * c * c + across * s * s
    noise[3, 3] = along * s * s + across * c * c
    noise[2, 3] = noise[3, 2] = (along - across) * c * s
    return 4


@jit
def measured(reports, rules):  # type: ignore[no-untyped-def]
    """Velocity east and north (M, 2) of reports, and the covariance of position and velocity (M, 4, 4), NaN where there is no velocity.

    Args: reports: REPORT; rules: RULES.
    """
    velocity, covariance = np.full((len(reports), 2), np.nan), np.full((len(reports), 4, 4), np.nan)
    z, noise = np.zeros(4), np.zeros((4, 4))
    for m in range(len(reports)):
        d = _measure_velocity(reports[m], (1.0, 0.0, 0.0, 1.0), rules, z, noise)
        copy_into(covariance[m], noise[:d, :d])
        if d == 4:
            velocity[m, 0], velocity[m, 1] = z[2], z[3]
    return velocity, covariance


@jit
def _initialise(track, report, rules, models, z, noise):  # type: ignore[no-untyped-def]
    """Begin the filter of a track anew from one report."""
    track.anchor_lat, track.anchor_lon = report.lat, report.lon
    d = measure(track, report, rules, z, noise)
    for j in range(len(models)):
        track.mode_probability[j] = models[j].prior_probability
        copy_into(track.state[j], z)
        track.state[j, MANOEUVRE] = 0.0
        track.covariance[j] = 0.0
        copy_into(track.covariance[j], noise)
        track.covariance[j, MANOEUVRE, MANOEUVRE] = models[j].manoeuvre_sigma ** 2
        if d == 2:
            track.covariance[j, EAST_RATE, EAST_RATE] = rules.start_speed_variance
            track.covariance[j, NORTH_RATE, NORTH_RATE] = rules.start_speed_variance


@jit
def _move_anchor(track, rules, models):  # type: ignore[no-untyped-def]
    """Where the anchor is out of reach, put a new one under the track, and the filter into the new plane."""
    east, north = mean_of(track, EAST), mean_of(track, NORTH)
    if east * east + north * north < rules.reach * rules.reach:
        return
    track.anchor_lat, track.anchor_lon, turn = from_plane(east, north, ecef_and_axes(track.anchor_lat, track.anchor_lon))
    for j in range(len(models)):
        track.state[j, EAST] -= east
        track.state[j, NORTH] -= north
        rotate(track.state[j], track.covariance[j], turn)


@jit
def rotate(mean, covariance, turn):  # type: ignore[no-untyped-def]
    """Turn position and velocity of a state in place. Args: turn: the matrix [[ee, en], [ne, nn]], row by row."""
    ee, en, ne, nn = turn
    for a in (EAST, EAST_RATE):
        mean[a], mean[a + 1] = ee * mean[a] + en * mean[a + 1], ne * mean[a] + nn * mean[a + 1]
        for b in range(SIZE):
            east, north = covariance[a, b], covariance[a + 1, b]
            covariance[a, b], covariance[a + 1, b] = ee * east + en * north, ne * east + nn * north
    for a in (EAST, EAST_RATE):
        for b in range(SIZE):
            east, north = covariance[b, a], covariance[b, a + 1]
            covariance[b, a], covariance[b, a + 1] = ee * east + en * north, ne * east + nn * north


@jit
def _record(track, report, rules):  # type: ignore[no-untyped-def]
    """What a track keeps of its newest report besides the filter, and how long it will wait for the next."""
    track.mmsi, track.class_b, track.origin, track.status = report.mmsi, report.class_b, report.origin, report.status
    track.updated, track.lat, track.lon = report.time, report.lat, report.lon
    track.sog, track.cog = report.sog, report.cog
    track.ee, track.en, track.nn, track.error = report.ee, report.en, report.nn, report.error
    if report.sog > rules.max_speed:
        track.sog = track.cog = math.nan
    track.hits += 1
    speed = math.sqrt(mean_of(track, EAST_RATE) ** 2 + mean_of(track, NORTH_RATE) ** 2)
    is_distress_device = track.mmsi // 1_000_000 in (970, 972, 974)  # it sends eight reports in a minute, then none
    fast = speed > rules.slow_speed and not _is_moored(track, speed, rules) and not is_distress_device
    nominal = (rules.moving_b if report.class_b == 1 else rules.moving_a) if fast else rules.slow
    if track.hits == 1 and track.confirmed == 1:
        nominal = max(nominal, rules.first)
    track.expected = max(nominal, min(track.interval, rules.slow) if fast else track.interval)
    track.patience = rules.patience_least + rules.patience_factor * track.expected


@jit
def _is_moored(track, speed, rules):  # type: ignore[no-untyped-def]
    """Whether a vessel says that it is at anchor, moored or aground, and is slow enough for that."""
    return track.status in (AT_ANCHOR, MOORED, AGROUND) and speed <= rules.anchor_speed


@jit
def estimates(tracks, rows, time, rules, models):  # type: ignore[no-untyped-def]
    """Position in degrees (N, 2), velocity (N, 2) and covariance (N, 4, 4), east and north there, of tracks predicted to a time.

    A vessel at rest that gets under way reports within the interval of a moving vessel. If it is silent for longer it is still at
    rest: it is predicted for that interval only, and not at all if it says that it is at anchor, moored or aground. For the rest of
    the time its position variance grows by its last velocity.
    Args: tracks: TRACK; rows: (N,) of them; time: not before their newest reports; rules: RULES; models: (J,) MODEL.
    """
    j, work = len(models), imm.workspace(len(models))
    position, velocity, covariance = np.empty((len(rows), 2)), np.empty((len(rows), 2)), np.empty((len(rows), 4, 4))
    state, spreads, mode = np.empty((j, SIZE)), np.empty((j, SIZE, SIZE)), np.empty(j)
    mean, spread = np.empty(SIZE), np.empty((SIZE, SIZE))
    for n in range(len(rows)):
        track = tracks[rows[n]]
        copy_into(state, track.state[:j])
        copy_into(spreads, track.covariance[:j])
        copy_into(mode, track.mode_probability[:j])
        dt, drift_variance = _drift(track, time - track.updated, rules)
        imm.predict_filter(state, spreads, mode, models, dt, math.inf, work)
        imm.moments(state, spreads, mode, mean, spread)
        frame = ecef_and_axes(track.anchor_lat, track.anchor_lon)
        position[n, 0], position[n, 1], turn = from_plane(mean[EAST], mean[NORTH], frame)
        rotate(mean, spread, turn)
        velocity[n, 0], velocity[n, 1] = mean[EAST_RATE], mean[NORTH_RATE]
        copy_into(covariance[n], spread[:4, :4])
        covariance[n, 0, 0] += drift_variance
        covariance[n, 1, 1] += drift_variance
    return position, velocity, covariance


@jit
def _drift(track, dt, rules):  # type: ignore[no-untyped-def]
    """For how long of a time to predict a track, and the variance of its position by drift in the rest of the time."""
    speed2 = mean_of(track, EAST_RATE) ** 2 + mean_of(track, NORTH_RATE) ** 2
    if _is_moored(track, math.sqrt(speed2), rules):
        return 0.0, speed2 * dt * dt
    under_way = rules.moving_b if track.class_b else rules.moving_a
    if speed2 >= rules.still_speed * rules.still_speed or dt <= under_way:
        return dt, 0.0
    return under_way, speed2 * (dt - under_way) ** 2


@jit
def carry_numbers(former, former_begin, former_end, tracks, begin, end):  # type: ignore[no-untyped-def]
    """Give tracks after a replay of reports the numbers that their vessel's tracks had before.

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
