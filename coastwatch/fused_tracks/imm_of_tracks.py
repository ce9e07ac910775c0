"""Fused tracks by a second IMM whose measurements are the tracks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from coastwatch.batches import Associations, Floats, FusedTracks, Ints, Measurements, Tracks
from coastwatch.fused_tracks.membership import by_vessel, rounds
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.kernels.lookup import find
from coastwatch.stage import Method

KINDS = np.array([0, 0, 1], np.int64)  # constant velocity, constant velocity, coordinated turn


@dataclass(frozen=True, eq=False)
class Bank:
    """The filters of V vessels in planes that touch at their anchors, and which tracks were last in each."""

    anchor_deg: Floats  # (V, 2)
    state: Floats  # (V, J, 5)
    covariance: Floats  # (V, J, 5, 5)
    mode: Floats  # (V, J)
    time_s: float
    track_id: Ints  # (L,) sorted
    row: Ints  # (L,) of the bank


class ImmOfTracks(Method):
    """An IMM (constant velocity with low and high noise, coordinated turn) over the tracks of a vessel as measurements.

    The errors of tracks are autocorrelated and share process noise, so that their covariance is taken `inflation` times (the paper
    adjusts it downwards, which is the wrong direction). A vessel with one track is that track.

    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven Approach,
    section III-F.
    """

    method: Literal["imm_of_tracks"] = "imm_of_tracks"
    inflation: Annotated[float, Field(gt=0.0)] = 4.0
    noise_m2_s3: tuple[float, float, float] = (0.01, 0.1, 0.02)  # density of white acceleration of the three models
    turn_noise_rad2_s3: Annotated[float, Field(gt=0.0)] = 2.5e-7  # density of the drift of the turn rate
    turn_sigma_rad_s: Annotated[float, Field(gt=0.0)] = 0.02
    sojourn_s: tuple[float, float, float] = (60.0, 15.0, 60.0)
    unknown_velocity_sigma_m_s: Annotated[float, Field(gt=0.0)] = 0.5

    def init(self) -> Bank:
        none = np.zeros(0, np.int64)
        models = len(KINDS)
        return Bank(
            np.zeros((0, 2)), np.zeros((0, models, 5)), np.zeros((0, models, 5, 5)), np.zeros((0, models)), 0.0, none, none
        )

    def step(
        self,
        memory: Bank,
        tracks: Tracks,
        measurements: Measurements,
        associations: Associations,
        time_s: float,
        kinds: Ints,
    ) -> tuple[Bank, FusedTracks]:
        """One estimate a vessel. Args: tracks: (N); measurements: unused; associations: of its rows; kinds: SourceKind of each source.

        Returns: memory and FusedTracks, one row for each vessel number.
        """
        from coastwatch.kernels import imm

        covariance = tracks.known_covariance(self.unknown_velocity_sigma_m_s)
        groups = by_vessel(associations.vessel)
        plan = rounds(groups, -tracks.source)
        if not plan:
            return self.init(), FusedTracks.empty()
        bank = self._carried(memory, tracks, associations.vessel, plan, covariance, time_s)
        state, spread, mode = bank.state, bank.covariance, bank.mode
        for who, row in plan:
            z = np.concatenate([difference_m(tracks.position_deg[row], bank.anchor_deg[who]), tracks.velocity_m_s[row]], axis=1)
            has_velocity = np.ones(len(row), np.bool_)
            s, p, m, _ = imm.imm_update(state[who], spread[who], mode[who], z, self.inflation * covariance[row], has_velocity)
            state[who], spread[who], mode[who] = s, p, m
        mean, total = imm.imm_estimate(state, spread, mode)
        position = offset_deg(bank.anchor_deg, mean[:, :2])
        velocity, fused = mean[:, 2:4].copy(), total[:, :4, :4].copy()
        alone = np.diff(groups.start) == 1
        row = plan[0][1][alone]
        position[alone], velocity[alone], fused[alone] = tracks.position_deg[row], tracks.velocity_m_s[row], covariance[row]
        return bank, FusedTracks(np.full(len(position), float(time_s)), position, velocity, fused)

    def _carried(
        self, memory: Bank, tracks: Tracks, vessel: Ints, plan: list[tuple[Ints, Ints]], covariance: Floats, time_s: float
    ) -> Bank:
        """Filters for this cycle's vessels: predicted where a member was in a filter before, begun at the lead track elsewhere."""
        lead = plan[0][1]
        state, spread, mode = self._begun(covariance[lead], tracks.velocity_m_s[lead])
        anchor = tracks.position_deg[lead]
        before = np.full(len(lead), -1, np.int64)
        for who, row in plan:
            before[who] = np.where(before[who] < 0, _lookup(memory, tracks.track_id[row]), before[who])
        known = before >= 0
        if known.any():
            rows = before[known]
            moved = difference_m(anchor[known], memory.anchor_deg[rows])
            old_state, old_spread, old_mode = self._predicted(memory, rows, time_s)
            old_state[:, :, :2] -= moved[:, None, :]
            state[known], spread[known], mode[known] = old_state, old_spread, old_mode
        order = np.argsort(tracks.track_id, kind="stable")
        return Bank(anchor, state, spread, mode, float(time_s), tracks.track_id[order], vessel[order])

    def _begun(self, covariance: Floats, velocity: Floats) -> tuple[Floats, Floats, Floats]:
        count, models = len(covariance), len(KINDS)
        state = np.zeros((count, models, 5))
        state[:, :, 2:4] = velocity[:, None, :]
        spread = np.zeros((count, models, 5, 5))
        spread[:, :, :4, :4] = covariance[:, None]
        spread[:, :, 4, 4] = self.turn_sigma_rad_s**2
        return state, spread, np.full((count, models), 1.0 / models)

    def _predicted(self, memory: Bank, rows: Ints, time_s: float) -> tuple[Any, Any, Any]:
        from coastwatch.kernels import imm

        turn_noise = np.array([0.0, 0.0, self.turn_noise_rad2_s3])
        turn_sigma = np.full(3, self.turn_sigma_rad_s)
        return imm.imm_predict(
            memory.state[rows],
            memory.covariance[rows],
            memory.mode[rows],
            np.full(len(rows), time_s - memory.time_s),
            KINDS,
            np.array(self.noise_m2_s3),
            turn_noise,
            turn_sigma,
            np.array(self.sojourn_s),
        )


def _lookup(memory: Bank, track_id: Ints) -> Ints:
    """The bank row that each track was in; -1 where none."""
    at = find(memory.track_id, track_id)
    return np.where(at >= 0, memory.row[at], -1).astype(np.int64) if len(memory.row) else at
