"""Small batches for the tests of the scores."""

from __future__ import annotations

import numpy as np

from coastwatch.batches import CLASSES, Associations, BearingTracks, FusedTracks, Picture, Tracks, Truth

KINDS = np.array([0, 0, 1, 2])  # two regions, AIS, a sonar
RADAR, OTHER_RADAR, AIS = 0, 1, 2
T0 = 1.7e9


def ints(*values):
    return np.array(values, np.int64)


def tracks(source, origin, position_deg=None, velocity_m_s=None):
    n = len(source)
    time = np.full(n, T0)
    return Tracks(
        track_id=np.arange(100, 100 + n),
        source=np.array(source, np.int64),
        time_s=time,
        position_deg=np.zeros((n, 2)) if position_deg is None else np.array(position_deg, float),
        velocity_m_s=np.zeros((n, 2)) if velocity_m_s is None else np.array(velocity_m_s, float),
        covariance=np.tile(np.eye(4), (n, 1, 1)),
        report_covariance=np.tile(np.eye(2), (n, 1, 1)),
        updated_s=time,
        started_s=time,
        mmsi=np.full(n, -1),
        origin=np.array(origin, np.int64),
    )


def joined(vessel):
    """Associations of which only the label of each track matters."""
    none = np.zeros(0, np.int64)
    return Associations(none, none, np.zeros(0), np.array(vessel, np.int64))


def picture(origin, vessel_id=None, flags=None, position_deg=None):
    n = len(origin)
    time = np.full(n, T0)
    return Picture(
        vessel_id=np.arange(n) if vessel_id is None else np.array(vessel_id, np.int64),
        time_s=time,
        position_deg=np.zeros((n, 2)) if position_deg is None else np.array(position_deg, float),
        velocity_m_s=np.zeros((n, 2)),
        covariance=np.tile(np.eye(4), (n, 1, 1)),
        since_s=time,
        updated_s=time,
        mmsi=np.full(n, -1),
        flags=np.zeros(n, np.int64) if flags is None else np.array(flags, np.int64),
        origin=np.array(origin, np.int64),
    )


def bearing_tracks(origin):
    n = len(origin)
    return BearingTracks(
        track_id=np.arange(n),
        source=np.full(n, 3),
        time_s=np.full(n, T0),
        bearing_rad=np.zeros(n),
        rate_rad_s=np.zeros(n),
        covariance=np.tile(np.eye(2), (n, 1, 1)),
        site_deg=np.zeros((n, 2)),
        updated_s=np.full(n, T0),
        started_s=np.full(n, T0),
        window_time_s=np.zeros((n, 0)),
        window_bearing_rad=np.zeros((n, 0)),
        window_site_deg=np.zeros((n, 0, 2)),
        window_variance=np.zeros((n, 0)),
        signatures=np.zeros((n, CLASSES), np.int64),
        origin=np.array(origin, np.int64),
    )


def fused(position_deg, velocity_m_s, covariance=None):
    v = len(position_deg)
    return FusedTracks(
        time_s=np.full(v, T0),
        position_deg=np.array(position_deg, float),
        velocity_m_s=np.array(velocity_m_s, float),
        covariance=np.tile(np.eye(4), (v, 1, 1)) if covariance is None else covariance,
    )


def truth(vessel, position_deg, velocity_m_s, time_s=T0):
    return Truth(
        vessel=np.array(vessel, np.int64),
        time_s=np.full(len(vessel), time_s),
        position_deg=np.array(position_deg, float).reshape(-1, 2),
        velocity_m_s=np.array(velocity_m_s, float).reshape(-1, 2),
    )
