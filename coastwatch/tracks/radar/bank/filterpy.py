"""The filters of many tracks by filterpy, one IMMEstimator a track: slow, the reference that the compiled bank equals to rounding."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from filterpy.kalman import IMMEstimator, KalmanFilter

from coastwatch import kernels
from coastwatch.batches import Floats, Ints
from coastwatch.kernels.arrays import Records
from coastwatch.kernels.filters.gaussian import Estimates
from coastwatch.kernels.tracks.columns import PlotColumns
from coastwatch.tracks.radar.bank.compiled import CompiledBank
from coastwatch.tracks.radar.motion import Filters, Prior
from coastwatch.tracks.radar.table import Table


class ModelFilter(KalmanFilter):  # type: ignore[misc]
    """A Kalman filter of filterpy whose prediction is one of our models of motion."""

    def __init__(self, model: np.void, state: Floats, covariance: Floats) -> None:
        super().__init__(dim_x=5, dim_z=2)
        self.model = model
        self.dt_s = 0.0
        self.x: Floats = state.copy()
        self.P: Floats = covariance.copy()
        self.H = np.eye(2, 5)

    def predict(self, u: None = None) -> None:
        """The state after dt_s; the argument is filterpy's and of no use here."""
        if self.dt_s > 0.0:
            jacobian, noise = np.eye(5), np.zeros((5, 5))
            kernels.filters.motion_models.move(self.model, self.x, self.dt_s, jacobian)
            kernels.filters.motion_models.add_process_noise(self.model, self.dt_s, noise)
            self.P = jacobian @ self.P @ jacobian.T + noise


@dataclass(frozen=True)
class FilterpyBank:
    """Filters by filterpy, one object after the other. A track takes one plot. See `coastwatch.tracks.radar.parts`."""

    prior: Prior
    particles: int = 0

    @cached_property
    def models(self) -> Records:
        """The models of each filter. (J,) MODEL"""
        return self.prior.table()

    def begin(self, table: Table, slots: Ints, plots: Ints, batch: PlotColumns) -> None:
        CompiledBank(self.prior).begin(table, slots, plots, batch)

    def update(self, filters: Filters, estimates: Estimates, rows: Ints, plots: Ints, columns: PlotColumns) -> None:
        for n, m in zip(rows.tolist(), plots.tolist(), strict=True):
            dt = columns.time[m] - estimates.time[n]
            late = min(dt, 0.0)
            state, covariance, mode = filters.state[n], filters.covariance[n], filters.mode_probability[n]
            predicted = self._predicted(state, covariance, mode, max(dt, 0.0))
            z = columns.position[m] - estimates.mean[n, 2:4] * late
            noise = columns.covariance[m] + estimates.covariance[n, 2:4, 2:4] * late**2
            for column, after in zip(filters, self._updated(*predicted, z, noise), strict=True):
                column[n] = after
            estimates.time[n] = max(estimates.time[n], columns.time[m])
            kernels.filters.imm.combine_filters(tuple(filters), estimates, np.array([n]), self.models)

    def predict(self, filters: Filters, estimates: Estimates, rows: Ints, time_s: float) -> Estimates:
        out = Estimates(*(column[rows] for column in estimates))
        for k, n in enumerate(rows.tolist()):
            dt = max(time_s - float(estimates.time[n]), 0.0)
            state, spread, mode = self._predicted(filters.state[n], filters.covariance[n], filters.mode_probability[n], dt)
            imm = self._estimator(state, spread, mode, np.eye(len(mode)))
            out.mean[k], out.covariance[k], out.time[k] = imm.x[:4], imm.P[:4, :4], estimates.time[n] + dt
            out.noise[k] = mode @ self.models["noise"]
        return out

    def _estimator(self, state: Floats, covariance: Floats, mode_probability: Floats, transition: Floats) -> IMMEstimator:
        models = [ModelFilter(*one) for one in zip(self.models, state, covariance, strict=True)]
        return IMMEstimator(models, mode_probability.copy(), transition)

    def _predicted(self, state: Floats, covariance: Floats, mode_probability: Floats, dt_s: float) -> Filters:
        sojourn_s, j = self.models["sojourn"], len(self.models)
        stay = (1.0 + (j - 1) * np.exp(-dt_s / sojourn_s * j / (j - 1))) / j
        transition = np.tile(((1.0 - stay) / (j - 1))[:, None], (1, j))  # [i, j]: of model j now, given model i before
        transition[np.arange(j), np.arange(j)] = stay
        imm = self._estimator(state, covariance, mode_probability, transition)
        for one in imm.filters:
            one.dt_s = dt_s
        imm.predict()
        return Filters(np.array([f.x for f in imm.filters]), np.array([f.P for f in imm.filters]), imm.cbar.copy())

    def _updated(
        self, state: Floats, covariance: Floats, mode_probability: Floats, position_m: Floats, noise: Floats
    ) -> Filters:
        imm = self._estimator(state, covariance, mode_probability, np.eye(len(mode_probability)))
        for one in imm.filters:
            one.R = noise
        imm.update(position_m)
        after = np.maximum(imm.mu, kernels.filters.imm.FLOOR)
        return Filters(np.array([f.x for f in imm.filters]), np.array([f.P for f in imm.filters]), after / after.sum())
