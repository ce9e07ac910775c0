"""Tracks of a vessel fused in numpy, by batches of matrices: how the methods were before they became kernels. What it says is the measure.

Each takes tracks, their covariances as known (N, 4, 4), and the vessel of each (N,); each returns positions, velocities and
covariances, (V, ...).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from coastwatch.batches import Floats, Ints, SourceKind, Tracks
from coastwatch.geodesy import difference_m, offset_deg

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
