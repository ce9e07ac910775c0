"""Memory that arrays of a cycle leave is kept for those of the next, where the C library can be told to."""

import ctypes

M_TRIM_THRESHOLD, M_TOP_PAD, M_MMAP_THRESHOLD = -1, -2, -3  # of glibc's malloc.h
MOST, NEVER = 2**31 - 1, -1
TOP_BYTES = 1 << 26


def keep_freed_memory() -> bool:
    """From now on this process gives no memory back to the system that it will want again a cycle later. Returns: whether it can.

    glibc maps arrays above 32 MB anew each time, and the system clears each page of them once more: at 1,000,000 tracks a third of the
    processor time of a cycle. What the process holds is what it held at its peak.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None:
        return False
    return all([mallopt(M_MMAP_THRESHOLD, MOST), mallopt(M_TRIM_THRESHOLD, NEVER), mallopt(M_TOP_PAD, TOP_BYTES)])
