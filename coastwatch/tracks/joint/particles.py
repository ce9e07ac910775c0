"""Radar tracks as clouds of particles, by sum-product association: the baseline that Hem and Brekke compare with.

One model of constant velocity, no visibility. Existence, ids, births and ends are those of `messages.MessageAssociation`, and the number
of potential vessels is not limited. Each cloud also has its mean and covariance as a filter of one model, for gates and reports.

Sources: F. Meyer, P. Braca, P. Willett, F. Hlawatsch, A scalable algorithm for tracking an unknown number of targets using multiple
sensors, IEEE Trans. Signal Processing 65(13), 2017; D. Gaglione et al., Fusion of sensor and AIS data by belief propagation, 2022.
Neither says where new clouds are drawn. Here it is around plots that probably nobody took.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch import kernels
from coastwatch.batches import Floats, Ints
from coastwatch.kernels.tracks.columns import Candidates, PlotColumns
from coastwatch.kernels.tracks.joint_update import LEAST, Hypotheses
from coastwatch.stage import Method
from coastwatch.tracks.clutter import ClutterSettings
from coastwatch.tracks.filter_bank import CompiledBank
from coastwatch.tracks.joint.association import by_track
from coastwatch.tracks.joint.existence import ExistenceManagement
from coastwatch.tracks.joint.messages import MessageAssociation, MessagesInTurn, NoisyMessages, in_order, positions_alone
from coastwatch.tracks.motion import Manoeuvres, Straight
from coastwatch.tracks.region import RegionInput, RegionOutput, update_region
from coastwatch.tracks.table import RadarMemory, Table

PREDICT, RESAMPLE, BEGIN = 91, 92, 93  # streams of random numbers


@dataclass(frozen=True)
class ParticleAssociation(MessageAssociation):
    """As `MessageAssociation`, with particles for filters. The same plots give the same random numbers."""

    seed: int
    particles: int

    def _predict_to(self, table: Table, pairs: Candidates, batch: PlotColumns) -> Hypotheses:
        hypotheses, noise = by_track(pairs, self.particles), float(self.bank.models["noise"][0])
        slot, start, plot, position, covariance, likelihood = hypotheses
        rng = self._generator(PREDICT, batch)
        position[:], covariance[:] = batch.position[plot], batch.covariance[plot]
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

    def _likelihood(self, table: Table, pairs: Hypotheses) -> Floats:
        mean: Floats = pairs.likelihood.mean(axis=1)
        return mean

    def _update(self, table: Table, pairs: Hypotheses, share: Floats, batch: PlotColumns) -> None:
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

    def _begin(self, memory: RadarMemory, batch: PlotColumns, existence: Floats) -> RadarMemory:
        return self._with_clouds(super()._begin(memory, batch, existence), len(memory.table), batch)

    def _begin_named(self, memory: RadarMemory, batch: PlotColumns, mmsi: Ints, existence: Floats) -> RadarMemory:
        return self._with_clouds(super()._begin_named(memory, batch, mmsi, existence), len(memory.table), batch)

    def _with_clouds(self, memory: RadarMemory, before: int, batch: PlotColumns) -> RadarMemory:
        """This memory with a cloud for each track beyond the first `before`."""
        table, rng = memory.table, self._generator(BEGIN, batch)
        for n in table.live[before:].tolist():
            root = np.linalg.cholesky(table.combined_covariance[n])
            table.particles[n] = table.combined_mean[n] + rng.standard_normal((self.particles, 4)) @ root.T
        return memory

    def _combine(self, table: Table, slots: Ints) -> None:
        """Write mean and covariance of clouds into the filters of these slots."""
        for n in slots.tolist():
            table.state[n, 0, :4] = table.particles[n].mean(axis=0)
            table.covariance[n, 0, :4, :4] = np.cov(table.particles[n].T)
        kernels.filters.imm.combine_filters(tuple(table.filters), table.estimates, slots, self.bank.models)

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


class BpParticles(Method):
    """Particles and sum-product, with the newest AIS message of each id at the time of the plots that follow: slow, a baseline.

    Source: see `coastwatch/tracks/joint/particles.py`.
    """

    method: Literal["bp_particles"] = "bp_particles"
    particles: Annotated[int, Field(ge=10, le=100_000)] = 3000  # of each track
    seed: Annotated[int, Field(ge=0)] = 0  # whole number that all randomness starts from
    motion: Manoeuvres = Manoeuvres(models=(Straight(noise_m2_s3=0.49, share=1.0),))
    upkeep: ExistenceManagement = ExistenceManagement(hides=False, exact_up_to=1)
    clutter: ClutterSettings = ClutterSettings()
    messages: NoisyMessages = NoisyMessages()

    def init(self) -> RadarMemory:
        """No track."""
        return RadarMemory.empty(models=1, particles=self.particles)

    def step(self, memory: RadarMemory, given: RegionInput) -> tuple[RadarMemory, RegionOutput]:
        """The confirmed tracks of one region that probably exist at time_s; see `Imm.step`.

        Raises: ValueError where `motion` has more than one model.
        """
        if len(self.motion.models) != 1:
            raise ValueError(
                f"tracks.motion.models: got {len(self.motion.models)}, needed 1 where tracks.method is bp_particles"
            )
        parts = self.upkeep, self.clutter, given.sensors, self.messages, self.seed, self.particles
        tracker = ParticleAssociation(CompiledBank(self.motion), *parts)
        heard = positions_alone(given.messages)
        take = MessagesInTurn(tracker.take_newest, in_order(heard, memory, self.upkeep.late_s))
        return update_region(tracker, memory, given, take_messages=take)
