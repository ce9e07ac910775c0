"""Tracks of a vessel fused in numpy, by batches of matrices: how the methods were before they became kernels. What it says is the measure.

Each takes tracks, their covariances as known (N, 4, 4), and the vessel of each (N,); each returns positions, velocities and
covariances, (V, ...).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from coastwatch.batches import Floats, Ints, SourceKind, Tracks
from coastwatch.fused_tracks import ImmOfTracks
from coastwatch.geodesy import difference_m, offset_deg
from coastwatch.kernels.filters.imm import estimate_filters, predict_filters, update_filters

Fused = tuple[Floats, Floats, Floats]
Combine = Callable[[Floats, Floats, Floats], tuple[Floats, Floats]]
"""(first (G, 4, 4), second (G, 4, 4), second less first (G, 4)) -> mean relative to the first (G, 4), covariance (G, 4, 4)."""


def combined(tracks: Tracks, covariance: Floats, vessel: Ints, combine: Combine) -> Fused:
    """The tracks of each vessel combined one after the other, the most precise first."""
    precise_first = np.argsort(np.argsort(np.linalg.det(covariance), kind="stable"), kind="stable")
    order = np.lexsort((precise_first, vessel))
    of = vessel[order]
    start = np.flatnonzero(np.r_[True, of[1:] != of[:-1]])
    rank = np.arange(len(of)) - np.repeat(start, np.diff(np.r_[start, len(of)]))
    row = order[rank == 0]
    position, velocity, fused = tracks.position_deg[row], tracks.velocity_m_s[row], covariance[row]
    for r in range(1, int(rank.max()) + 1):
        who, row = of[rank == r], order[rank == r]
        moved, faster = difference_m(tracks.position_deg[row], position[who]), tracks.velocity_m_s[row] - velocity[who]
        mean, fused[who] = combine(fused[who], covariance[row], np.concatenate([moved, faster], axis=1))
        position[who] = offset_deg(position[who], mean[:, :2])
        velocity[who] = velocity[who] + mean[:, 2:]
    return position, velocity, fused


def convex(tracks: Tracks, covariance: Floats, vessel: Ints, registration: float = 0.0) -> Fused:
    """Errors taken as independent; a share of a report's covariance is added to the place of radar tracks that are not alone."""
    covariance = covariance.copy()
    doubted = (np.bincount(vessel)[vessel] > 1) & (tracks.mmsi < 0)
    covariance[doubted, :2, :2] += registration * tracks.report_covariance[doubted]
    return combined(tracks, covariance, vessel, weigh)


def weigh(first: Floats, second: Floats, shift: Floats) -> tuple[Floats, Floats]:
    """Mean relative to the first and covariance of two estimates with independent errors."""
    gain = np.linalg.solve(first + second, first).swapaxes(1, 2)
    less = first - gain @ first
    return np.einsum("gij,gj->gi", gain, shift), 0.5 * (less + less.swapaxes(1, 2))


def intersection(tracks: Tracks, covariance: Floats, vessel: Ints, steps: int) -> Fused:
    """By covariance intersection."""
    return combined(tracks, covariance, vessel, lambda a, b, shift: intersect(a, b, shift, steps))


def intersect(first: Floats, second: Floats, shift: Floats, steps: int) -> tuple[Floats, Floats]:
    """Mean relative to the first and covariance of the intersection whose determinant is smallest, by golden section."""
    inverse_1, inverse_2 = np.linalg.inv(first), np.linalg.inv(second)
    ratio = (np.sqrt(5.0) - 1.0) / 2.0

    def log_det(w: Floats) -> Floats:
        blend = w[:, None, None] * inverse_1 + (1.0 - w)[:, None, None] * inverse_2
        return np.asarray(-np.linalg.slogdet(blend)[1])

    low, high = np.zeros(len(first)), np.ones(len(first))
    left, right = high - ratio * (high - low), low + ratio * (high - low)
    at_left, at_right = log_det(left), log_det(right)
    for _ in range(steps):
        down = at_left < at_right
        low, high = np.where(down, low, left), np.where(down, right, high)
        kept, value = np.where(down, left, right), np.where(down, at_left, at_right)
        probe = np.where(down, high - ratio * (high - low), low + ratio * (high - low))
        at_probe = log_det(probe)
        left, right = np.where(down, probe, kept), np.where(down, kept, probe)
        at_left, at_right = np.where(down, at_probe, value), np.where(down, value, at_probe)
    candidates = np.stack([0.5 * (low + high), np.zeros(len(first)), np.ones(len(first))])
    best = np.argmin(np.stack([log_det(w) for w in candidates]), axis=0)
    w = candidates[best, np.arange(len(first))]
    out = np.linalg.inv(w[:, None, None] * inverse_1 + (1.0 - w)[:, None, None] * inverse_2)
    out = 0.5 * (out + out.swapaxes(1, 2))
    return np.einsum("gij,gjk,gk->gi", out, (1.0 - w)[:, None, None] * inverse_2, shift), out


