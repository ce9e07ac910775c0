"""Filters of particles: the baseline that Hem and Brekke compare with, where a track weighs plots by sum-product.

One model of constant velocity. Each cloud also has its mean and covariance as a filter of one model, for gates and reports. The number
of potential vessels is not limited.

Sources: F. Meyer, P. Braca, P. Willett, F. Hlawatsch, A scalable algorithm for tracking an unknown number of targets using multiple
sensors, IEEE Trans. Signal Processing 65(13), 2017; D. Gaglione et al., Fusion of sensor and AIS data by belief propagation, 2022.
Neither says where new clouds are drawn. Here it is around plots that probably nobody took.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Floats, Ints
from coastwatch.kernels.arrays import Records
from coastwatch.kernels.filters.gaussian import Estimates
from coastwatch.kernels.tracks.columns import Candidates, PlotColumns
from coastwatch.kernels.tracks.joint_update import LEAST, Hypotheses
from coastwatch.tracks.radar.bank.compiled import CompiledBank, by_track
from coastwatch.tracks.radar.motion import Filters, Prior
from coastwatch.tracks.radar.table import Table

PREDICT, RESAMPLE, BEGIN = 91, 92, 93  # streams of random numbers


@dataclass(frozen=True)
class ParticleBank:
    """A cloud of particles a track. The same plots give the same random numbers. See `coastwatch.tracks.radar.parts`."""

    prior: Prior
    particles: int
    seed: int

    @cached_property
    def _compiled(self) -> CompiledBank:
        """The filters of one model that stand beside the clouds."""
        return CompiledBank(self.prior)

    @property
    def models(self) -> Records:
        """The model of each filter. (1,) MODEL"""
        return self._compiled.models

    def begin(self, table: Table, slots: Ints, plots: Ints, batch: PlotColumns) -> None:
        self._compiled.begin(table, slots, plots, batch)
        rng = self._generator(BEGIN, batch)
        for n in slots.tolist():
            root = np.linalg.cholesky(table.combined_covariance[n])
            table.particles[n] = table.combined_mean[n] + rng.standard_normal((self.particles, 4)) @ root.T

    def predict(self, filters: Filters, estimates: Estimates, rows: Ints, time_s: float) -> Estimates:
        return self._compiled.predict(filters, estimates, rows, time_s)

    def predict_to_plots(self, table: Table, pairs: Candidates, batch: PlotColumns, added: Floats | None = None) -> Hypotheses:
        hypotheses, noise = by_track(pairs, self.particles), float(self.models["noise"][0])
        slot, start, plot, position, covariance, likelihood = hypotheses
        rng = self._generator(PREDICT, batch)
        position[:], covariance[:] = batch.position[plot], batch.covariance[plot]
        if added is not None:
            covariance *= (1.0 + added[hypotheses.slot[hypotheses.track]])[:, None, None]
        for t, n in enumerate(slot.tolist()):
            mine = slice(start[t], start[t + 1])
            time_s = max(float(table.updated_s[n]), float(batch.time[plot[mine]].max()))
            _move(table.particles[n], time_s - float(table.updated_s[n]), noise, rng)
            table.updated_s[n] = time_s
            late = time_s - batch.time[plot[mine]]
            position[mine] += late[:, None] * table.combined_mean[n, 2:]
            covariance[mine] += late[:, None, None] ** 2 * table.combined_covariance[n, 2:, 2:]
            likelihood[mine] = _likelihoods(table.particles[n], position[mine], covariance[mine])
        self._combine(table, slot)
        return hypotheses

    def likelihood(self, table: Table, pairs: Hypotheses) -> Floats:
        mean: Floats = pairs.likelihood.mean(axis=1)
        return mean

    def update_by_shares(self, table: Table, pairs: Hypotheses, share: Floats, batch: PlotColumns, least: float) -> None:
        rng = self._generator(RESAMPLE, batch)
        for t, n in enumerate(pairs.slot.tolist()):
            mine = slice(pairs.start[t], pairs.start[t + 1])
            likelihood = pairs.likelihood[mine]
            weight = max(1.0 - share[mine].sum(), 0.0) + (
                share[mine, None] * likelihood / likelihood.mean(axis=1)[:, None]
            ).sum(0)
            total = np.cumsum(weight)
            drawn = (np.arange(self.particles) + rng.random()) / self.particles * total[-1]
            table.particles[n] = table.particles[n, np.minimum(np.searchsorted(total, drawn), self.particles - 1)]
        self._combine(table, pairs.slot)

    def _combine(self, table: Table, slots: Ints) -> None:
        """Write mean and covariance of clouds into the filters of these slots."""
        for n in slots.tolist():
            table.state[n, 0, :4] = table.particles[n].mean(axis=0)
            table.covariance[n, 0, :4, :4] = np.cov(table.particles[n].T)
        kernels.filters.imm.combine_filters(tuple(table.filters), table.estimates, slots, self.models)

    def _generator(self, stream: int, batch: PlotColumns) -> np.random.Generator:
        """Random numbers of a batch: they depend on its time and radar alone, so that a run resumes."""
        number = int(batch.sensor[0]) + 1
        return np.random.default_rng([self.seed, stream, abs(round(float(batch.time[-1]) * 1e3)), number])


def _move(particles: Floats, dt: float, noise: float, rng: np.random.Generator) -> None:
    """Particles (P, 4) after dt, in place: straight motion under white acceleration of this density, m2/s3."""
    if dt <= 0.0:
        return
    draw = rng.standard_normal((2, len(particles), 2)) * math.sqrt(noise)
    kick = draw[0] * math.sqrt(dt)
    particles[:, :2] += dt * particles[:, 2:] + 0.5 * dt * kick + draw[1] * math.sqrt(dt**3 / 12.0)
    particles[:, 2:] += kick


def _likelihoods(particles: Floats, position: Floats, covariance: Floats) -> Floats:
    """N(z; particle, R) of each of some positions. (M, P) Args: particles: (P, 4); position: (M, 2); covariance: (M, 2, 2)."""
    apart = position[:, None] - particles[None, :, :2]
    square = np.einsum("mpi,mij,mpj->mp", apart, np.linalg.inv(covariance), apart)
    scale = 2.0 * np.pi * np.sqrt(np.linalg.det(covariance))
    likelihood: Floats = np.maximum(np.exp(-0.5 * square) / scale[:, None], LEAST)
    return likelihood
