"""Regional centres over machines, on Ray: an actor keeps the memory of its regions and turns their plots into tracks."""

from __future__ import annotations

import copy
import importlib.metadata
import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from coastwatch.stage import In, Mem, Out, RegionStep
from coastwatch.workers.malloc import keep_freed_memory
from coastwatch.workers.processors import processors
from coastwatch.workers.remote_regions import Lost, RegionHost

PATIENCE_S = 10.0  # with an actor that does not answer; its regions are then done here
FIRST_PATIENCE_S = 120.0  # the first answer of an actor compiles what it needs


def version() -> str:
    """Of the program on this machine."""
    return importlib.metadata.version("coastwatch")


class RegionActor:
    """The regional centres of one actor of the cluster."""

    def __init__(self) -> None:
        keep_freed_memory()
        self._host: RegionHost[Any] = RegionHost()

    def joined(self) -> tuple[str, str]:
        """The node that it is on, and the version of the program there."""
        import ray

        return str(ray.get_runtime_context().get_node_id()), version()

    def step(self, region: int, step: RegionStep[Mem, In, Out], memory: Mem | None, given: Sequence[In]) -> tuple[float, Out]:
        """As `RegionHost.step`. Arrays from Ray are read-only, and a step writes into its memory."""
        return self._host.step(region, step, copy.deepcopy(memory), given)

    def memory(self, region: int) -> object:
        """As `RegionHost.memory`."""
        return self._host.memory(region)

    def release(self, region: int) -> object:
        """As `RegionHost.release`."""
        return self._host.release(region)


@dataclass(eq=False)
class _Actor:
    """An actor, and what is known of it here."""

    handle: Any
    joining: Any  # its first answer, until it has come
    patience_s: float = FIRST_PATIENCE_S


class Actors:
    """Hosts of `RemoteRegions`, an actor of a Ray cluster each; use it in a `with` block.

    Joins the cluster that RAY_ADDRESS names, or starts one on this machine. An actor is lost if it ends or is silent for too long.
    Another one joins when the cluster has a place for it.
    """

    least_regions = 1

    def __init__(self, count: int) -> None:
        self.count = count  # 0: one for every processor of the cluster
        self._actors: list[_Actor] = []
        self._own_cluster = self._running = False

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
        ray.wait([actor.joining for actor in self._actors], num_returns=len(self._actors), timeout=FIRST_PATIENCE_S)
        try:
            if not self.ready():
                raise ValueError(
                    f"workers.method = ray: no actor came up within {FIRST_PATIENCE_S:.0f} s; `ray status` says why"
                )
        except BaseException:
            self.__exit__()
            raise
        self._running = True
        return self

    def __exit__(self, *_: object) -> None:
        import ray

        for actor in self._actors:
            ray.kill(actor.handle)
        if self._own_cluster:
            ray.shutdown()

    def ready(self) -> list[_Actor]:
        """The actors that have joined. One of another version of the program is refused at the start, and left out later.

        Raises: ValueError: at the start an actor runs another version.
        """
        import ray

        waiting = {actor.joining: actor for actor in self._actors if actor.joining is not None}
        came = ray.wait(list(waiting), num_returns=len(waiting), timeout=0.0)[0] if waiting else []
        for ref in came:
            try:
                node, theirs = ray.get(ref)
            except ray.exceptions.RayError:
                self.replace(waiting[ref])
                continue
            if theirs != version():
                problem = f"workers.method = ray: got coastwatch {theirs} on node {node}, needed {version()} as here"
                if not self._running:
                    raise ValueError(problem)
                warnings.warn(f"{problem}; its processor is not used", stacklevel=2)
                ray.kill(waiting[ref].handle)
                self._actors.remove(waiting[ref])
                continue
            waiting[ref].joining = None
        return [actor for actor in self._actors if actor.joining is None]

    def call(self, host: _Actor, name: str, region: int, *given: object) -> object:
        """Begin a method of an actor."""
        return getattr(host.handle, name).remote(region, *given)

    def answer(self, host: _Actor, region: int, begun: object) -> object:
        """The result of a call, with read-only arrays. Raises: Lost; the error of the call."""
        import ray

        try:
            result = ray.get(begun, timeout=host.patience_s)
        except ray.exceptions.RayTaskError as error:
            raise error.cause from None
        except ray.exceptions.RayError as error:
            raise Lost from error
        host.patience_s = PATIENCE_S
        return result

    def replace(self, host: _Actor) -> None:
        """End an actor and ask for another one."""
        import ray

        ray.kill(host.handle)
        self._actors.remove(host)
        self._start()

    def _start(self) -> None:
        import ray

        actor = ray.remote(num_cpus=1, max_restarts=0, scheduling_strategy="SPREAD")(RegionActor).remote()
        self._actors.append(_Actor(actor, actor.joined.remote()))
