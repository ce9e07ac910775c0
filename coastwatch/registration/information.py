"""Tracking: azimuth bias, range bias and time lag of each radar by robust recursive least squares.

Residuals of one vessel share an offset: its antenna is not where its echo is, and its AIS track errs for a while. The offset is
marginalised, so that a hundred plots of one vessel are little more than one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from coastwatch.batches import Batch, Floats, Ints, column

REWEIGHTINGS = 4  # weights change in the third digit after three
OUTLIER_DISTANCE2 = 11.3  # squared distance that three degrees of freedom exceed once in a hundred
OBSERVABLE_SHARE = 1e-6  # of the greatest eigenvalue: directions with less are not observable from a vessel
DRIFT_SIGMAS = 4.0  # exceeded by chance once in 16,000 cycles
LEAST_COUNT = 0.02  # plots: a vessel with less left of them is dropped
PRIOR_VESSELS = 10.0  # vessels that the model's variances count as
SUMS = ("design_design", "design_offset", "offset_offset", "design_value", "offset_value", "count")


@dataclass(frozen=True, eq=False)
class Equations(Batch):
    """Whitened equations y = H x + D offset + noise of variance 1, with x in units of (azimuth sigma, range sigma, 1 s)."""

    radar: Ints = column(np.int64, "M")
    reference: Ints = column(np.int64, "M")  # track id of the vessel
    design: Floats = column(np.float64, "M", 3)  # H
    offset: Floats = column(np.float64, "M", 2)  # D, of the vessel's offset along and across the beam, in units of their sigma
    value: Floats = column(np.float64, "M")  # y


@dataclass(frozen=True, eq=False)
class Information(Batch):
    """Normal equations of each radar and vessel, sorted by radar, then vessel. Old equations are forgotten exponentially."""

    radar: Ints = column(np.int64, "N")
    reference: Ints = column(np.int64, "N")  # track id of the vessel
    design_design: Floats = column(np.float64, "N", 3, 3)  # sum of H^T H
    design_offset: Floats = column(np.float64, "N", 3, 2)  # sum of H^T D
    offset_offset: Floats = column(np.float64, "N", 2, 2)  # sum of D^T D
    design_value: Floats = column(np.float64, "N", 3)  # sum of H^T y
    offset_value: Floats = column(np.float64, "N", 2)  # sum of D^T y
    count: Floats = column(np.float64, "N")  # plots


@dataclass(frozen=True, eq=False)
class DriftTest:
    """Sum of the newest azimuth residuals, forgotten within seconds: a drift shows here first."""

    total: Floats  # (R,) sum of residuals over their standard deviations
    weight: Floats  # (R,) how many
    variance: Floats  # (R,) of that sum while nothing drifts

    @classmethod
    def none(cls, radars: int) -> DriftTest:
        return cls(np.zeros(radars), np.zeros(radars), np.zeros(radars))

    def after(self, equations: Equations, mean: Floats, keep: float) -> DriftTest:
        """The test after these equations. Args: mean: (R, 3) the estimate, in their units; keep: factor of the former sums."""
        new = equations.take(equations.design[:, 0] > 0.0)
        residual = new.value - (new.design * mean[new.radar]).sum(axis=1)
        share, radars = 1.0 / (1.0 + new.offset[:, 1] ** 2), len(self.total)
        total, weight = (np.bincount(new.radar, w, radars).astype(np.float64) for w in (residual * share, share))
        return DriftTest(self.total * keep + total, self.weight * keep + weight, self.variance * keep**2 + weight)

    @property
    def sigmas(self) -> Floats:
        """Size of the sum in its standard deviations. (R,)"""
        out: Floats = np.abs(self.total) / np.sqrt(np.maximum(self.variance, 1.0))
        return out

    @property
    def mean(self) -> Floats:
        """Mean size of the newest residuals in units of the azimuth's sigma; 0 where it may be chance. (R,)"""
        return np.where(self.sigmas > DRIFT_SIGMAS, np.abs(self.total) / np.maximum(self.weight, 1.0), 0.0)


class Estimate(NamedTuple):
    """Registration errors of each radar, in the units of the equations."""

    mean: Floats  # (R, 3)
    sigma: Floats  # (R, 3)
    references: Ints  # (R,) vessels that determine the bias
    plots: Floats  # (R,)


