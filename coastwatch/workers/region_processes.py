"""Regional centres in processes of this machine: each keeps the memory of its regions.

What a region is given and yields in a cycle goes through shared memory. Its memory, which rarely comes, goes through the executor.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, cast

from coastwatch.stage import In, Mem, Out, RegionStep
from coastwatch.workers.processes import new_pool
from coastwatch.workers.remote_regions import Lost, RegionHost
from coastwatch.workers.shared_memory import Publisher, Reader, Sent, receive, send


class ProcessHosts:
    """Hosts of `RemoteRegions`, a process each; use it in a `with` block. A process begins with its first call."""

    least_regions = 2  # one alone is computed faster here, where its kernels use all threads

    def __init__(self, count: int) -> None:
        self._pools = [new_pool(1) for _ in range(count)]
        self._inputs: dict[int, Publisher] = defaultdict(Publisher)  # to each region
        self._outputs: dict[tuple[ProcessPoolExecutor, int], Reader] = defaultdict(Reader)  # by each process for each region

    def __enter__(self) -> ProcessHosts:
        return self

    def __exit__(self, *_: object) -> None:
        for pool in self._pools:
            self._end(pool)
        for publisher in self._inputs.values():
            publisher.close()

    def ready(self) -> list[ProcessPoolExecutor]:
        """All processes."""
        return list(self._pools)

    def call(self, host: ProcessPoolExecutor, name: str, region: int, *given: object) -> Future[object]:
        """Begin a method of the `RegionHost` in a process. Raises: Lost; OSError: too little shared memory."""
        try:
            if name == "step":
                step, memory, cycles = cast("tuple[RegionStep[Any, Any, Any], Any, Sequence[Any]]", given)
                return host.submit(_step, region, step, memory, send(cycles, self._inputs[region]))
            return host.submit(_carry_out, name, region)
        except BrokenProcessPool as error:
            raise Lost from error

    def answer(self, host: ProcessPoolExecutor, region: int, begun: Future[object]) -> object:
        """The result of a call. Raises: Lost; the error of the call."""
        try:
            result = begun.result()
        except BrokenProcessPool as error:
            raise Lost from error
        return receive(result, self._outputs[host, region]) if isinstance(result, Sent) else result

    def replace(self, host: ProcessPoolExecutor) -> None:
        """A new process in place of a lost one."""
        self._end(host)
        self._pools[self._pools.index(host)] = new_pool(1)

    def _end(self, host: ProcessPoolExecutor) -> None:
        host.shutdown(cancel_futures=True)
        for key in [key for key in self._outputs if key[0] is host]:
            self._outputs.pop(key).release()


_host: RegionHost[Any] = RegionHost()  # in a process: its regions
_inputs: dict[int, Reader] = defaultdict(Reader)
_outputs: dict[int, Publisher] = defaultdict(Publisher)


def _step(
    region: int, step: RegionStep[Mem, In, Out], memory: Mem | None, cycles: Sent[Sequence[In]]
) -> Sent[tuple[float, Out]]:
    """The result of `step` of this process's `RegionHost`."""
    return send(_host.step(region, step, memory, receive(cycles, _inputs[region])), _outputs[region])


def _carry_out(name: str, region: int) -> Any:
    """The result of another method of it."""
    return getattr(_host, name)(region)
