"""Records of tracks that the pair kernels read, in the order of `candidate_pairs.sorted_places`: neighbours are adjacent."""

from __future__ import annotations

import math

import numpy as np

from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.copies import copy_into

ENTRY = np.dtype(
    [
        ("latitude_deg", np.float64),
        ("longitude_deg", np.float64),
        ("east_m_s", np.float32),
        ("north_m_s", np.float32),
        ("variance_m2", np.float32),
        ("rate_variance_m2_s2", np.float32),
    ]
)
"""A track at one cycle, as its history stores it. Variances are traces, of position and of velocity; float32 is exact enough."""

TRACK = np.dtype(
    [
        ("slot", np.int32),  # of its history
        ("length", np.int32),  # entries in its history
        ("covariance", np.float64, (4, 4)),  # of east, north, east rate, north rate
        ("registration", np.float64, (2, 2)),  # what a constant bias of its sensor may add to the position block
    ]
)


@jit
def track_records(low, high, row, history, given, bias_share, velocity_variance, out):  # type: ignore[no-untyped-def]
    """The records of tracks low to high.

    Args:
        row: (N,) row of each track in what is given. history: (slot of each row (N,), length of each slot (S,)).
        given: (covariance (N, 4, 4), NaN where there is none, report covariance (N, 2, 2), MMSI (N,) or -1), by row.
        bias_share: share of a radar report's covariance that is the registration term.
        velocity_variance: an axis, of a track without covariance; its position has the covariance of one report.
        out: (N,) TRACK, written.
    """
    slot, length = history
    covariance, report, mmsi = given
    for i in range(low, high):
        r, track = row[i], out[i]
        track.slot, track.length = slot[r], length[slot[r]]
        known = True
        for j in range(4):
            for k in range(4):
                known = known and math.isfinite(covariance[r, j, k])
                track.covariance[j, k] = covariance[r, j, k]
        if not known:
            track.covariance[:, :] = 0.0
            copy_into(track.covariance, report[r])
            track.covariance[2, 2] = track.covariance[3, 3] = velocity_variance
        share = bias_share if mmsi[r] < 0 else 0.0
        for j in range(2):
            for k in range(2):
                track.registration[j, k] = share * report[r, j, k]


@jit
def record_entries(low, high, row, position_deg, velocity_m_s, track, column, values):  # type: ignore[no-untyped-def]
    """Write tracks low to high into the column of this cycle of their history.

    Args: row: (N,) of each track; position_deg, velocity_m_s: (N, 2), by row; track: (N,) TRACK; values: (S, W) ENTRY, written.
    """
    for i in range(low, high):
        r, covariance, entry = row[i], track[i].covariance, values[track[i].slot, column]
        entry.latitude_deg, entry.longitude_deg = position_deg[r, 0], position_deg[r, 1]
        entry.east_m_s, entry.north_m_s = velocity_m_s[r, 0], velocity_m_s[r, 1]
        entry.variance_m2 = covariance[0, 0] + covariance[1, 1]
        entry.rate_variance_m2_s2 = covariance[2, 2] + covariance[3, 3]
