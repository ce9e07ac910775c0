"""Tracking: azimuth bias, range bias, time lag and wrong site of each radar by robust recursive least squares.

Residuals of one vessel share an offset: its antenna is not where its echo is, and its AIS track errs for a while. The offset is
marginalised, so that a hundred plots of one vessel are little more than one.

The site is estimated only where the other three cannot explain the residuals: vessels to one side hardly tell a site from a range bias.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from coastwatch.batches import Batch, Bools, Floats, Ints, column
from coastwatch.registration.references import summed_by_vessel

REWEIGHTINGS = 4  # weights change in the third digit after three
OUTLIER_DISTANCE2 = 11.3  # squared distance that three degrees of freedom exceed once in a hundred
OBSERVABLE_SHARE = 1e-6  # of the greatest eigenvalue: directions with less are not observable from a vessel
DRIFT_SIGMAS = 4.0  # exceeded by chance once in 16,000 cycles
DRIFT_OFFSET = 0.1  # standard deviation that newest residuals of one reference share, of the azimuth noise
LEAST_COUNT = 0.02  # plots: a vessel with less left of them is dropped
PRIOR_VESSELS = 10.0  # vessels that the model's variances count as
PLAIN = 3  # errors that every radar may have: azimuth, range, lag
SITE = slice(3, 5)  # the others: of its site, east and north
SITE_TAKEN, SITE_KEPT = 30.0, 15.0
"""Squared distance from zero that the error of a site must have, and keep. By chance two degrees exceed 30 once in 3 million."""

LEAST_SITE_DISTANCE2 = 5.0  # by the weights of the three other errors: under this the site is not looked at
SUMS = ("design_design", "design_offset", "offset_offset", "design_value", "offset_value", "count", "newest")


@dataclass(frozen=True, eq=False)
class Equations(Batch):
    """Whitened equations y = H x + D offset + noise of variance 1, with x in (azimuth sigma, range sigma, 1 s, twice range sigma)."""

    radar: Ints = column(np.int64, "M")
    reference: Ints = column(np.int64, "M")  # whose equations share an offset: a vessel under way, or those at rest in a square
    design: Floats = column(np.float64, "M", 5)  # H
    offset: Floats = column(np.float64, "M", 2)  # D, of the vessel's offset along and across the beam, in units of their sigma
    value: Floats = column(np.float64, "M")  # y
    weight: Floats = column(np.float64, "M")  # probability that plot and vessel are one


@dataclass(frozen=True, eq=False)
class Information(Batch):
    """Normal equations of each radar and reference, sorted by radar, then reference. Old equations are forgotten exponentially."""

    radar: Ints = column(np.int64, "N")
    reference: Ints = column(np.int64, "N")
    design_design: Floats = column(np.float64, "N", 5, 5)  # sum of H^T H
    design_offset: Floats = column(np.float64, "N", 5, 2)  # sum of H^T D
    offset_offset: Floats = column(np.float64, "N", 2, 2)  # sum of D^T D
    design_value: Floats = column(np.float64, "N", 5)  # sum of H^T y
    offset_value: Floats = column(np.float64, "N", 2)  # sum of D^T y
    count: Floats = column(np.float64, "N")  # plots
    newest: Floats = column(np.float64, "N", 2)  # of the last seconds, in azimuth: sum of residuals and of weights


class Drift(NamedTuple):
    """Whether the newest azimuth residuals contradict the estimate: a drift shows here first."""

    sigmas: Floats  # (R,) size of their sum in its standard deviations
    mean: Floats  # (R,) in units of the azimuth's sigma; 0 where it may be chance


class Estimate(NamedTuple):
    """Registration errors of each radar, in the units of the equations."""

    mean: Floats  # (R, 5); the site's error is 0 where it is not estimated
    sigma: Floats  # (R, 5); and this is 0
    references: Ints  # (R,) vessels that determine the bias
    plots: Floats  # (R,)


def add_equations(
    information: Information, equations: Equations, mean: Floats, keep: Floats, keep_newest: float
) -> Information:
    """The information after some equations.

    Args: mean: (R, 5) the estimate, in their units; keep: (R,) factor of the former sums of each radar; keep_newest: of `newest`.
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


