"""Fused tracks by weighted average, with fixed weights a kind of source or with calibrated ones."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import model_validator

from coastwatch import kernels
from coastwatch.batches import Floats, FusedTracks, Ints, SourceKind, Tracks
from coastwatch.fused_tracks.inputs import FusionInput, FusionMethod
from coastwatch.fused_tracks.vessel_tracks import VesselTracks, estimated
from coastwatch.stage import NoMemory, NotNegative, Positive


class WeightedAverage(FusionMethod):
    """The average of the tracks of a vessel.

    `weights = "fixed"` takes `radar_weight` and `ais_weight` (the paper's 0.2 and 0.8), shared by the tracks of one kind.
    `weights = "calibrated"` weighs each track by one over its position variance, which is the best for independent errors: at the
    paper's ratio of four in RMSE that is 0.059 and 0.941. The covariance is that of independent errors with these weights.

    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven Approach,
    section III-F.
    """

    method: Literal["weighted_average"] = "weighted_average"
    weights: Literal["calibrated", "fixed"] = "calibrated"
    radar_weight: NotNegative = 0.2
    ais_weight: NotNegative = 0.8
    unknown_velocity_sigma_m_s: Positive = 0.5

    @model_validator(mode="after")
    def _some_weight(self) -> WeightedAverage:
        if self.radar_weight + self.ais_weight <= 0.0:
            raise ValueError("radar_weight and ais_weight: got 0 and 0, needed at least one above 0")
        return self

    def init(self) -> NoMemory:
        return NoMemory()

    def step(self, memory: NoMemory, given: FusionInput) -> tuple[NoMemory, FusedTracks]:
        """One estimate a vessel: memory, and one row for each vessel number."""
        vessels, kernel = VesselTracks.of(given.associations), kernels.fusion.weighted_mean.weighted_mean
        weight = self._weight(given.tracks, given.associations.vessel, given.kinds)
        out = estimated(kernel, vessels, given.tracks, self.unknown_velocity_sigma_m_s, weight)
        return memory, out.at_time(given.time_s)

    def _weight(self, tracks: Tracks, vessel: Ints, kinds: Ints) -> Floats:
        """Weight of each track; the sum over the tracks of a vessel is 1. (N,)"""
        if self.weights == "fixed":
            kind = kinds[tracks.source]
            alike = len(SourceKind) * vessel + kind  # the same for tracks of one kind in one vessel
            weight = np.where(kind == SourceKind.AIS, self.ais_weight, self.radar_weight) / np.bincount(alike)[alike]
        else:
            known = np.isfinite(tracks.covariance).all(axis=(1, 2), keepdims=True)
            position = np.where(known, tracks.covariance[:, :2, :2], tracks.report_covariance)
            weight = 1.0 / np.trace(position, axis1=1, axis2=2)
        total = np.bincount(vessel, weight)[vessel]
        return np.where(total > 0.0, weight / np.where(total > 0.0, total, 1.0), 1.0 / np.bincount(vessel)[vessel])
