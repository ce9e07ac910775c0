"""The motion models of `ImmOfTracks` in plain numpy, for the IMM of peers: constant velocity twice, coordinated turn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from scaling.peers.exchange import Floats

SIZE, MODELS = 5, 3  # east, north, east rate, north rate, turn rate
MIN_TURN_RAD = 1e-3  # a smaller turn is computed as this one, against cancellation


@dataclass(frozen=True)
class Motion:
    """The settings of `ImmOfTracks`, and the period in seconds."""

    period_s: float
    inflation: float  # factor of the covariances of the tracks
    noise: tuple[float, ...]  # m2/s3, of each model
    turn_noise: float  # rad2/s3
    turn_sigma: float  # rad/s
    sojourn_s: tuple[float, ...]

    def constant_velocity(self, noise: float) -> tuple[Floats, Floats]:
        """F and Q of constant velocity over a period: (5, 5) each."""
        move, q = np.eye(SIZE), self._white_acceleration(noise)
        move[0, 2] = move[1, 3] = self.period_s
        move[4, 4], q[4, 4] = 0.0, self.turn_sigma**2
        return move, q

    def turn_process_noise(self, noise: float) -> Floats:
        """Q of the coordinated turn over a period: (5, 5)."""
        q = self._white_acceleration(noise)
        q[4, 4] = self.turn_noise * self.period_s
        return q

    def _white_acceleration(self, noise: float) -> Floats:
        dt, q = self.period_s, np.zeros((SIZE, SIZE))
        for k in range(2):
            q[k, k], q[k, k + 2], q[k + 2, k + 2] = noise * dt**3 / 3.0, noise * dt**2 / 2.0, noise * dt
            q[k + 2, k] = q[k, k + 2]
        return q

    def coordinated_turn(self, x: Floats) -> tuple[Floats, Floats]:
        """States after a period of coordinated turn, and its Jacobians. Args: x: (V, 5). Returns: (V, 5), (V, 5, 5)."""
        dt, vx, vy = self.period_s, x[:, 2], x[:, 3]
        w = np.where(np.abs(x[:, 4]) * dt < MIN_TURN_RAD, np.copysign(MIN_TURN_RAD / dt, x[:, 4]), x[:, 4])
        sin, cos = np.sin(w * dt), np.cos(w * dt)
        s, c = sin / w, (1.0 - cos) / w
        ds, dc = (dt * cos - s) / w, (dt * sin - c) / w
        f = np.tile(np.eye(SIZE), (len(x), 1, 1))
        f[:, 0, 2], f[:, 0, 3], f[:, 0, 4] = s, -c, ds * vx - dc * vy
        f[:, 1, 2], f[:, 1, 3], f[:, 1, 4] = c, s, dc * vx + ds * vy
        f[:, 2, 2], f[:, 2, 3], f[:, 2, 4] = cos, -sin, -dt * (sin * vx + cos * vy)
        f[:, 3, 2], f[:, 3, 3], f[:, 3, 4] = sin, cos, dt * (cos * vx - sin * vy)
        east, north = x[:, 0] + s * vx - c * vy, x[:, 1] + c * vx + s * vy
        return np.stack([east, north, cos * vx - sin * vy, sin * vx + cos * vy, x[:, 4]], axis=1), f


def motion_models(settings: Mapping[str, Any]) -> Motion:
    """The models of the settings in a TrackHistory."""
    s = settings["imm"]
    noise, sojourn = tuple(s["noise_m2_s3"]), tuple(s["sojourn_s"])
    return Motion(settings["period_s"], s["inflation"], noise, s["turn_noise_rad2_s3"], s["turn_sigma_rad_s"], sojourn)


def transition(motion: Motion) -> Floats:
    """transition[i, j]: the probability of model j now, history model i a period before. (3, 3)"""
    sojourn, j = np.array(motion.sojourn_s), MODELS
    stay = (1.0 + (j - 1) * np.exp(-motion.period_s / sojourn * j / (j - 1))) / j
    out = np.tile(((1.0 - stay) / (j - 1))[:, None], (1, j))
    out[np.arange(j), np.arange(j)] = stay
    return out


def initialise(motion: Motion, track: Floats, covariance: Floats) -> tuple[Floats, Floats, Floats]:
    """Filters initialised at a track: states (V, 3, 5), covariances (V, 3, 5, 5), probabilities (V, 3). Args: (V, 4), (V, 4, 4)."""
    count = len(track)
    state, cov = np.zeros((count, MODELS, SIZE)), np.zeros((count, MODELS, SIZE, SIZE))
    state[..., :4], cov[..., :4, :4] = track[:, None], covariance[:, None]
    cov[..., 4, 4] = motion.turn_sigma**2
    return state, cov, np.full((count, MODELS), 1.0 / MODELS)
