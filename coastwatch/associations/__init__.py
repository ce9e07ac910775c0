"""Which tracks are the same vessel: the methods of the stage."""

from typing import Annotated

from pydantic import Field

from coastwatch.associations.bearing_likelihood import BearingLikelihood as BearingLikelihood, LikelihoodMemory
from coastwatch.associations.bearing_literal import BearingWindowedCovariance as BearingWindowedCovariance, LiteralBearingMemory
from coastwatch.associations.candidates import Candidates as Candidates, step_with_candidates as step_with_candidates
from coastwatch.associations.chi_square import SingleScanTest as SingleScanTest
from coastwatch.associations.counting import (
    CountedTest as CountedTest,
    Counting as Counting,
    TestThenCounting as TestThenCounting,
    TwoCountings as TwoCountings,
)
from coastwatch.associations.inputs import (
    AssociationInput as AssociationInput,
    BearingAssociationInput as BearingAssociationInput,
)
from coastwatch.associations.pair_hits import PairCounts
from coastwatch.associations.windowed_covariance import WindowedCovariance as WindowedCovariance, WindowMemory
from coastwatch.associations.windowed_covariance_literal import (
    LiteralMemory,
    WindowedCovarianceLiteral as WindowedCovarianceLiteral,
)
from coastwatch.kernels.fusion.cross_covariance import CrossCovariances

Associator = Annotated[
    WindowedCovariance | WindowedCovarianceLiteral | SingleScanTest | Counting | TwoCountings | CountedTest | TestThenCounting,
    Field(discriminator="method"),
]
BearingAssociator = Annotated[BearingLikelihood | BearingWindowedCovariance, Field(discriminator="method")]
AssociationMemory = WindowMemory | LiteralMemory | PairCounts | tuple[PairCounts, PairCounts] | CrossCovariances
BearingAssociationMemory = LikelihoodMemory | LiteralBearingMemory
