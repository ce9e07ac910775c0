"""Fused tracks by a second IMM whose measurements are the tracks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch import kernels
from coastwatch.batches import Associations, Floats, FusedTracks, Ints, Measurements, Tracks
from coastwatch.fused_tracks.membership import Grouped, at_time, states, unwritten
from coastwatch.kernels.threads import in_blocks
from coastwatch.stage import Method

FEW = 512  # filters that keep a thread busy for long enough
KINDS = np.array([0, 0, 1], np.int64)  # constant velocity, constant velocity, coordinated turn


@dataclass(frozen=True, eq=False)
class Bank:
    """The filters of V vessels in planes that touch at their anchors, and which tracks were last in each."""

    anchor_deg: Floats  # (V, 2)
    state: Floats  # (V, J, 5)
    covariance: Floats  # (V, J, 5, 5)
    mode: Floats  # (V, J)
    time_s: float
    track_id: Ints  # (L,) every track of the last cycle, in its order
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

        groups, j = Grouped(*associations.by_vessel), len(KINDS)
        count, row = len(groups), kernels.tables.counting_sort.preferred(*groups, -tracks.source)
        at = kernels.tables.match_ids.index_of(memory.track_id, tracks.track_id)
        was = np.where(at >= 0, np.append(memory.row, -1)[at], -1).astype(np.int32)
        before = memory.anchor_deg, memory.state, memory.covariance, memory.mode
        after = np.empty((count, 2)), np.empty((count, j, 5)), np.empty((count, j, 5, 5)), np.empty((count, j))
        out, sigma = unwritten(count), self.unknown_velocity_sigma_m_s
        how = float(time_s - memory.time_s), self._models(), self.turn_sigma_rad_s**2, self.inflation, after, out
        in_blocks(
            kernels.filters.track_to_track_imm.filtered,
            count,
            groups.start,
            row,
            states(tracks),
            sigma,
            was,
            before,
            *how,
            least=FEW,
        )
        return Bank(*after, float(time_s), tracks.track_id, associations.vessel), at_time(time_s, out)

    def _models(self) -> tuple[Ints, Floats, Floats, Floats, Floats]:
        """The models as the kernel takes them."""
        turn_noise = np.array([0.0, 0.0, self.turn_noise_rad2_s3])
        return KINDS, np.array(self.noise_m2_s3), turn_noise, np.full(3, self.turn_sigma_rad_s), np.array(self.sojourn_s)
