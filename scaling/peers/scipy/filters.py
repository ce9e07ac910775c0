"""The IMM over the tracks of each vessel, all vessels at once in numpy: matmul, numpy.linalg.solve, no loop but over models and tracks."""

from __future__ import annotations

import numpy as np

from scaling.peers.exchange import AIS, RADAR, Answer, Floats, Given, Ints, Watch
from scaling.peers.models import MODELS, Motion, begun, motion_of, transition

Bank = tuple[Floats, Floats, Floats]  # states (V, 3, 5), covariances (V, 3, 5, 5), probabilities (V, 3)


def imm(given: Given, watch: Watch) -> Answer:
    """Predict and update of every vessel; AIS first, whose place a filter begins at."""
    motion = motion_of(given.settings)
    rows = [np.flatnonzero(given.source == s) for s in (AIS, RADAR)]
    members = [(given.vessel[r], r, motion.inflation * given.covariance[r]) for r in rows]
    vessels = given.true_position_m.shape[1]
    lead = np.zeros(vessels, np.int64)
    for who, row, _ in reversed(members):
        lead[who] = row
    seen = np.concatenate([given.position_m, given.velocity_m_s], axis=2)
    bank = begun(motion, seen[0, lead], given.covariance[lead])
    estimates = np.zeros((given.measured, vessels, 4))
    for cycle in range(len(given.time_s)):
        timed = cycle >= given.first
        with (watch if timed else Watch()).lap():
            if cycle:
                bank = predicted(motion, bank)
            for who, row, noise in members:
                bank = updated(bank, who, seen[cycle, row], noise)
            mean, _ = estimate(bank)
        if timed:
            estimates[cycle - given.first] = mean[:, :4]
    position, velocity = estimates[..., :2], estimates[..., 2:]
    return watch.answer(("numpy",), unit="vessel", units=vessels, position_m=position, velocity_m_s=velocity)


def predicted(motion: Motion, bank: Bank) -> Bank:
    """Mixed, then moved by each model."""
    state, covariance, mode = bank
    move = transition(motion)
    after = mode @ move
    weight = mode[:, :, None] * move / after[:, None, :]
    mixed = np.einsum("vij,vis->vjs", weight, state)
    off = state[:, :, None] - mixed[:, None]
    spread = np.einsum("vij,visr->vjsr", weight, covariance) + np.einsum("vij,vijs,vijr->vjsr", weight, off, off)
    out, cov = np.empty_like(mixed), np.empty_like(spread)
    for k in range(MODELS):
        if k == MODELS - 1:
            out[:, k], f = motion.turned(mixed[:, k])
            q = motion.turning_noise(motion.noise[k])
        else:
            f, q = motion.steady(motion.noise[k])
            out[:, k] = mixed[:, k] @ f.T
        cov[:, k] = f @ spread[:, k] @ np.swapaxes(f, -1, -2) + q
    return out, cov, after


def updated(bank: Bank, who: Ints, seen: Floats, noise: Floats) -> Bank:
    """After a measurement of position and velocity of some vessels. Args: who: (G,); seen: (G, 4); noise: (G, 4, 4)."""
    state, covariance, mode = (part.copy() for part in bank)
    x, p = state[who], covariance[who]
    s = p[..., :4, :4] + noise[:, None]
    gain = np.linalg.solve(s, p[..., :4, :]).swapaxes(-1, -2)
    off = seen[:, None] - x[..., :4]
    square = np.einsum("vjs,vjs->vj", off, np.linalg.solve(s, off[..., None])[..., 0])
    fit = -0.5 * (square + np.linalg.slogdet(s)[1])
    weight = mode[who] * np.exp(fit - fit.max(axis=1, keepdims=True))
    state[who] = x + (gain @ off[..., None])[..., 0]
    covariance[who] = p - gain @ p[..., :4, :]
    mode[who] = weight / weight.sum(axis=1, keepdims=True)
    return state, covariance, mode


def estimate(bank: Bank) -> tuple[Floats, Floats]:
    """Mean and covariance over the models: (V, 5), (V, 5, 5)."""
    state, covariance, mode = bank
    mean = np.einsum("vj,vjs->vs", mode, state)
    off = state - mean[:, None]
    return mean, np.einsum("vj,vjsr->vsr", mode, covariance) + np.einsum("vj,vjs,vjr->vsr", mode, off, off)
