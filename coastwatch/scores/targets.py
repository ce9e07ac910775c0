"""Scores of tracks of a few targets: OSPA, localisation error, probability of a track, false tracks and breaks.

Source: A. G. Hem, E. F. Brekke, Variations of joint integrated data association with radar and target-provided measurements, Journal of
Advances in Information Fusion 17(2), 2022, section VIII-B.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from coastwatch.batches import Tracks, Truth
from coastwatch.geodesy import difference_m
from coastwatch.scores.nees import nees

ORDER = 2.0


@dataclass(frozen=True)
class TargetScores:
    """Sums over the instants so far."""

    cutoff_m: float  # c of OSPA
    near_m: float  # a track farther from its target is false
    instants: int = 0
    ospa_m: float = 0.0
    present: int = 0
    matched: int = 0
    error_m: float = 0.0
    nees: float = 0.0
    false: int = 0
    breaks: int = 0
    matched_targets: tuple[int, ...] = ()  # targets that had a track in the last instant
    targets: tuple[int, ...] = ()  # seen so far
    every_ospa_m: tuple[float, ...] = ()  # at each instant
    named: int = 0  # instants of a matched target that sends an MMSI
    right: int = 0  # its track holds this MMSI
    wrong: int = 0  # its track holds another

    def seen(self, truth: Truth, tracks: Tracks, mmsi: Mapping[int, int]) -> TargetScores:
        """The sums after one more instant. Args: mmsi: of each target that sends one."""
        from scipy.optimize import linear_sum_assignment

        n, v = len(tracks), len(truth)
        every = difference_m(np.repeat(tracks.position_deg, v, axis=0), np.tile(truth.position_deg, (n, 1)))
        distance_m = np.hypot(*every.T).reshape(n, v)
        cost = np.minimum(distance_m, self.cutoff_m) ** ORDER
        row, target = linear_sum_assignment(cost)
        total, most = cost[row, target].sum() + self.cutoff_m**ORDER * abs(n - v), max(n, v)
        near = distance_m[row, target] < self.near_m
        row, target = row[near], target[near]
        off = every.reshape(n, v, 2)[row, target]
        error = np.column_stack([off, tracks.velocity_m_s[row] - truth.velocity_m_s[target]])
        now = tuple(truth.vessel[target].tolist())
        ospa_m = float((total / most) ** (1.0 / ORDER)) if most else 0.0
        name = np.array([mmsi.get(vessel, -1) for vessel in now], np.int64)
        reported_mmsi = tracks.held_mmsi[row]
        lost = set(self.matched_targets) & set(truth.vessel.tolist()) - set(now)
        return replace(
            self,
            instants=self.instants + 1,
            ospa_m=self.ospa_m + ospa_m,
            every_ospa_m=(*self.every_ospa_m, ospa_m),
            present=self.present + v,
            matched=self.matched + len(row),
            error_m=self.error_m + float(distance_m[row, target].sum()),
            nees=self.nees + float(nees(error, tracks.covariance[row]).sum()),
            false=self.false + n - len(row),
            breaks=self.breaks + len(lost),
            matched_targets=now,
            targets=tuple(sorted({*self.targets, *truth.vessel.tolist()})),
            named=self.named + int((name >= 0).sum()),
            right=self.right + int(((name >= 0) & (reported_mmsi == name)).sum()),
            wrong=self.wrong + int(((name >= 0) & (reported_mmsi >= 0) & (reported_mmsi != name)).sum()),
        )

    def as_dict(self) -> dict[str, float | None]:
        """The figures; none where nothing was counted.

        ospa_m: mean over instants; error_m: mean distance of matched tracks (TLE); probability: share of target instants with a track
        (TPD); false_tracks: at an instant (TFAR); breaks: of a target; nees: mean of position and velocity, 4 is right; id_right, id_wrong:
        share of the instants in which a target that sends an MMSI is matched by a track that holds it, or another.
        """
        return {
            "ospa_m": self.ospa_m / self.instants if self.instants else None,
            "error_m": self.error_m / self.matched if self.matched else None,
            "nees": self.nees / self.matched if self.matched else None,
            "probability": self.matched / self.present if self.present else None,
            "false_tracks": self.false / self.instants if self.instants else None,
            "breaks": self.breaks / len(self.targets) if self.targets else None,
            "id_right": self.right / self.named if self.named else None,
            "id_wrong": self.wrong / self.named if self.named else None,
        }
