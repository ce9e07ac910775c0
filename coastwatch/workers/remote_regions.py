"""Regional centres on hosts (other processes, of this machine or others): who has which, and what is needed if a host is lost.

A host keeps the memory of its regions. Each cycle it is sent what a region is given, and returns what the region yields. The
coordinator keeps a memory of some cycles ago, and what the region was given since. If the host is lost, these cycles are computed
again: a step is a pure function, so the result is the same to the bit.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, Protocol, TypeVar, cast

import numpy as np

from coastwatch.stage import In, Mem, Out, RegionStep, serial_regions
from coastwatch.workers.costs import deal

REPLAY_S = 1.0  # of processor time that may have to be computed again for the regions of a host
REPLAY_CYCLES = 50  # that may have to be computed again for a region
BALANCE_EVERY = 20  # cycles
BALANCE_GAIN = 0.8  # regions move if the busiest host then has less than this share of its work now


class Lost(Exception):
    """A host is gone, or does not answer."""


@dataclass(frozen=True)
class Kept:
    """Stands for the memory of a region after a cycle, while a host keeps it."""

    region: int
    cycle: int


HostT = TypeVar("HostT")
CallT = TypeVar("CallT")


class Hosts(Protocol[HostT, CallT]):
    """Other processes, each with a `RegionHost`."""

    least_regions: int  # fewer are computed by the coordinator

    def ready(self) -> list[HostT]:
        """The hosts that can be called now, the same objects from cycle to cycle."""
        ...

    def call(self, host: HostT, name: str, region: int, *given: object) -> CallT:
        """Begin the method of this name of a host's `RegionHost`. Returns: what `answer` takes. Raises: Lost."""
        ...

    def answer(self, host: HostT, region: int, begun: CallT) -> object:
        """The result of a call. Raises: Lost; the error of the call."""
        ...

    def replace(self, host: HostT) -> None:
        """End a lost host, and begin another if possible."""
        ...


class RegionHost(Generic[Mem]):
    """The regional centres of one host."""

    def __init__(self) -> None:
        self._memory: dict[int, Mem] = {}

    def step(self, region: int, step: RegionStep[Mem, In, Out], memory: Mem | None, given: Sequence[In]) -> tuple[float, Out]:
        """Cycles of a region. Returns: processor seconds, and what the last one yields.

        Args: memory: None: after the region's last cycle here; else it may be written into; given: for each cycle.
        """
        begun = time.process_time()
        output: Out
        memory = self._memory.pop(region) if memory is None else memory
        for cycle_input in given:
            memory, output = step(memory, cycle_input)
        self._memory[region] = memory
        return time.process_time() - begun, output

    def memory(self, region: int) -> Mem:
        """The memory of a region after its last cycle here."""
        return self._memory[region]

    def release(self, region: int) -> Mem:
        """The same, of a region that leaves this host."""
        return self._memory.pop(region)


@dataclass
class _Region(Generic[HostT]):
    """A region as the coordinator knows it."""

    base: Any  # a memory that is here, which no step writes into
    since: list[Any] = field(default_factory=list)  # what the region was given after it, for each cycle
    seconds: float = 0.0  # processor time of these cycles
    cost: float = 1.0  # of the last cycle
    host: HostT | None = None
    current: bool = False  # whether the host has the memory after all that was given
    kept: Kept | None = None  # what was returned for it

    def rebase(self, memory: object) -> None:
        """From now on this memory, after all that was given, is the base."""
        self.base, self.since, self.seconds = memory, [], 0.0


