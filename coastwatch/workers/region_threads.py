"""Regional centres over threads of this process."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from coastwatch.kernels.threads import over_threads
from coastwatch.stage import In, Mem, Out, RegionStep


class ThreadedRegions:
    """A RegionMap over the threads that `kernels.threads.threads` has opened. One region alone has them all for its kernels."""

    def __call__(self, step: RegionStep[Mem, In, Out], memories: Sequence[Mem], given: Sequence[In]) -> list[tuple[Mem, Out]]:
        """What step(memory, given) returns for each region."""
        return over_threads([partial(step, memory, region_input) for memory, region_input in zip(memories, given, strict=True)])

    def gather(self, memories: Sequence[Mem]) -> list[Mem]:
        """The memories as they are."""
        return list(memories)
