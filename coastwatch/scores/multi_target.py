"""Scores of the whole set of targets at each instant: acquisition, completeness, OSPA for several cut-offs, errors, identities.

The state is right at an instant where there are as many tracks as targets and each target has its own track near it.
Source: F. Heymann et al., Validation of Radar Image Tracking Algorithms with Simulated Data, section 4 and Table 1; the paper does not say
when a state is right.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from coastwatch.batches import Floats, Tracks, Truth
from coastwatch.geodesy import difference_m, earth_centred, wrap_rad
from coastwatch.scores.nees import nees
from coastwatch.scores.ospa import gospa, ospa

ORDER = 2.0  # of OSPA

Figures = Mapping[str, "float | int | Mapping[str, float | Mapping[str, float]] | None"]


class Instant(NamedTuple):
    """One instant."""

    since_s: float  # after the start
    right: bool
    false: int  # tracks that are near no target of their own
    ospa_m: tuple[float, ...]  # for each cut-off


@dataclass(frozen=True)
class MultiTargetScores:
    """What was seen so far."""

    cutoffs_m: tuple[float, ...]  # c of OSPA
    near_m: float  # a track farther from its target is false
    start_s: float  # of the run
    settled_s: float  # after the start: false tracks are also counted from then on
    every_s: float  # spans of time over which OSPA is averaged
    instants: tuple[Instant, ...] = ()
    errors: tuple[tuple[float, ...], ...] = ()  # squares of position, velocity, speed, course, and NEES, of each matched track
    identities: frozenset[int] = frozenset()
    targets: frozenset[int] = frozenset()
    followed: tuple[tuple[int, ...], ...] = ()  # targets with a track at each instant

    def seen(self, now_s: float, truth: Truth, tracks: Tracks) -> MultiTargetScores:
        """After one more instant. Args: tracks: predicted to it."""
        from scipy.optimize import linear_sum_assignment

        n, v = len(tracks), len(truth)
        every = difference_m(np.repeat(tracks.position_deg, v, axis=0), np.tile(truth.position_deg, (n, 1))).reshape(n, v, 2)
        distance_m = np.hypot(every[:, :, 0], every[:, :, 1])
        row, target = linear_sum_assignment(np.minimum(distance_m, 10.0 * self.near_m))
        near = distance_m[row, target] < self.near_m
        row, target = row[near], target[near]
        places = earth_centred(tracks.position_deg), earth_centred(truth.position_deg)
        apart = tuple(ospa(gospa(*places, c, ORDER), c, ORDER).total_m for c in self.cutoffs_m)
        now = Instant(round(now_s - self.start_s, 3), len(row) == v == n, n - len(row), apart)
        errors = _errors(every[row, target], tracks.velocity_m_s[row], truth.velocity_m_s[target], tracks.covariance[row])
        return replace(
            self,
            instants=(*self.instants, now),
            errors=(*self.errors, *map(tuple, errors.tolist())),
            identities=self.identities | set(tracks.track_id.tolist()),
            targets=self.targets | set(truth.vessel.tolist()),
            followed=(*self.followed, tuple(truth.vessel[target].tolist())),
        )

    def as_dict(self) -> Figures:
        """The figures; none where nothing was counted.

        acquisition_s: from the start to the first right instant; completeness: share of right instants; completeness_after: of those from
        acquisition on; position_m, velocity_m_s, speed_m_s, course_deg: root mean square errors of matched tracks; nees: mean of
        position and velocity, 4 is right; false_tracks, false_tracks_settled: at an instant, of all and of those after `settled_s`;
        identities; own_identities: 1 if there are as many as targets, else 0; ospa_m, ospa_median_m: by cut-off; ospa_over_time: by
        cut-off and begin of the span; followed: share of instants with a track, by target.
        """
        right = [one.right for one in self.instants]
        first = right.index(True) if any(right) else len(right)
        settled = [one.false for one in self.instants if one.since_s > self.settled_s]
        errors = np.array(self.errors).reshape(-1, 5)
        position, velocity, speed, course = (
            float(value) if len(errors) else None for value in np.sqrt(errors[:, :4].sum(axis=0) / max(len(errors), 1))
        )
        apart = np.array([one.ospa_m for one in self.instants]).reshape(-1, len(self.cutoffs_m))
        begun_s = self.every_s * np.ceil(np.array([one.since_s for one in self.instants]) / self.every_s - 1.0 - 1e-9) + 0.0
        names = [f"{c:g}" for c in self.cutoffs_m]
        count = max(len(right), 1)
        return {
            "acquisition_s": self.instants[first].since_s if any(right) else None,
            "completeness": float(np.mean(right)) if right else None,
            "completeness_after": float(np.mean(right[first:])) if any(right) else None,
            "position_m": position,
            "velocity_m_s": velocity,
            "speed_m_s": speed,
            "course_deg": course,
            "nees": float(errors[:, 4].mean()) if len(errors) else None,
            "false_tracks": float(np.mean([one.false for one in self.instants])) if right else None,
            "false_tracks_settled": float(np.mean(settled)) if settled else None,
            "identities": len(self.identities),
            "own_identities": int(len(self.identities) == len(self.targets)),
            "ospa_m": {name: float(apart[:, k].mean()) for k, name in enumerate(names) if right},
            "ospa_median_m": {name: float(np.median(apart[:, k])) for k, name in enumerate(names) if right},
            "ospa_over_time": {
                name: {f"{at:g}": float(apart[begun_s == at, k].mean()) for at in np.unique(begun_s).tolist()}
                for k, name in enumerate(names)
            },
            "followed": {str(target): sum(target in now for now in self.followed) / count for target in sorted(self.targets)},
        }


def _errors(off_m: Floats, velocity_m_s: Floats, true_m_s: Floats, covariance: Floats) -> Floats:
    """Squared errors of position, velocity, speed and course (deg), and NEES. (B, 5)"""
    wrong = velocity_m_s - true_m_s
    speed = np.hypot(*velocity_m_s.T) - np.hypot(*true_m_s.T)
    course = np.degrees(wrap_rad(np.arctan2(*velocity_m_s.T) - np.arctan2(*true_m_s.T)))
    squares = [(off_m**2).sum(axis=1), (wrong**2).sum(axis=1), speed**2, course**2, nees(np.hstack([off_m, wrong]), covariance)]
    return np.column_stack(squares)