def average(tracks: Tracks, covariance: Floats, vessel: Ints, kinds: Ints, shares: tuple[float, float] | None = None) -> Fused:
    """The weighted average: by one over the variance, or with these shares of radar and AIS."""
    count = int(vessel.max()) + 1
    if shares is None:
        raw = 1.0 / (covariance[:, 0, 0] + covariance[:, 1, 1])
    else:
        kind = kinds[tracks.source]
        key = vessel * (int(kinds.max()) + 1) + kind
        raw = np.where(kind == SourceKind.AIS, shares[1], shares[0]) / np.bincount(key)[key]
    total = np.bincount(vessel, raw)[vessel]
    weight = np.where(total <= 0.0, 1.0 / np.bincount(vessel)[vessel], raw / np.where(total <= 0.0, 1.0, total))
    anchor = np.zeros(count, np.int64)
    anchor[vessel[::-1]] = np.arange(len(vessel))[::-1]
    state = np.concatenate(
        [difference_m(tracks.position_deg, tracks.position_deg[anchor[vessel]]), tracks.velocity_m_s], axis=1
    )
    mean = np.stack([np.bincount(vessel, weight * state[:, k], minlength=count) for k in range(4)], axis=1)
    spread = np.zeros((count, 4, 4))
    np.add.at(spread, vessel, weight[:, None, None] ** 2 * covariance)
    return offset_deg(tracks.position_deg[anchor], mean[:, :2]), mean[:, 2:], spread


class Filtered:
    """The filters of `ImmOfTracks` by rounds: the first track of every vessel, then the second of those with one, ..."""

    def __init__(self, method: ImmOfTracks) -> None:
        self.method, self.time_s, self.row = method, 0.0, dict[int, int]()
        self.anchor, self.bank = np.zeros((0, 2)), (np.zeros((0, 3, 5)), np.zeros((0, 3, 5, 5)), np.zeros((0, 3)))

    def step(self, tracks: Tracks, covariance: Floats, vessel: Ints, time_s: float) -> Fused:
        """A cycle."""
        method, order = self.method, np.lexsort((-tracks.source, vessel))
        of = vessel[order]
        start = np.flatnonzero(np.r_[True, of[1:] != of[:-1]])
        rank = np.arange(len(of)) - np.repeat(start, np.diff(np.r_[start, len(of)]))
        plan = [(of[rank == r], order[rank == r]) for r in range(int(rank.max()) + 1)]
        lead = plan[0][1]
        anchor, (state, spread, mode) = tracks.position_deg[lead], self._begun(covariance[lead], tracks.velocity_m_s[lead])
        before = np.full(len(lead), -1)
        for who, row in plan:
            was = np.array([self.row.get(k, -1) for k in tracks.track_id[row].tolist()])
            before[who] = np.where(before[who] < 0, was, before[who])
        known = before >= 0
        if known.any():
            dt = np.full(int(known.sum()), time_s - self.time_s)
            old = [part[before[known]] for part in self.bank]
            old = list(predict_filters(*old, dt, np.inf, method._models()))
            old[0][:, :, :2] -= difference_m(anchor[known], self.anchor[before[known]])[:, None, :]
            state[known], spread[known], mode[known] = old
        for who, row in plan:
            away = difference_m(tracks.position_deg[row], anchor[who])
            z, all_of_it = np.concatenate([away, tracks.velocity_m_s[row]], axis=1), np.ones(len(row), np.bool_)
            made = update_filters(state[who], spread[who], mode[who], z, method.inflation * covariance[row], all_of_it)
            state[who], spread[who], mode[who] = made[:3]
        mean, total = estimate_filters(state, spread, mode)
        position, velocity, fused = offset_deg(anchor, mean[:, :2]), mean[:, 2:4].copy(), total[:, :4, :4].copy()
        alone = np.bincount(vessel) == 1
        position[alone], velocity[alone] = tracks.position_deg[lead[alone]], tracks.velocity_m_s[lead[alone]]
        fused[alone] = covariance[lead[alone]]
        self.anchor, self.bank, self.time_s = anchor, (state, spread, mode), time_s
        self.row = dict(zip(tracks.track_id.tolist(), vessel.tolist(), strict=True))
        return position, velocity, fused

    def _begun(self, covariance: Floats, velocity: Floats) -> tuple[Floats, Floats, Floats]:
        state, spread = np.zeros((len(velocity), 3, 5)), np.zeros((len(velocity), 3, 5, 5))
        state[:, :, 2:4] = velocity[:, None, :]
        spread[:, :, :4, :4] = covariance[:, None]
        spread[:, :, 4, 4] = self.method.turn_sigma_rad_s**2
        return state, spread, np.full((len(velocity), 3), 1.0 / 3.0)
