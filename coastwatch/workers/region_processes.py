"""Regional centres in processes of this machine: each keeps the memory of its regions."""

from __future__ import annotations

from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from coastwatch.workers.processes import new_pool
from coastwatch.workers.remote_regions import Lost, RegionHost


class ProcessHosts:
    """Hosts of `RemoteRegions`, a process each; use it in a `with` block. A process begins with its first call."""

    least_regions = 2  # one alone is computed faster here, where its kernels use all threads

    def __init__(self, count: int) -> None:
        self._pools = [new_pool(1) for _ in range(count)]

    def __enter__(self) -> ProcessHosts:
        return self

    def __exit__(self, *_: object) -> None:
        for pool in self._pools:
            pool.shutdown(cancel_futures=True)

    def ready(self) -> list[Any]:
        """All processes."""
        return list(self._pools)

    def call(self, host: ProcessPoolExecutor, name: str, region: int, *given: Any) -> Future[Any]:
        """Begin a method of the `RegionHost` in a process. Raises: Lost."""
        try:
            return host.submit(_carry_out, name, region, given)
        except BrokenProcessPool as error:
            raise Lost from error

    def answer(self, host: ProcessPoolExecutor, region: int, begun: Future[Any]) -> Any:
        """The result of a call. Raises: Lost; the error of the call."""
        try:
            return begun.result()
        except BrokenProcessPool as error:
            raise Lost from error

    def replace(self, host: ProcessPoolExecutor) -> None:
        """A new process in place of a lost one."""
        host.shutdown(cancel_futures=True)
        self._pools[self._pools.index(host)] = new_pool(1)


_host = RegionHost()  # in a process: its regions


def _carry_out(name: str, region: int, given: tuple[Any, ...]) -> Any:
    """The result of a method of this process's `RegionHost`."""
    return getattr(_host, name)(region, *given)
