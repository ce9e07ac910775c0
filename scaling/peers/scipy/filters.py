"""The IMM over the tracks of each vessel, batched over vessels in numpy: matmul and numpy.linalg.solve."""

from __future__ import annotations

import numpy as np

from scaling.peers.exchange import AIS, RADAR, Floats, Ints, Stopwatch, TaskResult, TrackHistory
from scaling.peers.models import MODELS, Motion, initialise, motion_models, transition

Bank = tuple[Floats, Floats, Floats]  # states (V, 3, 5), covariances (V, 3, 5, 5), probabilities (V, 3)


def imm(history: TrackHistory, watch: Stopwatch) -> TaskResult:
    """Predict and update every vessel. A filter is initialised at the AIS track, which is also the first measurement."""
    motion = motion_models(history.settings)
    rows = [np.flatnonzero(history.source == s) for s in (AIS, RADAR)]
    members = [(history.vessel[r], r, motion.inflation * history.covariance[r]) for r in rows]
    vessels = history.true_position_m.shape[1]
    lead = np.zeros(vessels, np.int64)
    for who, row, _ in reversed(members):
        lead[who] = row
    states = np.concatenate([history.position_m, history.velocity_m_s], axis=2)
    bank = initialise(motion, states[0, lead], history.covariance[lead])
    estimates = np.zeros((history.measured, vessels, 4))
    for cycle in range(len(history.time_s)):
        timed = cycle >= history.first
        with (watch if timed else Stopwatch()).lap():
            if cycle:
                bank = predict(motion, bank)
            for who, row, noise in members:
                bank = update(bank, who, states[cycle, row], noise)
            mean, _ = estimate(bank)
        if timed:
            estimates[cycle - history.first] = mean[:, :4]
    position, velocity = estimates[..., :2], estimates[..., 2:]
    return watch.result(("numpy",), unit="vessel", units=vessels, position_m=position, velocity_m_s=velocity)


def predict(motion: Motion, bank: Bank) -> Bank:
    """IMM mixing, then the prediction of each model. Args: bank: states, covariances, mode probabilities."""
    state, covariance, mode = bank
    move = transition(motion)
    after = mode @ move
    weight = mode[:, :, None] * move / after[:, None, :]
    mixed = np.einsum("vij,vis->vjs", weight, state)
    off = state[:, :, None] - mixed[:, None]
    mixed_covariance = np.einsum("vij,visr->vjsr", weight, covariance) + np.einsum("vij,vijs,vijr->vjsr", weight, off, off)
    out, cov = np.empty_like(mixed), np.empty_like(mixed_covariance)
    for k in range(MODELS):
        if k == MODELS - 1:
            out[:, k], f = motion.coordinated_turn(mixed[:, k])
            q = motion.turn_process_noise(motion.noise[k])
        else:
            f, q = motion.constant_velocity(motion.noise[k])
            out[:, k] = mixed[:, k] @ f.T
        cov[:, k] = f @ mixed_covariance[:, k] @ np.swapaxes(f, -1, -2) + q
    return out, cov, after


def update(bank: Bank, who: Ints, measured: Floats, noise: Floats) -> Bank:
    """Update with a measurement of position and velocity. Args: who: (G,) vessels; measured: (G, 4); noise: (G, 4, 4)."""
    state, covariance, mode = (part.copy() for part in bank)
    x, p = state[who], covariance[who]
    s = p[..., :4, :4] + noise[:, None]
    gain = np.linalg.solve(s, p[..., :4, :]).swapaxes(-1, -2)
    innovation = measured[:, None] - x[..., :4]
    distance = np.einsum("vjs,vjs->vj", innovation, np.linalg.solve(s, innovation[..., None])[..., 0])
    log_likelihood = -0.5 * (distance + np.linalg.slogdet(s)[1])
    weight = mode[who] * np.exp(log_likelihood - log_likelihood.max(axis=1, keepdims=True))
    state[who] = x + (gain @ innovation[..., None])[..., 0]
    covariance[who] = p - gain @ p[..., :4, :]
    mode[who] = weight / weight.sum(axis=1, keepdims=True)
    return state, covariance, mode


def estimate(bank: Bank) -> tuple[Floats, Floats]:
    """Mean and covariance of the mixture of models: (V, 5), (V, 5, 5)."""
    state, covariance, mode = bank
    mean = np.einsum("vj,vjs->vs", mode, state)
    off = state - mean[:, None]
    return mean, np.einsum("vj,vjsr->vsr", mode, covariance) + np.einsum("vj,vjs,vjr->vsr", mode, off, off)
