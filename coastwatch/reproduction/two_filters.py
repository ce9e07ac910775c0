"""Two Kalman filters of one target, radar and AIS, and three ways to fuse them: figures of simulated runs beside the exact ones.

The errors of all filters are linear in the noises, with gains that no measurement changes. So the covariance of the joint error has
an exact recursion, and a run is the same recursion on drawn noises.

Source: A. Sagild, track-to-track fusion of radar and AIS, 2021, chapter 11.
"""

from __future__ import annotations

from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Floats
from coastwatch.stage import Count, CountOrZero, Positive, Settings

STREAM = 65  # of random numbers
PRIOR_ERROR = np.array([-1.0, 1.0, -0.1, 0.1])  # truth less prior mean: east, north, east rate, north rate
METHODS = ("independent", "dependent", "kalman")  # and as the second `partial_feedback` where there is feedback
RADAR, AIS, KALMAN, FED = range(4)  # filters: FED is the radar filter that may get feedback
NOTHING = np.zeros((1, 4, 4))


class TwoFilters(Settings):
    """A target at constant velocity under white acceleration, two sensors of its position, a Kalman filter each, steps of 1 s.

    All filters know the noises, and begin with one prior, at the first measurement of both.
    """

    process_noise_m2_s3: Positive = 0.5
    radar_variance_m2: Positive = 5.0  # per axis
    ais_variance_m2: Positive | None = None  # per axis; none: as the radar
    radar_every: Count = 1  # steps
    ais_every: Count = 1
    ais_messages: Count = 200  # until the end
    scored_from: CountOrZero = 50  # step
    feedback: bool = False
    propagated: bool = True  # whether two predictions propagate the cross-covariance; false: as the thesis writes

    @property
    def steps(self) -> int:
        """Steps of a run, the first with the first measurement."""
        return (self.ais_messages - 1) * self.ais_every + 1

    @property
    def variances(self) -> tuple[float, float]:
        """Of radar and AIS."""
        return self.radar_variance_m2, self.ais_variance_m2 or self.radar_variance_m2

    def prior(self) -> Floats:
        """Covariance of the prior. (4, 4)"""
        radar, ais = self.variances
        return np.diag([radar * ais, radar * ais, radar * self.process_noise_m2_s3, radar * self.process_noise_m2_s3]) ** 2


class Law(NamedTuple):
    """How the joint error of the four filters, (16,), goes on: e = update (F e + process noise) + noises, then feedback."""

    update: Floats  # (T, 16, 16)
    noise: Floats  # (T, 16, 4) gain for radar's and AIS's measurement noise
    fused: Floats  # (T, 3, 4, 16) error of each method
    covariance: Floats  # (T, 3, 4, 4) that each method claims
    feedback: Floats  # (T, 16, 16)


def measure(settings: TwoFilters, seed: int) -> dict[str, dict[str, float]]:
    """Figures of one run by method: anees, rmse over all four states, position_rmse_m, and exact_... of each; of the Kalman filter
    also the manoeuvring index: process noise over radar noise, as the thesis prints both, in steps of 1 s.
    """
    names = METHODS[0], "partial_feedback" if settings.feedback else METHODS[1], METHODS[2]
    rows = zip(run(settings, seed), exact(settings), strict=True)
    keys = ("anees", "rmse", "position_rmse_m")
    found = {
        name: {**dict(zip(keys, own, strict=True)), **{f"exact_{key}": float(x) for key, x in zip(keys, true, strict=True)}}
        for name, (own, true) in zip(names, rows, strict=True)
    }
    found[METHODS[2]]["manoeuvring_index"] = settings.process_noise_m2_s3 / settings.radar_variance_m2
    return found


def run(settings: TwoFilters, seed: int) -> list[list[float]]:
    """ANEES, RMSE and position RMSE of each method in one run. (3, 3)"""
    found = law(settings)
    rng, count = np.random.default_rng([seed, STREAM]), settings.steps
    root = np.linalg.cholesky(_predicted(np.zeros((4, 4)), settings))
    moved = np.tile(rng.standard_normal((count, 4)) @ root.T, (1, 4))
    measured = rng.standard_normal((count, 4)) * np.sqrt(np.repeat(settings.variances, 2))
    kicks = np.einsum("tij,tj->ti", found.noise, measured)
    step, error, errors = _transition(4), np.tile(PRIOR_ERROR, 4), np.empty((count, 16))
    for k in range(count):
        if k:
            error = step @ (found.feedback[k - 1] @ error) + moved[k]
        errors[k] = error = found.update[k] @ error - kicks[k]
    scored = slice(settings.scored_from, None)
    fused = np.einsum("tmij,tj->tmi", found.fused[scored], errors[scored])
    nees = np.einsum("tmi,tmij,tmj->tm", fused, np.linalg.inv(found.covariance[scored]), fused)
    square = fused**2
    columns = nees.mean(0), np.sqrt(square.sum(2).mean(0)), np.sqrt(square[..., :2].sum(2).mean(0))
    table: list[list[float]] = np.stack(columns, axis=1).tolist()
    return table