def add_equations(information: Information, equations: Equations, keep: Floats) -> Information:
    """The information after some equations. Args: keep: (R,) factor of the former sums of each radar."""
    factor = keep[information.radar]
    sums = {name: getattr(information, name) for name in SUMS}
    old = replace(information, **{name: a * factor.reshape(-1, *[1] * (a.ndim - 1)) for name, a in sums.items()})
    h, d, y = equations.design, equations.offset, equations.value
    new = Information(
        radar=equations.radar,
        reference=equations.reference,
        design_design=h[:, :, None] * h[:, None, :],
        design_offset=h[:, :, None] * d[:, None, :],
        offset_offset=d[:, :, None] * d[:, None, :],
        design_value=h * y[:, None],
        offset_value=d * y[:, None],
        count=np.where(h[:, :2].any(axis=1), 0.5, 1.0),  # against AIS a plot gives two equations
    )
    return _summed(Information.join([old.take(old.count > LEAST_COUNT), new]))


def _summed(parts: Information) -> Information:
    """One row for each radar and vessel, summed in the order of the parts."""
    references, which = np.unique(parts.reference, return_inverse=True)
    key, group = np.unique(parts.radar * len(references) + which, return_inverse=True)
    count = max(len(references), 1)

    def total(values: Floats) -> Floats:
        out = np.zeros((len(key), *values.shape[1:]))
        np.add.at(out, group, values)
        return out

    sums = {name: total(getattr(parts, name)) for name in SUMS}
    return Information(radar=key // count, reference=references[key % count], **sums)


def solve(information: Information, centre: Floats, prior_sigma: Floats) -> Estimate:
    """The registration errors of each radar and their standard deviations.

    A vessel that contradicts the others counts less. The variances are scaled by how much the vessels differ in fact.
    Args: centre: (R, 3) mean of the prior; prior_sigma: (R, 3) its standard deviation.
    Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 3.4 (recursive least
    squares with a prior); P. J. Huber, E. M. Ronchetti, Robust Statistics, 7.8 (iteratively reweighted).
    """
    radar, radars = information.radar, len(centre)
    matrix, vector = _marginalise_offsets(information, centre)
    prior = np.zeros((radars, 3, 3))
    prior[:, range(3), range(3)] = 1.0 / prior_sigma**2
    weight, error = np.ones(len(radar)), np.zeros((radars, 3))
    eigenvalue, axes = np.linalg.eigh(matrix)
    observable = eigenvalue > OBSERVABLE_SHARE * eigenvalue[:, -1:]
    covariance: Floats = np.zeros((radars, 3, 3))
    distance2 = np.zeros(len(radar))
    for _ in range(REWEIGHTINGS):
        total_matrix, total_vector = prior.copy(), np.zeros((radars, 3))
        np.add.at(total_matrix, radar, matrix * weight[:, None, None])
        np.add.at(total_vector, radar, vector * weight[:, None])
        covariance = np.asarray(np.linalg.inv(total_matrix), np.float64)
        error = (covariance @ total_vector[:, :, None])[..., 0]
        residual = vector - (matrix @ error[radar][:, :, None])[..., 0]
        along_axes = (axes.swapaxes(-1, -2) @ residual[:, :, None])[..., 0]
        distance2 = np.where(observable, along_axes**2 / np.where(observable, eigenvalue, 1.0), 0.0).sum(axis=1)
        weight = np.minimum(1.0, OUTLIER_DISTANCE2 / np.maximum(distance2, 1e-12))
    freedom = np.bincount(radar, observable.sum(axis=1), radars)
    differ = np.bincount(radar, np.minimum(distance2, OUTLIER_DISTANCE2), radars)
    scale = (3.0 * PRIOR_VESSELS + differ) / (3.0 * PRIOR_VESSELS + freedom)
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2) * scale[:, None])
    determines_bias = (weight >= 0.5) & (information.design_design[:, 0, 0] > 0.0)
    return Estimate(
        centre + error,
        sigma,
        np.bincount(radar, determines_bias, radars).astype(np.int64),
        np.bincount(radar, information.count, radars).astype(np.float64),
    )


def _marginalise_offsets(information: Information, centre: Floats) -> tuple[Floats, Floats]:
    """Information matrix (N, 3, 3) and vector (N, 3) of each vessel about x less centre, without its offset (variance 1)."""
    at = centre[information.radar][:, :, None]
    vector = information.design_value - (information.design_design @ at)[..., 0]
    offset_vector = information.offset_value - (information.design_offset.swapaxes(-1, -2) @ at)[..., 0]
    gain = information.design_offset @ np.linalg.inv(information.offset_offset + np.eye(2))
    matrix = information.design_design - gain @ information.design_offset.swapaxes(-1, -2)
    matrix = 0.5 * (matrix + matrix.swapaxes(-1, -2))
    return matrix, vector - (gain @ offset_vector[:, :, None])[..., 0]
