"""Track-to-track association by counting: so many cycles in a row near each other, or far apart."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from coastwatch.associations.inputs import AssociationInput
from coastwatch.associations.pair_hits import MOST, Check, PairCounts, chosen, find_hits, united
from coastwatch.batches import Associations
from coastwatch.kernels.filters.gaussian import gate
from coastwatch.stage import Method, Probability

Metres = Annotated[float, Field(gt=0.0, le=10_000.0)]
Cycles = Annotated[int, Field(ge=1, lt=MOST)]
STATES = 4  # dimensions of the difference: position and velocity


class Counting(Method):
    """Two tracks are associated after `hits` cycles in a row within `threshold_m`, until `misses` cycles in a row beyond it.

    Of a paper, for comparison.

    It needs no covariance. Statistic: distance of the positions, m.

    Source: A. Sagild, track-to-track fusion of radar and AIS, 2021, section 4.2.
    """

    method: Literal["counting"] = "counting"
    threshold_m: Metres = 30.0
    hits: Cycles = 4  # cycles in a row
    misses: Cycles = 3  # cycles in a row

    @property
    def gate_m(self) -> float:
        """Pairs farther apart are missed."""
        return self.threshold_m

    def init(self) -> PairCounts:
        return PairCounts.empty()

    def step(self, memory: PairCounts, given: AssociationInput) -> tuple[PairCounts, Associations]:
        hits = find_hits(Check(self.threshold_m), given)
        after, first, second = memory.counted(given.tracks, hits, self.hits, self.misses)
        return after, chosen(given.tracks, first, second, None, hits)


class TwoCountings(Method):
    """Two tracks are associated while a tight or a loose counting associates them: see `counting`. Of a paper, for comparison.

    Statistic: distance of the positions, m.

    Source: A. Sagild, track-to-track fusion of radar and AIS, 2021, section 8.
    """

    method: Literal["two_countings"] = "two_countings"
    tight_m: Metres = 10.0
    hits_tight: Cycles = 2  # cycles in a row
    misses_tight: Cycles = 1  # cycles in a row
    loose_m: Metres = 30.0
    hits_loose: Cycles = 4  # cycles in a row
    misses_loose: Cycles = 3  # cycles in a row

    @model_validator(mode="after")
    def _tight_is_inside_loose(self) -> Self:
        if self.tight_m > self.loose_m:
            raise ValueError(f"tight_m: got {self.tight_m:g}, needed at most loose_m = {self.loose_m:g}")
        return self

    @property
    def gate_m(self) -> float:
        """Pairs farther apart are missed by both."""
        return self.loose_m

    def init(self) -> tuple[PairCounts, PairCounts]:
        return PairCounts.empty(), PairCounts.empty()

    def step(
        self, memory: tuple[PairCounts, PairCounts], given: AssociationInput
    ) -> tuple[tuple[PairCounts, PairCounts], Associations]:
        tracks, hits = given.tracks, find_hits(Check(self.loose_m), given)
        near = hits.take(hits.score[:, 0] <= self.tight_m)
        tight, *pairs_tight = memory[0].counted(tracks, near, self.hits_tight, self.misses_tight)
        loose, *pairs_loose = memory[1].counted(tracks, hits, self.hits_loose, self.misses_loose)
        first, second = united((pairs_tight[0], pairs_tight[1]), (pairs_loose[0], pairs_loose[1]), len(tracks))
        return (tight, loose), chosen(given.tracks, first, second, None, hits)


class CountedTest(Method):
    """Two tracks are associated after `hits` passed tests in a row, until `misses` refused ones in a row. Of a paper, for comparison.

    The test is `single_scan_test` with independent errors. A pair without covariance never passes.
    Statistic: distance of the positions, m.
    """

    method: Literal["counted_test"] = "counted_test"
    significance: Probability = 0.001  # alpha: share of right pairs that a single test refuses, if errors are independent
    hits: Cycles = 4  # cycles in a row
    misses: Cycles = 1  # cycles in a row
    gate_m: Metres = 1000.0  # pairs farther apart are not tested

    def init(self) -> PairCounts:
        return PairCounts.empty()

    def step(self, memory: PairCounts, given: AssociationInput) -> tuple[PairCounts, Associations]:
        hits = find_hits(Check(self.gate_m, gate(1.0 - self.significance, STATES), measures_states=True), given)
        after, first, second = memory.counted(given.tracks, hits, self.hits, self.misses)
        return after, chosen(given.tracks, first, second, None, hits)


class TestThenCounting(Method):
    """As `counting`; a hit that also passes the test at `significance` associates at once, because the two are very close.

    Of a paper, for comparison.

    A pair without covariance is associated by counting alone. Statistic: distance of the positions, m.
    """

    method: Literal["test_then_counting"] = "test_then_counting"
    significance: Probability = 0.9  # alpha of the test that begins: near 1 the states must nearly agree
    threshold_m: Metres = 30.0
    hits: Cycles = 6  # cycles in a row
    misses: Cycles = 5  # cycles in a row

    @property
    def gate_m(self) -> float:
        """Pairs farther apart are missed."""
        return self.threshold_m

    def init(self) -> PairCounts:
        return PairCounts.empty()

    def step(self, memory: PairCounts, given: AssociationInput) -> tuple[PairCounts, Associations]:
        hits = find_hits(Check(self.threshold_m, measures_states=True), given)
        close = hits.score[:, 1] <= gate(1.0 - self.significance, STATES)
        after, first, second = memory.counted(given.tracks, hits, self.hits, self.misses, close)
        return after, chosen(given.tracks, first, second, None, hits)
