"""Tracking: azimuth and range bias, time lag, wrong site and scale of range of each radar by robust recursive least squares.

Residuals of one vessel share an offset: its antenna is not where its echo is, and its AIS track errs for a while. The offset is
marginalised, so that a hundred plots of one vessel are little more than one.

The last two are estimated only where the other three cannot explain the residuals: vessels to one side, or at one distance, hardly tell
them from a range bias.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from coastwatch.batches import Batch, Bools, Floats, Ints, column
from coastwatch.kernels.tables.lookup import find
from coastwatch.registration.references import summed_by_vessel

REWEIGHTINGS = 4  # weights change in the third digit after three
OUTLIER_DISTANCE2 = 11.3  # squared distance that three degrees of freedom exceed once in a hundred
OBSERVABLE_SHARE = 1e-6  # of the greatest eigenvalue: directions with less are not observable from a vessel
DRIFT_SIGMAS = 4.0  # exceeded by chance once in 16,000 cycles
DRIFT_OFFSET = 0.1  # standard deviation that newest residuals of one reference share, of the azimuth noise
LEAST_COUNT = 0.02  # plots: a vessel with less left of them is dropped
PRIOR_VESSELS = 10.0  # vessels that the model's variances count as
ERRORS = 6
PLAIN = (0, 1, 2)  # errors that every radar may have: azimuth, range, lag
SITE, SCALE = (3, 4), (5,)  # the others: its site, east and north; what a longer range is too long by
TAKEN, KEPT = {SITE: 30.0, SCALE: 25.0}, {SITE: 15.0, SCALE: 12.0}
"""Squared distance from zero that these must have, and keep. By chance 30 and 25 are exceeded once in 3 and 2 million."""

LEAST_DISTANCE2 = 5.0  # by the weights of the three other errors: under this they are not looked at
SUMS = ("design_design", "design_offset", "offset_offset", "design_value", "offset_value", "count", "newest")


@dataclass(frozen=True, eq=False)
class Equations(Batch):
    """Whitened equations y = H x + D offset + noise of variance 1, with x in the units of the method."""

    radar: Ints = column(np.int64, "M")
    reference: Ints = column(np.int64, "M")  # whose equations share an offset: a vessel under way, or those at rest in a square
    design: Floats = column(np.float64, "M", 6)  # H
    offset: Floats = column(np.float64, "M", 2)  # D, of the vessel's offset along and across the beam, in units of their sigma
    value: Floats = column(np.float64, "M")  # y
    weight: Floats = column(np.float64, "M")  # probability that plot and vessel are one


@dataclass(frozen=True, eq=False)
class Information(Batch):
    """Normal equations of each radar and reference, sorted by radar, then reference. Old equations are forgotten exponentially."""

    radar: Ints = column(np.int64, "N")
    reference: Ints = column(np.int64, "N")
    design_design: Floats = column(np.float64, "N", 6, 6)  # sum of H^T H
    design_offset: Floats = column(np.float64, "N", 6, 2)  # sum of H^T D
    offset_offset: Floats = column(np.float64, "N", 2, 2)  # sum of D^T D
    design_value: Floats = column(np.float64, "N", 6)  # sum of H^T y
    offset_value: Floats = column(np.float64, "N", 2)  # sum of D^T y
    count: Floats = column(np.float64, "N")  # plots
    newest: Floats = column(np.float64, "N", 2)  # of the last seconds, in azimuth: sum of residuals and of weights


class Drift(NamedTuple):
    """Whether the newest azimuth residuals contradict the estimate: a drift shows here first."""

    sigmas: Floats  # (R,) size of their sum in its standard deviations
    mean: Floats  # (R,) in units of the azimuth's sigma


class Estimate(NamedTuple):
    """Registration errors of each radar, in the units of the equations."""

    mean: Floats  # (R, 6); those of site and scale are 0 where they are not estimated
    sigma: Floats  # (R, 6); and these are 0
    references: Ints  # (R,) vessels that determine the bias
    plots: Floats  # (R,)


def add_equations(
    information: Information, equations: Equations, mean: Floats, keep: Floats, keep_newest: float
) -> Information:
    """The information after some equations.

    Args: mean: (R, 6) the estimate, in their units; keep: (R,) factor of the former sums of each radar; keep_newest: of `newest`.
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
    return Drift(sigmas, of_all / np.maximum(weights, 1.0))


