"""Whole regional centres over machines, on Ray: an actor turns the plots of its regions into tracks and keeps their memory."""

from __future__ import annotations

import copy
import importlib.metadata
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from coastwatch.stage import RegionStep
from coastwatch.workers.costs import deal
from coastwatch.workers.malloc import keep_freed_memory
from coastwatch.workers.processors import processors

PATIENCE_S = 10.0  # with an actor that does not answer; its regions are then done here
DEAL_EVERY = 20  # cycles
FIRST_PATIENCE_S = 120.0  # the first answer of an actor compiles what it needs


def version() -> str:
    """Of the program on this machine."""
    return importlib.metadata.version("coastwatch")


class RegionActor:
    """The regional centres of one actor of the cluster."""

    def __init__(self) -> None:
        keep_freed_memory()
        self._memory: dict[int, Any] = {}

    def joined(self) -> tuple[str, str]:
        """The node that it is on, and the version of the program there."""
        import ray

        return str(ray.get_runtime_context().get_node_id()), version()

    def step(self, step: RegionStep, region: int, memory: Any, given: tuple[Any, ...]) -> tuple[float, tuple[Any, ...]]:
        """Processor seconds, and the result of step(memory, *given). Args: memory: None: the memory after this region's last step."""
        begun = time.process_time()
        # Arrays from Ray are read-only, and a step writes into its memory.
        before = copy.deepcopy(memory) if memory is not None else self._memory.pop(region)
        found = step(before, *given)
        self._memory[region] = found[0]
        return time.process_time() - begun, found


@dataclass(eq=False)
class _Held:
    """An actor, and the memories of regions that it keeps."""

    actor: Any
    joining: Any  # its first answer, until it has come
    memory: dict[int, Any]  # region -> the object that its last step returned
    patience_s: float = FIRST_PATIENCE_S


class Actors:
    """A RegionMap over actors of a Ray cluster; use it in a `with` block.

    Joins the cluster that RAY_ADDRESS names, or starts one on this machine. Each cycle an actor receives the plots of its regions and
    returns their tracks and memory. It keeps the memory too, so the coordinator sends only a changed one. Regions are distributed by
    their cost, again every DEAL_EVERY cycles or when actors change. If an actor is lost, or silent for too long, its regions are
    computed here in that cycle and given to other actors in the next. A new actor joins when the cluster has a place for it.
    """

    def __init__(self, count: int) -> None:
        self.count = count  # 0: one for every processor of the cluster
        self._held: list[_Held] = []
        self._joined: list[_Held] = []  # the actors over which regions were distributed
        self._owner: dict[int, _Held] = {}
        self._cycle = -1
        self._seconds: dict[int, float] = {}
        self._own_cluster = False

    def __enter__(self) -> Actors:
        try:
            import ray
        except ImportError as error:
            raise ValueError("workers.method = ray: Ray is not installed, needed: pip install 'coastwatch[ray]'") from error
        self._own_cluster = not ray.is_initialized()
        if self._own_cluster:
            local = {"address": "local", "num_cpus": processors(self.count), "include_dashboard": False}
            ray.init(log_to_driver=False, logging_level="ERROR", **({} if "RAY_ADDRESS" in os.environ else local))
        for _ in range(self.count or int(ray.cluster_resources().get("CPU", 1))):
            self._start()
        ray.wait([held.joining for held in self._held], num_returns=len(self._held), timeout=FIRST_PATIENCE_S)
        if not self.at_hand():
            self.__exit__()
            raise ValueError(f"workers.method = ray: no actor came up within {FIRST_PATIENCE_S:.0f} s; `ray status` says why")
        return self

    def __exit__(self, *_: object) -> None:
        import ray

        for held in self._held:
            ray.kill(held.actor)
        if self._own_cluster:
            ray.shutdown()

    def __call__(self, step: RegionStep, memories: Sequence[Any], given: Sequence[tuple[Any, ...]]) -> list[tuple[Any, ...]]:
        """The result of step(memory, *given) for each region."""
        self._deal(len(memories))
        refs = {}
        for region, memory in enumerate(memories):
            if held := self._owner.get(region):
                kept = held.memory.get(region) is memory
                refs[region] = held.actor.step.remote(step, region, None if kept else memory, given[region])
        found = [self._answer(region, refs[region]) if region in refs else None for region in range(len(memories))]
        return [
            here if here is not None else step(copy.deepcopy(memory), *more)
            for here, memory, more in zip(found, memories, given, strict=True)
        ]

    def at_hand(self) -> list[_Held]:
        """The actors that have joined. Raises: ValueError: one runs another version of the program."""
        import ray

        waiting = {held.joining: held for held in self._held if held.joining is not None}
        ready = ray.wait(list(waiting), num_returns=len(waiting), timeout=0.0)[0] if waiting else []
        for ref in ready:
            try:
                node, theirs = ray.get(ref)
            except ray.exceptions.RayError:
                self._replace_actor(waiting[ref])
                continue
            if theirs != version():
                raise ValueError(f"workers.method = ray: got coastwatch {theirs} on node {node}, needed {version()} as here")
            waiting[ref].joining = None
        return [held for held in self._held if held.joining is None]

    def _deal(self, regions: int) -> None:
        """Distribute the regions over the joined actors by cost, if the actors have changed, and every DEAL_EVERY cycles."""
        hands = self.at_hand()
        self._cycle += 1
        if hands == self._joined and self._cycle % DEAL_EVERY:
            return
        self._joined = hands
        cost = np.array([self._seconds.get(region, 1.0) for region in range(regions)])
        dealt = zip(hands, deal(cost, max(len(hands), 1)), strict=False)
        self._owner = {int(region): held for held, mine in dealt for region in mine}

    def _answer(self, region: int, ref: Any) -> tuple[Any, ...] | None:
        """The result of a region's actor; None if the actor is lost. Raises: the error of the step."""
        import ray

        held = self._owner.get(region)
        if held is None:
            return None
        try:
            self._seconds[region], found = ray.get(ref, timeout=held.patience_s)
        except ray.exceptions.RayTaskError as error:
            raise error.cause from None
        except ray.exceptions.RayError:
            self._replace_actor(held)
            return None
        held.memory[region], held.patience_s = found[0], PATIENCE_S
        made: tuple[Any, ...] = found
        return made

    def _replace_actor(self, held: _Held) -> None:
        """Ends an actor and asks for another one."""
        import ray

        ray.kill(held.actor)
        self._held.remove(held)
        self._owner = {region: owner for region, owner in self._owner.items() if owner is not held}
        self._start()

    def _start(self) -> None:
        import ray

        actor = ray.remote(num_cpus=1, max_restarts=0, scheduling_strategy="SPREAD")(RegionActor).remote()
        self._held.append(_Held(actor, actor.joined.remote(), {}))
