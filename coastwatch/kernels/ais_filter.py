"""The filter of one AIS vessel: what a report measures, one IMM step, a change of plane, the prediction. Scalar, by numba.

A track is a row of `track_dtype`; a report is a row of REPORT. SI and radians, but for latitudes and longitudes (degrees).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from coastwatch.kernels.imm import _estimate_rows, _predict_rows, _update_rows
from coastwatch.kernels.tangent import from_tangent, to_tangent, turn_to

REPORT = np.dtype(
    [
        ("time", "f8"),
        ("mmsi", "i8"),
        ("lat", "f8"),
        ("lon", "f8"),
        ("sog", "f8"),
        ("cog", "f8"),
        ("class_b", "i8"),
        ("origin", "i8"),
    ]
)  # sog in m/s, cog in radians clockwise from north, NaN where not available


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


def track_dtype(models: int) -> np.dtype:
    """The row of a track whose IMM has so many models: state (J, 5) and covariance (J, 5, 5) in the plane at the anchor."""
    words = ["mmsi", "number", "confirmed", "hits", "class_b", "origin"]
    times = [
        "updated",
        "started",
        "heard",
        "interval",
        "expected",
        "patience",
        "alarm",
        "lat",
        "lon",
        "anchor_lat",
        "anchor_lon",
    ]
    arrays = [("mode", "f8", (models,)), ("state", "f8", (models, 5)), ("covariance", "f8", (models, 5, 5))]
    return np.dtype([*((w, "i8") for w in words), *((t, "f8") for t in times), *arrays])


@njit(cache=True)
def mean_of(track, k):  # type: ignore[no-untyped-def]
    """Element k of the state, averaged over the models."""
    total = 0.0
    for j in range(track.mode.shape[0]):
        total += track.mode[j] * track.state[j, k]
    return total


@njit(cache=True)
def predict(track, dt, rules, spare):  # type: ignore[no-untyped-def]
    """The track's models after dt, in place; spare is a row to work in."""
    models = track.mode.shape[0]
    spare.state[:] = track.state
    spare.covariance[:] = track.covariance
    spare.mode[:] = track.mode
    _predict_rows(
        spare.state.reshape((1, models, 5)),
        spare.covariance.reshape((1, models, 5, 5)),
        spare.mode.reshape((1, models)),
        np.full(1, dt),
        rules.kind,
        rules.noise,
        rules.turn_noise,
        rules.turn_sigma,
        rules.sojourn,
        track.state.reshape((1, models, 5)),
        track.covariance.reshape((1, models, 5, 5)),
        track.mode.reshape((1, models)),
    )


@njit(cache=True)
def update(track, z, noise, moving, spare):  # type: ignore[no-untyped-def]
    """The track's models after a measurement, in place; spare is a row to work in."""
    models = track.mode.shape[0]
    spare.state[:] = track.state
    spare.covariance[:] = track.covariance
    spare.mode[:] = track.mode
    _update_rows(
        spare.state.reshape((1, models, 5)),
        spare.covariance.reshape((1, models, 5, 5)),
        spare.mode.reshape((1, models)),
        z,
        noise,
        moving,
        track.state.reshape((1, models, 5)),
        track.covariance.reshape((1, models, 5, 5)),
        track.mode.reshape((1, models)),
        np.empty(1),
    )


@njit(cache=True)
def measure(track, report, rules, z, noise, moving):  # type: ignore[no-untyped-def]
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
def restart(track, report, rules, z, noise, moving):  # type: ignore[no-untyped-def]
    """A track's filter begun anew from one report."""
    track.anchor_lat, track.anchor_lon = report.lat, report.lon
    measure(track, report, rules, z, noise, moving)
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
def anchor_near(track, rules):  # type: ignore[no-untyped-def]
    """A new anchor under the track where the former is out of reach; the filter is moved and turned into its plane."""
    east, north = mean_of(track, 0), mean_of(track, 1)
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
    work, mean, spread = np.zeros(2, tracks.dtype), np.zeros((1, 5)), np.zeros((1, 5, 5))
    track = work[0]
    for i in range(len(rows)):
        work[0] = tracks[rows[i]]
        if time > track.updated:
            predict(track, time - track.updated, rules, work[1])
        models = track.mode.shape[0]
        _estimate_rows(
            track.state.reshape((1, models, 5)),
            track.covariance.reshape((1, models, 5, 5)),
            track.mode.reshape((1, models)),
            mean,
            spread,
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
