"""Echoes in radar video as plainly as possible: windows summed cell by cell, components and moments of scipy.ndimage."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import ndimage

TURN = 2.0 * np.pi
SECTORS = 128


def unwrapped(azimuth):
    """Angles that never fall, of azimuths that step back by less than 10 deg."""
    out = [azimuth[0]]
    for a in azimuth[1:]:
        forward = (a - out[-1]) % TURN
        out.append(out[-1] + (0.0 if forward > TURN - np.radians(10.0) else forward))
    return np.array(out)


def windows(values, counts, rows, half):
    """Sums of values that count, over rows and so many cells to each side of each cell; and how many count."""
    cells = values.shape[1]
    near = np.abs(np.arange(cells)[:, None] - np.arange(cells)) <= half
    return near @ np.where(counts[rows], values[rows], 0).sum(axis=0, dtype=np.int64), near @ counts[rows].sum(axis=0)


def excesses(level, masked, azimuth, rules):
    """Which cells are over their background, and by how many dB; and which spokes could be looked at. Args: rules: of the kernel."""
    spokes, cells = level.shape
    angle = unwrapped(azimuth)
    blocks = -(-cells // rules.block_cells)
    background = np.full((SECTORS, blocks), np.nan, np.float32)
    square = np.full((SECTORS, blocks), np.nan, np.float32)
    sector_of = np.minimum((angle % TURN / TURN * SECTORS).astype(int), SECTORS - 1)
    clipped, entered = np.zeros((spokes, cells), np.uint8), 0
    block_of = np.arange(cells) // rules.block_cells
    sums: dict[str, Any] = {"sector": -1, "b": [], "d": []}
    on, db, looked = np.zeros(level.shape, bool), np.zeros(level.shape, np.float32), 0
    limit = most = np.zeros(cells, np.float32)
    for s in range(spokes):
        while entered < spokes and angle[entered] <= angle[s] + rules.window_rad:
            clip = background[sector_of[entered]].copy()
            for k in np.flatnonzero(np.isnan(clip)):
                near = slice(
                    max((k - 2) * rules.block_cells, 0), min(k + 1, blocks) * rules.block_cells + 2 * rules.block_cells
                )
                if k == blocks - 1:
                    near = slice(near.start, cells)
                some = np.sort(level[entered, near][~masked[entered, near]])
                clip[k] = some[(len(some) + 1) // 2 - 1] if len(some) else 0.0
            top = np.minimum(clip + np.float32(rules.clip) + np.float32(0.5), np.float32(254)).astype(np.uint8)
            clipped[entered] = np.minimum(level[entered], top[block_of])
            entered += 1
        if entered == spokes:
            break
        if sector_of[s] != sums["sector"]:
            if sums["b"]:
                k = sums["sector"]
                b_sum = np.zeros(cells, np.float32)
                d_sum, n = np.zeros(cells, np.float32), np.zeros(cells, int)
                for b, d in zip(sums["b"], sums["d"], strict=True):
                    good = np.isfinite(b)
                    b_sum[good] += b[good]
                    d_sum[good] += (d * d)[good]
                    n += good
                for block in range(blocks):
                    here = block_of == block
                    if n[here].sum():
                        mean = np.float32(d_sum[here].astype(float).sum() / n[here].sum())
                        background[k, block] = np.float32(b_sum[here].astype(float).sum() / n[here].sum())
                        old = square[k, block]
                        square[k, block] = mean if np.isnan(old) else old + np.float32(0.2) * (mean - old)
            sums = {"sector": sector_of[s], "b": [], "d": []}
            limit, most = np.empty(cells, np.float32), np.empty(cells, np.float32)
            for block in range(blocks):
                around = square[np.arange(sector_of[s] - 2, sector_of[s] + 3) % SECTORS, max(block - 2, 0) : block + 3]
                known = around[np.isfinite(around)].astype(float)
                deviation = np.float32(np.sqrt(known.sum() / len(known))) if len(known) else np.float32(0.0)
                limit[block_of == block] = max(np.float32(rules.threshold), np.float32(rules.sigmas) * deviation)
                most[block_of == block] = np.float32(3.0) * deviation if len(known) else np.float32(rules.first_turn)
        rows = [
            np.flatnonzero(np.abs(angle - angle[s]) <= half) for half in (rules.window_rad, rules.guard_rad, rules.beam_rad)
        ]
        wide, wide_n = windows(clipped, ~masked, rows[0], rules.window_cells)
        near, near_n = windows(clipped, ~masked, rows[1], rules.guard_cells)
        beam, beam_n = windows(level, np.ones_like(masked), rows[2], rules.pulse_cells)
        count = wide_n - near_n
        b = np.where(
            count >= 30, (wide - near).astype(np.float32) / np.maximum(count, 1).astype(np.float32), np.float32(np.nan)
        )
        y = beam.astype(np.float32) / beam_n.astype(np.float32)
        good = np.isfinite(b) & ~masked[s]
        on[s] = good & (y - np.where(good, b, 0.0) > limit) & (np.arange(cells) >= rules.first_cell)
        excess = (level[s].astype(np.float32) - np.where(good, b, 0.0)) * np.float32(rules.db_per_level)
        db[s] = np.clip(excess, 0.0, rules.most_db)
        sums["b"].append(np.where(good, b, np.nan).astype(np.float32))
        off = np.where(good, y - b, 0.0).astype(np.float32)
        sums["d"].append(np.where(off > limit, most / np.float32(3.0), np.clip(off, -most, most)))
        looked = s + 1
    return on, db, looked


def over_level(level, masked, rules):
    """As `excesses`, of cells whose own level is over one that is set: every spoke can be looked at as soon as it comes.

    The level that is set stands for the background.
    """
    on = ~masked & (level > rules.threshold) & (np.arange(level.shape[1]) >= rules.first_cell)
    db = np.clip((level - np.float32(rules.threshold)) * np.float32(rules.db_per_level), 0.0, rules.most_db)
    return on, db, len(level)


def echoes(on, db, azimuth, gap_rad):
    """Moments of each component: cells, weight, mean cell and angle, variances and covariance, and its last spoke. Unsorted rows."""
    angle = unwrapped(azimuth)
    place = angle + (azimuth - angle + np.pi) % TURN - np.pi
    row_of = np.arange(len(on)) + np.cumsum(np.append(0, np.diff(angle) > gap_rad))  # an empty row for each gap
    wide = np.zeros((row_of[-1] + 1, on.shape[1]), bool)
    wide[row_of] = on
    label, count = ndimage.label(wide, np.ones((3, 3)))
    label, index = label[row_of], np.arange(1, count + 1)
    if not count:
        return np.zeros((0, 8))
    weight = np.where(on, 10.0 ** (db.astype(float) / 20.0), 0.0)
    cell, turned = np.broadcast_to(np.arange(on.shape[1]), on.shape), np.broadcast_to(place[:, None], on.shape)

    def total(values):
        return ndimage.sum_labels(values, label, index)

    w = total(weight)
    c, a = total(weight * cell) / w, total(weight * turned) / w
    off_c, off_a = np.append(0.0, c)[label], np.append(0.0, a)[label]
    moments = [total(weight * x * y) / w for x, y in ((cell - off_c, cell - off_c), (turned - off_a, turned - off_a))]
    both = total(weight * (cell - off_c) * (turned - off_a)) / w
    last = ndimage.maximum(np.broadcast_to(np.arange(len(on))[:, None], on.shape), label, index)
    return np.column_stack([total(on.astype(float)), w, c, a, *moments, both, last])
