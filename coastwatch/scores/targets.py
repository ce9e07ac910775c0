"""Scores of tracks of a few targets at each instant, as two papers have them: OSPA, errors, false tracks, breaks, identities."""

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


@dataclass(frozen=True)
class TargetScores:
    """OSPA, localisation error, probability of a track, false tracks and breaks: sums over the instants so far.

    Source: A. G. Hem, E. F. Brekke, Variations of joint integrated data association with radar and target-provided measurements, Journal
    of Advances in Information Fusion 17(2), 2022, section VIII-B.
    """

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

        n, v, off_m = len(tracks), len(truth), offsets(tracks, truth)
        distance_m = np.hypot(off_m[:, :, 0], off_m[:, :, 1])
        cost = np.minimum(distance_m, self.cutoff_m) ** ORDER
        row, target = linear_sum_assignment(cost)
        total, most = cost[row, target].sum() + self.cutoff_m**ORDER * abs(n - v), max(n, v)
        near = distance_m[row, target] < self.near_m
        row, target = row[near], target[near]
        error = np.column_stack([off_m[row, target], tracks.velocity_m_s[row] - truth.velocity_m_s[target]])
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


class Instant(NamedTuple):
    """One instant."""

    since_s: float  # after the start
    right: bool
    false: int  # tracks that are near no target of their own
    ospa_m: tuple[float, ...]  # for each cut-off


@dataclass(frozen=True)
class MultiTargetScores:
    """Acquisition, completeness, OSPA for several cut-offs, errors and identities: what was seen so far.

    The state is right at an instant where there are as many tracks as targets and each target has its own track near it.
    Source: F. Heymann et al., Validation of Radar Image Tracking Algorithms with Simulated Data, section 4 and Table 1; the paper does
    not say when a state is right.
    """

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

        n, v, off_m = len(tracks), len(truth), offsets(tracks, truth)
        distance_m = np.hypot(off_m[:, :, 0], off_m[:, :, 1])
        row, target = linear_sum_assignment(np.minimum(distance_m, 10.0 * self.near_m))
        near = distance_m[row, target] < self.near_m
        row, target = row[near], target[near]
        places = earth_centred(tracks.position_deg), earth_centred(truth.position_deg)
        apart = tuple(ospa(gospa(*places, c, ORDER), c, ORDER).total_m for c in self.cutoffs_m)
        now = Instant(round(now_s - self.start_s, 3), len(row) == v == n, n - len(row), apart)
        errors = _errors(off_m[row, target], tracks.velocity_m_s[row], truth.velocity_m_s[target], tracks.covariance[row])
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


def offsets(tracks: Tracks, truth: Truth) -> Floats:
    """How far each track is from each target, metres east and north. (N, V, 2)"""
    n, v = len(tracks), len(truth)
    off_m = difference_m(np.repeat(tracks.position_deg, v, axis=0), np.tile(truth.position_deg, (n, 1)))
    return off_m.reshape(n, v, 2)


def _errors(off_m: Floats, velocity_m_s: Floats, true_m_s: Floats, covariance: Floats) -> Floats:
    """Squared errors of position, velocity, speed and course (deg), and NEES. (B, 5)"""
    wrong = velocity_m_s - true_m_s
    speed = np.hypot(*velocity_m_s.T) - np.hypot(*true_m_s.T)
    course = np.degrees(wrap_rad(np.arctan2(*velocity_m_s.T) - np.arctan2(*true_m_s.T)))
    squares = [(off_m**2).sum(axis=1), (wrong**2).sum(axis=1), speed**2, course**2, nees(np.hstack([off_m, wrong]), covariance)]
    return np.column_stack(squares)