@cache
def exact(settings: TwoFilters) -> Floats:
    """Expected ANEES, root of the expected squared error, and that of the position, of each method. (3, 3)"""
    found, step = law(settings), _transition(4)
    shared = np.tile(_predicted(np.zeros((4, 4)), settings), (4, 4))
    spread, total = np.tile(np.outer(PRIOR_ERROR, PRIOR_ERROR), (4, 4)), np.zeros((3, 3))
    measured = np.diag(np.repeat(settings.variances, 2))
    for k in range(settings.steps):
        if k:
            map_ = step @ found.feedback[k - 1]
            spread = map_ @ spread @ map_.T + shared
        spread = found.update[k] @ spread @ found.update[k].T + found.noise[k] @ measured @ found.noise[k].T
        if k < settings.scored_from:
            continue
        of_each = found.fused[k] @ spread @ found.fused[k].transpose(0, 2, 1)
        variance = np.diagonal(of_each, axis1=1, axis2=2)
        nees = np.trace(np.linalg.solve(found.covariance[k], of_each), axis1=1, axis2=2)
        total += np.column_stack([nees, variance.sum(1), variance[:, :2].sum(1)])
    total /= settings.steps - settings.scored_from
    total[:, 1:] = np.sqrt(total[:, 1:])
    return total


@lru_cache(maxsize=2)  # the runs of one setting follow each other; a law takes some 10 MB
def law(settings: TwoFilters) -> Law:
    """The gains of all filters and of all fusions."""
    count, (radar_m2, ais_m2) = settings.steps, settings.variances
    out = Law(*(np.zeros((count, *shape)) for shape in ((16, 16), (16, 4), (3, 4, 16), (3, 4, 4), (16, 16))))
    own, cross = np.tile(settings.prior(), (4, 1, 1)), np.zeros((4, 4))
    for k in range(count):
        radar, ais = k % settings.radar_every == 0, k % settings.ais_every == 0
        fuses = radar or ais or settings.propagated
        if k:
            own = kernels.fusion.cross_covariance.predicted(own, np.ones(4), settings.process_noise_m2_s3)
            cross = _predicted(cross, settings) if fuses else cross
        out.update[k], out.feedback[k] = np.eye(16), np.eye(16)
        plans = [(row, radar, radar_m2, slice(0, 2)) for row in (RADAR, FED, KALMAN)]
        plans += [(row, ais, ais_m2, slice(2, 4)) for row in (AIS, KALMAN)]
        for row, there, variance, sensor in plans:
            if there:
                own[row] = _update(out, k, row, own[row], variance, sensor)
        cross = _block(out.update[k], FED) @ cross @ _block(out.update[k], AIS).T
        combined = NOTHING, own[FED][None]
        if fuses:
            combined = kernels.fusion.cross_covariance.combined(own[FED][None], own[AIS][None], cross[None])
        alone = kernels.fusion.cross_covariance.combined(own[RADAR][None], own[AIS][None], NOTHING)
        for method, (row, (gain, covariance)) in enumerate(((RADAR, alone), (FED, combined))):
            out.fused[k, method, :, _at(row)], out.fused[k, method, :, _at(AIS)] = np.eye(4) - gain[0], gain[0]
            out.covariance[k, method] = covariance[0]
        out.fused[k, 2, :, _at(KALMAN)], out.covariance[k, 2] = np.eye(4), own[KALMAN]
        if settings.feedback and fuses:
            out.feedback[k, _at(FED)] = out.fused[k, 1]
            own[FED] = cross = combined[1][0]
    return out


def _update(out: Law, k: int, row: int, covariance: Floats, variance: float, sensor: slice) -> Floats:
    """The covariance of a filter after a position; its gain is written into the law."""
    gain = covariance[:, :2] @ np.linalg.inv(covariance[:2, :2] + variance * np.eye(2))
    left = np.eye(4)
    left[:, :2] -= gain
    out.update[k, _at(row)] = left @ out.update[k, _at(row)]
    out.noise[k, _at(row)] = left @ out.noise[k, _at(row)]
    out.noise[k, _at(row), sensor] += gain
    after: Floats = left @ covariance @ left.T + variance * gain @ gain.T
    return after


def _at(row: int) -> slice:
    return slice(4 * row, 4 * row + 4)


def _block(matrix: Floats, row: int) -> Floats:
    """The part of the joint update that one filter has of its own."""
    block: Floats = matrix[_at(row), _at(row)]
    return block


def _predicted(matrix: Floats, settings: TwoFilters) -> Floats:
    one: Floats = kernels.fusion.cross_covariance.predicted(matrix[None], np.ones(1), settings.process_noise_m2_s3)[0]
    return one


def _transition(filters: int) -> Floats:
    """F of the joint error of so many filters."""
    return np.kron(np.eye(filters), np.eye(4) + np.eye(4, k=2)).astype(np.float64)
