"""Fused tracks by a second IMM whose measurements are the tracks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Floats, FusedTracks, Ints, Struct, Tracks, column
from coastwatch.fused_tracks.inputs import FusionInput, FusionMethod
from coastwatch.fused_tracks.vessel_tracks import Estimates, VesselTracks
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.stage import Positive

MODELS = 3  # constant velocity with low and with high noise, coordinated turn


@dataclass(frozen=True, eq=False)
class TrackFilters(Struct):
    """The filters of V vessels in planes that touch at their anchors, and which tracks were last in each."""

    anchor_deg: Floats = column(np.float64, "V", 2)
    state: Floats = column(np.float64, "V", "J", 5)
    covariance: Floats = column(np.float64, "V", "J", 5, 5)
    mode_probability: Floats = column(np.float64, "V", "J")
    track_id: Ints = column(np.int64, "L")  # every track of the last cycle, in its order
    filter_of_track: Ints = column(np.int64, "L", rows_of="V")
    time_s: float = 0.0


class ImmOfTracks(FusionMethod):
    """An IMM (constant velocity with low and high noise, coordinated turn) over the tracks of a vessel as measurements.

    The errors of tracks are autocorrelated and share process noise, so their covariance is multiplied by `inflation`. (The paper
    makes it smaller, which is the wrong direction.) The estimate of a vessel with one track is that track.

    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven Approach,
    section III-F.
    """

    method: Literal["imm_of_tracks"] = "imm_of_tracks"
    inflation: Positive = 4.0
    """Factor on the covariance (a variance, no unit) of each track: above 1 it trusts tracks less, e.g. 4 doubles their standard
    deviations."""
    noise_m2_s3: tuple[float, float, float] = (0.01, 0.1, 0.02)  # density of white acceleration of the three models
    turn_noise_rad2_s3: Positive = 2.5e-7  # density of the drift of the turn rate
    turn_sigma_rad_s: Positive = 0.02
    sojourn_s: tuple[float, float, float] = (60.0, 15.0, 60.0)  # mean time in each of the three models
    unknown_velocity_sigma_m_s: Positive = 0.5

    def init(self) -> TrackFilters:
        return TrackFilters.empty(J=MODELS)

    def step(self, memory: TrackFilters, given: FusionInput) -> tuple[TrackFilters, FusedTracks]:
        """One estimate a vessel: memory, and one row for each vessel number."""
        vessels, tracks, time_s = VesselTracks.of(given.associations), given.tracks, given.time_s
        row = kernels.tables.counting_sort.preferred(*vessels, -tracks.source)
        covariance = tracks.known_covariance(self.unknown_velocity_sigma_m_s)
        first = row[vessels.start[:-1]]
        filters = self._predict(memory, vessels, row, tracks, covariance[first], time_s)
        anchor_deg, state, spread, mode = filters
        for rank in range(int(vessels.size.max(initial=0))):
            who = np.flatnonzero(vessels.size > rank)
            n = row[vessels.start[who] + rank]
            east_north = difference_m(tracks.position_deg[n], anchor_deg[who])
            z, noise = np.concatenate([east_north, tracks.velocity_m_s[n]], axis=1), self.inflation * covariance[n]
            every = np.ones(len(n), np.bool_)
            after = kernels.filters.imm.update_filters(state[who], spread[who], mode[who], z, noise, every)
            state[who], spread[who], mode[who] = after[:3]
        mean, total = kernels.filters.imm.estimate_filters(state, spread, mode)
        out = Estimates(offset_deg(anchor_deg, mean[:, :2]), mean[:, 2:4].copy(), total[:, :4, :4].copy())
        alone = vessels.size == 1
        out.position_deg[alone], out.velocity_m_s[alone] = tracks.position_deg[first[alone]], tracks.velocity_m_s[first[alone]]
        out.covariance[alone] = covariance[first[alone]]
        return TrackFilters(*filters, tracks.track_id, given.associations.vessel, float(time_s)), out.at_time(time_s)

    def _predict(
        self, memory: TrackFilters, vessels: VesselTracks, row: Ints, tracks: Tracks, covariance: Floats, time_s: float
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Anchor, state, covariance and mode probability of the filter of each vessel, before its tracks are taken.

        A vessel goes on with the filter that the first of its tracks was in; where none was, it begins at the first track.
        Args: row: (N,) the tracks of each vessel in order of preference; covariance: (V, 4, 4) of the first of each.
        """
        at = kernels.tables.match_ids.index_of(memory.track_id, tracks.track_id)
        before = np.append(memory.filter_of_track, -1)[at][row]
        entry = np.where(before >= 0, np.arange(len(row)), len(row))
        entry = np.minimum.reduceat(entry, vessels.start[:-1]) if len(row) else entry
        filter_of = np.append(before, -1)[entry]
        first = row[vessels.start[:-1]]
        anchor_deg = tracks.position_deg[first]
        state, spread = np.zeros((vessels.vessel_count, MODELS, 5)), np.zeros((vessels.vessel_count, MODELS, 5, 5))
        mode = np.full((vessels.vessel_count, MODELS), 1.0 / MODELS)
        state[:, :, 2:4] = tracks.velocity_m_s[first][:, None]
        spread[:, :, :4, :4] = covariance[:, None]
        spread[:, :, 4, 4] = self.turn_sigma_rad_s**2
        known = np.flatnonzero(filter_of >= 0)
        old, dt_s = filter_of[known], np.full(len(known), time_s - memory.time_s)
        state[known], spread[known], mode[known] = kernels.filters.imm.predict_filters(
            memory.state[old], memory.covariance[old], memory.mode_probability[old], dt_s, math.inf, self._models()
        )
        state[known, :, :2] += difference_m(memory.anchor_deg[old], anchor_deg[known])[:, None]
        return anchor_deg, state, spread, mode

    def _models(self) -> Any:
        """The models as the kernels take them. (J,) MODEL"""
        models = kernels.filters.motion_models
        return models.table(
            kind=[models.STRAIGHT, models.STRAIGHT, models.TURNING],
            noise=self.noise_m2_s3,
            manoeuvre_noise=[0.0, 0.0, self.turn_noise_rad2_s3],
            manoeuvre_sigma=self.turn_sigma_rad_s,
            sojourn=self.sojourn_s,
        )