def solve(information: Information, centre: Floats, prior_sigma: Floats, former: Floats, least: Floats) -> Estimate:
    """The registration errors of each radar and their standard deviations.

    Those of the site and of the scale are 0 unless they are significant and of some size. Their standard deviations are 0 then, too.
    Args: centre: (R, 6) mean of the prior; prior_sigma: (R, 6) its standard deviation; former: (R, 6) errors of the cycle before;
    least: (R, 6) smaller ones of site and scale are not taken; once taken they are kept until under half of this.
    """
    matrix, vector = _marginalise_offsets(information, centre)
    every = np.arange(len(centre))
    estimate, covariance, weight = _least_squares(information, matrix, vector, prior_sigma, every, PLAIN)
    normal, right = _summed(information.radar, matrix, vector, weight, prior_sigma)
    crude: Floats = np.asarray(np.linalg.inv(normal), np.float64)
    mean = (crude @ right[:, :, None])[..., 0]
    asked = np.flatnonzero(np.maximum(*(_distance2(mean, crude, block) for block in (SITE, SCALE))) > LEAST_DISTANCE2)
    if not len(asked):
        return estimate._replace(mean=centre + estimate.mean)
    # First the better one of the two alone, then both, if the other one is significant beside it.
    over, best = np.zeros((2, len(centre))), [estimate, estimate]
    for k, block in enumerate((SITE, SCALE)):
        best[k], covariance, _ = _least_squares(information, matrix, vector, prior_sigma, asked, PLAIN + block)
        over[k, asked] = _excess(best[k].mean, covariance, block, former[asked], least[asked])
    for k, other in enumerate((SCALE, SITE)):
        alone = (over[k] > 0.0) & (over[k] >= over[1 - k])
        _take(estimate, best[k], asked, alone[asked])
        rows = np.flatnonzero(alone)
        if not len(rows):
            continue
        both, covariance, _ = _least_squares(information, matrix, vector, prior_sigma, rows, PLAIN + SITE + SCALE)
        _take(estimate, both, rows, _excess(both.mean, covariance, other, former[rows], least[rows]) > 0.0)
    return estimate._replace(mean=centre + estimate.mean)


def _take(estimate: Estimate, other: Estimate, rows: Ints, taken: Bools) -> None:
    """Write rows of another estimate over those of the first. Args: rows: (K,) of its rows; taken: (K,) which of them."""
    for mine, its in zip(estimate, other, strict=True):
        mine[rows[taken]] = its[taken]


def _excess(mean: Floats, covariance: Floats, block: tuple[int, ...], former: Floats, least: Floats) -> Floats:
    """By how much the squared distance of some errors from zero exceeds what they need, in shares of it; 0 and less: too little. (K,)"""
    columns = list(block)
    has = former[:, columns].any(axis=1)
    size = np.sqrt((mean[:, columns] ** 2).sum(axis=1))
    share = _distance2(mean, covariance, block) / np.where(has, KEPT[block], TAKEN[block]) - 1.0
    return np.where(size > np.where(has, 0.5, 1.0) * least[:, columns].max(axis=1), share, -1.0)


def _distance2(mean: Floats, covariance: Floats, block: tuple[int, ...]) -> Floats:
    """The squared distance of some errors from zero. (K,) Args: (K, 6), (K, 6, 6)."""
    columns = list(block)
    of_block = mean[:, columns, None]
    inverse = np.linalg.solve(covariance[:, columns][:, :, columns], of_block)
    distance2: Floats = (of_block.swapaxes(1, 2) @ inverse)[:, 0, 0]
    return distance2


def _summed(radar: Ints, matrix: Floats, vector: Floats, weight: Floats, prior_sigma: Floats) -> tuple[Floats, Floats]:
    """Normal matrix (R, k, k) and vector (R, k) of each radar. Args: radar, matrix, vector, weight: of each
    reference; prior_sigma: (R, k).
    """
    radars, k = prior_sigma.shape
    total_matrix, total_vector = np.zeros((radars, k, k)), np.zeros((radars, k))
    total_matrix[:, range(k), range(k)] = 1.0 / prior_sigma**2
    np.add.at(total_matrix, radar, matrix * weight[:, None, None])
    np.add.at(total_vector, radar, vector * weight[:, None])
    return total_matrix, total_vector


