"""What the levels of a radar's video look like, and their scale, told from its noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coastwatch.batches import Array

QUARTILES_DB = 6.83  # between the quartiles of noise of exponential power
CLEANED = 0.5  # share of cells of level 0: the radar sends cleaned video
SKEWNESS = 0.2  # of noise: over it levels are linear in amplitude, 0.63 there, -1.1 in decibels
NOISE_CELLS = 30  # and spokes, least, from which the scale is told
BLOCK = 32  # spokes and cells that are looked at together


class Levels(NamedTuple):
    """What the levels of a radar look like."""

    zero_share: float
    highest: int
    mean: float
    db_per_level: float | None  # 0: linear in amplitude; none: it cannot be told


def levels_of(spokes: Array) -> Levels:
    """What levels look like, and their scale, told from noise in the far half of the range. Args: spokes: (S, C) uint8, in order."""
    zero_share, far = float((spokes == 0).mean()), spokes[:, spokes.shape[1] // 2 :]
    scale = None
    if zero_share < CLEANED and min(far.shape) >= NOISE_CELLS and len(noise := _noise_of(far)):
        off = noise - noise.mean(axis=1, keepdims=True)
        skewness = float(np.median((off**3).mean(axis=1) / noise.std(axis=1) ** 3))
        between = max(float(np.median([_between_quartiles(block) for block in noise])), 0.1)
        scale = 0.0 if skewness > SKEWNESS else float(f"{QUARTILES_DB / between:.2g}")
    return Levels(zero_share, int(spokes.max(initial=0)), float(spokes.mean()) if spokes.size else 0.0, scale)


def _noise_of(far: Array) -> Array:
    """The blocks that look most like noise alone, without land and ships: low levels that vary little. (B, N)

    Of the blocks with the lower half of the means, those with the lower half of the deviations. A block without any is blanked.
    """
    rows, columns = (min(size, BLOCK) for size in far.shape)
    spokes, cells = far.shape[0] // rows, far.shape[1] // columns
    whole = far[: spokes * rows, : cells * columns].reshape(spokes, rows, cells, columns)
    blocks = whole.swapaxes(1, 2).reshape(spokes * cells, rows * columns).astype(np.float64)
    blocks = blocks[blocks.std(axis=1) > 0.0]
    low = blocks[np.argsort(blocks.mean(axis=1), kind="stable")[: (len(blocks) + 1) // 2]]
    quietest: Array = low[np.argsort(low.std(axis=1), kind="stable")[: (len(low) + 1) // 2]]
    return quietest


def _between_quartiles(block: Array) -> float:
    """How far the quartiles of whole levels are apart, as if each level were spread evenly over its step."""
    share = np.cumsum(np.bincount(block.astype(np.int64))) / len(block)
    first, third = np.interp((0.25, 0.75), np.append(0.0, share), np.arange(len(share) + 1))
    return float(third - first)
