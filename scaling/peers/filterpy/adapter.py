"""filterpy's IMM, one object per vessel: `python -m scaling.peers.filterpy.adapter imm INPUT.npz RESULT.npz`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from filterpy.kalman import IMMEstimator, KalmanFilter

from scaling.peers.exchange import Floats, Stopwatch, Task, TaskResult, TrackHistory, run_adapter
from scaling.peers.models import MIN_TURN_RAD, Motion, initialise, motion_models, transition


class ConstantVelocity(KalmanFilter):
    """Constant velocity; the turn rate stays at its prior."""

    def __init__(self, motion: Motion, noise: float, tracks: int) -> None:
        super().__init__(dim_x=5, dim_z=4 * tracks)
        self.F, self.Q = motion.constant_velocity(noise)


class CoordinatedTurn(KalmanFilter):
    """Coordinated turn, linearised at the state."""

    x: Floats  # (5,)
    P: Floats  # (5, 5)

    def __init__(self, motion: Motion, noise: float, tracks: int) -> None:
        super().__init__(dim_x=5, dim_z=4 * tracks)
        self.motion, self.Q = motion, motion.turn_process_noise(noise)

    def predict(self, u: Any = None, B: Any = None, F: Any = None, Q: Any = None) -> None:
        """Predict over one period. The arguments are filterpy's and unused."""
        dt, (x, y, vx, vy, rate) = self.motion.period_s, self.x.tolist()
        w = math.copysign(max(abs(rate), MIN_TURN_RAD / dt), rate)
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


def imm(history: TrackHistory, watch: Stopwatch) -> TaskResult:
    """Predict and update every vessel, one object after the other. The tracks of a vessel are one stacked measurement."""
    motion = motion_models(history.settings)
    members = [np.flatnonzero(history.vessel == v) for v in range(history.true_position_m.shape[1])]
    members = [rows[np.argsort(-history.source[rows])] for rows in members]  # AIS first: the filter is initialised there
    noise = [motion.inflation * _block_diagonal(history.covariance[rows]) for rows in members]
    filters = [_filter(history, motion, int(rows[0]), r) for rows, r in zip(members, noise, strict=True)]
    estimates = np.zeros((history.measured, len(members), 4))
    for cycle in range(len(history.time_s)):
        states = np.concatenate([history.position_m[cycle], history.velocity_m_s[cycle]], axis=1)
        timed = cycle >= history.first
        with (watch if timed else Stopwatch()).lap():
            for one, rows in zip(filters, members, strict=True):
                if cycle:
                    one.predict()
                one.update(states[rows].ravel())
        if timed:
            estimates[cycle - history.first] = [one.x[:4] for one in filters]
    return watch.result(
        ("filterpy", "numpy"),
        unit="vessel",
        units=len(members),
        position_m=estimates[..., :2],
        velocity_m_s=estimates[..., 2:],
    )


def _filter(history: TrackHistory, motion: Motion, lead: int, noise: Floats) -> IMMEstimator:
    """The IMM of one vessel, initialised at its lead track."""
    first = np.concatenate([history.position_m[0, lead], history.velocity_m_s[0, lead]])
    state, covariance, mode = initialise(motion, first[None], history.covariance[lead][None])
    tracks = len(noise) // 4
    kinds = ConstantVelocity, ConstantVelocity, CoordinatedTurn
    models: list[KalmanFilter] = [kind(motion, q, tracks) for kind, q in zip(kinds, motion.noise, strict=True)]
    for k, model in enumerate(models):
        model.x, model.P, model.R = state[0, k], covariance[0, k], noise
        model.H = np.tile(np.eye(4, 5), (tracks, 1))
    made = IMMEstimator(models, mode[0], transition(motion))
    made.cbar = mode[0].copy()  # the first measurement comes without a prediction before it
    return made


def _block_diagonal(covariances: Floats) -> Floats:
    """The covariance of stacked tracks with independent errors. Args: (L, 4, 4). Returns: (4 L, 4 L)."""
    out = np.zeros((4 * len(covariances), 4 * len(covariances)))
    for k, one in enumerate(covariances):
        out[4 * k : 4 * k + 4, 4 * k : 4 * k + 4] = one
    return out


TASKS: dict[str, Task] = {"imm": imm}

if __name__ == "__main__":
    run_adapter(TASKS)
