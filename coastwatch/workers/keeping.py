"""What an actor of the cluster is: it keeps the windows of its spots and works on them."""

from __future__ import annotations

import importlib.metadata
import pickle
import time
from collections import defaultdict

from coastwatch.batches import Array, Ints
from coastwatch.workers.blocks import Attached
from coastwatch.workers.freed import keep_freed_memory
from coastwatch.workers.serving import Call, carried_out, open_call
from coastwatch.workers.windows import Holder, Sent


def version() -> str:
    """Of the program on this machine."""
    return importlib.metadata.version("coastwatch")


class Keeper:
    """The windows of the spots of one actor, by the kind of work."""

    def __init__(self) -> None:
        keep_freed_memory()
        self._holders: dict[str, Holder] = defaultdict(Holder)
        self._attached = Attached(related=False)

    def joined(self) -> tuple[str, str]:
        """The node that it is on, and the version of the program there."""
        import ray

        return str(ray.get_runtime_context().get_node_id()), version()

    def work(self, kind: str, what: bytes, sent: Sent) -> tuple[float, tuple[Array, ...]]:
        """Processor seconds, and what the work gives for what was sent."""
        begun = time.process_time()
        work, settings = pickle.loads(what)
        found = self._holders[kind].work(work, settings, sent)
        return time.process_time() - begun, found

    def read(self, call: Call, groups: Ints) -> tuple[float, tuple[Array, ...]]:
        """The same for groups whose arrays lie in the memory of this machine."""
        return carried_out(open_call(call, self._attached), groups)
