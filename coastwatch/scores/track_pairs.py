"""Associations of radar and AIS tracks by pair: true and false positive rate, and the time until the first right one.

The true vessel of a radar track is the most frequent origin of its 5 newest plots (`Tracks.origin`; the source has 10). A track too
far from that vessel is lost: associating it is wrong. A pair whose vessel no longer exists is not scored: both tracks coast, rightly
associated.

Source: A. Sagild, track-to-track fusion of radar and AIS, 2021, section 6.3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Associations, Bools, Floats, Ints, SourceKind, Tracks, Truth
from coastwatch.geodesy import difference_m
from coastwatch.kernels.tables.match_ids import index_of

GONE, NOBODY = -3, -1  # in place of the number of a true vessel


@dataclass(frozen=True)
class TruePairs:
    """Every pair of a radar and an AIS track at one instant: whether it is scored, and whether it is of one vessel."""

    radar: Ints  # (N,) number of each track among the R radar tracks, -1 for others
    ais: Ints  # (N,) number of each track among the A AIS tracks, -1 for others
    scored: Bools  # (R, A)
    same: Bools  # (R, A) of one vessel; a lost radar track has none
    vessel: Ints  # (A,) true vessel of each AIS track

    @staticmethod
    def of(tracks: Tracks, truth: Truth, kinds: Ints, lost_m: float) -> TruePairs:
        """The pairs of these tracks. Args: kinds: SourceKind of each source; lost_m: a radar track farther from its vessel is lost."""
        rows = [np.flatnonzero(kinds[tracks.source] == kind) for kind in (SourceKind.RADAR, SourceKind.AIS)]
        of_radar, of_ais = (
            true_vessels(tracks.take(some), truth, most) for some, most in zip(rows, (lost_m, np.inf), strict=True)
        )
        number = np.full((2, len(tracks)), -1)
        for k, some in enumerate(rows):
            number[k, some] = np.arange(len(some))
        scored = (of_radar != GONE)[:, None] & (of_ais != GONE)
        return TruePairs(number[0], number[1], scored, scored & (of_radar[:, None] == of_ais) & (of_ais != NOBODY), of_ais)


@dataclass(frozen=True)
class PairScores:
    """Sums over the instants so far."""

    tp: int = 0
    fn: int = 0
    fp: int = 0
    tn: int = 0
    waited: int = 0  # instants before the first right association of a vessel that had tracks of both kinds
    wanted: frozenset[int] = frozenset()  # vessels that have had tracks of both kinds
    found: frozenset[int] = frozenset()  # of them, those that have been associated rightly

    def seen(self, pairs: TruePairs, associations: Associations) -> PairScores:
        """The sums after one more instant. Args: pairs, associations: of the same tracks."""
        is_associated = np.zeros(pairs.scored.shape, np.bool_)
        for one, other in ((associations.first, associations.second), (associations.second, associations.first)):
            row, column = pairs.radar[one], pairs.ais[other]
            of_both_kinds = (row >= 0) & (column >= 0)
            is_associated[row[of_both_kinds], column[of_both_kinds]] = True
        is_associated &= pairs.scored
        right = is_associated & pairs.same
        wanted = set(pairs.vessel[pairs.same.any(axis=0)].tolist())
        paired = self.found.union(pairs.vessel[right.any(axis=0)].tolist())
        begun = pairs.same & np.array([vessel in paired for vessel in pairs.vessel.tolist()], np.bool_)
        scored, same, accepted, tp = (int(np.count_nonzero(one)) for one in (pairs.scored, pairs.same, is_associated, right))
        return PairScores(
            self.tp + tp,
            self.fn + int(np.count_nonzero(begun)) - tp,
            self.fp + accepted - tp,
            self.tn + scored - same - (accepted - tp),
            self.waited + len(wanted - paired),
            self.wanted | wanted,
            paired,
        )

    def as_dict(self, period_s: float) -> dict[str, float | int | None]:
        """Counts, and rates; none where there is nothing to count.

        tpr: share of right pairs that are associated, from the first time on; fpr: share of wrong pairs; wrong_per_1000: of all
        associations; initialisation_s: mean time of a vessel with tracks of both kinds until they are associated.
        Args: period_s: between two instants.
        """
        vessels = len(self.wanted)
        return {
            "tp": self.tp,
            "fn": self.fn,
            "fp": self.fp,
            "tn": self.tn,
            "tpr": self.tp / (self.tp + self.fn) if self.tp + self.fn else None,
            "fpr": self.fp / (self.fp + self.tn) if self.fp + self.tn else None,
            "wrong_per_1000": 1000.0 * self.fp / (self.fp + self.tp) if self.fp + self.tp else None,
            "waited_s": self.waited * period_s,
            "vessels": vessels,
            "initialisation_s": self.waited * period_s / vessels if vessels else None,
        }


def true_vessels(tracks: Tracks, truth: Truth, lost_m: float) -> Ints:
    """The true vessel of each track; GONE where it no longer exists, NOBODY for clutter and for lost tracks. (N,)"""
    at = index_of(truth.vessel, tracks.origin)
    there = at >= 0
    distance_m: Floats = np.full(len(tracks), np.inf)
    distance_m[there] = np.hypot(*difference_m(tracks.position_deg[there], truth.position_deg[at[there]]).T)
    vessel = np.where(distance_m <= lost_m, tracks.origin, NOBODY)
    vessel[(tracks.origin >= 0) & ~there] = GONE
    return vessel.astype(np.int64)
