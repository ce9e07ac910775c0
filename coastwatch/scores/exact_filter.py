"""Kalman filters of many vessels, event by event, with the true motion model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coastwatch.batches import Batch, Floats, Ints, Trajectories, column

POSITION, VELOCITY, KICK, INSTANT = 0, 1, 2, 3
POSITION_PRIOR_M, VELOCITY_PRIOR_M_S = 1e4, 10.0  # wide: forgotten after two reports


@dataclass(frozen=True, eq=False)
class Events(Batch):
    """Events of the filters, in any order: measurements, perturbations, and instants at which estimates are wanted."""

    row: Ints = column(np.int64, "M")  # of the vessel
    time_s: Floats = column(np.float64, "M")
    kind: Ints = column(np.int64, "M")
    value: Floats = column(np.float64, "M", 2)  # measured position in the plane, or velocity
    covariance: Floats = column(np.float64, "M", 2, 2)  # of the measurement, or of the perturbation
    instant: Ints = column(np.int64, "M")  # 0..T-1


def filtered(truth: Trajectories, events: Events, instants: int) -> tuple[Floats, Floats, Floats]:
    """Position, velocity and their covariance at the instants, NaN for vessels without an event there.

    The state is position, velocity and, where perturbations die out, mean velocity; before the first event velocity is its mean.
    One round takes the next event of every vessel that still has one, so there are as many rounds as the busiest vessel has events.

    Args: truth: the motion models of the vessels (V). Returns: (V, T, 2), (V, T, 2), (V, T, 4, 4).
    """
    v = len(truth.vessel)
    keep = truth.kick_keep if len(truth.kick_keep) else np.ones(v)
    d = 6 if (keep < 1.0).any() else 4
    state, covariance = np.zeros((v, d)), np.zeros((v, d, d))
    tie = np.ones((d // 2 - 1, d // 2 - 1))
    covariance[:, :2, :2] = POSITION_PRIOR_M**2 * np.eye(2)
    covariance[:, 2:, 2:] = VELOCITY_PRIOR_M_S**2 * np.kron(tie, np.eye(2))
    filtered_at = np.full((v, instants, d), np.nan), np.full((v, instants, d, d), np.nan)
    events = events.take(np.lexsort((events.kind, events.time_s, events.row)))
    last_s = np.full(v, np.min(events.time_s, initial=np.inf))
    for rows in _rounds(events.row):
        now = events.take(rows)
        x, p = _predicted(truth, now.row, now.time_s - last_s[now.row], state[now.row], covariance[now.row])
        last_s[now.row] = now.time_s
        for kind, first in ((POSITION, 0), (VELOCITY, 2)):
            at = np.flatnonzero(now.kind == kind)
            if len(at):
                x[at], p[at] = _updated(x[at], p[at], now.value[at], now.covariance[at], first)
        at = np.flatnonzero(now.kind == KICK)
        if len(at):
            x[at], p[at] = _kicked(x[at], p[at], keep[now.row[at]], now.covariance[at])
        at = np.flatnonzero(now.kind == INSTANT)
        filtered_at[0][now.row[at], now.instant[at]], filtered_at[1][now.row[at], now.instant[at]] = x[at], p[at]
        state[now.row], covariance[now.row] = x, p
    return filtered_at[0][..., :2], filtered_at[0][..., 2:4], filtered_at[1][..., :4, :4]


def _rounds(row: Ints) -> list[Ints]:
    """For each round the events in it. Args: (M,) sorted."""
    first = np.searchsorted(row, row)
    number = np.arange(len(row)) - first
    order = np.argsort(number, kind="stable")
    return np.split(order, np.searchsorted(number[order], np.arange(1, int(number.max(initial=0)) + 1)))


def _predicted(truth: Trajectories, row: Ints, span_s: Floats, x: Floats, p: Floats) -> tuple[Floats, Floats]:
    """States after a time without perturbation."""
    d = x.shape[1]
    angle = truth.turn_rate_rad_s[row] * span_s
    ahead = span_s * np.sinc(angle / np.pi)
    aside = span_s * np.sin(0.5 * angle) * np.sinc(0.5 * angle / np.pi)
    f = np.zeros((len(row), d, d))
    f[:, [0, 1], [0, 1]] = 1.0
    f[:, 0, 2], f[:, 0, 3], f[:, 1, 2], f[:, 1, 3] = ahead, -aside, aside, ahead
    cos, sin = np.cos(angle), np.sin(angle)
    for k in range(2, d, 2):
        f[:, k, k], f[:, k, k + 1], f[:, k + 1, k], f[:, k + 1, k + 1] = cos, -sin, sin, cos
    gain = truth.acceleration_m_s2[row]
    moved = np.concatenate([0.5 * span_s[:, None] ** 2 * gain, *([span_s[:, None] * gain] * (d // 2 - 1))], axis=1)
    return np.einsum("mij,mj->mi", f, x) + moved, f @ p @ f.transpose(0, 2, 1)


def _updated(x: Floats, p: Floats, value: Floats, covariance: Floats, first: int) -> tuple[Floats, Floats]:
    """States after a measurement of two of their components."""
    at = slice(first, first + 2)
    s = p[:, at, at] + covariance
    gain = np.linalg.solve(s, p[:, at, :]).transpose(0, 2, 1)
    after = p - gain @ p[:, at, :]
    return x + np.einsum("mij,mj->mi", gain, value - x[:, at]), 0.5 * (after + after.transpose(0, 2, 1))


def _kicked(x: Floats, p: Floats, keep: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """States after a perturbation: velocity goes back towards its mean and takes a random step."""
    d = x.shape[1]
    g = np.tile(np.eye(d), (len(x), 1, 1))
    if d == 6:
        g[:, [2, 3], [2, 3]] = keep[:, None]
        g[:, [2, 3], [4, 5]] = 1.0 - keep[:, None]
    p = g @ p @ g.transpose(0, 2, 1)
    p[:, 2:4, 2:4] += covariance
    return np.einsum("mij,mj->mi", g, x), p
