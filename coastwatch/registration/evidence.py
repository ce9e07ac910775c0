"""Acquisition, second part: the evidence for each bias, added up over reference cells.

Each reference cell has a likelihood ratio for each bias: that its vessel is seen there, against the background of plots around it.
Divided by its mean over the biases nearby it is an e-value. It is 1 on average if the plots near a vessel could as well be turned or
shifted a little, however quays and lanes lie. Products and means of e-values are e-values, and one exceeds 1 / a by chance with a
probability of at most a.

Source: V. Vovk, R. Wang, E-values: calibration, combination and applications, Annals of Statistics 49, 2021. The vote of differences is
after P. V. C. Hough's transform, US patent 3069654.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from coastwatch.batches import Bools, Floats, Ints
from coastwatch.registration.reference_cells import AROUND, Grid, ReferenceCells

Singles = NDArray[np.float32]

DETECTION = (0.1, 0.3, 0.7)  # probability of detection of a vessel that is seen: tried values, of equal weight
SEEN_SHARE = (0.05, 0.15, 0.4, 0.8)  # of the reference cells that are seen at all: tried values, of equal weight
IN_BELL = 0.6  # share of true echoes that the bell counts
BACKGROUND = 0.05  # hits, added to the mean around a bin
LARGEST_LOG = 20.0  # of a likelihood ratio
MOST_UNDER_WAY, MOST_AT_REST = np.log(1000.0), np.log(100.0)  # log evidence of one group, at most
SPEAKS = np.log(2.0)  # log evidence with which a group counts for a bias
WINDOW_M = 100.0  # half width of a window of bins that are one bias, in range
WINDOW_SIGMAS, WINDOW_BINS = 3.0, 2.0  # the same in azimuth: of the azimuth noise, and at least so many bins
APART_SIGMAS = 2.0  # the same between two biases that cannot be one
BELL_SIGMAS, BELL_M = 1.1, 25.0  # standard deviations of the bell
BLOCK = 128  # reference cells at a time: they stay in the processor's cache


class Field(NamedTuple):
    """Evidence for each bias that is searched. Bins in range come first, then bins in azimuth."""

    log_evidence: Floats  # (D, S)
    by_group: Singles  # (V, D, S) of each group, at the share of seen reference cells that fits best
    range_m: Floats  # (D,)
    azimuth_rad: Floats  # (S,)


class Decision(NamedTuple):
    """The best bias and the best other one."""

    azimuth_rad: float
    range_m: float
    log_odds: float  # of the best bias against chance, averaged over all that are searched
    groups: int  # that speak for it
    share: float  # of the evidence of all biases that is in its window
    rival_share: float  # of the same in the best window beside it
    log_evidence: float  # of its bin


def evidence(reference_cells: ReferenceCells, azimuth_sigma_rad: float, grid: Grid) -> Field:
    """The evidence for each bias. Args: reference_cells: counted, sorted by group."""
    azimuth = grid.azimuth_rad
    searched = (np.abs(azimuth) <= grid.search_rad + 1e-9).nonzero()[0]
    heard = np.unique(reference_cells.counts.reference_cell).astype(np.int64)  # without a plot the evidence is 1 everywhere
    group, first = np.unique(reference_cells.group[heard], return_index=True)
    number = np.repeat(np.arange(len(group)), np.diff(np.append(first, len(heard))))
    by_group = np.zeros((len(SEEN_SHARE), len(group), len(grid.range_m), len(searched)), np.float32)
    across = _bell(azimuth, float(np.hypot(BELL_SIGMAS * azimuth_sigma_rad, 0.5 * grid.step_rad)))
    near = np.abs(azimuth[:, None] - azimuth) <= AROUND + 1e-9
    along, around = (
        _bell(grid.range_m, BELL_M),
        (near / near.sum(axis=0)).astype(np.float32),
    )  # of the mean over the bins around each
    # Vessels in one cell see the same background, so they count as their geometric mean: it is under the mean, which is an e-value
    # however they depend on each other. A lane that is turned onto another lane so counts no more than one vessel a cell.
    _, cell, vessels = np.unique(reference_cells.cell[heard] // 2, return_inverse=True, return_counts=True)
    weight = (1.0 / vessels[cell]).astype(np.float32)[:, None, None]
    for low in range(0, len(heard), BLOCK):
        rows = heard[low : low + BLOCK]
        e = _e_values(reference_cells.histograms(rows, grid), reference_cells.looks[rows], along, across, around, searched)
        group_of_row = number[low : low + BLOCK]
        starts = np.flatnonzero(np.diff(group_of_row, prepend=-1))
        for k, seen_share in enumerate(SEEN_SHARE):
            logs = weight[low : low + BLOCK] * np.log(np.float32(1.0 - seen_share) + np.float32(seen_share) * e)
            by_group[k, group_of_row[starts]] += np.add.reduceat(logs, starts, axis=0)
    most: Any = np.where(group >= 0, np.float32(MOST_UNDER_WAY), np.float32(MOST_AT_REST))
    by_group = np.minimum(by_group, most[:, None, None])
    total = by_group.sum(axis=1, dtype=np.float64)
    best = int(total.reshape(len(SEEN_SHARE), -1).max(axis=1).argmax())
    top = total.max(axis=0)
    log_evidence = top + np.log(np.exp(total - top).mean(axis=0))
    return Field(log_evidence, by_group[best], grid.range_m, azimuth[searched])


def _e_values(histogram: Singles, looks: Floats, along: Singles, across: Singles, around: Singles, searched: Ints) -> Singles:
    """The e-value of each reference cell for each bias that is searched. (N, D, S)"""
    n, rows, columns = histogram.shape
    looked = looks.astype(np.float32)[:, None, None]
    count = np.matmul(along, (histogram.reshape(-1, columns) @ across).reshape(n, rows, columns))
    count = np.minimum(count, looked)
    background = (count.mean(axis=1) @ around)[:, None, :] + np.float32(BACKGROUND)
    ratio: Any = np.zeros_like(count)
    for detection in DETECTION:
        mean = np.float32(IN_BELL * detection) * looked
        ratio += np.exp(np.clip(count * np.log1p(mean / background) - mean, -LARGEST_LOG, LARGEST_LOG))
    e_value: Singles = ratio[:, :, searched] / (ratio.mean(axis=1) @ around)[:, None, searched]
    return e_value


def _bell(at: Floats, sigma: float) -> Singles:
    """Weight with which a hit in one bin counts in another. (A, A)"""
    weight: Singles = np.exp(-0.5 * ((at[:, None] - at) / sigma) ** 2).astype(np.float32)
    return weight


def decide(field: Field, azimuth_sigma_rad: float) -> Decision:
    """The best bias: the mean of its window by evidence, with the odds that it is not chance."""
    logs = field.log_evidence
    best = np.unravel_index(int(logs.argmax()), logs.shape)
    weight = np.exp(logs - logs[best])
    here = _window(field, best, azimuth_sigma_rad)
    inside, total = float(weight[here].sum()), float(weight.sum())
    other = np.where(here, 0.0, weight)
    rival = _window(field, np.unravel_index(int(other.argmax()), logs.shape), azimuth_sigma_rad)
    mean = weight * here / inside
    return Decision(
        azimuth_rad=float(mean.sum(axis=0) @ field.azimuth_rad),
        range_m=float(mean.sum(axis=1) @ field.range_m),
        log_odds=float(logs[best] + np.log(inside / logs.size)),
        groups=int((field.by_group[:, best[0], best[1]] > SPEAKS).sum()),
        share=inside / total,
        rival_share=float(other[rival].sum()) / total,
        log_evidence=float(logs[best]),
    )


def log_evidence_at(field: Field, azimuth_rad: float) -> float:
    """The log evidence of the best range for an azimuth bias, of the nearest bin."""
    return float(field.log_evidence[:, np.abs(field.azimuth_rad - azimuth_rad).argmin()].max())


def is_apart(azimuth_rad: float, other_rad: float, azimuth_sigma_rad: float, step_rad: float) -> bool:
    """Whether two azimuth biases cannot be the same one."""
    return abs(azimuth_rad - other_rad) > max(APART_SIGMAS * azimuth_sigma_rad, WINDOW_BINS * step_rad)


def _window(field: Field, at: tuple[Any, ...], azimuth_sigma_rad: float) -> Bools:
    """The bins that are the same bias as this one. (D, S)"""
    step = float(field.azimuth_rad[1] - field.azimuth_rad[0])
    half = max(WINDOW_SIGMAS * azimuth_sigma_rad, WINDOW_BINS * step)
    close = np.abs(field.azimuth_rad - field.azimuth_rad[at[1]]) <= half + 1e-9
    is_same: Bools = (np.abs(field.range_m - field.range_m[at[0]]) <= WINDOW_M)[:, None] & close
    return is_same
