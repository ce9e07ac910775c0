"""AIS messages in turn, and those of one id as one measurement: filters run through several, mixtures of filters. Compiled by numba.

Source: A. G. Hem, E. F. Brekke, Variations of joint integrated data association with radar and target-provided measurements, Journal of
Advances in Information Fusion 17(2), 2022, section VI (precise batch) and equations (71) to (78).
"""

from __future__ import annotations

import math

import numpy as np

from coastwatch.kernels.filters import imm
from coastwatch.kernels.filters.kalman import SIZE
from coastwatch.kernels.jit import jit
from coastwatch.kernels.tables.copies import copy_into


@jit
def rounds(count, message, node, nodes, close):  # type: ignore[no-untyped-def]
    """The round of each message: the one after the latest round of an earlier message that shares a node with it or is close. (M,)

    Args: count: M, of messages in order of time; message, node: (A,) which message has which node, sorted by message; nodes: how many
    there are; close: (K, 2) messages that are close, the earlier one first, sorted by the later one.
    """
    out, last = np.zeros(count, np.int64), np.full(nodes, -1)
    at, pair = 0, 0
    for m in range(count):
        begin = at
        while at < len(message) and message[at] == m:
            out[m] = max(out[m], last[node[at]] + 1)
            at += 1
        while pair < len(close) and close[pair, 1] == m:
            out[m] = max(out[m], out[close[pair, 0]] + 1)
            pair += 1
        last[node[begin:at]] = out[m]
    return out


@jit
def _fits(state, covariance, z, noise, limit):  # type: ignore[no-untyped-def]
    """Whether a measured position is in the gate of any model of a filter."""
    for j in range(len(state)):
        ee, en, nn = covariance[j, 0, 0] + noise[0, 0], covariance[j, 1, 0] + noise[1, 0], covariance[j, 1, 1] + noise[1, 1]
        east, north = z[0] - state[j, 0], z[1] - state[j, 1]
        if nn * east * east - 2.0 * en * east * north + ee * north * north <= limit * (ee * nn - en * en):
            return True
    return False


@jit
def in_any_gate(filters, hypotheses, limit):  # type: ignore[no-untyped-def]
    """Whether each pair of a track and a message is in the gate of any model of the track. (A,)

    Args: filters: state (S, J, 5), covariance (S, J, 5, 5), mode probability (S, J), predicted to the messages; hypotheses: `Hypotheses`;
    limit: squared Mahalanobis distance.
    """
    out = np.empty(len(hypotheses.plot), np.bool_)
    for t in range(len(hypotheses.slot)):
        n = hypotheses.slot[t]
        for a in range(hypotheses.start[t], hypotheses.start[t + 1]):
            out[a] = _fits(filters[0][n], filters[1][n], hypotheses.position[a], hypotheses.noise[a], limit)
    return out


@jit
def run_through(filters, time, rows, measured, until, limit, renewal, models):  # type: ignore[no-untyped-def]
    """Predict and update each filter by its messages, and predict it to a time. In place.

    Args: filters: state (A, J, 5), covariance (A, J, 5, 5), mode probability (A, J); time: (A,) of each, overwritten; rows: first message
    of each and the end, (A,) each, rows of measured in order of time; measured: time (M,), z (M, 4) east, north, east rate, north rate,
    NaN rates where none were sent, and noise R (M, 4, 4); until: no filter is taken back to it; limit: squared Mahalanobis distance of
    the gate of the position; renewal: as of `imm.predict_filter`; models: (J,) MODEL.
    Returns: log-likelihood of the messages (A,); whether the position of each was in the gate of any model (A,).
    """
    states, covariances, modes = filters
    work, z, noise = imm.workspace(len(models)), np.empty(4), np.empty((4, 4))
    log_likelihood, fit = np.zeros(len(time)), np.ones(len(time), np.bool_)
    for k in range(len(time)):
        state, covariance, mode = states[k], covariances[k], modes[k]
        for m in range(rows[0][k], rows[1][k]):
            dt = measured[0][m] - time[k]
            copy_into(z, measured[1][m])
            copy_into(noise, measured[2][m])
            if dt < 0.0:
                imm.moments(state, covariance, mode, work.mean, work.spread)
                imm.bring_forward(z, noise, -dt, work.mean, work.spread)
            else:
                imm.predict_filter(state, covariance, mode, models, dt, renewal, work)
                time[k] = measured[0][m]
            fit[k] &= _fits(state, covariance, z, noise, limit)
            known = z[:2] if math.isnan(z[2]) else z
            log_likelihood[k] += imm.update_filter(state, covariance, mode, known, noise, work)
        if until > time[k]:
            imm.predict_filter(state, covariance, mode, models, until - time[k], renewal, work)
            time[k] = until
    return log_likelihood, fit


@jit
def mix_filters(filters, estimates, slot, start, others, share, least, models):  # type: ignore[no-untyped-def]
    """Each filter becomes the mixture of itself and of others, model by model reduced to one Gaussian. In place.

    Args: filters: state (S, J, 5), covariance (S, J, 5, 5), mode probability (S, J); estimates: `Estimates` of them; slot: (T,); start:
    (T + 1,) first of the others of each; others: as filters, of A; share: (A,) their probabilities; least: of that of a model.
    """
    count = len(models)
    mean, spread, apart = np.empty(SIZE), np.empty((SIZE, SIZE)), np.empty(SIZE)
    for t in range(len(slot)):
        n, first, end = slot[t], start[t], start[t + 1]
        state, covariance, mode = filters[0][n], filters[1][n], filters[2][n]
        missed = 1.0
        for a in range(first, end):
            missed -= share[a]
        missed, floored = max(missed, 0.0), 0.0
        for j in range(count):
            total = missed * mode[j]
            for a in range(first, end):
                total += share[a] * others[2][a, j]
            if total > 0.0:
                _mix(
                    state[j],
                    covariance[j],
                    missed * mode[j] / total,
                    others,
                    (first, end),
                    j,
                    share / total,
                    (mean, spread, apart),
                )
            mode[j] = max(total, least)
            floored += mode[j]
        for j in range(count):
            mode[j] /= floored
        imm.combine(state, covariance, mode, models, n, estimates)


@jit
def _mix(state, covariance, own, others, rows, j, share, work):  # type: ignore[no-untyped-def]
    """One model becomes the moments of itself with weight `own` and of model j of the others, weighted by share and mode probability."""
    mean, spread, apart = work
    for a in range(SIZE):
        mean[a] = own * state[a]
    for row in range(rows[0], rows[1]):
        weight = share[row] * others[2][row, j]
        for a in range(SIZE):
            mean[a] += weight * others[0][row, j, a]
    for a in range(SIZE):
        apart[a] = state[a] - mean[a]
        for b in range(SIZE):
            spread[a, b] = own * (covariance[a, b] + apart[a] * (state[b] - mean[b]))
    for row in range(rows[0], rows[1]):
        weight = share[row] * others[2][row, j]
        for a in range(SIZE):
            apart[a] = others[0][row, j, a] - mean[a]
        for a in range(SIZE):
            for b in range(SIZE):
                spread[a, b] += weight * (others[1][row, j, a, b] + apart[a] * apart[b])
    copy_into(state, mean)
    copy_into(covariance, spread)
