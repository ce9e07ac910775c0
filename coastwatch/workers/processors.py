"""How many processors this process may use."""

import os


def processors(count: int) -> int:
    """The number of processors to use. Args: count: as in the settings, 0: all that this process may use."""
    if count:
        return count
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
