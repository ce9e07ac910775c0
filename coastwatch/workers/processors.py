"""How many processors this process may use."""

import os


def processors(count: int) -> int:
    """How many processors are used where so many are asked for: 0 means all that this process may use."""
    if count:
        return count
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
