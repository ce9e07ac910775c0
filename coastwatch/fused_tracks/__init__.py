"""One estimate from all tracks of a vessel: the methods of the stage."""

from typing import Annotated

from pydantic import Field

from coastwatch.fused_tracks.central_imm import CentralImm
from coastwatch.fused_tracks.convex import Convex
from coastwatch.fused_tracks.covariance_intersection import CovarianceIntersection
from coastwatch.fused_tracks.dependent import Dependent
from coastwatch.fused_tracks.imm_of_tracks import ImmOfTracks
from coastwatch.fused_tracks.imm_of_tracks_literal import ImmOfTracksLiteral
from coastwatch.fused_tracks.partial_feedback import PartialFeedback
from coastwatch.fused_tracks.weighted_average import WeightedAverage

Fuser = Annotated[
    CentralImm
    | Convex
    | CovarianceIntersection
    | Dependent
    | PartialFeedback
    | WeightedAverage
    | ImmOfTracks
    | ImmOfTracksLiteral,
    Field(discriminator="method"),
]

__all__ = [
    "CentralImm",
    "Convex",
    "CovarianceIntersection",
    "Dependent",
    "Fuser",
    "ImmOfTracks",
    "ImmOfTracksLiteral",
    "PartialFeedback",
    "WeightedAverage",
]
