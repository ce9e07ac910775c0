"""Fused tracks with partial feedback: a radar filter that goes on from the fused track, and AIS tracks that are left alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Bools, Floats, FusedTracks, Ints, Measurements, SourceKind, Struct, Tracks, column
from coastwatch.fused_tracks.convex import Convex
from coastwatch.fused_tracks.inputs import FusionInput, FusionMethod
from coastwatch.fused_tracks.vessel_tracks import VesselTracks
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.stage import NoMemory, Positive


@dataclass(frozen=True, eq=False)
class FeedbackFilters(Struct):
    """The radar filters of B vessels after the feedback of the last cycle, and what is kept of their AIS tracks."""

    radar_id: Ints = column(np.int64, "B")
    ais_id: Ints = column(np.int64, "B")
    position_deg: Floats = column(np.float64, "B", 2)
    velocity_m_s: Floats = column(np.float64, "B", 2)
    covariance: Floats = column(np.float64, "B", 4, 4)  # also the cross-covariance with the AIS track
    ais_covariance: Floats = column(np.float64, "B", 4, 4)
    ais_updated_s: Floats = column(np.float64, "B")
    time_s: float = 0.0


class PartialFeedback(FusionMethod):
    """Radar and AIS track fused with their cross-covariance; the radar filter of a vessel then takes the fused estimate over.

    The filter is kept here: it is updated by the plots of the vessel's radar track. After the feedback its cross-covariance with
    the AIS track is its own covariance, because the fused error is orthogonal to the difference of both errors. A cycle without a
    new measurement changes nothing. A cycle with a plot, a report or neither propagates the cross-covariance alike.

    A filter begins at its radar track, uncorrelated, when a vessel gets another radar or AIS track, or a radar track that was
    updated without a plot. Vessels without one radar and one AIS track, and tracks without covariance, are fused as by `convex`.

    Source: A. Sagild, track-to-track fusion of radar and AIS, 2021, section 10.2.2 and eq. 9.23 to 9.25, with the cross-covariance
    of two predictions propagated.
    """

    method: Literal["partial_feedback"] = "partial_feedback"
    noise_m2_s3: Positive = 0.09  # density of the white acceleration of vessels
    unknown_velocity_sigma_m_s: Positive = 0.5  # of a source that gives no covariance

    def init(self) -> FeedbackFilters:
        return FeedbackFilters.empty()

    def step(self, memory: FeedbackFilters, given: FusionInput) -> tuple[FeedbackFilters, FusedTracks]:
        """One estimate a vessel: memory, and one row for each vessel number."""
        tracks, time_s = given.tracks, float(given.time_s)
        _, fused = Convex(unknown_velocity_sigma_m_s=self.unknown_velocity_sigma_m_s).step(NoMemory(), given)
        vessel, radar, ais = _radar_and_ais(VesselTracks.of(given.associations), tracks, given.kinds)
        position, velocity = tracks.position_deg[radar].copy(), tracks.velocity_m_s[radar].copy()
        covariance, cross = tracks.covariance[radar].copy(), np.zeros((len(radar), 4, 4))
        row = kernels.tables.match_ids.index_of(tracks.track_id, given.measurements.track_id).astype(np.int64)
        mine: Bools = (row >= 0) & (given.measurements.sensor >= 0)
        plot, track_of_plot = given.measurements.take(mine), row[mine]
        goes_on, before = self._continued(memory, tracks, radar, ais, plot, track_of_plot)
        dt = np.full(len(before), time_s - memory.time_s)
        position[goes_on], velocity[goes_on], covariance[goes_on], before_report = _updated(
            memory, before, plot, track_of_plot, radar[goes_on], time_s, self.noise_m2_s3
        )
        expected = kernels.fusion.cross_covariance.predicted(memory.ais_covariance[before], dt, self.noise_m2_s3)
        share = kernels.fusion.cross_covariance.remaining(expected, tracks.covariance[ais[goes_on]])
        share[tracks.updated_s[ais[goes_on]] == memory.ais_updated_s[before]] = np.eye(4)
        cross[goes_on] = before_report @ share.transpose(0, 2, 1)
        mean, total = _fed_back(position, velocity, covariance, cross, tracks.take(ais))
        position = offset_deg(position, mean[:, :2])
        fused.position_deg[vessel], fused.velocity_m_s[vessel], fused.covariance[vessel] = position, mean[:, 2:], total
        after = FeedbackFilters(
            radar_id=tracks.track_id[radar],
            ais_id=tracks.track_id[ais],
            position_deg=position,
            velocity_m_s=mean[:, 2:].copy(),
            covariance=total,
            ais_covariance=tracks.covariance[ais],
            ais_updated_s=tracks.updated_s[ais],
            time_s=time_s,
        )
        return after, fused

    def _continued(
        self, memory: FeedbackFilters, tracks: Tracks, radar: Ints, ais: Ints, plot: Measurements, track_of_plot: Ints
    ) -> tuple[Ints, Ints]:
        """Which of the vessels go on with a filter, and with which. Args: radar, ais: (B,) rows. Returns: two times (G,)."""
        at = kernels.tables.match_ids.index_of(memory.radar_id, tracks.track_id[radar])
        same = np.append(memory.ais_id, -1)[at] == tracks.track_id[ais]
        plotted_s = np.full(len(tracks), memory.time_s)
        np.maximum.at(plotted_s, track_of_plot, plot.time_s)
        goes_on = np.flatnonzero((at >= 0) & same & (tracks.updated_s[radar] <= plotted_s[radar]))
        return goes_on, at[goes_on].astype(np.int64)


def _radar_and_ais(vessels: VesselTracks, tracks: Tracks, kinds: Ints) -> tuple[Ints, Ints, Ints]:
    """Vessels of one radar and one AIS track, both with covariance; the rows of these tracks. (B,) each."""
    vessel = np.flatnonzero(vessels.size == 2)
    pair = vessels.row[vessels.start[:-1][vessel][:, None] + np.arange(2)].astype(np.int64)
    kind, known = kinds[tracks.source[pair]], np.isfinite(tracks.covariance[pair]).all(axis=(1, 2, 3))
    some = np.flatnonzero((np.sort(kind, axis=1) == np.sort([SourceKind.RADAR, SourceKind.AIS])).all(axis=1) & known)
    radar_second = kind[some, 0] != SourceKind.RADAR
    radar = np.where(radar_second, pair[some, 1], pair[some, 0])
    return vessel[some], radar, np.where(radar_second, pair[some, 0], pair[some, 1])


def _updated(
    memory: FeedbackFilters, before: Ints, plot: Measurements, track_of_plot: Ints, radar: Ints, time_s: float, noise: float
) -> tuple[Floats, Floats, Floats, Floats]:
    """The filters after the plots of a cycle, at its time: position (G, 2), velocity (G, 2), covariance (G, 4, 4).

    The last, (G, 4, 4), is the cross-covariance before the AIS report of the cycle. A late plot counts as one of the last cycle.
    Args: before: (G,) filters; track_of_plot: row of the track of each plot; radar: (G,) row of the radar track of each filter.
    """
    kernel, count = kernels.fusion.cross_covariance, len(before)
    filter_of = np.full(int(max(radar.max(initial=-1), track_of_plot.max(initial=-1))) + 1, -1)
    filter_of[radar] = np.arange(count)
    owner = filter_of[track_of_plot]
    mine = np.flatnonzero(owner >= 0)
    mine = mine[np.lexsort((plot.time_s[mine], owner[mine]))]
    owner = owner[mine]
    rank = np.arange(len(mine)) - np.searchsorted(owner, owner)
    anchor = memory.position_deg[before]
    state = np.concatenate([np.zeros((count, 2)), memory.velocity_m_s[before]], axis=1)
    covariance = memory.covariance[before].copy()
    cross, now = covariance.copy(), np.full(count, memory.time_s)
    for k in range(int(rank.max(initial=-1)) + 2):
        last = k > rank.max(initial=-1)
        f = np.arange(count) if last else owner[rank == k]
        one = mine[:0] if last else mine[rank == k]
        to = np.full(count, time_s) if last else np.maximum(plot.time_s[one], now[f])
        dt = to - now[f]
        state[f, :2] += dt[:, None] * state[f, 2:]
        covariance[f], cross[f] = (kernel.predicted(matrix[f], dt, noise) for matrix in (covariance, cross))
        now[f] = to
        if last:
            break
        ahead = covariance[f, :, :2]
        inverse = np.linalg.inv(ahead[:, :2] + plot.covariance[one, :2, :2])
        gain = ahead @ inverse
        residual = difference_m(plot.position_deg[one], anchor[f]) - state[f, :2]
        state[f] += (gain @ residual[..., None])[..., 0]
        covariance[f] -= gain @ ahead.transpose(0, 2, 1)
        cross[f] -= gain @ cross[f, :2]
    return offset_deg(anchor, state[:, :2]), state[:, 2:], covariance, cross


def _fed_back(position: Floats, velocity: Floats, covariance: Floats, cross: Floats, ais: Tracks) -> tuple[Floats, Floats]:
    """Fused state relative to the radar's position, (B, 4), and covariance. Where none comes out, as if C were 0."""
    combined, positive = kernels.fusion.cross_covariance.combined, kernels.fusion.cross_covariance.positive
    total = covariance + ais.covariance - cross - cross.transpose(0, 2, 1)
    wrong = ~positive(0.5 * (total + total.transpose(0, 2, 1)))
    cross = np.where(wrong[:, None, None], 0.0, cross)
    gain, fused = combined(covariance, ais.covariance, cross)
    wrong = ~positive(fused)
    gain[wrong], fused[wrong] = combined(covariance[wrong], ais.covariance[wrong], np.zeros((int(wrong.sum()), 4, 4)))
    state = np.concatenate([np.zeros_like(position), velocity], axis=1)
    apart = np.concatenate([difference_m(ais.position_deg, position), ais.velocity_m_s - velocity], axis=1)
    return state + (gain @ apart[..., None])[..., 0], fused
