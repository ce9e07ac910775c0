"""Which tracks are the same vessel: the methods of the stage."""

from typing import Annotated

from pydantic import Field

from coastwatch.associations.bearing_likelihood import BearingLikelihood, LikelihoodMemory
from coastwatch.associations.bearing_literal import BearingWindowedCovariance, LiteralBearingMemory
from coastwatch.associations.candidates import Candidates, step_with_candidates
from coastwatch.associations.chi_square import SingleScanTest
from coastwatch.associations.counting import CountedTest, Counting, TestThenCounting, TwoCountings
from coastwatch.associations.inputs import AssociationInput, BearingAssociationInput
from coastwatch.associations.pair_hits import PairCounts
from coastwatch.associations.windowed_covariance import WindowedCovariance, WindowMemory
from coastwatch.associations.windowed_covariance_literal import LiteralMemory, WindowedCovarianceLiteral
from coastwatch.kernels.fusion.cross_covariance import CrossCovariances

Associator = Annotated[
    WindowedCovariance | WindowedCovarianceLiteral | SingleScanTest | Counting | TwoCountings | CountedTest | TestThenCounting,
    Field(discriminator="method"),
]
BearingAssociator = Annotated[BearingLikelihood | BearingWindowedCovariance, Field(discriminator="method")]
AssociationMemory = WindowMemory | LiteralMemory | PairCounts | tuple[PairCounts, PairCounts] | CrossCovariances
BearingAssociationMemory = LikelihoodMemory | LiteralBearingMemory

__all__ = [
    "AssociationInput",
    "AssociationMemory",
    "Associator",
    "BearingAssociationInput",
    "BearingAssociationMemory",
    "BearingAssociator",
    "BearingLikelihood",
    "BearingWindowedCovariance",
    "Candidates",
    "CountedTest",
    "Counting",
    "SingleScanTest",
    "TestThenCounting",
    "TwoCountings",
    "WindowedCovariance",
    "WindowedCovarianceLiteral",
    "step_with_candidates",
]
