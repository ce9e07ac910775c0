"""Recorded fixes to a smooth path: Rauch-Tung-Striebel smoother under constant acceleration, for many paths at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coastwatch.batches import Bools, Floats, Ints

START_ACCELERATION = 0.3  # m/s2, standard deviation before the first fix


class Moments(NamedTuple):
    """Mean and covariance of position, velocity and acceleration, each east and north; one row per fix."""

    mean: Floats  # (M, 6)
    covariance: Floats  # (M, 6, 6)


def smooth(start: Ints, length: Ints, time_s: Floats, seen: Floats, noise: Floats, jerk: float) -> Floats:
    """East, north, their rates and accelerations at each fix, given all fixes of its path. (M, 6)

    Args: start, length: (S,) where each path begins among the fixes and how many it has, at least 1; time_s: (M,) increasing in
    a path; seen: (M, 4) position and velocity, m and m/s; noise: (M, 4, 4); jerk: density of the white jerk, m2/s5.
    Source: Rauch, Tung, Striebel, Maximum likelihood estimates of linear dynamic systems, 1965, eqs. 3.29-3.31.
    """
    order = np.argsort(-length, kind="stable")
    start, length = start[order], length[order]
    longest = int(length[0]) if len(length) else 0
    mean, covariance = np.zeros((len(time_s), 6)), np.zeros((len(time_s), 6, 6))
    ahead: list[Moments] = []
    for k in range(longest):
        rows = start[length > k] + k
        before = _start(seen[rows], noise[rows]) if k == 0 else _predicted(mean, covariance, rows, time_s, jerk)
        ahead.append(before)
        mean[rows], covariance[rows] = _updated(before, seen[rows], noise[rows])
    for k in range(longest - 2, -1, -1):
        rows = start[length > k + 1] + k
        move, _ = _motion(time_s[rows + 1] - time_s[rows], jerk)
        gain = np.linalg.solve(ahead[k + 1].covariance, move @ covariance[rows]).swapaxes(1, 2)
        mean[rows] += np.einsum("sij,sj->si", gain, mean[rows + 1] - ahead[k + 1].mean)
    return mean


def _motion(step_s: Floats, jerk: float) -> tuple[Floats, Floats]:
    """Transition from before to now and its noise, for steps of these lengths. (S, 6, 6) each"""
    one, t = np.ones_like(step_s), step_s
    zero = np.zeros_like(t)
    move = np.array([[one, t, t**2 / 2], [zero, one, t], [zero, zero, one]]).transpose(2, 0, 1)
    added = np.array([[t**5 / 20, t**4 / 8, t**3 / 6], [t**4 / 8, t**3 / 3, t**2 / 2], [t**3 / 6, t**2 / 2, t]]).transpose(
        2, 0, 1
    )
    axes = np.eye(2)
    wide = (len(t), 6, 6)
    return (
        np.einsum("sij,kl->sikjl", move, axes).reshape(wide),
        np.einsum("sij,kl->sikjl", jerk * added, axes).reshape(wide),
    )


def _start(seen: Floats, noise: Floats) -> Moments:
    mean, covariance = np.zeros((len(seen), 6)), np.zeros((len(seen), 6, 6))
    mean[:, :4] = seen
    covariance[:, :4, :4] = 100.0 * noise  # large, so that the first fix has the same weight as the others
    covariance[:, 4, 4] = covariance[:, 5, 5] = START_ACCELERATION**2
    return Moments(mean, covariance)


def _predicted(mean: Floats, covariance: Floats, rows: Ints, time_s: Floats, jerk: float) -> Moments:
    move, added = _motion(time_s[rows] - time_s[rows - 1], jerk)
    return Moments(
        np.einsum("sij,sj->si", move, mean[rows - 1]),
        move @ covariance[rows - 1] @ move.swapaxes(1, 2) + added,
    )


def _updated(before: Moments, seen: Floats, noise: Floats) -> Moments:
    innovation_covariance = before.covariance[:, :4, :4] + noise
    gain = np.linalg.solve(innovation_covariance, before.covariance[:, :4, :]).swapaxes(1, 2)
    covariance = before.covariance - gain @ before.covariance[:, :4, :]
    mean = before.mean + np.einsum("sij,sj->si", gain, seen - before.mean[:, :4])
    return Moments(mean, 0.5 * (covariance + covariance.swapaxes(1, 2)))


def between(time_s: Floats, state: Floats, part: Ints, at_s: Floats) -> tuple[Floats, Floats, Bools]:
    """Position and velocity at times between the fixes of one vessel, NaN outside its paths, and which times are inside.

    Cubic Hermite interpolation of positions and velocities of the two neighbouring fixes.
    Args: time_s: (M,) increasing; state: (M, 6); part: (M,) equal within an unbroken path; at_s: (T,). Returns: (T, 2), (T, 2), (T,).
    """
    last = max(len(time_s) - 1, 0)
    hi = np.clip(np.searchsorted(time_s, at_s, side="left"), 1, max(last, 1))
    hi = np.where((part[hi - 1] != part[np.minimum(hi, last)]) & (at_s == time_s[np.minimum(hi, last)]), hi + 1, hi)
    lo, hi = np.minimum(hi - 1, last), np.minimum(hi, last)
    inside = (at_s >= time_s[lo]) & (at_s <= time_s[hi]) & (part[lo] == part[hi]) & (hi > lo)
    step = np.where(hi > lo, time_s[hi] - time_s[lo], 1.0)[:, None]
    u = np.clip((at_s - time_s[lo])[:, None] / step, 0.0, 1.0)
    p0, p1, v0, v1 = state[lo, :2], state[hi, :2], state[lo, 2:4] * step, state[hi, 2:4] * step
    position = (2 * u**3 - 3 * u**2 + 1) * p0 + (u**3 - 2 * u**2 + u) * v0 + (3 * u**2 - 2 * u**3) * p1 + (u**3 - u**2) * v1
    slope = (6 * u**2 - 6 * u) * p0 + (3 * u**2 - 4 * u + 1) * v0 + (6 * u - 6 * u**2) * p1 + (3 * u**2 - 2 * u) * v1
    position[~inside] = np.nan
    velocity = slope / step
    velocity[~inside] = np.nan
    return position, velocity, inside
