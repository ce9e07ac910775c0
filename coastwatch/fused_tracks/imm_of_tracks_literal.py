"""Fused tracks by the paper's second IMM: tracks as measurements, their covariances measured in a window, then made smaller."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch.batches import Associations, Floats, FusedTracks, Ints, Measurements, Tracks
from coastwatch.fused_tracks.imm_of_tracks import Bank, ImmOfTracks
from coastwatch.fused_tracks.window import Window
from coastwatch.stage import Method

Share = Annotated[float, Field(gt=0.0, le=1.0)]


@dataclass(frozen=True, eq=False)
class LiteralBank:
    window: Window
    bank: Bank


class ImmOfTracksLiteral(Method):
    """The IMM of plot fusion once more, with radar and AIS tracks as its measurements, every cycle.

    What the paper says: "the same IMM filter used for radar plot fusion" (III-F), inputs are tracks, "process error and measurement
    errors were adjusted downwards, considering that both inputs are already providing filtered information" (III-F); "variances are
    dynamically calculated within a time window" (V). What it leaves open, and contradicts: errors that are calculated are not
    adjusted, the variance of what and over how many values is not said, nor by how much is adjusted; and downwards is the wrong
    direction, because the errors of a filtered track are alike from cycle to cycle and the window shows only how they change.
    What is taken here: the covariance of each track is the sample covariance (eq. 7) of its last p states, of what is left of
    them about a straight line (`scatter = "about_line"`) or as they stand, motion and all (`"values"`); that, and the process
    noise of the plot fusion, are multiplied by the two shares. Before p cycles a track's own covariance serves (AIS: its
    specification). A vessel with one track is that track.

    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven Approach,
    sections III-F and V.
    """

    method: Literal["imm_of_tracks_literal"] = "imm_of_tracks_literal"
    window: Annotated[int, Field(ge=6, le=200)] = (
        10  # p, cycles; a line takes two values off, and fewer than 4 make it singular
    )
    scatter: Literal["about_line", "values"] = "about_line"  # of what the covariance is taken
    measurement_share: Share = 0.5  # of the covariance of the window that is believed
    process_share: Share = 0.5  # of the process noise of the plot fusion
    unknown_velocity_sigma_m_s: Annotated[float, Field(gt=0.0)] = 0.5  # of a source that gives no covariance, before p cycles

    def init(self) -> LiteralBank:
        return LiteralBank(Window.empty(self.window), self._filter().init())

    def step(
        self,
        memory: LiteralBank,
        tracks: Tracks,
        measurements: Measurements,
        associations: Associations,
        time_s: float,
        kinds: Ints,
    ) -> tuple[LiteralBank, FusedTracks]:
        """One estimate a vessel. Args: tracks: (N); measurements: unused; associations: of its rows; kinds: SourceKind of each source.

        Returns: memory and FusedTracks, one row for each vessel number.
        """
        window = memory.window.extended(tracks, time_s)
        seen = replace(tracks, covariance=self._measured(window, tracks, associations.vessel))
        bank, fused = self._filter().step(memory.bank, seen, measurements, associations, time_s, kinds)
        return LiteralBank(window, bank), fused

    def _measured(self, window: Window, tracks: Tracks, vessel: Ints) -> Floats:
        """The covariances that the filter is told. (N, 4, 4)"""
        told = tracks.known_covariance(self.unknown_velocity_sigma_m_s)
        together = np.flatnonzero(np.bincount(vessel, minlength=1)[vessel] > 1)
        scattered = window.covariance(tracks.track_id[together], about_line=self.scatter == "about_line")
        full = np.isfinite(scattered).all(axis=(1, 2))
        told[together[full]] = self.measurement_share * scattered[full]
        return told

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
