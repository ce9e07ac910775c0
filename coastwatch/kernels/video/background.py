"""Detection over the local background: one pass a spoke, with running sums by column over the window of azimuths.

Levels are whole numbers, so sums of them are exact: a stream that is cut anywhere, with its sums made again, has the same background.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coastwatch.kernels.arrays import Array, Floats
from coastwatch.kernels.jit import jit

MASKED = 255  # among clipped levels
LEAST_CELLS = 30  # of the window without the guard; with fewer there is no background
AVERAGED = 0.2  # weight of a turn in the mean square of what is over the background: five turns
CLIPPED_SIGMAS = np.float32(3.0)  # of the turns before: what is farther off the background counts as this
AROUND = 2  # sectors and blocks to each side over which mean squares are averaged: about the window
HALF = np.float32(0.5)


class Rules(NamedTuple):
    """Sizes and limits. Sizes are to each side, levels in steps of the video."""

    window_rad: float
    guard_rad: float
    beam_rad: float  # half a beam
    window_cells: int
    guard_cells: int
    pulse_cells: int
    first_cell: int  # nothing nearer is detected
    block_cells: int  # of the coarse background
    threshold: float  # over the background, levels
    sigmas: float  # over the background, standard deviations
    clip: float  # over the background of the turn before, levels
    first_turn: float  # most that counts over an unknown deviation, levels
    db_per_level: float
    most_db: float  # of an excess


class Spokes(NamedTuple):
    """Spokes in order. R rows, C cells."""

    level: Array  # (R, C) uint8
    clipped: Array  # (R, C) uint8: MASKED, or, once it is entered, at most the background of the turn before and the clip
    angle: Floats  # (R,) rad, never falling
    released: Array  # (R,) int64: row whose arrival let this one be looked at; written


class Learnt(NamedTuple):
    """The turn before on a coarse grid of A sectors and B blocks of cells, NaN where nothing is known, and the sums of this sector."""

    background: Array  # (A, B) float32, levels
    square: Array  # (A, B) float32, levels squared
    level_sum: Array  # (C,) float32
    square_sum: Array  # (C,) float32
    cells: Array  # (C,) int32: how many are in the sums
    sector: Array  # (1,) int64: which one; -1: none yet


@jit
def detected(spokes, rules, learnt, begun, runs, excess):  # type: ignore[no-untyped-def]
    """Runs of cells over their background in every spoke behind which the window is full.

    y is the mean level over one beam and one pulse; b the mean of clipped levels over the window less the guard.
    Args: begun: first row to look at, and how many rows are entered, (2,), written; runs: (K, 3) int32 row, first cell, end, written;
    excess: (K,) float32 dB over b of the cells of the runs, one after the other, written.
    Returns: how many runs; the first row that may be needed again.
    """
    level, clipped, angle, released = spokes
    count, cells = level.shape
    row, found, over = begun[0], 0, 0
    if row >= count:
        return found, max(count - 1, 0)
    sums = np.zeros((5, cells), np.int32)  # levels and cells of the window, of the guard, and levels of the beam
    pads = max(rules.window_cells, rules.guard_cells, rules.pulse_cells) + 1
    prefix, limits = np.zeros((5, cells + 2 * pads), np.int32), np.empty((2, cells), np.float32)
    y, b = np.empty(cells, np.float32), np.empty(cells, np.float32)
    sizes = np.array([rules.window_rad, rules.guard_rad, rules.beam_rad])
    rows = np.empty((3, 2), np.int64)  # first row of each, and end; their sums are made again, exactly
    for k in range(3):
        rows[k] = np.searchsorted(angle, angle[row] - sizes[k])
    if learnt.sector[0] >= 0:
        _limits(learnt, rules, limits)
    while row < count:
        _enter(spokes, rules, learnt, begun, angle[row] + sizes[0])
        _slide(clipped, angle, (angle[row] - sizes[0], angle[row] + sizes[0]), rows[0], sums[0], sums[1])
        if rows[0, 1] == count:
            break
        _slide(clipped, angle, (angle[row] - sizes[1], angle[row] + sizes[1]), rows[1], sums[2], sums[3])
        _slide_beam(level, angle, (angle[row] - sizes[2], angle[row] + sizes[2]), rows[2], sums[4])
        sector = _sector(angle[row], learnt)
        if sector != learnt.sector[0]:
            _finish_sector(learnt, rules)
            learnt.sector[0] = sector
            _limits(learnt, rules, limits)
        for k in range(5):
            _prefix(sums[k], prefix[k], pads)
        _compare(prefix, pads, rows[2, 1] - rows[2, 0], rules, y, b)
        _learn(clipped[row], y, b, limits, learnt)
        found, over = _runs_of(row, level[row], clipped[row], (y, b, limits[0]), rules, (runs, excess), (found, over))
        released[row] = rows[0, 1]
        row += 1
    begun[0] = row
    return found, max(min(rows[0, 0], row - 1), 0)


@jit
def _enter(spokes, rules, learnt, begun, until):  # type: ignore[no-untyped-def]
    """Write the clipped levels of the spokes that come into the window. Args: begun: as of `detected`; until: rad."""
    while begun[1] < len(spokes.angle) and spokes.angle[begun[1]] <= until:
        background = learnt.background[_sector(spokes.angle[begun[1]], learnt)]
        _clip(spokes.level[begun[1]], spokes.clipped[begun[1]], background, rules)
        begun[1] += 1


@jit
def _slide(clipped, angle, span, rows, sums, count):  # type: ignore[no-untyped-def]
    """Move a window on. Args: span: from and to, rad; rows: its first row and end, written; sums, count: (C,), written."""
    while rows[1] < len(angle) and angle[rows[1]] <= span[1]:
        _add(clipped[rows[1]], sums, count)
        rows[1] += 1
    while angle[rows[0]] < span[0]:
        _remove(clipped[rows[0]], sums, count)
        rows[0] += 1


@jit
def _slide_beam(level, angle, span, rows, sums):  # type: ignore[no-untyped-def]
    """As `_slide`, of levels as they are."""
    while rows[1] < len(angle) and angle[rows[1]] <= span[1]:
        for c in range(len(sums)):
            sums[c] += level[rows[1], c]
        rows[1] += 1
    while angle[rows[0]] < span[0]:
        for c in range(len(sums)):
            sums[c] -= level[rows[0], c]
        rows[0] += 1


@jit
def _sector(angle, learnt):  # type: ignore[no-untyped-def]
    sectors = len(learnt.background)
    return min(int((angle % (2.0 * np.pi)) / (2.0 * np.pi) * sectors), sectors - 1)


@jit
def _add(clipped, sums, count):  # type: ignore[no-untyped-def]
    for c in range(len(clipped)):
        counts = np.int32(clipped[c] != MASKED)
        sums[c] += np.int32(clipped[c]) * counts
        count[c] += counts


@jit
def _remove(clipped, sums, count):  # type: ignore[no-untyped-def]
    for c in range(len(clipped)):
        counts = np.int32(clipped[c] != MASKED)
        sums[c] -= np.int32(clipped[c]) * counts
        count[c] -= counts


@jit
def _clip(level, clipped, background, rules):  # type: ignore[no-untyped-def]
    """Write the clipped levels of a spoke. Where nothing is known of the turn before, the median of five blocks stands for it."""
    for block in range(len(background)):
        first, end = block * rules.block_cells, min((block + 1) * rules.block_cells, len(level))
        known = background[block]
        if np.isnan(known):
            known = _median(level, clipped, max(first - AROUND * rules.block_cells, 0), end + AROUND * rules.block_cells)
        most = np.uint8(min(known + np.float32(rules.clip) + HALF, np.float32(MASKED - 1)))
        for c in range(first, end):
            if clipped[c] != MASKED:
                clipped[c] = min(level[c], most)


@jit
def _median(level, clipped, first, end):  # type: ignore[no-untyped-def]
    """The median of the levels of some cells that are not masked; 0 of none."""
    counts, total = np.zeros(256, np.int32), 0
    for c in range(first, min(end, len(level))):
        if clipped[c] != MASKED:
            counts[level[c]] += 1
            total += 1
    below, value = 0, 0
    while 2 * (below + counts[value]) < total:
        below += counts[value]
        value += 1
    return np.float32(value)


@jit
def _prefix(sums, prefix, pads):  # type: ignore[no-untyped-def]
    """Write sums of the cells before each one; so many more at both ends stand for no cells."""
    out, total = prefix[pads:], np.int32(0)
    for c in range(len(sums)):
        out[c] = total
        total += sums[c]
    out[len(sums) :] = total


@jit
def _compare(prefix, pads, beams, rules, y, b):  # type: ignore[no-untyped-def]
    """Write the mean level around each cell, and its background, NaN where there is none. Args: beams: spokes within the beam."""
    cells, wide, near, pulse = len(y), rules.window_cells, rules.guard_cells, rules.pulse_cells
    # Slices, because a loop over an index that may be negative does not become vector instructions.
    window_to, window_from = prefix[0, pads + wide + 1 :], prefix[0, pads - wide :]
    inside_to, inside_from = prefix[1, pads + wide + 1 :], prefix[1, pads - wide :]
    guard_to, guard_from = prefix[2, pads + near + 1 :], prefix[2, pads - near :]
    within_to, within_from = prefix[3, pads + near + 1 :], prefix[3, pads - near :]
    beam_to, beam_from = prefix[4, pads + pulse + 1 :], prefix[4, pads - pulse :]
    for c in range(cells):
        total = (window_to[c] - window_from[c]) - (guard_to[c] - guard_from[c])
        count = (inside_to[c] - inside_from[c]) - (within_to[c] - within_from[c])
        mean = np.float32(total) / np.float32(count)
        b[c] = mean if count >= LEAST_CELLS else np.float32(np.nan)
        looked = min(c + pulse + 1, cells) - max(c - pulse, 0)
        y[c] = np.float32(beam_to[c] - beam_from[c]) / np.float32(beams * looked)


@jit
def _learn(clipped, y, b, limits, learnt):  # type: ignore[no-untyped-def]
    """Add a spoke to the sums of its sector. What is detected counts as one deviation: else a large ship would hide parts of itself.

    Args: limits: (2, C) over the background: what is detected, and what counts at most.
    """
    level_sum, square_sum, count, most = learnt.level_sum, learnt.square_sum, learnt.cells, limits[1]
    for c in range(len(y)):
        counts = (clipped[c] != MASKED) & (b[c] == b[c])
        off = min(max(y[c] - b[c], -most[c]), most[c])
        off = most[c] / CLIPPED_SIGMAS if y[c] - b[c] > limits[0, c] else off
        level_sum[c] += b[c] if counts else np.float32(0.0)
        square_sum[c] += off * off if counts else np.float32(0.0)
        count[c] += np.int32(counts)


@jit
def _finish_sector(learnt, rules):  # type: ignore[no-untyped-def]
    """Write the background and the mean square of the sector whose sums are complete, and begin them again."""
    sector, cells = learnt.sector[0], len(learnt.cells)
    if sector < 0:
        return
    for block in range(learnt.background.shape[1]):
        level, square, count = 0.0, 0.0, 0
        for c in range(block * rules.block_cells, min((block + 1) * rules.block_cells, cells)):
            level += learnt.level_sum[c]
            square += learnt.square_sum[c]
            count += learnt.cells[c]
        if count:
            before = learnt.square[sector, block]
            mean = np.float32(square / count)
            learnt.background[sector, block] = np.float32(level / count)
            learnt.square[sector, block] = mean if np.isnan(before) else before + np.float32(AVERAGED) * (mean - before)
    learnt.level_sum[:], learnt.square_sum[:], learnt.cells[:] = 0.0, 0.0, 0


@jit
def _limits(learnt, rules, limits):  # type: ignore[no-untyped-def]
    """Write how much over the background is detected, and how much counts for the deviation, in each cell. (2, C)

    The deviation is averaged over the sectors and blocks around: in the first turn over those behind the beam.
    """
    sectors, blocks = learnt.square.shape
    for block in range(blocks):
        total, count = 0.0, 0
        for s in range(learnt.sector[0] - AROUND, learnt.sector[0] + AROUND + 1):
            for k in range(max(block - AROUND, 0), min(block + AROUND + 1, blocks)):
                square = learnt.square[s % sectors, k]
                if square == square:
                    total += square
                    count += 1
        deviation = np.float32(np.sqrt(total / count)) if count else np.float32(0.0)
        first, end = block * rules.block_cells, min((block + 1) * rules.block_cells, limits.shape[1])
        limits[0, first:end] = max(np.float32(rules.threshold), np.float32(rules.sigmas) * deviation)
        limits[1, first:end] = CLIPPED_SIGMAS * deviation if count else np.float32(rules.first_turn)


@jit
def _runs_of(row, level, clipped, levels, rules, out, done):  # type: ignore[no-untyped-def]
    """Write the runs of a spoke behind those before. Args: levels: y, b, limit; out: runs, excess; done: how many of each are written."""
    y, b, limit = levels
    runs, excess = out
    found, over = done
    start = -1
    for c in range(rules.first_cell, len(level) + 1):
        on = c < len(level) and clipped[c] != MASKED and y[c] - b[c] > limit[c]
        if on:
            if start < 0:
                start = c
            db = (np.float32(level[c]) - b[c]) * np.float32(rules.db_per_level)
            excess[over] = min(max(db, np.float32(0.0)), np.float32(rules.most_db))
            over += 1
        elif start >= 0:
            runs[found, 0], runs[found, 1], runs[found, 2] = row, start, c
            found += 1
            start = -1
    return found, over


@jit
def over_level(spokes, rules, learnt, begun, runs, excess):  # type: ignore[no-untyped-def]
    """As `detected`, of cells whose own level is over `rules.threshold`, as soon as they come."""
    level, clipped, angle, released = spokes
    count, cells = level.shape
    least, none = np.full(cells, np.float32(rules.threshold)), np.zeros(cells, np.float32)
    found, over = 0, 0
    for row in range(begun[0], count):
        own = level[row].astype(np.float32)
        found, over = _runs_of(row, level[row], clipped[row], (own, least, none), rules, (runs, excess), (found, over))
        released[row] = row
    begun[0] = begun[1] = count
    return found, max(min(np.searchsorted(angle, angle[-1] - rules.window_rad), count - 1), 0) if count else 0
