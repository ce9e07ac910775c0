"""Track-to-track association as in the paper: sample covariance of the window, chi-square test, nearest neighbour."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch import kernels
from coastwatch.associations.inputs import AssociationInput
from coastwatch.associations.pairing import associations_of, gate_arrays, gated, one_to_one, over_members, passed_pairs
from coastwatch.batches import Array, Associations, Ints
from coastwatch.kernels.association.history import History
from coastwatch.kernels.association.pair_features import ENTRY
from coastwatch.stage import Arrays, Groups, Method, Positive, Probability


@dataclass(frozen=True, eq=False)
class LiteralMemory:
    history: History


class WindowedCovarianceLiteral(Method):
    """Pairs whose newest difference passes a chi-square test with the sample covariance of the last p differences.

    Of a paper, for comparison.

    Kept to reproduce the published figures; p and the confidence are not published. p <= 4 makes the covariance singular and is
    refused. With `one_to_one` false each track of the lower source takes its nearest (smallest x) partner of each other source.
    Two tracks of one source may take the same partner; then the nearer one keeps it.

    The newest difference is part of its own covariance, which bounds x. If errors are independent from cycle to cycle, chi-square
    with .95 passes 50, 91, 95 and 97 % of true pairs at p = 5, 8, 10 and 20. So autocorrelation refuses true pairs, not p.
    `threshold = "hotelling"` is 4 (p - 1) / (p - 4) F(4, p - 4): the quantile of x if the covariance came from other differences.
    It is too wide, which makes up for the autocorrelation.
    Statistic: x = Delta^T Phi^-1 Delta.

    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven Approach,
    eq. 7-9 and section III-E.
    """

    method: Literal["windowed_covariance_literal"] = "windowed_covariance_literal"
    window: Annotated[int, Field(ge=5, le=200)] = 10  # p, cycles
    confidence: Probability = 0.95  # that a true pair passes, if its errors were as the test assumes
    threshold: Literal["chi_square", "hotelling"] = "chi_square"
    one_to_one: bool = False
    gate_m: Positive = 1000.0

    def init(self) -> LiteralMemory:
        return LiteralMemory(History.empty(self.window, ENTRY))

    def limit(self) -> float:
        """The value that x must stay below."""
        from scipy import stats

        if self.threshold == "chi_square":
            return float(stats.chi2.ppf(self.confidence, 4))
        p = self.window
        return float(4.0 * (p - 1) / (p - 4) * stats.f.ppf(self.confidence, 4, p - 4))

    def step(self, memory: LiteralMemory, given: AssociationInput) -> tuple[LiteralMemory, Associations]:
        tracks = given.tracks
        arrays = gate_arrays(tracks, given.spots, self.gate_m)
        history, slot = memory.history.advanced(tracks.track_id, arrays["place"]["row"])
        entry = np.zeros(len(tracks), ENTRY)
        entry["latitude_deg"], entry["longitude_deg"] = tracks.position_deg.T
        entry["east_m_s"], entry["north_m_s"] = tracks.velocity_m_s.T
        history.values[slot, history.column] = entry
        windows = {"slot": slot, "length": history.length, "values": history.values, "newest": np.array(history.column)}
        pairs = passed_pairs(accept_in_spots, self, {**arrays, **windows}, given)
        first, second, x = pairs.first, pairs.second, pairs.score
        gain = 2.0 * self.limit() - x
        if self.one_to_one:
            chosen = one_to_one(tracks, first, second, gain)
        else:  # for each track and other source the pair with the smallest x
            order = np.lexsort((second, x, tracks.source[second], first))
            key = first[order] * (int(tracks.source.max(initial=0)) + 1) + tracks.source[second][order]
            chosen = np.sort(order[np.unique(key, return_index=True)[1]])
        first, second, x = first[chosen], second[chosen], x[chosen]
        return LiteralMemory(history), associations_of(tracks, first, second, x, gain[chosen], is_distance=True, counts=pairs)


def accept_in_spots(settings: WindowedCovarianceLiteral, arrays: Arrays, spots: Groups) -> tuple[Array, ...]:
    """Pairs that these spots own and that pass: rows of the first and second track, statistic; and how many were tested."""
    return over_members(_accept_members, arrays, spots, settings)


def _accept_members(
    low: int, high: int, member: Ints, arrays: Arrays, settings: WindowedCovarianceLiteral
) -> tuple[Array, ...]:
    """What `accept_in_spots` gives for the members low to high."""
    pair, row = gated(low, high, member, arrays, settings.gate_m), arrays["place"]["row"]
    first, second = (row[pair[name]].astype(np.int64) for name in ("first", "second"))
    x = kernels.association.pair_score.sample_statistics(
        first, second, arrays["slot"], arrays["length"], arrays["values"], int(arrays["newest"])
    )
    kept = x < settings.limit()
    return first[kept], second[kept], x[kept], np.array([len(pair)])
