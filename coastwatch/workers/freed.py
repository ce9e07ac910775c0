"""Memory that arrays of a cycle leave is kept for those of the next, where the C library can be told to."""

import ctypes

M_TRIM_THRESHOLD, M_TOP_PAD, M_MMAP_THRESHOLD, M_ARENA_MAX = -1, -2, -3, -8  # of glibc's malloc.h
MOST, NEVER, ONE = 2**31 - 1, -1, 1
TOP_BYTES = 1 << 26


def keep_freed_memory() -> bool:
    """From now on this process gives no memory back to the system that it will want again a cycle later. Returns: whether it can.

    glibc maps arrays above 32 MB anew each time, and the system clears each page of them once more: at 1,000,000 tracks a third of the
    processor time of a cycle. What the process holds is what it held at its peak. All threads take from one arena, or what the thread that
    writes a cycle leaves would not serve that which computes the next; and the arenas of threads end at 64 MB, what is larger is mapped.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None:
        return False
    wanted = {M_MMAP_THRESHOLD: MOST, M_TRIM_THRESHOLD: NEVER, M_TOP_PAD: TOP_BYTES, M_ARENA_MAX: ONE}
    return all(mallopt(option, value) for option, value in wanted.items())
