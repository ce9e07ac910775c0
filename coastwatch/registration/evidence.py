"""Tracking: azimuth bias, range bias and lag of each radar by robust recursive least squares, one cluster a reference vessel.

A vessel's residuals share an offset of their own (its antenna is not where its echo is, its AIS track errs for a while), which is
taken out of what the vessel says, and so much of its information with it: a hundred plots of one vessel are little more than one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from coastwatch.batches import Batch, Floats, Ints, column

ROUNDS = 4  # of reweighting; weights change in the third digit after three
BELIEVED = 11.3  # squared distance that three degrees of freedom exceed once in a hundred
SEPARATE = 1e-6  # of the greatest eigenvalue: directions of which a vessel says less are none
CHANCE = 4.0  # standard deviations: once in 16,000 cycles
FORGOTTEN = 0.02  # plots: a vessel of which so little is left is dropped
PRIOR_VESSELS = 10.0  # as if so many had said that the model's variances are right


@dataclass(frozen=True, eq=False)
class Rows(Batch):
    """Whitened equations y = H x + D offset + noise of variance 1, x in units of (azimuth sigma, range sigma, 1 s)."""

    radar: Ints = column(np.int64, "M")
    reference: Ints = column(np.int64, "M")  # track id of the vessel
    design: Floats = column(np.float64, "M", 3)  # H
    own: Floats = column(np.float64, "M", 2)  # D, of the vessel's offset along and across the beam, in units of their sigma
    value: Floats = column(np.float64, "M")  # y


@dataclass(frozen=True, eq=False)
class Evidence(Batch):
    """Sums over the rows of each radar and vessel, forgotten with time; sorted by radar, then vessel."""

    radar: Ints = column(np.int64, "N")
    reference: Ints = column(np.int64, "N")
    design2: Floats = column(np.float64, "N", 3, 3)
    design_own: Floats = column(np.float64, "N", 3, 2)
    own2: Floats = column(np.float64, "N", 2, 2)
    design_value: Floats = column(np.float64, "N", 3)
    own_value: Floats = column(np.float64, "N", 2)
    count: Floats = column(np.float64, "N")


@dataclass(frozen=True, eq=False)
class Surprise:
    """What the newest azimuths say against the estimate, forgotten within seconds: a drift shows here first."""

    total: Floats  # (R,) sum of residuals over their standard deviations
    weight: Floats  # (R,) of how many
    variance: Floats  # (R,) of that sum while nothing drifts

    @classmethod
    def none(cls, radars: int) -> Surprise:
        return cls(np.zeros(radars), np.zeros(radars), np.zeros(radars))

    def after(self, rows: Rows, mean: Floats, keep: float) -> Surprise:
        """With these rows. Args: mean: (R, 3) in the units of the rows; keep: what is left of the former sums."""
        rows = rows.take(rows.design[:, 0] > 0.0)
        left = rows.value - (rows.design * mean[rows.radar]).sum(axis=1)
        share, radars = 1.0 / (1.0 + rows.own[:, 1] ** 2), len(self.total)
        total, weight = (np.bincount(rows.radar, w, radars).astype(np.float64) for w in (left * share, share))
        return Surprise(self.total * keep + total, self.weight * keep + weight, self.variance * keep**2 + weight)

    @property
    def sigmas(self) -> Floats:
        """By how many of its standard deviations the sum is off. (R,)"""
        out: Floats = np.abs(self.total) / np.sqrt(np.maximum(self.variance, 1.0))
        return out

    @property
    def mean(self) -> Floats:
        """By how much the estimate is off lately, in units of the azimuth's standard deviation, where that is no chance. (R,)"""
        return np.where(self.sigmas > CHANCE, np.abs(self.total) / np.maximum(self.weight, 1.0), 0.0)


class Estimate(NamedTuple):
    """What is known of each radar, in the units of the rows."""

    mean: Floats  # (R, 3)
    sigma: Floats  # (R, 3)
    references: Ints  # (R,) vessels that tell the bias
    plots: Floats  # (R,)


