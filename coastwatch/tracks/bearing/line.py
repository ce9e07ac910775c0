"""Bearing and rate by least squares through the newest slots of a window, and how far these are from a smooth curve."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from coastwatch.batches import Array, BearingReports, Floats, Ints
from coastwatch.geodesy import wrap_rad

FEWEST_SCATTERED = 6  # slots that tell the noise: a curve of three parameters goes through them


class Slots(NamedTuple):
    """The newest slots of some windows, the newest last."""

    sensor: Ints  # (N,)
    time_s: Floats  # (N, W) NaN where there is none
    bearing_rad: Floats  # (N, W)
    weight: Floats  # (N, W) 0 where there is none

    @classmethod
    def newest(cls, column: Mapping[str, Array], rows: Ints, length: int) -> Slots:
        """The newest `length` slots of these rows. Args: column: of a BearingMemory, by name."""
        return cls(column["sensor"][rows], *(column[name][rows, -length:] for name in cls._fields[1:]))


def relative_weight(reports: BearingReports, sigma_rad: Floats) -> Floats:
    """The variance of the sensor over that of each bearing: 1 for a bearing without a variance of its own. (M,)"""
    own = np.radians(reports.bearing_sigma_deg)
    given = own > 0.0
    out = np.ones(len(reports))
    out[given] = (sigma_rad[reports.sensor[given]] / own[given]) ** 2
    return out


def line(slots: Slots, time_s: Array, sigma_rad: Floats, rate_sigma_rad_s: float) -> tuple[Floats, Floats, Floats]:
    """Bearing (N,), rate (N,) and covariance (N, 2, 2) at these times by least squares.

    Args: sigma_rad: (K,) of a bearing of each sensor; rate_sigma_rad_s: of bearing rates before anything is known.
    """
    t, y, weight = _from_newest(slots)
    last = slots.bearing_rad[:, -1]
    variance = sigma_rad[slots.sensor] ** 2
    prior = variance / rate_sigma_rad_s**2
    s0, s1, s2 = weight.sum(1), (weight * t).sum(1), (weight * t * t).sum(1) + prior
    b0, b1 = (weight * y).sum(1), (weight * t * y).sum(1)
    det = s0 * s2 - s1 * s1
    rate = (s0 * b1 - s1 * b0) / det
    ahead = np.asarray(time_s) - slots.time_s[:, -1]
    bearing = wrap_rad(last + (s2 * b0 - s1 * b1) / det + ahead * rate)
    p00, p01, p11 = variance * s2 / det, -variance * s1 / det, variance * s0 / det
    across = p01 + ahead * p11
    rows = [[p00 + 2.0 * ahead * p01 + ahead**2 * p11, across], [across, p11]]
    return bearing, rate, np.moveaxis(np.array(rows), 2, 0)


def scatter(slots: Slots, sigma_rad: Floats) -> Floats:
    """Mean squared distance of the newest slots from a parabola through them, over that of the noise; NaN of too few. (N,)"""
    t, y, weight = _from_newest(slots)
    out, some = np.full(len(y), np.nan), np.flatnonzero((weight > 0.0).sum(axis=1) >= FEWEST_SCATTERED)
    t, y, weight = t[some] / np.maximum(-t[some].min(axis=1, keepdims=True), 1e-9), y[some], weight[some]
    power = t[:, :, None] ** np.arange(3)
    normal = np.einsum("nwa,nw,nwb->nab", power, weight, power) + 1e-9 * np.eye(3)
    curve = np.linalg.solve(normal, np.einsum("nwa,nw,nw->na", power, weight, y)[:, :, None])
    off2 = (weight * (y - (power @ curve)[:, :, 0]) ** 2).sum(axis=1)
    out[some] = off2 / ((weight > 0.0).sum(axis=1) - 3) / sigma_rad[slots.sensor[some]] ** 2
    return out


def _from_newest(slots: Slots) -> tuple[Floats, Floats, Floats]:
    """Times and bearings from those of the newest slot, 0 where there is none, and weights. (N, W) each"""
    there = slots.weight > 0.0
    t = np.where(there, slots.time_s - slots.time_s[:, -1:], 0.0)
    y = np.where(there, wrap_rad(slots.bearing_rad - slots.bearing_rad[:, -1:]), 0.0)
    return t, y, slots.weight
