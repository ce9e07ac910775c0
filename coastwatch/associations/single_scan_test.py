"""Track-to-track association by a chi-square test of the newest difference."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from coastwatch import kernels
from coastwatch.associations.counting import STATES, Metres, Share
from coastwatch.associations.pair_hits import Hits, chosen, find_hits
from coastwatch.batches import Associations, Floats, Spots, Tracks
from coastwatch.geodesy import difference_m
from coastwatch.kernels.filters.gaussian import gate, squared_distance
from coastwatch.kernels.fusion.cross_covariance import CrossCovariances, positive
from coastwatch.stage import Map, Method

KEPT = 4.0  # a refused pair keeps its cross-covariance up to so many times the limit: a difference stays large for some scans


class SingleScanTest(Method):
    """Two tracks are associated while their difference d of position and velocity passes D = d' T^-1 d <= chi2(1 - alpha).

    `dependence` says what T is. `independent`: the sum of both covariances. `recursive`: less C + C', the cross-covariance of their
    errors by its recursion, exact for Kalman filters with the process noise `noise_m2_s3`. `geometric_mean`: C is `correlation`
    times the geometric mean of both covariances.

    Errors of two tracks share process noise. So `independent` refuses a tenth of alpha of the right pairs, at alpha 0.01.
    A pair without covariance never passes. Statistic: D.

    Source: A. Sagild, track-to-track fusion of radar and AIS, 2021, chapter 4; Y. Bar-Shalom, On the track-to-track correlation
    problem, 1981.
    """

    statistic_is_distance: ClassVar[bool] = True
    method: Literal["single_scan_test"] = "single_scan_test"
    significance: Share = 0.01  # alpha: share of right pairs that the test refuses, if T is right
    dependence: Literal["independent", "recursive", "geometric_mean"] = "independent"
    correlation: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.4  # of `geometric_mean`
    noise_m2_s3: Annotated[float, Field(gt=0.0)] = 0.09  # density of the white acceleration of vessels, of `recursive`
    gate_m: Metres = 1000.0  # pairs farther apart are not tested

    @property
    def limit(self) -> float:
        """Of D with independent errors, beyond which a pair is not looked at. D with dependent errors is not smaller."""
        return self.largest * (KEPT if self.dependence == "recursive" else 1.0)

    @property
    def largest(self) -> float:
        """D up to which a pair passes."""
        return gate(1.0 - self.significance, STATES)

    @property
    def measures_states(self) -> bool:
        """Position and velocity."""
        return True

    def init(self) -> CrossCovariances:
        return CrossCovariances.empty()

    def step(self, memory: CrossCovariances, tracks: Tracks, spots: Spots, map_: Map) -> tuple[CrossCovariances, Associations]:
        """Associations of these tracks. Args: tracks: (N); spots: of the same rows. Returns: memory and Associations."""
        found = find_hits(self, tracks, spots, map_)
        squared = found.squared
        if self.dependence == "recursive":
            pairs, time_s = (found.first, found.second), float(tracks.time_s.max(initial=memory.time_s))
            given = tracks.track_id, tracks.covariance, tracks.updated_s, pairs
            memory = memory.advanced(*given, time_s, self.noise_m2_s3)
            squared = _dependent(tracks, found, memory.cross)
        elif self.dependence == "geometric_mean":
            mean = kernels.fusion.cross_covariance.geometric_mean(*_covariances(tracks, found))
            squared = _dependent(tracks, found, self.correlation * mean)
        passed = squared <= self.largest
        return memory, chosen(tracks, found.first[passed], found.second[passed], squared[passed], found)


def _covariances(tracks: Tracks, found: Hits) -> tuple[Floats, Floats]:
    return tracks.covariance[found.first], tracks.covariance[found.second]


def _dependent(tracks: Tracks, found: Hits, cross: Floats) -> Floats:
    """D with this cross-covariance, (A, 4, 4); with none where no covariance of the difference comes out. (A,)"""
    first, second = _covariances(tracks, found)
    total = first + second - cross - cross.transpose(0, 2, 1)
    total = 0.5 * (total + total.transpose(0, 2, 1))
    wrong = ~positive(total)
    total[wrong] = first[wrong] + second[wrong]
    apart = difference_m(tracks.position_deg[found.second], tracks.position_deg[found.first])
    return squared_distance(
        np.concatenate([apart, tracks.velocity_m_s[found.second] - tracks.velocity_m_s[found.first]], axis=1), total
    )