def solve(information: Information, centre: Floats, prior_sigma: Floats, has_site: Bools, least_site: Floats) -> Estimate:
    """The registration errors of each radar and their standard deviations.

    The error of the site is 0 unless it is significant and of some size. Its standard deviation is 0 then, too.
    Args: centre: (R, 5) mean of the prior; prior_sigma: (R, 5) its standard deviation; has_site: (R,) whose site had an error before;
    least_site: (R,) a smaller one is not taken, and kept until it is under half of this.
    """
    matrix, vector = _marginalise_offsets(information, centre)
    first = prior_sigma[:, :PLAIN]
    plain, _, weight = _least_squares(information, matrix[:, :PLAIN, :PLAIN], vector[:, :PLAIN], first)
    none = np.zeros((len(centre), 2))
    estimate = Estimate(
        np.column_stack([centre[:, :PLAIN] + plain.mean, none]), np.column_stack([plain.sigma, none]), *plain[2:]
    )
    normal, right = _summed(information, matrix, vector, weight, prior_sigma)
    covariance: Floats = np.asarray(np.linalg.inv(normal), np.float64)
    distance2 = _site_distance2((covariance @ right[:, :, None])[..., 0], covariance)
    asked = np.flatnonzero(distance2 > LEAST_SITE_DISTANCE2)
    if not len(asked):
        return estimate
    at = np.searchsorted(asked, information.radar)
    row = np.flatnonzero(asked[np.minimum(at, len(asked) - 1)] == information.radar)
    mine = replace(information.take(row), radar=at[row])
    full, covariance, _ = _least_squares(mine, matrix[row], vector[row], prior_sigma[asked])
    size = np.hypot(*(centre[asked] + full.mean)[:, SITE].T)
    taken = _site_distance2(full.mean, covariance) > np.where(has_site[asked], SITE_KEPT, SITE_TAKEN)
    taken &= size > np.where(has_site[asked], 0.5, 1.0) * least_site[asked]
    full = full._replace(mean=centre[asked] + full.mean)
    for every, new in zip(estimate, full, strict=True):
        every[asked[taken]] = new[taken]
    return estimate


def _site_distance2(mean: Floats, covariance: Floats) -> Floats:
    """The squared distance of the error of the site from zero. (R,) Args: (R, 5), (R, 5, 5)."""
    site = mean[:, SITE, None]
    distance2: Floats = (site.swapaxes(1, 2) @ np.linalg.solve(covariance[:, SITE, SITE], site))[:, 0, 0]
    return distance2


def _summed(
    information: Information, matrix: Floats, vector: Floats, weight: Floats, prior_sigma: Floats
) -> tuple[Floats, Floats]:
    """Normal matrix (R, k, k) and vector (R, k) of each radar. Args: of each reference, with its weight; prior_sigma: (R, k)."""
    radars, k = prior_sigma.shape
    total_matrix, total_vector = np.zeros((radars, k, k)), np.zeros((radars, k))
    total_matrix[:, range(k), range(k)] = 1.0 / prior_sigma**2
    np.add.at(total_matrix, information.radar, matrix * weight[:, None, None])
    np.add.at(total_vector, information.radar, vector * weight[:, None])
    return total_matrix, total_vector


def _least_squares(
    information: Information, matrix: Floats, vector: Floats, prior_sigma: Floats
) -> tuple[Estimate, Floats, Floats]:
    """The errors of each radar less the centre of the prior, their covariance (R, k, k), and the weight of each reference (N,).

    A vessel that contradicts the others counts less. The variances are scaled by how much the vessels differ in fact.
    Args: matrix, vector: (N, k, k), (N, k) of each reference; prior_sigma: (R, k).
    Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 3.4 (recursive least
    squares with a prior); P. J. Huber, E. M. Ronchetti, Robust Statistics, 7.8 (iteratively reweighted).
    """
    radar, (radars, k) = information.radar, prior_sigma.shape
    weight, error = np.ones(len(radar)), np.zeros((radars, k))
    eigenvalue, axes = np.linalg.eigh(matrix)
    observable = eigenvalue > OBSERVABLE_SHARE * eigenvalue[:, -1:]
    covariance: Floats = np.zeros((radars, k, k))
    distance2 = np.zeros(len(radar))
    for _ in range(REWEIGHTINGS):
        total_matrix, total_vector = _summed(information, matrix, vector, weight, prior_sigma)
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
    determines_bias = (weight >= 0.5) & (information.design_design[:, 0, 0] > 0.0)
    estimate = Estimate(
        error,
        sigma,
        np.bincount(radar, determines_bias, radars).astype(np.int64),
        np.bincount(radar, information.count, radars).astype(np.float64),
    )
    return estimate, model * larger[:, :, None] * larger[:, None, :], weight


def _marginalise_offsets(information: Information, centre: Floats) -> tuple[Floats, Floats]:
    """Information matrix (N, 5, 5) and vector (N, 5) of each vessel about x less centre, without its offset (variance 1)."""
    at = centre[information.radar][:, :, None]
    vector = information.design_value - (information.design_design @ at)[..., 0]
    offset_vector = information.offset_value - (information.design_offset.swapaxes(-1, -2) @ at)[..., 0]
    gain = information.design_offset @ np.linalg.inv(information.offset_offset + np.eye(2))
    matrix = information.design_design - gain @ information.design_offset.swapaxes(-1, -2)
    matrix = 0.5 * (matrix + matrix.swapaxes(-1, -2))
    return matrix, vector - (gain @ offset_vector[:, :, None])[..., 0]
