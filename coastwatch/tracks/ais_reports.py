"""AIS reports of a cycle as measurements of the tracks that they went into."""

from __future__ import annotations

from typing import Any

import numpy as np

from coastwatch.batches import Floats, Ints, Measurements, Tracks
from coastwatch.geodesy import difference_m
from coastwatch.tracks.lateness import SLOTS, Rows


def taken_reports(fresh: Rows, tracks: Tracks, rules: Any) -> Measurements:
    """Those of the reports that a ship on one of these tracks could have sent, sorted by track, then time.

    Args: fresh: REPORT rows sorted by MMSI, then time; tracks: after these reports, sorted by MMSI; rules: of the AIS kernel.
    Where one MMSI has several tracks the nearest takes the report.
    """
    track = _track_of(fresh, tracks, rules)
    again = np.zeros(len(fresh), np.bool_)
    soon = fresh["time"][1:] - fresh["time"][:-1] <= rules["repeat"]
    for name in ("mmsi", "lat", "lon"):
        soon &= fresh[name][1:] == fresh[name][:-1]
    again[1:] = soon
    taken = np.flatnonzero((track >= 0) & ~again)
    reports, track = fresh[taken], track[taken]
    order = np.lexsort((reports["time"], tracks.track_id[track]))
    reports, track = reports[order], track[order]
    velocity, covariance = _measured(reports, rules)
    n = len(reports)
    return Measurements(
        track_id=tracks.track_id[track],
        sensor=np.full(n, -1, np.int64),
        time_s=reports["time"],
        position_deg=np.column_stack([reports["lat"], reports["lon"]]),
        velocity_m_s=velocity,
        covariance=covariance,
        site_deg=np.full((n, 2), np.nan),
    )


def _track_of(fresh: Rows, tracks: Tracks, rules: Any) -> Ints:
    """The row of the track that each report went into, -1 where none could have sent it. (M,)"""
    best, least = np.full(len(fresh), -1, np.int64), np.full(len(fresh), np.inf)
    mmsi = np.ascontiguousarray(fresh["mmsi"])
    first, place = np.searchsorted(tracks.mmsi, mmsi), np.column_stack([fresh["lat"], fresh["lon"]])
    for k in range(SLOTS if len(tracks) else 0):
        row = np.minimum(first + k, len(tracks) - 1)
        gap = difference_m(place, tracks.position_deg[row])
        gap -= tracks.velocity_m_s[row] * (fresh["time"] - tracks.time_s[row])[:, None]
        miss = np.hypot(gap[:, 0], gap[:, 1])
        way = rules["max_speed"] * np.abs(tracks.updated_s[row] - fresh["time"]) + rules["tolerance"]
        nearer = (first + k < len(tracks)) & (tracks.mmsi[row] == mmsi) & (miss <= way) & (miss < least)
        best[nearer], least[nearer] = row[nearer], miss[nearer]
    return best


def _measured(reports: Rows, rules: Any) -> tuple[Floats, Floats]:
    """Velocity east and north, and the covariance of position and velocity, as the AIS kernel takes them. (M, 2), (M, 4, 4)"""
    n, speed, course = len(reports), reports["sog"], reports["cog"]
    heading = ~np.isnan(course)
    still = ~heading & (speed < rules["still_speed"])
    along = np.column_stack([np.sin(course), np.cos(course)])
    velocity = np.where(heading[:, None], speed[:, None] * along, np.where(still, 0.0, np.nan)[:, None])
    across = speed**2 * rules["cog_variance"] + rules["sog_variance"] / (1.0 + (speed / rules["polar_speed"]) ** 2)
    outer = along[:, :, None] * along[:, None, :]
    eye = np.eye(2)
    moving = rules["sog_variance"] * outer + across[:, None, None] * (eye - outer)
    resting = (rules["sog_variance"] + 0.5 * speed**2)[:, None, None] * eye
    covariance = np.full((n, 4, 4), np.nan)
    late = np.where(heading & ~np.isnan(speed), speed * rules["jitter"], 0.0) ** 2
    covariance[:, :2, :2] = rules["position_variance"] * eye
    covariance[:, :2, :2] += np.where(late[:, None, None] > 0.0, late[:, None, None] * outer, 0.0)
    known = np.isfinite(velocity[:, 0])
    covariance[known, 2:, 2:] = np.where(heading[:, None, None], moving, resting)[known]
    covariance[known, :2, 2:] = covariance[known, 2:, :2] = 0.0
    return velocity, covariance
