"""The filters of many tracks by filterpy, one IMMEstimator a track."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from filterpy.kalman import IMMEstimator, KalmanFilter

from coastwatch import kernels
from coastwatch.batches import Floats, Ints
from coastwatch.tracks import stepwise
from coastwatch.tracks.motion import Filters, Parameters


class ModelFilter(KalmanFilter):  # type: ignore[misc]
    """A Kalman filter of filterpy whose prediction is one of our models of motion."""

    def __init__(self, model: tuple[int, float, float, float]) -> None:
        super().__init__(dim_x=5, dim_z=2)
        self.model = model
        self.dt_s = 0.0
        self.x: Floats = np.zeros(5)
        self.P: Floats = np.eye(5)
        self.H = np.eye(2, 5)

    def predict(self, u: Any = None, B: Any = None, F: Any = None, Q: Any = None) -> None:
        """The state after dt_s; the arguments are filterpy's and of no use here."""
        moved, jacobian, noise = kernels.filters.imm.one_model(self.x, self.dt_s, *self.model)
        self.P = jacobian @ self.P @ jacobian.T + noise
        self.x = moved


@dataclass(frozen=True)
class ObjectBank:
    """The filters of many tracks, one object of filterpy after the other."""

    parameters: Parameters

    def predict(self, filters: Filters, dt_s: Floats) -> Filters:
        return _stacked(filters, [self._predicted(*one) for one in zip(*filters, dt_s, strict=True)])

    def update(self, filters: Filters, position_m: Floats, covariance: Floats) -> tuple[Filters, Floats]:
        done = [self._updated(*one) for one in zip(*filters, position_m, covariance, strict=True)]
        return _stacked(filters, [new for new, _ in done]), np.array([fit for _, fit in done], float)

    def estimate(self, filters: Filters) -> tuple[Floats, Floats]:
        made = [self._estimator(*one, np.eye(len(self.parameters.kind))) for one in zip(*filters, strict=True)]
        mean, covariance = np.zeros((len(made), 5)), np.zeros((len(made), 5, 5))
        for row, imm in enumerate(made):
            mean[row], covariance[row] = imm.x, imm.P
        return mean, covariance

    def foresee(self, filters: Filters, dt_s: Floats) -> tuple[Floats, Floats]:
        return stepwise.foresee(self, filters, dt_s)

    def absorb(
        self, filters: Filters, rows: Ints, dt_s: Floats, position_m: Floats, covariance: Floats
    ) -> tuple[Filters, Floats, Floats]:
        return stepwise.absorb(self, filters, rows, dt_s, position_m, covariance)

    def _estimator(self, state: Floats, covariance: Floats, mode: Floats, transition: Floats) -> IMMEstimator:
        p = self.parameters
        bank = []
        for j, model in enumerate(zip(p.kind, p.noise, p.turn_noise, p.turn_sigma, strict=True)):
            one = ModelFilter(model)
            one.x, one.P = state[j].copy(), covariance[j].copy()
            bank.append(one)
        return IMMEstimator(bank, mode.copy(), transition)

    def _predicted(self, state: Floats, covariance: Floats, mode: Floats, dt_s: float) -> Filters:
        imm = self._estimator(state, covariance, mode, _transition(self.parameters.sojourn_s, dt_s))
        for one in imm.filters:
            one.dt_s = dt_s
        imm.predict()
        return Filters(np.array([f.x for f in imm.filters]), np.array([f.P for f in imm.filters]), imm.cbar.copy())

    def _updated(
        self, state: Floats, covariance: Floats, mode: Floats, position_m: Floats, noise: Floats
    ) -> tuple[Filters, float]:
        imm = self._estimator(state, covariance, mode, np.eye(len(mode)))
        for one in imm.filters:
            one.R = noise
        imm.update(position_m)
        after = np.maximum(imm.mu, kernels.filters.imm.FLOOR)
        filters = Filters(np.array([f.x for f in imm.filters]), np.array([f.P for f in imm.filters]), after / after.sum())
        return filters, float(np.logaddexp.reduce(np.log(mode) + [f.log_likelihood for f in imm.filters]))


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