def _least_squares(
    information: Information, matrix: Floats, vector: Floats, prior_sigma: Floats, rows: Ints, errors: tuple[int, ...]
) -> tuple[Estimate, Floats, Floats]:
    """Some errors of some radars less the centre of the prior, their covariance (K, 6, 6), and the weight of each reference (N,).

    A vessel that contradicts the others counts less. The variances are scaled by how much the vessels differ in fact.
    Args: matrix, vector: (N, 6, 6), (N, 6) of each reference; prior_sigma: (R, 6); rows: (K,) radars, increasing; errors: columns; the
    others are 0, with a variance of 0.
    Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 3.4 (recursive least
    squares with a prior); P. J. Huber, E. M. Ronchetti, Robust Statistics, 7.8 (iteratively reweighted).
    """
    at = find(rows, information.radar)
    mine, columns = np.flatnonzero(at >= 0), list(errors)
    radar, radars, k = at[mine], len(rows), len(columns)
    matrix, vector = matrix[mine][:, columns][:, :, columns], vector[mine][:, columns]
    prior_sigma = prior_sigma[rows][:, columns]
    weight, error = np.ones(len(radar)), np.zeros((radars, k))
    eigenvalue, axes = np.linalg.eigh(matrix)
    observable = eigenvalue > OBSERVABLE_SHARE * eigenvalue[:, -1:]
    covariance: Floats = np.zeros((radars, k, k))
    distance2 = np.zeros(len(radar))
    for _ in range(REWEIGHTINGS):
        total_matrix, total_vector = _summed(radar, matrix, vector, weight, prior_sigma)
        covariance = np.asarray(np.linalg.inv(total_matrix), np.float64)
        error = (covariance @ total_vector[:, :, None])[..., 0]
        residual = vector - (matrix @ error[radar][:, :, None])[..., 0]
        along_axes = (axes.swapaxes(-1, -2) @ residual[:, :, None])[..., 0]
        distance2 = np.where(observable, along_axes**2 / np.where(observable, eigenvalue, 1.0), 0.0).sum(axis=1)
        weight = np.minimum(1.0, OUTLIER_DISTANCE2 / np.maximum(distance2, 1e-12))
    freedom = np.bincount(radar, observable.sum(axis=1), radars)
    differ = np.bincount(radar, np.minimum(distance2, OUTLIER_DISTANCE2), radars)
    scale = (3.0 * PRIOR_VESSELS + differ) / (3.0 * PRIOR_VESSELS + freedom)
    score = weight[:, None] * (vector - (matrix @ error[radar][:, :, None])[..., 0])
    scores = np.zeros((radars, k, k))
    np.add.at(scores, radar, score[:, :, None] * score[:, None, :])
    count = np.maximum(np.bincount(radar, minlength=radars), 2)
    sandwich = covariance @ scores @ covariance * (count / (count - 1.0))[:, None, None]
    model = covariance * scale[:, None, None]
    sigma = np.sqrt(np.maximum(np.diagonal(model, axis1=1, axis2=2), np.diagonal(sandwich, axis1=1, axis2=2)))
    larger = sigma / np.sqrt(np.diagonal(model, axis1=1, axis2=2))
    determines_bias = (weight >= 0.5) & (information.design_design[mine, 0, 0] > 0.0)
    full_error, full_sigma, full_covariance = (
        np.zeros((radars, ERRORS)),
        np.zeros((radars, ERRORS)),
        np.zeros((radars, ERRORS, ERRORS)),
    )
    full_error[:, columns], full_sigma[:, columns] = error, sigma
    full_covariance[:, np.array(columns)[:, None], columns] = model * larger[:, :, None] * larger[:, None, :]
    estimate = Estimate(
        full_error,
        full_sigma,
        np.bincount(radar, determines_bias, radars).astype(np.int64),
        np.bincount(radar, information.count[mine], radars).astype(np.float64),
    )
    return estimate, full_covariance, weight


def _marginalise_offsets(information: Information, centre: Floats) -> tuple[Floats, Floats]:
    """Information matrix (N, 6, 6) and vector (N, 6) of each vessel about x less centre, without its offset (variance 1)."""
    at = centre[information.radar][:, :, None]
    vector = information.design_value - (information.design_design @ at)[..., 0]
    offset_vector = information.offset_value - (information.design_offset.swapaxes(-1, -2) @ at)[..., 0]
    gain = information.design_offset @ np.linalg.inv(information.offset_offset + np.eye(2))
    matrix = information.design_design - gain @ information.design_offset.swapaxes(-1, -2)
    matrix = 0.5 * (matrix + matrix.swapaxes(-1, -2))
    return matrix, vector - (gain @ offset_vector[:, :, None])[..., 0]
