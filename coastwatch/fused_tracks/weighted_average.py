"""Fused tracks by weighted average, with fixed weights a kind of source or with calibrated ones."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from coastwatch import kernels
from coastwatch.batches import Associations, FusedTracks, Ints, Measurements, SourceKind, Tracks
from coastwatch.fused_tracks.membership import Grouped, at_time, states, unwritten
from coastwatch.kernels.threads import in_blocks
from coastwatch.stage import Method, NoMemory


class WeightedAverage(Method):
    """The average of the tracks of a vessel.

    `weights = "fixed"` takes `radar_weight` and `ais_weight` (the paper's 0.2 and 0.8), shared by the tracks of one kind.
    `weights = "calibrated"` weighs each track by one over its position variance, which is the best for independent errors: at the
    paper's ratio of four in RMSE that is 0.059 and 0.941. The covariance is that of independent errors with these weights.

    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven Approach,
    section III-F.
    """

    method: Literal["weighted_average"] = "weighted_average"
    weights: Literal["calibrated", "fixed"] = "calibrated"
    radar_weight: Annotated[float, Field(ge=0.0)] = 0.2
    ais_weight: Annotated[float, Field(ge=0.0)] = 0.8
    unknown_velocity_sigma_m_s: Annotated[float, Field(gt=0.0)] = 0.5

    @model_validator(mode="after")
    def _some_weight(self) -> WeightedAverage:
        if self.radar_weight + self.ais_weight <= 0.0:
            raise ValueError("radar_weight and ais_weight: got 0 and 0, needed at least one above 0")
        return self

    def init(self) -> NoMemory:
        return NoMemory()

    def step(
        self,
        memory: NoMemory,
        tracks: Tracks,
        measurements: Measurements,
        associations: Associations,
        time_s: float,
        kinds: Ints,
    ) -> tuple[NoMemory, FusedTracks]:
        """One estimate a vessel. Args: tracks: (N); measurements: unused; associations: of its rows; kinds: SourceKind of each source.

        Returns: memory and FusedTracks, one row for each vessel number.
        """

        groups = Grouped(*associations.by_vessel)
        out = unwritten(len(groups))
        share = np.zeros(0)
        if self.weights == "fixed":
            share = np.where(kinds == SourceKind.AIS, self.ais_weight, self.radar_weight)
        of_source = tracks.source, share, kinds
        in_blocks(
            kernels.fusion.weighted_mean.average,
            len(groups),
            *groups,
            states(tracks),
            self.unknown_velocity_sigma_m_s,
            *of_source,
            out,
        )
        return memory, at_time(time_s, out)
