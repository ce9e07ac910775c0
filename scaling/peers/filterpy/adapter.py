"""filterpy's IMM, an object a vessel: `python -m scaling.peers.filterpy.adapter imm GIVEN.npz ANSWER.npz`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from filterpy.kalman import IMMEstimator, KalmanFilter

from scaling.peers.exchange import Answer, Floats, Given, Task, Watch, answer_command
from scaling.peers.models import LEAST_TURN_RAD, Motion, begun, motion_of, transition


class Steady(KalmanFilter):
    """Constant velocity; the turn rate, no part of the motion, stands at its prior."""

    def __init__(self, motion: Motion, noise: float, tracks: int) -> None:
        super().__init__(dim_x=5, dim_z=4 * tracks)
        self.F, self.Q = motion.steady(noise)


class Turning(KalmanFilter):
    """Coordinated turn, linearised about the state."""

    def __init__(self, motion: Motion, noise: float, tracks: int) -> None:
        super().__init__(dim_x=5, dim_z=4 * tracks)
        self.motion, self.Q = motion, motion.turning_noise(noise)

    def predict(self, u: Any = None, B: Any = None, F: Any = None, Q: Any = None) -> None:
        """The state after a period; the arguments are filterpy's and of no use here."""
        dt, (x, y, vx, vy, rate) = self.motion.period_s, self.x.tolist()
        w = math.copysign(max(abs(rate), LEAST_TURN_RAD / dt), rate)
        sin, cos = math.sin(w * dt), math.cos(w * dt)
        s, c = sin / w, (1.0 - cos) / w
        ds, dc = (dt * cos - s) / w, (dt * sin - c) / w
        jacobian = np.array(
            [
                [1.0, 0.0, s, -c, ds * vx - dc * vy],
                [0.0, 1.0, c, s, dc * vx + ds * vy],
                [0.0, 0.0, cos, -sin, -dt * (sin * vx + cos * vy)],
                [0.0, 0.0, sin, cos, dt * (cos * vx - sin * vy)],
                [0.0, 0.0, 0.0, 0.0, 1.0],
            ]
        )
        self.x = np.array([x + s * vx - c * vy, y + c * vx + s * vy, cos * vx - sin * vy, sin * vx + cos * vy, rate])
        self.P = jacobian @ self.P @ jacobian.T + self.Q


def imm(given: Given, watch: Watch) -> Answer:
    """Predict and update of every vessel, one object after the other; the tracks of a vessel are one stacked measurement."""
    motion = motion_of(given.settings)
    members = [np.flatnonzero(given.vessel == v) for v in range(given.true_position_m.shape[1])]
    members = [rows[np.argsort(-given.source[rows])] for rows in members]  # AIS first, whose place a filter begins at
    noise = [motion.inflation * _blocks(given.covariance[rows]) for rows in members]
    filters = [_filter(given, motion, int(rows[0]), r) for rows, r in zip(members, noise, strict=True)]
    estimates = np.zeros((given.measured, len(members), 4))
    for cycle in range(len(given.time_s)):
        seen = np.concatenate([given.position_m[cycle], given.velocity_m_s[cycle]], axis=1)
        timed = cycle >= given.first
        with (watch if timed else Watch()).lap():
            for one, rows in zip(filters, members, strict=True):
                if cycle:
                    one.predict()
                one.update(seen[rows].ravel())
        if timed:
            estimates[cycle - given.first] = [one.x[:4] for one in filters]
    return watch.answer(
        ("filterpy", "numpy"),
        unit="vessel",
        units=len(members),
        position_m=estimates[..., :2],
        velocity_m_s=estimates[..., 2:],
    )


def _filter(given: Given, motion: Motion, lead: int, noise: Floats) -> IMMEstimator:
    """The IMM of one vessel, begun at its lead track."""
    first = np.concatenate([given.position_m[0, lead], given.velocity_m_s[0, lead]])
    state, covariance, mode = begun(motion, first[None], given.covariance[lead][None])
    tracks = len(noise) // 4
    kinds = Steady, Steady, Turning
    models = [kind(motion, q, tracks) for kind, q in zip(kinds, motion.noise, strict=True)]
    for k, model in enumerate(models):
        model.x, model.P, model.R = state[0, k], covariance[0, k], noise
        model.H = np.tile(np.eye(4, 5), (tracks, 1))
    made = IMMEstimator(models, mode[0], transition(motion))
    made.cbar = mode[0].copy()  # the first measurement comes at once, with no period in between
    return made


def _blocks(covariances: Floats) -> Floats:
    """The covariance of tracks stacked, their errors unrelated. Args: (L, 4, 4). Returns: (4 L, 4 L)."""
    out = np.zeros((4 * len(covariances), 4 * len(covariances)))
    for k, one in enumerate(covariances):
        out[4 * k : 4 * k + 4, 4 * k : 4 * k + 4] = one
    return out


TASKS: dict[str, Task] = {"imm": imm}

if __name__ == "__main__":
    answer_command(TASKS)
