"""Track-to-track association by a chi-square test of the newest difference."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch import kernels
from coastwatch.associations.counting import STATES, Metres
from coastwatch.associations.inputs import AssociationInput
from coastwatch.associations.pair_hits import Check, chosen, find_hits
from coastwatch.associations.pairing import PassedPairs
from coastwatch.batches import Associations, Floats, Tracks
from coastwatch.geodesy import difference_m
from coastwatch.kernels.filters.gaussian import gate, squared_distance
from coastwatch.kernels.fusion.cross_covariance import CrossCovariances, positive
from coastwatch.stage import Method, Positive, Probability

KEPT = 4.0  # a refused pair keeps its cross-covariance up to so many times the limit: a difference stays large for some scans


class SingleScanTest(Method):
    """Two tracks are associated while their difference d of position and velocity passes D = d' T^-1 d <= chi2(1 - alpha).

    Of a paper, for comparison.

    `dependence` says what T is. `independent`: the sum of both covariances. `recursive`: less C + C', the cross-covariance of their
    errors by its recursion, exact for Kalman filters with the process noise `noise_m2_s3`. `geometric_mean`: C is `correlation`
    times the geometric mean of both covariances.

    Errors of two tracks share process noise. So `independent` refuses a tenth of alpha of the right pairs, at alpha 0.01.
    A pair without covariance never passes. Statistic: D.

    Source: A. Sagild, track-to-track fusion of radar and AIS, 2021, chapter 4; Y. Bar-Shalom, On the track-to-track correlation
    problem, 1981.
    """

    method: Literal["single_scan_test"] = "single_scan_test"
    significance: Probability = 0.01  # alpha: share of right pairs that the test refuses, if T is right
    dependence: Literal["independent", "recursive", "geometric_mean"] = "independent"
    correlation: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.4  # of `geometric_mean`
    noise_m2_s3: Positive = 0.09  # density of the white acceleration of vessels, of `recursive`
    gate_m: Metres = 1000.0  # pairs farther apart are not tested

    def init(self) -> CrossCovariances:
        return CrossCovariances.empty()

    def step(self, memory: CrossCovariances, given: AssociationInput) -> tuple[CrossCovariances, Associations]:
        tracks, largest = given.tracks, gate(1.0 - self.significance, STATES)
        # With independent errors D is not greater than with dependent ones, so pairs beyond this limit are not looked at.
        limit = largest * (KEPT if self.dependence == "recursive" else 1.0)
        hits = find_hits(Check(self.gate_m, limit, measures_states=True), given)
        squared = hits.score[:, 1]
        if self.dependence == "recursive":
            time_s = float(tracks.time_s.max(initial=memory.time_s))
            pairs = hits.first, hits.second
            memory = memory.advanced(tracks.track_id, tracks.covariance, tracks.updated_s, pairs, time_s, self.noise_m2_s3)
            squared = _dependent(tracks, hits, memory.cross)
        elif self.dependence == "geometric_mean":
            mean = kernels.fusion.cross_covariance.geometric_mean(*_covariances(tracks, hits))
            squared = _dependent(tracks, hits, self.correlation * mean)
        passed = squared <= largest
        return memory, chosen(tracks, hits.first[passed], hits.second[passed], squared[passed], hits)


def _covariances(tracks: Tracks, hits: PassedPairs) -> tuple[Floats, Floats]:
    return tracks.covariance[hits.first], tracks.covariance[hits.second]


def _dependent(tracks: Tracks, hits: PassedPairs, cross: Floats) -> Floats:
    """D with this cross-covariance, (A, 4, 4); with none where no covariance of the difference comes out. (A,)"""
    first, second = _covariances(tracks, hits)
    total = first + second - cross - cross.transpose(0, 2, 1)
    total = 0.5 * (total + total.transpose(0, 2, 1))
    wrong = ~positive(total)
    total[wrong] = first[wrong] + second[wrong]
    offset_m = difference_m(tracks.position_deg[hits.second], tracks.position_deg[hits.first])
    return squared_distance(
        np.concatenate([offset_m, tracks.velocity_m_s[hits.second] - tracks.velocity_m_s[hits.first]], axis=1), total
    )
