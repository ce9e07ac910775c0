"""Where stations hear and radars see: places are looked up in cells, of which most are wholly in range or out of it."""

from __future__ import annotations

import mmap
from functools import lru_cache

import numpy as np

from coastwatch import kernels
from coastwatch.batches import Array, Bools, Floats
from coastwatch.kernels.threads import in_blocks

Cover = tuple[Floats, Array, Array]
"""Sites, cells and entries as `coastwatch.kernels.geometry.cover` has them."""


def cover(site_deg: Floats, range_m: Floats) -> Cover:
    """What is within range of any of the sites. Args: (R, 2), (R,). The cells of the last few sets of sites are kept."""
    return _cover(np.ascontiguousarray(site_deg, np.float64).tobytes(), np.ascontiguousarray(range_m, np.float64).tobytes())


def covered(place: Cover, position_deg: Floats) -> Bools:
    """Whether places are in range. Args: position_deg: (V, 2). Returns: (V,)."""

    out = np.empty(len(position_deg), np.bool_)
    in_blocks(kernels.geometry.cover.all_in_range, len(out), position_deg, *place, out)
    return out


@lru_cache(maxsize=8)
def _cover(sites: bytes, ranges: bytes) -> Cover:

    site, reach = np.frombuffer(sites).reshape(-1, 2), np.frombuffer(ranges)
    frame, room = np.empty((len(site), 9)), 256 * (len(site) + 1)
    kernels.geometry.cover.framed(site, reach, frame)
    while True:
        head, entry = _zeros(kernels.geometry.cover.ROWS * kernels.geometry.cover.COLUMNS), np.empty((room, 2), np.int32)
        count = kernels.geometry.cover.cells(site, reach, frame, head, entry)
        if count < room:
            return frame, head, entry[: count + 1].copy()
        room = count + 1


def _zeros(count: int) -> Array:
    """Zeros that take memory only near where something else is written: most cells are far from any site. Returns: (count,) int32.

    np.zeros is given memory that others have left (`workers.freed`), and clears all of it.
    """
    bytes_ = mmap.mmap(-1, 4 * count, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    return np.frombuffer(bytes_, np.int32)
