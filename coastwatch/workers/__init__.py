"""Work over processors: per-spot work over threads or processes, whole regional centres over machines."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from coastwatch.kernels.threads import threads
from coastwatch.stage import Map, RegionMap, serial, serial_regions
from coastwatch.workers.malloc import keep_freed_memory
from coastwatch.workers.processors import processors

__all__ = ["Workers", "open_workers", "processors"]


class Workers(NamedTuple):
    """The maps of per-spot work and of regional centres."""

    spots: Map = serial
    regions: RegionMap = serial_regions


@contextmanager
def open_workers(method: str, count: int) -> Iterator[Workers]:
    """The workers of a method, over so many processors (0: all). Kernels in this process also run over threads.

    Args: method: auto or threads; processes, for the spots; ray, for the regions. Pairs, ids and flags are the same for all.
    """
    keep_freed_memory()
    if method == "ray":
        from coastwatch.workers.ray import Actors

        with threads(processors(0)), Actors(count) as actors:
            yield Workers(regions=actors)
        return
    count = processors(count)
    with threads(count):
        if method != "processes" or count == 1:
            yield Workers()
            return
        from coastwatch.workers.processes import Processes

        with Processes(count) as pool:
            yield Workers(spots=pool)
