"""The filter of one AIS vessel: what a report measures, one IMM step, a change of plane, the prediction. Scalar, by numba.

A track is a row of TRACK; a report is a row of REPORT. SI and radians, but for latitudes and longitudes (degrees).
"""

import math

import numpy as np

from coastwatch.kernels.filters.imm import _estimate_rows, _predict_rows, _update_rows
from coastwatch.kernels.geometry.ellipsoid import enu_rotation, from_enu, to_enu
from coastwatch.kernels.jit import jit

BLOCK = 64  # tracks predicted at once: what they need stays in the cache
MODELS = 3  # room in a row; fewer may be in use
# One layout for all settings: numba numbers record types anew in each process, so that code cached for a row of two models
# would be taken for the code of a row of three.
WORDS = ["mmsi", "number", "confirmed", "hits", "class_b", "origin"]
REALS = ["updated", "started", "heard", "interval", "expected", "patience", "alarm", "anchor_lat", "anchor_lon"]
SAID = ["lat", "lon", "sog", "cog"]  # by the newest report, as in REPORT
TRACK = np.dtype(
    [
        *((word, "i8") for word in WORDS),
        *((real, "f8") for real in (*REALS, *SAID)),
        ("mode", "f8", (MODELS,)),
        ("state", "f8", (MODELS, 5)),  # in the plane at the anchor
        ("covariance", "f8", (MODELS, 5, 5)),
    ]
)
# sog in m/s, cog in radians clockwise from north, NaN where not available
REPORT = np.dtype(
    [("mmsi", "i8"), ("class_b", "i8"), ("origin", "i8"), *((real, "f8") for real in ["time", "lat", "lon", "sog", "cog"])]
)
RULES = np.dtype(
    [
        ("models", "i8"),  # in use
        ("kind", "i8", (MODELS,)),  # 0 constant velocity, 1 coordinated turn
        *((name, "f8", (MODELS,)) for name in ("noise", "turn_noise", "turn_sigma", "sojourn", "share")),
        ("position_variance", "f8"),
        ("sog_variance", "f8"),
        ("cog_variance", "f8"),
        ("still_speed", "f8"),  # under which a report without COG says that the vessel stands
        ("polar_speed", "f8"),  # at which COG begins to mean something
        ("jitter", "f8"),  # of the time of a fix
        ("start_speed_variance", "f8"),
        ("max_speed", "f8"),
        ("tolerance", "f8"),  # added to the way that max_speed allows
        ("repeat", "f8"),  # the same place so soon is the same fix
        ("patience_least", "f8"),
        ("patience_factor", "f8"),
        ("moving_a", "f8"),  # nominal intervals
        ("moving_b", "f8"),
        ("slow", "f8"),
        ("slow_speed", "f8"),
        ("forget", "f8"),  # after which an MMSI is a new vessel
        ("alarm", "f8"),
        ("reach", "f8"),  # from the anchor, before a new one is taken
    ]
)


@jit
def mean_of(track, k):  # type: ignore[no-untyped-def]
    """Element k of the state, averaged over the models."""
    total = 0.0
    for j in range(MODELS):
        total += track.mode[j] * track.state[j, k]
    return total


@jit
def step_filter(track, dt, z, noise, moving, rules, spare, span, fit):  # type: ignore[no-untyped-def]
    """The track's models after dt and a measurement, in place; spare is a row to work in, span and fit are (1,)."""
    j = rules.models
    flat, square, line = (1, j, 5), (1, j, 5, 5), (1, j)
    span[0] = dt
    state, covariance, mode = track.state[:j].reshape(flat), track.covariance[:j].reshape(square), track.mode[:j].reshape(line)
    ahead = spare.state[:j].reshape(flat), spare.covariance[:j].reshape(square), spare.mode[:j].reshape(line)
    models = rules.kind[:j], rules.noise[:j], rules.turn_noise[:j], rules.turn_sigma[:j], rules.sojourn[:j]
    _predict_rows(state, covariance, mode, span, *models, *ahead)
    _update_rows(*ahead, z, noise, moving, state, covariance, mode, fit)


@jit
def measure(track, report, rules, z, noise, moving):  # type: ignore[no-untyped-def]
    """What a report measures besides the place, which z (1, 4) has: the rest of z, noise (1, 4, 4), moving (1,) or not."""
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
    ee, en, ne, nn = enu_rotation(report.lat, report.lon, track.anchor_lat, track.anchor_lon)
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


@jit
def restart(track, report, rules, z, noise, moving):  # type: ignore[no-untyped-def]
    """A track's filter begun anew from one report."""
    track.anchor_lat, track.anchor_lon = report.lat, report.lon
    z[0, 0] = z[0, 1] = 0.0
    measure(track, report, rules, z, noise, moving)
    for j in range(rules.models):
        track.mode[j] = rules.share[j]
        track.state[j, :4] = z[0]
        track.state[j, 4] = 0.0
        track.covariance[j] = 0.0
        track.covariance[j, :4, :4] = noise[0]
        track.covariance[j, 4, 4] = rules.turn_sigma[j] ** 2
        if not moving[0]:
            track.covariance[j, 2, 2] = track.covariance[j, 3, 3] = rules.start_speed_variance


