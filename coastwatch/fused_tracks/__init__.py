"""One estimate from all tracks of a vessel: the methods of the stage."""

from typing import Annotated

from pydantic import Field

from coastwatch.fused_tracks.central_imm import CentralImm as CentralImm, VesselFilters
from coastwatch.fused_tracks.convex import Convex as Convex
from coastwatch.fused_tracks.covariance_intersection import CovarianceIntersection as CovarianceIntersection
from coastwatch.fused_tracks.dependent import Dependent as Dependent
from coastwatch.fused_tracks.imm_of_tracks import ImmOfTracks as ImmOfTracks, TrackFilters
from coastwatch.fused_tracks.imm_of_tracks_literal import ImmOfTracksLiteral as ImmOfTracksLiteral, LiteralFilters
from coastwatch.fused_tracks.inputs import FusionInput as FusionInput
from coastwatch.fused_tracks.partial_feedback import FeedbackFilters, PartialFeedback as PartialFeedback
from coastwatch.fused_tracks.weighted_average import WeightedAverage as WeightedAverage
from coastwatch.kernels.fusion.cross_covariance import CrossCovariances
from coastwatch.stage import NoMemory

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
FusionMemory = NoMemory | VesselFilters | TrackFilters | LiteralFilters | FeedbackFilters | CrossCovariances
