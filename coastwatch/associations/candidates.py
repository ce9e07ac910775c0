"""Scores of all pairs that a method tests in a cycle, accepted or not, for receiver operating characteristics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from coastwatch.associations.inputs import AssociationInput
from coastwatch.associations.windowed_covariance import WindowedCovariance
from coastwatch.associations.windowed_covariance_literal import WindowedCovarianceLiteral
from coastwatch.batches import Array, Associations, Floats, Ints
from coastwatch.stage import Arrays, Groups, Work, serial


@dataclass(frozen=True, eq=False)
class Candidates:
    """All pairs inside the gate that were tested, sorted by first, then second."""

    first: Ints  # (A,) row of a track
    second: Ints  # (A,) row of a track of a later source
    score: Floats  # (A,) greater is more alike: the log-likelihood ratio of the default, -x of the literal method


def step_with_candidates(
    method: WindowedCovariance | WindowedCovarianceLiteral, memory: Any, given: AssociationInput
) -> tuple[Any, Associations, Candidates]:
    """The result of `method.step`, and the score of every tested pair before threshold and assignment.

    The work of each spot is done a second time without a threshold, so memory and associations are those of an ordinary step.
    A pair without the history that the test needs (literal: p cycles) is not tested.
    Args: memory: of the method; given: its `map_` is not used.
    """
    literal = isinstance(method, WindowedCovarianceLiteral)
    opened = method.model_copy(update={"confidence": 1.0} if literal else {"threshold": -np.inf})
    scored: list[tuple[Array, ...]] = []

    def twice(work: Work[Any], settings: Any, arrays: Arrays, spots: Groups) -> list[tuple[Array, ...]]:
        scored.extend(serial(work, opened, arrays, spots))
        return serial(work, settings, arrays, spots)

    memory, associations = method.step(memory, given._replace(map_=twice))
    first, second = (np.concatenate([np.zeros(0, np.int64), *(part[k] for part in scored)]) for k in range(2))
    statistic = np.concatenate([np.zeros(0), *(part[2] if literal else part[2][:, 0] for part in scored)])
    order = np.lexsort((second, first))
    score = -statistic if literal else statistic
    return memory, associations, Candidates(first[order], second[order], score[order])