def learn(evidence: Evidence, rows: Rows, keep: Floats) -> Evidence:
    """The evidence after some rows. Args: keep: (R,) what is left of the former sums of each radar."""
    held = keep[evidence.radar]
    old = replace(
        evidence,
        **{
            name: getattr(evidence, name) * held.reshape(-1, *[1] * (getattr(evidence, name).ndim - 1))
            for name in ("design2", "design_own", "own2", "design_value", "own_value", "count")
        },
    )
    h, d, y = rows.design, rows.own, rows.value
    new = Evidence(
        radar=rows.radar,
        reference=rows.reference,
        design2=h[:, :, None] * h[:, None, :],
        design_own=h[:, :, None] * d[:, None, :],
        own2=d[:, :, None] * d[:, None, :],
        design_value=h * y[:, None],
        own_value=d * y[:, None],
        count=np.where(h[:, :2].any(axis=1), 0.5, 1.0),  # against AIS a plot is two rows
    )
    return _summed(Evidence.join([old.take(old.count > FORGOTTEN), new]))


def _summed(parts: Evidence) -> Evidence:
    """One row a radar and vessel, summed in the order in which the parts stand."""
    references, which = np.unique(parts.reference, return_inverse=True)
    key, of = np.unique(parts.radar * len(references) + which, return_inverse=True)
    count = max(len(references), 1)

    def total(values: Floats) -> Floats:
        out = np.zeros((len(key), *values.shape[1:]))
        np.add.at(out, of, values)
        return out

    names = ("design2", "design_own", "own2", "design_value", "own_value", "count")
    return Evidence(
        radar=key // count, reference=references[key % count], **{name: total(getattr(parts, name)) for name in names}
    )


def solve(evidence: Evidence, centre: Floats, prior_sigma: Floats) -> Estimate:
    """The registration errors of each radar and what is not known of them.

    A vessel that contradicts the others counts the less. The variances are scaled by how much the vessels really differ.
    Args: centre: (R, 3) what was thought before any evidence; prior_sigma: (R, 3) how well.
    Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 3.4 (recursive least
    squares with a prior); P. J. Huber, E. M. Ronchetti, Robust Statistics, 7.8 (iteratively reweighted).
    """
    radars = len(centre)
    information, vector = _without_own(evidence, centre)
    prior = np.zeros((radars, 3, 3))
    prior[:, range(3), range(3)] = 1.0 / prior_sigma**2
    weight, off = np.ones(len(evidence)), np.zeros((radars, 3))
    eigen, axes = np.linalg.eigh(information)
    told = eigen > SEPARATE * eigen[:, -1:]
    inverse: Floats = np.zeros((radars, 3, 3))
    square = np.zeros(len(evidence))
    for _ in range(ROUNDS):
        whole, right = prior.copy(), np.zeros((radars, 3))
        np.add.at(whole, evidence.radar, information * weight[:, None, None])
        np.add.at(right, evidence.radar, vector * weight[:, None])
        inverse = np.asarray(np.linalg.inv(whole), np.float64)
        off = (inverse @ right[:, :, None])[..., 0]
        left = vector - (information @ off[evidence.radar][:, :, None])[..., 0]
        seen = (axes.swapaxes(-1, -2) @ left[:, :, None])[..., 0]
        square = np.where(told, seen**2 / np.where(told, eigen, 1.0), 0.0).sum(axis=1)
        weight = np.minimum(1.0, BELIEVED / np.maximum(square, 1e-12))
    believed = np.minimum(square, BELIEVED)
    freedom = np.bincount(evidence.radar, told.sum(axis=1), radars)
    differ = np.bincount(evidence.radar, believed, radars)
    scale = (3.0 * PRIOR_VESSELS + differ) / (3.0 * PRIOR_VESSELS + freedom)
    sigma = np.sqrt(np.diagonal(inverse, axis1=1, axis2=2) * scale[:, None])
    return Estimate(
        centre + off,
        sigma,
        np.bincount(evidence.radar, (weight >= 0.5) & (evidence.design2[:, 0, 0] > 0.0), radars).astype(np.int64),
        np.bincount(evidence.radar, evidence.count, radars).astype(np.float64),
    )


def _without_own(evidence: Evidence, centre: Floats) -> tuple[Floats, Floats]:
    """Information (N, 3, 3) and vector (N, 3) of each vessel about x less centre, its own offset (variance 1) marginalised."""
    at = centre[evidence.radar][:, :, None]
    vector = evidence.design_value - (evidence.design2 @ at)[..., 0]
    own = evidence.own_value - (evidence.design_own.swapaxes(-1, -2) @ at)[..., 0]
    taken = evidence.design_own @ np.linalg.inv(evidence.own2 + np.eye(2))
    information = evidence.design2 - taken @ evidence.design_own.swapaxes(-1, -2)
    information = 0.5 * (information + information.swapaxes(-1, -2))
    return information, vector - (taken @ own[:, :, None])[..., 0]
