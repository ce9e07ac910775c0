"""How the literal tracker begins tracks: two plots of successive looks, then m plots in n looks.

Source: E. Liland, AIS aided multi hypothesis tracker, master thesis, NTNU, 2017, section 4.2. Where text and program differ, the program.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Bools, Floats, Ints
from coastwatch.kernels.tracks.thesis_growth import LookReports, process_noise
from coastwatch.stage import Count, Positive, Settings
from coastwatch.tracks.radar.multi_hypothesis_literal.forest import Preliminary

MOST_COST_M = 1e6  # of a pair; the Hungarian method takes as many pairs as it can, and of these the shortest
COPY_VARIANCE = 9.0  # of each of four numbers, in the comparison with a preliminary track that is already there

Pairing = Literal["hungarian", "shortest_first", "in_turn"]


class InitiationSettings(Settings):
    """Two plots near each other make a preliminary track; a few more confirm it."""

    pairing: Pairing = "hungarian"  # of plots: least sum of distances; shortest first; the nearest, in turn
    max_speed_m_s: Positive = 22.0  # between the first two plots
    speed_margin: Positive = 1.5  # a preliminary track faster than so many times this goes
    preliminary_gate: Positive = 9.21  # squared distance of a plot from a preliminary track
    copy_distance: Positive = 1.0  # squared distance of two plots to a preliminary track, within which they are a copy of it
    confirm_plots: Count = 2  # m: number of looks with a plot that confirm a track
    confirm_looks: Count = 4  # n: out of so many
    nearest_new_m: Positive = 25.0  # a new track nearer to a leaf of another is not begun
    start_variance: tuple[Positive, Positive, Positive, Positive] = (6.25, 6.25, 1.875, 1.875)  # of a new track, m2 and m2/s2


class Begun(NamedTuple):
    """What a look leaves of the beginnings."""

    preliminary: Preliminary
    single_m: Floats  # (Z, 2) plots that may be the first of a track
    state: Floats  # (B, 4) of the tracks that were confirmed
    covariance: Floats  # (B, 4, 4)


def paired(first: Ints, second: Ints, cost: Floats, pairing: Pairing) -> Ints:
    """Rows of the pairs that are taken, each label once on its side. (B,) Args: first, second: (A,) labels; cost: (A,), not negative."""
    if pairing == "hungarian":
        return np.flatnonzero(kernels.association.assignment.assign(first, second, MOST_COST_M - cost))
    order = np.argsort(cost, kind="stable") if pairing == "shortest_first" else np.lexsort((cost, first))
    out: list[int] = []
    left, right = set(first.tolist()), set(second.tolist())
    for row in order.tolist():
        if first[row] in left and second[row] in right:
            left.remove(first[row])
            right.remove(second[row])
            out.append(row)
    return np.array(out, np.int64)


def near_pairs(first_m: Floats, second_m: Floats, reach_m: float) -> tuple[Ints, Ints, Floats]:
    """Rows of both sides within a distance of each other, and the distance, sorted. (A,), (A,), (A,)"""
    from scipy.spatial import cKDTree

    if not len(first_m) or not len(second_m):
        none = np.zeros(0, np.int64)
        return none, none, np.zeros(0)
    found = cKDTree(first_m).sparse_distance_matrix(cKDTree(second_m), reach_m, output_type="ndarray")
    order = np.lexsort((found["j"], found["i"]))
    return found["i"][order].astype(np.int64), found["j"][order].astype(np.int64), found["v"][order]


def begin(
    settings: InitiationSettings,
    before: Preliminary,
    single_m: Floats,
    plots: tuple[Floats, float],
    reports: LookReports,
    elapsed: tuple[float, float],
) -> Begun:
    """Take the plots and reports of a look that no leaf used.

    Args: before: preliminary tracks at the look before; single_m: (Z, 2) single plots of it; plots: (M, 2), and their variance; reports:
    unused; elapsed: seconds since then, and the factor of the process noise.
    """
    plot_m, variance = plots
    move = transition(elapsed[0])
    covariance = move @ before.covariance @ move.T + process_noise(*elapsed)
    predicted = replace(before, state=before.state @ move.T, covariance=covariance)
    preliminary = _with_reports(predicted, reports, elapsed[1])
    preliminary, taken = _checked(settings, preliminary, plot_m, variance)
    speed_m_s = np.hypot(preliminary.state[:, 2], preliminary.state[:, 3])
    fast = speed_m_s > settings.speed_margin * settings.max_speed_m_s
    good = (preliminary.passed >= settings.confirm_plots) & ~fast
    kept = preliminary.take(~good & ~fast & (preliminary.checked < settings.confirm_looks))
    kept, left_m = _with_pairs(settings, kept, single_m, plot_m[~taken], elapsed[0])
    return Begun(kept, left_m, preliminary.state[good], preliminary.covariance[good])


def transition(elapsed_s: float) -> Floats:
    """States of constant velocity after a time. (4, 4)"""
    return np.eye(4) + elapsed_s * np.eye(4, k=2)


def _with_reports(tracks: Preliminary, reports: LookReports, noise: float) -> Preliminary:
    """With a preliminary track for each report whose MMSI has none, section 4.2.4."""
    new = np.flatnonzero(~np.isin(reports.mmsi, tracks.mmsi))
    if not len(new):
        return tracks
    move = np.array([transition(age) for age in reports.age[new].tolist()])
    grown = np.array([process_noise(age, noise) for age in reports.age[new].tolist()])
    zero = np.zeros(len(new), np.int64)
    more = Preliminary(
        (move @ reports.state[new][:, :, None])[:, :, 0],
        reports.variance[new][:, None, None] * (move @ np.swapaxes(move, 1, 2)) + grown,
        zero,
        zero,
        reports.mmsi[new],
    )
    return Preliminary.join([tracks, more])


def _checked(settings: InitiationSettings, tracks: Preliminary, plot_m: Floats, variance: float) -> tuple[Preliminary, Bools]:
    """The tracks after a check with the plots in their gates, and which plots they took. (M,)"""
    state, covariance, passed = tracks.state.copy(), tracks.covariance.copy(), tracks.passed.copy()
    taken = np.zeros(len(plot_m), np.bool_)
    total = covariance[:, :2, :2] + variance * np.eye(2)
    widest = float(np.linalg.eigvalsh(total).max(initial=0.0)) if len(total) else 0.0
    i, j, far_m = near_pairs(state[:, :2], plot_m, float(np.sqrt(settings.preliminary_gate * widest)))
    gap = plot_m[j] - state[i, :2]
    inside = (gap * np.linalg.solve(total[i], gap[:, :, None])[:, :, 0]).sum(axis=1) <= settings.preliminary_gate
    i, j, far_m = i[inside], j[inside], far_m[inside]
    won = paired(i, j, far_m, "hungarian")
    i, j = i[won], j[won]
    gain = covariance[i][:, :, :2] @ np.linalg.inv(total[i])
    after = state[i] + (gain @ (plot_m[j] - state[i, :2])[:, :, None])[:, :, 0]
    covariance[i] -= gain @ covariance[i][:, :2]
    state[i], taken[j] = after, True
    passed[i] += 1
    return Preliminary(state, covariance, passed, tracks.checked + 1, tracks.mmsi), taken


def _with_pairs(
    settings: InitiationSettings, tracks: Preliminary, single_m: Floats, plot_m: Floats, elapsed_s: float
) -> tuple[Preliminary, Floats]:
    """The tracks with one for each pair of a single plot and one of this look, and the plots that are single now. (Z, 2)"""
    i, j, far_m = near_pairs(single_m, plot_m, settings.max_speed_m_s * elapsed_s)
    won = paired(i, j, far_m, settings.pairing)
    i, j = (i[won], j[won]) if elapsed_s > 0.0 else (i[:0], j[:0])
    left = np.ones(len(plot_m), np.bool_)
    if not len(i):
        return tracks, plot_m
    state = np.hstack([plot_m[j], (plot_m[j] - single_m[i]) / elapsed_s])
    new = np.ones(len(state), np.bool_)
    if len(tracks):
        gap = state[:, None] - tracks.state[None]
        solved = np.linalg.solve((tracks.covariance + COPY_VARIANCE * np.eye(4))[None], gap[..., None])[..., 0]
        new = ~((gap * solved).sum(axis=2) <= settings.copy_distance).any(axis=1)
    left[j] = False
    state, zero = state[new], np.zeros(int(new.sum()), np.int64)
    covariance = np.tile(np.diag(settings.start_variance), (len(state), 1, 1))
    return Preliminary.join([tracks, Preliminary(state, covariance, zero, zero, zero - 1)]), plot_m[left]
