"""Associations of radar and AIS tracks by pair: true and false positive rate, and the time until the first right one.

The true vessel of a radar track is the most frequent origin of its 5 newest plots (`Tracks.origin`; the source has 10). A track too
far from that vessel is lost: associating it is wrong. A pair whose vessel no longer exists is not scored: both tracks coast, rightly
associated.

Source: A. Sagild, track-to-track fusion of radar and AIS, 2021, section 6.3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Associations, Floats, Ints, SourceKind, Tracks, Truth
from coastwatch.geodesy import difference_m
from coastwatch.kernels.tables.match_ids import index_of

GONE, NOBODY = -3, -1  # in place of the number of a true vessel


@dataclass(frozen=True)
class PairScores:
    """Sums over the instants so far."""

    lost_m: float = 100.0  # a radar track farther than this from its vessel is lost
    tp: int = 0
    fn: int = 0
    fp: int = 0
    tn: int = 0
    waited: int = 0  # instants before the first right association of a vessel that had tracks of both kinds
    wanted: tuple[int, ...] = ()  # vessels that have had tracks of both kinds
    found: tuple[int, ...] = ()  # of them, those that have been associated rightly

    def seen(self, tracks: Tracks, associations: Associations, truth: Truth, kinds: Ints) -> PairScores:
        """The sums after one more instant. Args: associations: of these tracks; kinds: SourceKind of each source."""
        radar, ais = (np.flatnonzero(kinds[tracks.source] == kind) for kind in (SourceKind.RADAR, SourceKind.AIS))
        of_radar, of_ais = true_vessels(tracks.take(radar), truth, self.lost_m), true_vessels(tracks.take(ais), truth, np.inf)
        scored = (of_radar != GONE)[:, None] & (of_ais != GONE)
        same = scored & (of_radar[:, None] == of_ais) & (of_ais != NOBODY)
        column = np.full(len(tracks), -1)
        column[ais], row = np.arange(len(ais)), np.full(len(tracks), -1)
        row[radar] = np.arange(len(radar))
        made = np.zeros(scored.shape, np.bool_)
        for one, other in ((associations.first, associations.second), (associations.second, associations.first)):
            pair = (row[one] >= 0) & (column[other] >= 0)
            made[row[one[pair]], column[other[pair]]] = True
        right = made & same
        wanted = set(np.broadcast_to(of_ais, same.shape)[same].tolist())
        found = set(self.found) | set(np.broadcast_to(of_ais, same.shape)[right].tolist())
        begun = same & np.isin(of_ais, sorted(found))
        return PairScores(
            self.lost_m,
            self.tp + int(right.sum()),
            self.fn + int((begun & ~made).sum()),
            self.fp + int((made & scored & ~same).sum()),
            self.tn + int((scored & ~made & ~same).sum()),
            self.waited + len(wanted - found),
            tuple(sorted(set(self.wanted) | wanted)),
            tuple(sorted(found)),
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
    apart: Floats = np.full(len(tracks), np.inf)
    apart[there] = np.hypot(*difference_m(tracks.position_deg[there], truth.position_deg[at[there]]).T)
    out = np.where(apart <= lost_m, tracks.origin, NOBODY)
    out[(tracks.origin >= 0) & ~there] = GONE
    return out.astype(np.int64)