@jit
def anchor_near(track, report, rules, z):  # type: ignore[no-untyped-def]
    """A new anchor under the track where the former is out of reach; filter and report's place go into the new plane."""
    east, north = mean_of(track, 0), mean_of(track, 1)
    if east * east + north * north < rules.reach * rules.reach:
        return
    lat, lon = from_enu(east, north, track.anchor_lat, track.anchor_lon)
    turn = np.eye(5)
    turn[0, 0], turn[0, 1], turn[1, 0], turn[1, 1] = enu_rotation(track.anchor_lat, track.anchor_lon, lat, lon)
    turn[2:4, 2:4] = turn[:2, :2]
    track.anchor_lat, track.anchor_lon = lat, lon
    z[0, 0], z[0, 1], _ = to_enu(report.lat, report.lon, lat, lon)
    for j in range(rules.models):
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


@jit
def foresee(tracks, rows, time, rules, position, velocity, covariance):  # type: ignore[no-untyped-def]
    """Tracks predicted to a time: degrees, and metres a second and covariance east and north there.

    A vessel at rest that got under way would be heard within the interval of a moving one. Silence for longer says that it still
    lies there: it is predicted for that interval alone, and for the rest of the time it may have drifted as fast as it last seemed to.

    Args: tracks: rows of TRACK; rows: (N,) of these; time: not before their newest report; rules; position (N, 2),
        velocity (N, 2), covariance (N, 4, 4): written.
    """
    span, mean, spread = np.zeros(BLOCK), np.zeros((BLOCK, 5)), np.zeros((BLOCK, 5, 5))
    j = rules.models
    state, ahead = np.zeros((BLOCK, j, 5)), np.zeros((BLOCK, j, 5))
    cov, cov_ahead = np.zeros((BLOCK, j, 5, 5)), np.zeros((BLOCK, j, 5, 5))
    mode, mode_ahead = np.zeros((BLOCK, j)), np.zeros((BLOCK, j))
    drift = np.zeros(BLOCK)
    models = rules.kind[:j], rules.noise[:j], rules.turn_noise[:j], rules.turn_sigma[:j], rules.sojourn[:j]
    for start in range(0, len(rows), BLOCK):
        n = min(BLOCK, len(rows) - start)
        for i in range(n):
            track = tracks[rows[start + i]]
            span[i], drift[i] = _split(track, time - track.updated, rules)
            state[i] = track.state[:j]
            cov[i] = track.covariance[:j]
            mode[i] = track.mode[:j]
        _predict_rows(state[:n], cov[:n], mode[:n], span[:n], *models, ahead[:n], cov_ahead[:n], mode_ahead[:n])
        _estimate_rows(ahead[:n], cov_ahead[:n], mode_ahead[:n], mean[:n], spread[:n])
        for i in range(n):
            track, k = tracks[rows[start + i]], start + i
            _settle(track, mean[i], spread[i], position[k], velocity[k], covariance[k])
            covariance[k, 0, 0] += drift[i]
            covariance[k, 1, 1] += drift[i]


@jit
def _split(track, dt, rules):  # type: ignore[no-untyped-def]
    """For how long of a time to predict a track, and the position variance of the drift in the rest of it."""
    east, north = mean_of(track, 2), mean_of(track, 3)
    speed2 = east * east + north * north
    under_way = rules.moving_b if track.class_b else rules.moving_a
    if speed2 >= rules.still_speed * rules.still_speed or dt <= under_way:
        return dt, 0.0
    return under_way, speed2 * (dt - under_way) ** 2


@jit
def _settle(track, mean, spread, position, velocity, covariance):  # type: ignore[no-untyped-def]
    """An estimate in the track's plane as degrees, and east and north at its own place; the last three are written."""
    lat, lon = from_enu(mean[0], mean[1], track.anchor_lat, track.anchor_lon)
    position[0], position[1] = lat, lon
    ee, en, ne, nn = enu_rotation(track.anchor_lat, track.anchor_lon, lat, lon)
    velocity[0], velocity[1] = ee * mean[2] + en * mean[3], ne * mean[2] + nn * mean[3]
    for a in range(0, 4, 2):
        for b in range(0, 4, 2):
            w, x, y, q = spread[a, b], spread[a, b + 1], spread[a + 1, b], spread[a + 1, b + 1]
            covariance[a, b] = ee * (w * ee + x * en) + en * (y * ee + q * en)
            covariance[a, b + 1] = ee * (w * ne + x * nn) + en * (y * ne + q * nn)
            covariance[a + 1, b] = ne * (w * ee + x * en) + nn * (y * ee + q * en)
            covariance[a + 1, b + 1] = ne * (w * ne + x * nn) + nn * (y * ne + q * nn)
