"""The filters of many tracks by filterpy, one IMMEstimator a track: slow, the reference that the compiled bank equals to rounding."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from filterpy.kalman import IMMEstimator, KalmanFilter

from coastwatch import kernels
from coastwatch.batches import Floats, Ints
from coastwatch.kernels.filters.gaussian import squared_distance
from coastwatch.tracks.motion import Filters, Motion, initialise


class ModelFilter(KalmanFilter):  # type: ignore[misc]
    """A Kalman filter of filterpy whose prediction is one of our models of motion."""

    def __init__(self, model: Any, state: Floats, covariance: Floats) -> None:
        super().__init__(dim_x=5, dim_z=2)
        self.model = model
        self.dt_s = 0.0
        self.x: Floats = state.copy()
        self.P: Floats = covariance.copy()
        self.H = np.eye(2, 5)

    def predict(self, u: Any = None, B: Any = None, F: Any = None, Q: Any = None) -> None:
        """The state after dt_s; the arguments are filterpy's and of no use here."""
        if self.dt_s > 0.0:
            jacobian, noise = np.eye(5), np.zeros((5, 5))
            kernels.filters.motion_models.move(self.model, self.x, self.dt_s, jacobian)
            kernels.filters.motion_models.add_process_noise(self.model, self.dt_s, noise)
            self.P = jacobian @ self.P @ jacobian.T + noise


@dataclass(frozen=True)
class FilterpyBank:
    """Filters by filterpy, one object after the other. The steps of `coastwatch.tracks.filter_bank.FilterBank`."""

    prior: Motion

    def initialise(self, position_m: Floats, covariance: Floats) -> Filters:
        return initialise(self.prior, position_m, covariance)

    def predict(self, filters: Filters, dt_s: Floats) -> tuple[Floats, Floats]:
        return self._estimate(self._predict(filters, dt_s))

    def update(
        self, filters: Filters, rows: Ints, dt_s: Floats, position_m: Floats, covariance: Floats
    ) -> tuple[Filters, Floats, Floats]:
        late = np.minimum(dt_s, 0.0)
        predicted = self._predict(filters.take(rows), np.maximum(dt_s, 0.0))
        mean, spread = self._estimate(predicted)
        z = position_m - mean[:, 2:4] * late[:, None]
        noise = covariance + spread[:, 2:4, 2:4] * (late**2)[:, None, None]
        done = [self._updated(*one) for one in zip(*predicted, z, noise, strict=True)]
        after = _stacked(predicted, [new for new, _ in done])
        distance = squared_distance(z - mean[:, :2], spread[:, :2, :2] + noise)
        return after, np.array([log_likelihood for _, log_likelihood in done], float), distance

    @cached_property
    def _models(self) -> Any:
        return self.prior.table()

    def _predict(self, filters: Filters, dt_s: Floats) -> Filters:
        return _stacked(filters, [self._predicted(*one) for one in zip(*filters, dt_s, strict=True)])

    def _estimate(self, filters: Filters) -> tuple[Floats, Floats]:
        made = [self._estimator(*one, np.eye(len(self._models))) for one in zip(*filters, strict=True)]
        mean, covariance = np.zeros((len(made), 5)), np.zeros((len(made), 5, 5))
        for row, imm in enumerate(made):
            mean[row], covariance[row] = imm.x, imm.P
        return mean, covariance

    def _estimator(self, state: Floats, covariance: Floats, mode_probability: Floats, transition: Floats) -> IMMEstimator:
        models = [ModelFilter(*one) for one in zip(self._models, state, covariance, strict=True)]
        return IMMEstimator(models, mode_probability.copy(), transition)

    def _predicted(self, state: Floats, covariance: Floats, mode_probability: Floats, dt_s: float) -> Filters:
        imm = self._estimator(state, covariance, mode_probability, _transition(self._models["sojourn"], dt_s))
        for one in imm.filters:
            one.dt_s = dt_s
        imm.predict()
        return Filters(np.array([f.x for f in imm.filters]), np.array([f.P for f in imm.filters]), imm.cbar.copy())

    def _updated(
        self, state: Floats, covariance: Floats, mode_probability: Floats, position_m: Floats, noise: Floats
    ) -> tuple[Filters, float]:
        imm = self._estimator(state, covariance, mode_probability, np.eye(len(mode_probability)))
        for one in imm.filters:
            one.R = noise
        imm.update(position_m)
        after = np.maximum(imm.mu, kernels.filters.imm.FLOOR)
        filters = Filters(np.array([f.x for f in imm.filters]), np.array([f.P for f in imm.filters]), after / after.sum())
        return filters, float(np.logaddexp.reduce(np.log(mode_probability) + [f.log_likelihood for f in imm.filters]))


def _stacked(like: Filters, done: list[Filters]) -> Filters:
    """The filters of each track as arrays of all; `like` gives the shapes where there is no track."""
    parts = ([one[k] for one in done] for k in range(3))
    return Filters(*(np.array(part, float).reshape(old.shape) for part, old in zip(parts, like, strict=True)))


def _transition(sojourn_s: Floats, dt_s: float) -> Floats:
    """transition[i, j]: the probability of model j now, given model i before. (J, J)"""
    j = len(sojourn_s)
    stay = (1.0 + (j - 1) * np.exp(-dt_s / sojourn_s * j / (j - 1))) / j
    out: Floats = np.tile(((1.0 - stay) / (j - 1))[:, None], (1, j))
    out[np.arange(j), np.arange(j)] = stay
    return out
