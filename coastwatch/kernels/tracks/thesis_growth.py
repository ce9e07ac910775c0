"""Growth of hypothesis trees by one look as printed in a thesis: the children of every leaf, with their scores. Compiled by numba.

A child misses the look, takes a plot in its gate, or takes an AIS report and then a plot in the gate of what the report leaves; a report
without such a plot is a child of its own. A score is a negative logarithm of a likelihood ratio: less is better.

Source: E. Liland, AIS aided multi hypothesis tracker, master thesis, NTNU, 2017, sections 4.4 and 4.5, (4.9) to (4.20).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coastwatch.kernels.arrays import Floats, Ints
from coastwatch.kernels.jit import jit

TURN = 2.0 * np.pi


class LeafStates(NamedTuple):
    """The leaves before a look, all at one time."""

    state: Floats  # (L, 4) east, north, and their rates
    covariance: Floats  # (L, 4, 4)
    mmsi: Ints  # (L,) whose reports it took, -1: nobody's


class Look(NamedTuple):
    """The plots of one look, sorted by east."""

    position: Floats  # (M, 2)
    variance: float  # of a plot, each axis
    elapsed: float  # since the leaves


class LookReports(NamedTuple):
    """AIS reports since the look before, one of an MMSI."""

    state: Floats  # (A, 4) position and velocity
    variance: Floats  # (A,) of each of the four
    age: Floats  # (A,) at the look
    mmsi: Ints  # (A,)


class GrowthRules(NamedTuple):
    """Gates and scores."""

    noise: float  # factor of the process noise
    gate: float  # squared distance of a plot
    report_gate: float  # squared distance of a report
    miss: float  # score of a look without a plot
    plot: float  # of a plot, beside its distance and the determinant of its innovation
    report: float  # the same of a report
    scored: bool  # reports have a score; false: they score zero
    at_look: bool  # reports are gated at the time of the look; false: at their own
    gates_known: bool  # a report of the MMSI of a leaf is gated; false: it is taken wherever it is


class Children(NamedTuple):
    """The leaves after a look, by parent."""

    parent: Ints  # (C,)
    plot: Ints  # (C,) row of the look, -1: none
    report: Ints  # (C,) row of the reports, -1: none
    score: Floats  # (C,) of this look
    state: Floats  # (C, 4)
    covariance: Floats  # (C, 4, 4)


@jit
def process_noise(elapsed, factor):  # type: ignore[no-untyped-def]
    """The process noise of a time, as the program of the thesis has it. (4, 4)"""
    out = np.zeros((4, 4))
    for k in range(2):
        out[k, k], out[k + 2, k + 2] = factor * elapsed**4 / 4.0, factor * elapsed**2
        out[k, k + 2] = out[k + 2, k] = factor * elapsed**3 / 3.0
    return out


@jit
def predict(state, covariance, elapsed, factor):  # type: ignore[no-untyped-def]
    """State and covariance after a time at constant velocity, (4.9)."""
    moved, spread = state.copy(), covariance + process_noise(elapsed, factor)
    for i in range(2):
        moved[i] += elapsed * state[i + 2]
        for j in range(2):
            both, rates = covariance[i, j + 2], covariance[i + 2, j + 2]
            spread[i, j] += elapsed * (both + covariance[i + 2, j]) + elapsed * elapsed * rates
            spread[i, j + 2] += elapsed * rates
            spread[i + 2, j] += elapsed * rates
    return moved, spread


@jit
def take_plot(state, covariance, gap, inverse):  # type: ignore[no-untyped-def]
    """State and covariance after a plot, (4.14). Args: gap: (2,) to the plot; inverse: of the innovation (2, 2)."""
    after, spread = state.copy(), covariance.copy()
    for i in range(4):
        first = covariance[i, 0] * inverse[0, 0] + covariance[i, 1] * inverse[1, 0]
        second = covariance[i, 0] * inverse[0, 1] + covariance[i, 1] * inverse[1, 1]
        after[i] += first * gap[0] + second * gap[1]
        for j in range(4):
            spread[i, j] -= first * covariance[0, j] + second * covariance[1, j]
    return after, spread


@jit
def innovation(covariance, variance):  # type: ignore[no-untyped-def]
    """The inverse of the innovation of a plot (2, 2), its determinant, and its larger diagonal element, (4.10)."""
    a, b, c = covariance[0, 0] + variance, covariance[0, 1], covariance[1, 1] + variance
    det = a * c - b * b
    return np.array([[c, -b], [-b, a]]) / det, det, max(a, c)


@jit
def plots_in_gate(state, covariance, look, gate):  # type: ignore[no-untyped-def]
    """Rows of the plots in the gate of a prediction and their squared distances, (4.11); inverse and determinant of the innovation."""
    inverse, det, widest = innovation(covariance, look.variance)
    reach = np.sqrt(gate * widest)
    rows, square = np.empty(0, np.int64), np.empty(0)
    low, high = np.searchsorted(look.position[:, 0], state[0] - reach), np.searchsorted(look.position[:, 0], state[0] + reach)
    if high > low:
        rows, square, count = np.empty(high - low, np.int64), np.empty(high - low), 0
        for k in range(low, high):
            x, y = look.position[k, 0] - state[0], look.position[k, 1] - state[1]
            nis = x * x * inverse[0, 0] + 2.0 * x * y * inverse[0, 1] + y * y * inverse[1, 1]
            if nis <= gate:
                rows[count], square[count] = k, nis
                count += 1
        rows, square = rows[:count], square[:count]
    return rows, square, inverse, det


@jit
def take_report(state, covariance, reports, row, look, rules, known):  # type: ignore[no-untyped-def]
    """What a report makes of a leaf, at the time of the look: whether it is taken, state, covariance, score, (4.15) to (4.19).

    Args: state, covariance: of the leaf, at the look before; known: the leaf has the MMSI of the report.
    """
    age = reports.age[row]
    value, wait = reports.state[row].copy(), look.elapsed - age
    if rules.at_look:
        value[:2] += age * value[2:]
        wait = look.elapsed
    at, spread = predict(state, covariance, wait, rules.noise)
    total, gap = spread + reports.variance[row] * np.eye(4), value - at
    if rules.gates_known or not known:
        if rules.at_look:
            two, _, _ = innovation(spread, look.variance)
            if gap[:2] @ two @ gap[:2] > rules.gate:
                return False, at, spread, 0.0
        elif (gap * gap > rules.report_gate * np.diag(total)).any():  # cheap, and of no gate that holds it
            return False, at, spread, 0.0
    inverse = np.linalg.inv(total)
    nis = gap @ inverse @ gap
    if not rules.at_look and (rules.gates_known or not known) and nis > rules.report_gate:
        return False, at, spread, 0.0
    gain = spread @ inverse
    at, spread = at + gain @ gap, spread - gain @ spread
    at, spread = predict(at, spread, look.elapsed - wait, rules.noise)
    score = 0.5 * nis + rules.report + 0.5 * np.log(np.linalg.det(total)) if rules.scored else 0.0
    return True, at, spread, score


@jit
def _room(count, parent, plot, report, score, state, covariance):  # type: ignore[no-untyped-def]
    """The columns of children with place for one more than this count."""
    size = len(parent)
    if count < size:
        return parent, plot, report, score, state, covariance
    more = np.full(size, -1)
    parent, plot, report = np.concatenate((parent, more)), np.concatenate((plot, more)), np.concatenate((report, more))
    score, state = np.concatenate((score, np.zeros(size))), np.concatenate((state, np.zeros((size, 4))))
    return parent, plot, report, score, state, np.concatenate((covariance, np.zeros((size, 4, 4))))


@jit
def grow(leaves, look, reports, rules):  # type: ignore[no-untyped-def]
    """The children of every leaf: Children. Args: leaves: LeafStates; look: Look; reports: LookReports; rules: GrowthRules."""
    size = 4 * len(leaves.state) + 16
    parent, plot, report, score = np.full(size, -1), np.full(size, -1), np.full(size, -1), np.zeros(size)
    state, covariance, count = np.zeros((size, 4)), np.zeros((size, 4, 4)), 0
    for leaf in range(len(leaves.state)):
        for a in range(-1, len(reports.age)):
            if a < 0:
                at, spread = predict(leaves.state[leaf], leaves.covariance[leaf], look.elapsed, rules.noise)
                before = 0.0
            else:
                known = leaves.mmsi[leaf] == reports.mmsi[a]
                if not known and leaves.mmsi[leaf] >= 0:
                    continue
                taken, at, spread, before = take_report(
                    leaves.state[leaf], leaves.covariance[leaf], reports, a, look, rules, known
                )
                if not taken:
                    continue
            rows, square, inverse, det = plots_in_gate(at, spread, look, rules.gate)
            for k in range(-1, len(rows)):
                if k < 0 and a >= 0 and len(rows):  # a report without a plot is a child only if no plot is in its gate
                    continue
                parent, plot, report, score, state, covariance = _room(count, parent, plot, report, score, state, covariance)
                parent[count], report[count] = leaf, a
                if k < 0:
                    plot[count], state[count], covariance[count] = -1, at, spread
                    score[count] = rules.miss if a < 0 else before
                else:
                    plot[count] = rows[k]
                    state[count], covariance[count] = take_plot(at, spread, look.position[rows[k]] - at[:2], inverse)
                    own = 0.5 * square[k] + rules.plot + 0.5 * np.log(det)
                    score[count] = own if a < 0 else 0.5 * before + 0.5 * own
                count += 1
    return Children(parent[:count], plot[:count], report[:count], score[:count], state[:count], covariance[:count])


@jit
def like_their_miss(parent, plot, report, state, limit):  # type: ignore[no-untyped-def]
    """Which children miss the look while a sibling is within a distance of them in all four numbers, metres and m/s mixed. (C,)

    Args: parent: (C,) not decreasing; plot, report: (C,) -1: none; state: (C, 4).
    """
    out, begin = np.zeros(len(parent), np.bool_), 0
    while begin < len(parent):
        end = begin
        while end < len(parent) and parent[end] == parent[begin]:
            end += 1
        for k in range(begin, end):
            if plot[k] < 0 and report[k] < 0:
                for other in range(begin, end):
                    if other != k and ((state[other] - state[k]) ** 2).sum() <= limit * limit:
                        out[k] = True
        begin = end
    return out


def plot_score(density: float, detection: float) -> float:
    """The constant part of the score of a plot, (4.12). Args: density: lambda_ex, of plots that are not of the vessel."""
    return float(np.log(density * TURN / detection))


def report_score(density: float) -> float:
    """The constant part of the score of a report, (4.19). Args: density: lambda_AIS, 1/m2, read as one of four-vectors."""
    return float(np.log(density) + 2.0 * np.log(TURN))
