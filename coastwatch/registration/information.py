"""Tracking: azimuth bias, range bias and time lag of each radar by robust recursive least squares.

Residuals of one vessel share an offset: its antenna is not where its echo is, and its AIS track errs for a while. The offset is
marginalised, so that a hundred plots of one vessel are little more than one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from coastwatch.batches import Batch, Floats, Ints, column
from coastwatch.registration.references import summed_by_vessel

REWEIGHTINGS = 4  # weights change in the third digit after three
OUTLIER_DISTANCE2 = 11.3  # squared distance that three degrees of freedom exceed once in a hundred
OBSERVABLE_SHARE = 1e-6  # of the greatest eigenvalue: directions with less are not observable from a vessel
DRIFT_SIGMAS = 4.0  # exceeded by chance once in 16,000 cycles
DRIFT_OFFSET = 0.1  # standard deviation that newest residuals of one reference share, of the azimuth noise
LEAST_COUNT = 0.02  # plots: a vessel with less left of them is dropped
PRIOR_VESSELS = 10.0  # vessels that the model's variances count as
SUMS = ("design_design", "design_offset", "offset_offset", "design_value", "offset_value", "count", "newest")


@dataclass(frozen=True, eq=False)
class Equations(Batch):
    """Whitened equations y = H x + D offset + noise of variance 1, with x in units of (azimuth sigma, range sigma, 1 s)."""

    radar: Ints = column(np.int64, "M")
    reference: Ints = column(np.int64, "M")  # whose equations share an offset: a vessel under way, or those at rest in a square
    design: Floats = column(np.float64, "M", 3)  # H
    offset: Floats = column(np.float64, "M", 2)  # D, of the vessel's offset along and across the beam, in units of their sigma
    value: Floats = column(np.float64, "M")  # y
    weight: Floats = column(np.float64, "M")  # probability that plot and vessel are one


@dataclass(frozen=True, eq=False)
class Information(Batch):
    """Normal equations of each radar and reference, sorted by radar, then reference. Old equations are forgotten exponentially."""

    radar: Ints = column(np.int64, "N")
    reference: Ints = column(np.int64, "N")
    design_design: Floats = column(np.float64, "N", 3, 3)  # sum of H^T H
    design_offset: Floats = column(np.float64, "N", 3, 2)  # sum of H^T D
    offset_offset: Floats = column(np.float64, "N", 2, 2)  # sum of D^T D
    design_value: Floats = column(np.float64, "N", 3)  # sum of H^T y
    offset_value: Floats = column(np.float64, "N", 2)  # sum of D^T y
    count: Floats = column(np.float64, "N")  # plots
    newest: Floats = column(np.float64, "N", 2)  # of the last seconds, in azimuth: sum of residuals and of weights


class Drift(NamedTuple):
    """Whether the newest azimuth residuals contradict the estimate: a drift shows here first."""

    sigmas: Floats  # (R,) size of their sum in its standard deviations
    mean: Floats  # (R,) in units of the azimuth's sigma; 0 where it may be chance


class Estimate(NamedTuple):
    """Registration errors of each radar, in the units of the equations."""

    mean: Floats  # (R, 3)
    sigma: Floats  # (R, 3)
    references: Ints  # (R,) vessels that determine the bias
    plots: Floats  # (R,)


def add_equations(
    information: Information, equations: Equations, mean: Floats, keep: Floats, keep_newest: float
) -> Information:
    """The information after some equations.

    Args: mean: (R, 3) the estimate, in their units; keep: (R,) factor of the former sums of each radar; keep_newest: of `newest`.
    """
    factor = dict.fromkeys(SUMS, keep[information.radar]) | {"newest": np.full(len(information), keep_newest)}
    sums = {name: getattr(information, name) for name in SUMS}
    old = replace(information, **{name: a * factor[name].reshape(-1, *[1] * (a.ndim - 1)) for name, a in sums.items()})
    h, d, y, w = equations.design, equations.offset, equations.value, equations.weight
    of_azimuth = w * (h[:, 0] > 0.0)
    residual = y - (h * mean[equations.radar]).sum(axis=1)
    new = Information(
        radar=equations.radar,
        reference=equations.reference,
        design_design=w[:, None, None] * h[:, :, None] * h[:, None, :],
        design_offset=w[:, None, None] * h[:, :, None] * d[:, None, :],
        offset_offset=w[:, None, None] * d[:, :, None] * d[:, None, :],
        design_value=(w * y)[:, None] * h,
        offset_value=(w * y)[:, None] * d,
        count=w * np.where(h[:, :2].any(axis=1), 0.5, 1.0),  # against AIS a plot gives two equations
        newest=of_azimuth[:, None] * np.column_stack([residual, np.ones(len(y))]),
    )
    return summed_by_vessel(Information.join([old.take(old.count > LEAST_COUNT), new]))


def drift(information: Information, radars: int) -> Drift:
    """The test for drift. Residuals of one reference share an offset, so a hundred of them are little more than one."""
    total, weight = information.newest.T
    variance_of_each = weight + (DRIFT_OFFSET * weight) ** 2
    of_all, weights, variance = (
        np.bincount(information.radar, v, radars).astype(np.float64) for v in (total, weight, variance_of_each)
    )
    sigmas = np.abs(of_all) / np.sqrt(np.maximum(variance, 1.0))
    mean = np.where(sigmas > DRIFT_SIGMAS, of_all / np.maximum(weights, 1.0), 0.0)
    return Drift(sigmas, mean)


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
    model = np.diagonal(covariance, axis1=1, axis2=2) * scale[:, None]
    score = weight[:, None] * (vector - (matrix @ error[radar][:, :, None])[..., 0])
    scores = np.zeros((radars, 3, 3))
    np.add.at(scores, radar, score[:, :, None] * score[:, None, :])
    count = np.maximum(np.bincount(radar, minlength=radars), 2)
    sandwich = np.diagonal(covariance @ scores @ covariance, axis1=1, axis2=2) * (count / (count - 1.0))[:, None]
    sigma = np.sqrt(np.maximum(model, sandwich))
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
