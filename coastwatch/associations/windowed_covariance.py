"""Track-to-track association by windowed covariance: likelihood ratio of each pair over its history, one-to-one assignment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from coastwatch import kernels
from coastwatch.associations.inputs import AssociationInput
from coastwatch.associations.pairing import associations_of, gate_arrays, gated, one_to_one, over_members, passed_pairs
from coastwatch.batches import Array, Associations, Floats, Ints, Tracks
from coastwatch.kernels.association.candidate_pairs import PAIR
from coastwatch.kernels.association.history import History
from coastwatch.kernels.association.pair_features import ENTRY, TRACK
from coastwatch.kernels.association.pair_score import Rule
from coastwatch.kernels.association.prune_pairs import BOUND
from coastwatch.kernels.threads import in_blocks
from coastwatch.stage import Arrays, Groups, Method, NotNegative, Positive, PositiveShare, Probability, Share

LEAST_GAIN = 1e-3  # of an accepted pair in the assignment, so that a pair without a rival is taken


@dataclass(frozen=True, eq=False)
class WindowMemory:
    history: History


class WindowedCovariance(Method):
    """Pairs by a log-likelihood ratio accumulated over the window, then the best one-to-one assignment.

    - Covariance of a difference: the sum of both tracks' covariances. Its position and velocity blocks are scaled by the sample
      covariance of the window about its mean. So a quiet pair is not refused, and a drifting pair is not accepted.
    - Errors of tracks persist, so a short window underestimates them. The scale is averaged with 1, which weighs as much as
      `prior` entries of the window, and is limited to `floor` and `cap`.
    - `registration` adds that share of a radar plot's covariance, unscaled. A constant azimuth or range bias is as large as the
      specified noise, and does not show in the window.
    - With probability `misled_share` the velocities do not count. A track that took plots of another vessel has a good position
      but a wrong velocity.
    - The alternative hypothesis is an unrelated vessel at the local density of tracks.
    - Each cycle multiplies the former sum by `forgetting` and adds one ratio, limited to +- `step_limit`. So a track that changes
      vessel loses its partner within a few cycles.
    - Among accepted pairs that share a track the newest cycles decide: the assignment takes the sums with `rival_forgetting`.
      Otherwise a radar track that went over to another vessel would stay with the AIS track of the first one.

    Statistic: the accumulated log-likelihood ratio.

    Source: P. Rangel et al., Enhancing Performance and Reliability in Maritime Target Fusion Through a Context-Driven Approach,
    eq. 5 and 7, with the covariance bounded; Y. Bar-Shalom and H. Chen, Multisensor track-to-track association for tracks with
    dependent errors, 2006, for the likelihood ratio against an extraneous track.
    """

    method: Literal["windowed_covariance"] = "windowed_covariance"
    window: Annotated[int, Field(ge=1, le=200)] = 20  # cycles
    gate_m: Positive = 1000.0
    prior: NotNegative = 10.0  # weight of the tracks' own covariance, in entries of the window
    floor: PositiveShare = 0.5  # least factor on the covariance of a difference
    cap: Annotated[float, Field(ge=1.0)] = 2.0  # largest factor on the covariance of a difference
    forgetting: Share = 0.9  # factor on the former sum in each cycle
    rival_forgetting: Share = 0.5  # the same, of the sums that decide among accepted pairs
    registration: NotNegative = 0.5  # share of a plot's covariance that is added
    step_limit: Positive = 20.0  # largest log-likelihood ratio of a cycle, of either sign
    misled_share: Probability = 0.01  # of tracks whose velocity is wrong, by plots of other vessels
    threshold: float = 0.0  # the statistic of a pair, a log-likelihood ratio, must exceed it: positive speaks for one vessel
    unrelated_speed_m_s: Positive = 4.0
    unknown_velocity_sigma_m_s: Positive = 0.5  # of a source that gives no covariance

    def init(self) -> WindowMemory:
        return WindowMemory(History.empty(self.window, ENTRY))

    def step(self, memory: WindowMemory, given: AssociationInput) -> tuple[WindowMemory, Associations]:
        tracks = given.tracks
        arrays = gate_arrays(tracks, given.spots, self.gate_m)
        history, arrays["track"], arrays["bound"] = self._features(memory.history, tracks, arrays["place"]["row"])
        arrays["values"], arrays["newest"] = history.values, np.array(history.column)
        pairs = passed_pairs(score_spots, self, arrays, given)
        gain = self._gains(arrays, pairs.first, pairs.second, pairs.score[:, 1])
        chosen = one_to_one(tracks, pairs.first, pairs.second, gain)
        first, second, score = pairs.first[chosen], pairs.second[chosen], pairs.score[chosen, 0]
        associations = associations_of(tracks, first, second, score, gain[chosen], is_distance=False, counts=pairs)
        return WindowMemory(history), associations

    def _gains(self, arrays: Arrays, first: Ints, second: Ints, density: Floats) -> Floats:
        """What each accepted pair is worth in the assignment: its newest score where it shares a track, else 1. (A,)"""
        place, rows = arrays["place"], len(arrays["place"])
        often = np.bincount(first, minlength=rows) + np.bincount(second, minlength=rows)
        rival = np.flatnonzero((often[first] > 1) | (often[second] > 1))
        at = np.empty(rows, np.int32)
        at[place["row"]] = np.arange(rows)
        pair = np.empty(len(rival), PAIR)
        pair["first"], pair["second"], pair["density"] = at[first[rival]], at[second[rival]], density[rival]
        rule, newest = self.rule()._replace(forgetting=self.rival_forgetting), int(arrays["newest"])
        gain = np.ones(len(first))
        newer = kernels.association.pair_score.pair_scores(pair, arrays["track"], arrays["values"], newest, rule)
        gain[rival] = newer + self.step_limit + LEAST_GAIN
        return gain

    def rule(self) -> Rule:
        """The settings as the kernels read them."""
        return Rule(
            self.gate_m,
            self.prior,
            self.floor,
            self.cap,
            self.forgetting,
            self.step_limit,
            self.misled_share,
            self.unrelated_speed_m_s,
            self.threshold,
        )

    def _features(self, before: History, tracks: Tracks, row: Ints) -> tuple[History, Array, Array]:
        """The history with this cycle, and what kernels read of each track: TRACK and BOUND. Args: row: (N,) in the order of the grid."""
        history, slot = before.advanced(tracks.track_id, row)
        count, column = len(tracks), history.column
        track, bound = np.empty(count, TRACK), np.empty(count, BOUND)
        reported = tracks.covariance, tracks.report_covariance, tracks.mmsi
        unknown_m2_s2 = self.unknown_velocity_sigma_m_s**2
        features = kernels.association.pair_features
        in_blocks(features.track_records, count, row, (slot, history.length), reported, self.registration, unknown_m2_s2, track)
        in_blocks(features.record_entries, count, row, tracks.position_deg, tracks.velocity_m_s, track, column, history.values)
        in_blocks(kernels.association.prune_pairs.track_bounds, count, track, history.values, column, self.rule(), bound)
        return history, track, bound


def score_spots(settings: WindowedCovariance, arrays: Arrays, spots: Groups) -> tuple[Array, ...]:
    """Pairs that these spots own and that pass: rows of the first and second track; score and density (A, 2); number tested."""
    return over_members(_score_members, arrays, spots, settings)


def _score_members(low: int, high: int, member: Ints, arrays: Arrays, settings: WindowedCovariance) -> tuple[Array, ...]:
    """What `score_spots` gives for the members low to high."""
    rule, values, newest = settings.rule(), arrays["values"], int(arrays["newest"])
    pair = gated(low, high, member, arrays, rule.gate_m)
    least = kernels.association.prune_pairs.hopeless_steps(rule, values.shape[1])
    some = pair[kernels.association.prune_pairs.possible_pairs(pair, arrays["bound"], least, rule.null_speed_m_s)]
    score = kernels.association.pair_score.pair_scores(some, arrays["track"], values, newest, rule)
    kept, row = score > rule.threshold, arrays["place"]["row"]
    some = some[kept]
    first, second = (row[some[name]].astype(np.int64) for name in ("first", "second"))
    return first, second, np.column_stack([score[kept], some["density"]]), np.array([len(pair)])
