"""Bounds on the numbers of reports, and on the states of tracks and vessels: what is beyond them is no measurement and no vessel.

Sources of reports say anything. Filters and kernels rest on finite numbers and on covariances that can be inverted.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import fields, replace
from typing import Any, TypeVar, assert_never

import numpy as np

from coastwatch.batches.reports import AisReports, BearingReports, HeadingReports, RadarReports, Reports, TrackReports
from coastwatch.batches.video import RadarVideo, Videos
from coastwatch.kernels.arrays import Bools, Floats

HIGHEST_LATITUDE_DEG = 85.0
"""North and south, to which planes tangent to the earth are right (`coastwatch.geodesy`)."""

LATITUDES = f"latitude {-HIGHEST_LATITUDE_DEG:g} to {HIGHEST_LATITUDE_DEG:g}"
MOST_RANGE_M = 500_000.0
RANGE_SIGMA_M = 1e-3, 20_000.0
AZIMUTH_SIGMA_DEG = 1e-5, 90.0
CONTACTS = 2**40
"""Contact numbers of one sensor of bearings."""

MOST_SPEED_M_S = 110.0
"""Of a track of another system: more than 200 knots."""

SIGMA_M, SIGMA_M_S = (1e-4, 200_000.0), (1e-6, 1_000.0)
"""Standard deviations of position and velocity in a covariance."""

TIMES_S = 0.0, 8e9
"""Unix times: from 1970 to 2223."""

ASYMMETRY = 1e-6
BEYOND = "beyond the bounds of its format: "
WITHOUT_BOUNDS = ("statics",)
"""Fields of `Reports` whose numbers no filter takes."""

Bounded = RadarReports | BearingReports | AisReports | TrackReports | HeadingReports | RadarVideo
Of = TypeVar("Of", RadarReports, BearingReports, AisReports, TrackReports, HeadingReports, RadarVideo)


def faults_of(batch: Bounded) -> dict[str, Bools]:
    """Which rows of reports, or spokes of a video, are none, by kind. (M,) each"""
    own: dict[str, Bools]
    match batch:
        case RadarReports():
            own = {
                "range": ~((batch.range_m >= 0.0) & (batch.range_m <= MOST_RANGE_M)),
                "azimuth": ~(np.abs(batch.azimuth_deg) <= 360.0),
                f"site ({LATITUDES})": ~_is_on_earth(batch.site_deg),
                "standard deviation of range": _no_sigma(batch.range_sigma_m, RANGE_SIGMA_M),
                "standard deviation of azimuth": _no_sigma(batch.azimuth_sigma_deg, AZIMUTH_SIGMA_DEG),
            }
        case BearingReports():
            own = {
                "bearing": ~(np.abs(batch.bearing_deg) <= 360.0),
                f"site ({LATITUDES})": ~_is_on_earth(batch.site_deg),
                "standard deviation of bearing": _no_sigma(batch.bearing_sigma_deg, AZIMUTH_SIGMA_DEG),
                "contact number": batch.contact >= CONTACTS,
            }
        case AisReports():
            own = {f"position ({LATITUDES})": ~_is_on_earth(batch.position_deg)}
        case TrackReports():
            speed_m_s, given = np.hypot(*batch.velocity_m_s.T), ~np.isnan(batch.velocity_m_s).all(axis=1)
            own = {
                f"position ({LATITUDES})": ~_is_on_earth(batch.position_deg),
                "velocity": given & ~(speed_m_s <= MOST_SPEED_M_S),
                "covariance": _no_covariance(batch.covariance),
            }
        case HeadingReports():
            own = {"heading": ~(np.abs(batch.heading_deg) <= 360.0)}
        case RadarVideo():
            far_m = batch.first_m + batch.cell_m * batch.level.shape[1]
            own = {
                "range": np.full(len(batch), not far_m <= MOST_RANGE_M),
                "azimuth": ~(np.abs(batch.azimuth_rad) <= 2.0 * np.pi),
                f"site ({LATITUDES})": ~_is_on_earth(batch.site_deg),
            }
        case _:
            assert_never(batch)
    return {"time": _no_time(batch.time_s, batch.received_s), **own}


def within(batch: Of) -> tuple[Of, dict[str, Bools]]:
    """The rows or spokes without a fault, and the faults that there are. (M,) each"""
    found = {kind: mask for kind, mask in faults_of(batch).items() if mask.any()}
    if not found:
        return batch, {}
    return batch.take(~np.logical_or.reduce(list(found.values()))), found


def reports_within(reports: Reports) -> tuple[Reports, dict[str, int]]:
    """The reports within all bounds, and how many of the others there are, by kind."""
    kept: dict[str, Any] = {}
    counts: Counter[str] = Counter()
    for name in (field.name for field in fields(reports) if field.name not in WITHOUT_BOUNDS):
        given = getattr(reports, name)
        parts = [within(part) for part in (given.parts if isinstance(given, Videos) else [given]) if len(part)]
        for _, found in parts:
            counts.update({f"{name}: {kind}": int(mask.sum()) for kind, mask in found.items()})
        inside = [part for part, _ in parts]
        kept[name] = Videos(tuple(inside)) if isinstance(given, Videos) else (inside or [given])[0]
    return (replace(reports, **kept), dict(counts)) if counts else (reports, {})


def are_sound(position_deg: Floats, covariance: Floats) -> Bools:
    """Whether states are on the earth, with covariances that are finite or not given. Args: (N, 2), (N, 4, 4). Returns: (N,)."""
    good = np.isfinite(covariance.sum(axis=(1, 2)))
    some = np.flatnonzero(~good)
    given, of_position = ~np.isnan(covariance[some]), covariance[some, :2, :2]
    finite = ~np.isinf(covariance[some]).any(axis=(1, 2))
    good[some] = finite & (~given.any(axis=(1, 2)) | np.isfinite(of_position).all(axis=(1, 2)))
    return np.asarray(_is_on_earth(position_deg) & good)


def are_near_a_pole(position_deg: Floats) -> Bools:
    """Which positions are beyond the highest latitude: a track or vessel ends there. (N, 2) -> (N,)"""
    latitude_deg = np.abs(position_deg[:, 0])
    return np.asarray((latitude_deg > HIGHEST_LATITUDE_DEG) & (latitude_deg <= 90.0))


def _no_time(*times_s: Floats) -> Bools:
    out = np.zeros(len(times_s[0]), np.bool_)
    for time_s in times_s:
        out |= ~((time_s >= TIMES_S[0]) & (time_s <= TIMES_S[1]))
    return np.asarray(out)


def _is_on_earth(position_deg: Floats) -> Bools:
    return np.asarray((np.abs(position_deg[:, 0]) <= HIGHEST_LATITUDE_DEG) & (np.abs(position_deg[:, 1]) <= 180.0))


def _no_sigma(sigma: Floats, bounds: tuple[float, float]) -> Bools:
    """Which given deviations are beyond bounds. NaN: not given."""
    return np.asarray(~np.isnan(sigma) & ~((sigma >= bounds[0]) & (sigma <= bounds[1])))


def _no_covariance(covariance: Floats) -> Bools:
    """Which covariances are given and are none: not symmetric, not positive definite, or beyond bounds. (M, 4, 4) -> (M,)"""
    out = np.zeros(len(covariance), np.bool_)
    given = ~np.isnan(covariance).all(axis=(1, 2))
    rows = np.flatnonzero(given)
    if not len(rows):
        return out
    some = covariance[rows]
    alone = np.isnan(some[:, 2:, 2:]).all(axis=(1, 2))  # of the position alone
    some[alone, :2, 2:] = some[alone, 2:, :2] = 0.0
    some[alone, 2:, 2:] = np.eye(2)
    out[rows] = ~_is_positive_definite(some)
    return out


def _is_positive_definite(covariance: Floats) -> Bools:
    """Whether matrices are symmetric, positive definite and within bounds, by their LDL factors. (M, 4, 4) -> (M,)"""
    diagonal = np.diagonal(covariance, axis1=1, axis2=2)
    low = np.array([SIGMA_M[0], SIGMA_M[0], SIGMA_M_S[0], SIGMA_M_S[0]]) ** 2
    high = np.array([SIGMA_M[1], SIGMA_M[1], SIGMA_M_S[1], SIGMA_M_S[1]]) ** 2
    good: Bools = np.asarray(((diagonal >= low) & (diagonal <= high)).all(axis=1))
    scale = np.sqrt(np.where(good[:, None], diagonal, 1.0))
    unit = np.where(good[:, None, None], covariance / (scale[:, :, None] * scale[:, None, :]), np.eye(4))
    good &= (np.abs(unit - unit.transpose(0, 2, 1)) <= ASYMMETRY).all(axis=(1, 2))
    rest = unit.copy()
    for k in range(4):
        pivot = rest[:, k, k]
        good &= pivot > 1e-12
        rest = rest - rest[:, :, k, None] * rest[:, k, None, :] / np.where(pivot > 1e-12, pivot, 1.0)[:, None, None]
    return np.asarray(good)