class RemoteRegions(Generic[HostT, CallT]):
    """A RegionMap over hosts; use it in a `with` block of theirs."""

    def __init__(self, hosts: Hosts[HostT, CallT]) -> None:
        self._hosts = hosts
        self._regions: list[_Region[HostT]] = []
        self._step: RegionStep[Any, Any, Any] | None = None
        self._cycle = -1
        self._ready: list[HostT] = []
        self.lost = 0  # hosts so far

    def __call__(self, step: RegionStep[Mem, In, Out], memories: Sequence[Mem], given: Sequence[In]) -> list[tuple[Mem, Out]]:
        """What step(memory, given) returns for each region, but for the memory, in whose place is a `Kept`.

        Raises: ValueError: a `Kept` that is not of the last call; the error of a step.
        """
        if len(memories) < self._hosts.least_regions:
            return serial_regions(step, memories, given)
        if len(self._regions) != len(memories):
            self._regions = [_Region(memory) for memory in memories]
        self._step = step
        self._cycle += 1
        for region, memory in zip(self._regions, memories, strict=True):
            if not isinstance(memory, Kept):
                region.rebase(memory)
                region.current = False
            elif memory != region.kept:
                raise ValueError(f"memory of a region: got {memory}, needed {region.kept}, of the last cycle")
        self._balance()
        for region, region_input in zip(self._regions, given, strict=True):
            region.since.append(region_input)
        begun = []
        for k, region in enumerate(self._regions):  # a memory is sent where the host has not the newest
            base, cycles = (None, region.since[-1:]) if region.current else (region.base, region.since)
            begun.append(self._call(k, "step", step, base, cycles))
        stepped = [self._stepped(k, call) for k, call in enumerate(begun)]
        self._shorten_replay()
        return cast("list[tuple[Mem, Out]]", stepped)  # a `Kept` in place of each memory

    def gather(self, memories: Sequence[Mem]) -> list[Mem]:
        """The memory of each region after the last call, to be saved and not to be stepped."""
        kept = [k for k, memory in enumerate(memories) if isinstance(memory, Kept)]
        self._fetch([k for k in kept if self._regions[k].since])
        return [self._regions[k].base if isinstance(memory, Kept) else memory for k, memory in enumerate(memories)]

    def _call(self, k: int, name: str, *given: object) -> CallT | None:
        """What a region's host has begun; None if it is lost."""
        region = self._regions[k]
        if region.host is None:
            return None
        try:
            return self._hosts.call(region.host, name, k, *given)
        except Lost:
            self._lose(region.host)
            return None

    def _answer(self, k: int, begun: CallT | None) -> object:
        """The result of a call; None if the host is lost."""
        host = self._regions[k].host
        if host is None or begun is None:
            return None
        try:
            return self._hosts.answer(host, k, begun)
        except Lost:
            self._lose(host)
            return None

    def _lose(self, host: HostT) -> None:
        self.lost += 1
        for region in self._regions:
            if region.host is host:
                region.host, region.current = None, False
        self._ready.remove(host)
        self._hosts.replace(host)

    def _stepped(self, k: int, begun: CallT | None) -> tuple[Kept, object]:
        """A region's `Kept` and what it yields, from its host, or computed here if that is lost."""
        region, answer = self._regions[k], self._answer(k, begun)
        region.kept = Kept(k, self._cycle)
        if answer is None:
            return region.kept, self._replay(region)
        seconds, output = cast("tuple[float, object]", answer)
        region.cost = seconds / (1 if region.current else len(region.since))
        region.seconds += seconds
        region.current = True
        return region.kept, output

    def _replay(self, region: _Region[HostT]) -> object:
        """What a region yields in its last cycle, computed here, with all cycles since the base."""
        assert self._step is not None
        alone: RegionHost[Any] = RegionHost()
        output: object
        _, output = alone.step(0, self._step, copy.deepcopy(region.base), region.since)
        region.rebase(alone.memory(0))
        return output

    def _fetch(self, which: Sequence[int], name: str = "memory") -> None:
        """Make the memories of these regions their bases. Args: name: of the method that hosts call."""
        begun = [(k, self._call(k, name) if self._regions[k].current else None) for k in which]
        for k, call in begun:
            memory = self._answer(k, call)
            if memory is not None:
                self._regions[k].rebase(memory)
            elif self._regions[k].since:
                self._replay(self._regions[k])

    def _shorten_replay(self) -> None:
        """Of each host with much to compute again, make the memory of the region with most of it a base."""
        worst = []
        for host in self._ready:
            mine = [k for k, region in enumerate(self._regions) if region.host is host and region.since]
            seconds = sum(self._regions[k].seconds for k in mine)
            if seconds > REPLAY_S or any(len(self._regions[k].since) >= REPLAY_CYCLES for k in mine):
                worst.append(max(mine, key=lambda k: (self._regions[k].seconds, len(self._regions[k].since))))
        self._fetch(worst)

    def _balance(self) -> None:
        """Distribute the regions over the hosts by cost, if a region has no host or it is worth while. Few regions move."""
        before, self._ready = self._ready, list(self._hosts.ready())
        for region in self._regions:
            if region.host not in self._ready:
                region.host, region.current = None, False
        unassigned = any(region.host is None for region in self._regions)
        if not self._ready or not (unassigned or before != self._ready or self._cycle % BALANCE_EVERY == 0):
            return
        cost = np.array([region.cost for region in self._regions])
        dealt = deal(cost, len(self._ready))
        busiest = max(sum(region.cost for region in self._regions if region.host is host) for host in self._ready)
        if not unassigned and cost[dealt[0]].sum() > BALANCE_GAIN * busiest:
            return
        free, moved = list(self._ready), []
        for chunk in dealt:
            here = [sum(cost[k] for k in chunk if self._regions[k].host is host) for host in free]
            host = free.pop(int(np.argmax(here)))
            moved += [(int(k), host) for k in chunk if self._regions[k].host is not host]
        self._fetch([k for k, _ in moved if self._regions[k].current], "release")
        for k, host in moved:
            self._regions[k].host = host if host in self._ready else None
            self._regions[k].current = False
