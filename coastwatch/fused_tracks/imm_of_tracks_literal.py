"""Fused tracks by the paper's second IMM: tracks as measurements, their covariances measured in a window, then made smaller."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch.batches import Floats, FusedTracks, Ints, Struct, Tracks, column
from coastwatch.fused_tracks.imm_of_tracks import ImmOfTracks, TrackFilters
from coastwatch.fused_tracks.inputs import FusionInput, FusionMethod
from coastwatch.geodesy import difference_m
from coastwatch.kernels.tables.lookup import find
from coastwatch.stage import Positive, PositiveShare


@dataclass(frozen=True, eq=False)
class Window(Struct):
    """States of N tracks at the last p cycles, newest last."""

    time_s: Floats = column(np.float64, "p", new=np.nan)  # of the cycles; NaN before the first
    track_id: Ints = column(np.int64, "N")  # sorted
    position_deg: Floats = column(np.float64, "N", "p", 2)  # NaN before the first
    velocity_m_s: Floats = column(np.float64, "N", "p", 2)

    def extended(self, tracks: Tracks, time_s: float) -> Window:
        """The window one cycle later; tracks that are gone are forgotten. Args: tracks: (N) at `time_s`."""
        order = np.argsort(tracks.track_id, kind="stable")
        before = find(self.track_id, tracks.track_id[order])
        known = before >= 0
        windows = []
        for window, value in ((self.position_deg, tracks.position_deg), (self.velocity_m_s, tracks.velocity_m_s)):
            out = np.full((len(order), *window.shape[1:]), np.nan)
            out[known, :-1] = window[before[known], 1:]
            out[:, -1] = value[order]
            windows.append(out)
        return Window(np.append(self.time_s[1:], time_s), tracks.track_id[order], windows[0], windows[1])

    def covariance(self, track_id: Ints, *, about_line: bool) -> Floats:
        """Sample covariance (divisor p - 1) of the last p states of tracks in the window; NaN for fewer states.

        Args: about_line: of the residuals of each component about its least-squares line in time; else about its mean, as in
        eq. 7. Returns: (N, 4, 4) of east, north, east rate, north rate.
        """
        row = find(self.track_id, track_id)
        newest = self.position_deg[row, -1:]
        metres = difference_m(self.position_deg[row], np.broadcast_to(newest, self.position_deg[row].shape))
        state = np.concatenate([metres, self.velocity_m_s[row]], axis=2)
        state = state - state.mean(axis=1, keepdims=True)
        if about_line:
            t = self.time_s - self.time_s.mean()
            state = state - t[:, None] * np.einsum("p,npk->nk", t, state)[:, None, :] / (t @ t)
        return np.asarray(np.einsum("npi,npj->nij", state, state) / (len(self.time_s) - 1))


@dataclass(frozen=True, eq=False)
class LiteralFilters:
    """The states of the last p cycles, and the filters."""

    window: Window
    filters: TrackFilters


class ImmOfTracksLiteral(FusionMethod):
    """The IMM of plot fusion again, with radar and AIS tracks as its measurements in every cycle. Of a paper, for comparison.

    The paper says: "the same IMM filter used for radar plot fusion" (III-F), with tracks as inputs; "process error and measurement
    errors were adjusted downwards" because the inputs are filtered already (III-F); "variances are dynamically calculated within a
    time window" (V). It does not say which variance, over how many values, or how much smaller. And smaller is the wrong direction:
    errors of a filtered track persist from cycle to cycle, and the window shows only how they change.

    Assumed here: the covariance of each track is the sample covariance (eq. 7) of its last p states. With `scatter = "about_line"`
    it is taken of the residuals about a straight line, with `"values"` of the states with their motion. It is multiplied by
    `measurement_share`, and the process noise of plot fusion by `process_share`. Before p cycles a track's own covariance is used
    (AIS: its specification). The estimate of a vessel with one track is that track.

    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven Approach,
    sections III-F and V.
    """

    method: Literal["imm_of_tracks_literal"] = "imm_of_tracks_literal"
    window: Annotated[int, Field(ge=6, le=200)] = (
        10  # p, cycles; a line takes two degrees of freedom, and fewer than 4 are singular
    )
    scatter: Literal["about_line", "values"] = "about_line"  # sample covariance of residuals about a line, or of the states
    measurement_share: PositiveShare = 0.5  # factor of the sample covariance
    process_share: PositiveShare = 0.5  # factor of the process noise of plot fusion
    unknown_velocity_sigma_m_s: Positive = 0.5  # of a source that gives no covariance, before p cycles

    def init(self) -> LiteralFilters:
        return LiteralFilters(Window.empty(p=self.window), self._filter().init())

    def step(self, memory: LiteralFilters, given: FusionInput) -> tuple[LiteralFilters, FusedTracks]:
        """One estimate a vessel: memory, and one row for each vessel number."""
        tracks = given.tracks
        window = memory.window.extended(tracks, given.time_s)
        measured = replace(tracks, covariance=self._measured(window, tracks, given.associations.vessel))
        filters, fused = self._filter().step(memory.filters, given._replace(tracks=measured))
        return LiteralFilters(window, filters), fused

    def _measured(self, window: Window, tracks: Tracks, vessel: Ints) -> Floats:
        """The covariances that the filter takes. (N, 4, 4)"""
        covariance = tracks.known_covariance(self.unknown_velocity_sigma_m_s)
        together = np.flatnonzero(np.bincount(vessel, minlength=1)[vessel] > 1)
        scattered = window.covariance(tracks.track_id[together], about_line=self.scatter == "about_line")
        full = np.isfinite(scattered).all(axis=(1, 2))
        covariance[together[full]] = self.measurement_share * scattered[full]
        return covariance

    def _filter(self) -> ImmOfTracks:
        """The filter of plot fusion (the defaults of `[tracks.motion]`) with less noise."""
        return ImmOfTracks(
            inflation=1.0,
            noise_m2_s3=tuple(self.process_share * q for q in (1e-4, 0.25, 1e-3)),
            turn_noise_rad2_s3=self.process_share * 5e-9,
            turn_sigma_rad_s=float(np.radians(0.45)),
            sojourn_s=(900.0, 100.0, 1200.0),
            unknown_velocity_sigma_m_s=self.unknown_velocity_sigma_m_s,
        )
