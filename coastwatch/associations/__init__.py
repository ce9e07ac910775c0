"""Which tracks are the same vessel: the methods of the stage."""

from typing import Annotated

from pydantic import Field

from coastwatch.associations.bearing_likelihood import BearingLikelihood
from coastwatch.associations.bearing_literal import BearingWindowedCovariance
from coastwatch.associations.candidates import Candidates, step_with_candidates
from coastwatch.associations.counting import CountedTest, Counting, TestThenCounting, TwoCountings
from coastwatch.associations.single_scan_test import SingleScanTest
from coastwatch.associations.windowed_covariance import WindowedCovariance
from coastwatch.associations.windowed_covariance_literal import WindowedCovarianceLiteral

Associator = Annotated[
    WindowedCovariance | WindowedCovarianceLiteral | SingleScanTest | Counting | TwoCountings | CountedTest | TestThenCounting,
    Field(discriminator="method"),
]
BearingAssociator = Annotated[BearingLikelihood | BearingWindowedCovariance, Field(discriminator="method")]

__all__ = [
    "Associator",
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
