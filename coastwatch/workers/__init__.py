"""Work over processors and machines: per-spot work, and whole regional centres."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import NamedTuple

from coastwatch.kernels.threads import over_threads, threads
from coastwatch.stage import In, Map, Mem, Out, RegionMap, RegionStep, serial
from coastwatch.workers.malloc import keep_freed_memory
from coastwatch.workers.processors import processors as processors


class ThreadedRegions:
    """A RegionMap over the threads that `kernels.threads.threads` has opened. One region alone has them all for its kernels."""

    def __call__(self, step: RegionStep[Mem, In, Out], memories: Sequence[Mem], given: Sequence[In]) -> list[tuple[Mem, Out]]:
        """What step(memory, given) returns for each region."""
        return over_threads([partial(step, memory, region_input) for memory, region_input in zip(memories, given, strict=True)])

    def gather(self, memories: Sequence[Mem]) -> list[Mem]:
        """The memories as they are."""
        return list(memories)


class Workers(NamedTuple):
    """The maps of per-spot work and of regional centres, and how many processes or actors were lost and replaced so far."""

    spots: Map
    regions: RegionMap
    lost: Callable[[], int] = lambda: 0


@contextmanager
def open_workers(method: str, count: int) -> Iterator[Workers]:
    """The workers of a method, over so many processors (0: all). Kernels in this process also run over threads.

    Args: method: auto or threads; processes, of this machine; ray, for regional centres on other machines. Pairs, ids and flags are
    the same for all.
    """
    keep_freed_memory()
    if method == "ray":
        from coastwatch.workers.ray import Actors
        from coastwatch.workers.remote_regions import RemoteRegions

        with threads(processors(0)), Actors(count) as actors:
            remote = RemoteRegions(actors)
            yield Workers(serial, remote, lambda: remote.lost)
        return
    count = processors(count)
    with threads(count):
        if method != "processes" or count == 1:
            yield Workers(serial, ThreadedRegions())
            return
        from coastwatch.workers.processes import Processes
        from coastwatch.workers.region_processes import ProcessHosts
        from coastwatch.workers.remote_regions import RemoteRegions

        with Processes(count) as pool, ProcessHosts(count) as hosts:
            regions = RemoteRegions(hosts)
            yield Workers(pool, regions, lambda: pool.lost + regions.lost)
