"""Per-spot work over machines, on Ray: actors that hold the windows of their spots."""

from __future__ import annotations

import os
import pickle
import time
from collections import defaultdict
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

import numpy as np

from coastwatch.batches import Array, Ints
from coastwatch.stage import RING, Groups, Shared, Work, in_turn
from coastwatch.workers.costs import Costs
from coastwatch.workers.owners import owners
from coastwatch.workers.processors import processors
from coastwatch.workers.windows import Holder, Part, Sent

PATIENCE_S = 10.0  # with an actor that says nothing; its work is then done here
FIRST_PATIENCE_S = 120.0  # the first answer of an actor compiles what it needs


class Keeper:
    """What an actor is: the holders of the windows of its spots, by the kind of work."""

    def __init__(self) -> None:
        self._holders: dict[bytes, Holder] = defaultdict(Holder)

    def version(self) -> str:
        """Of the program on its machine."""
        return version("coastwatch")

    def node(self) -> str:
        """Of the cluster, on which it is."""
        import ray

        return str(ray.get_runtime_context().get_node_id())

    def work(self, what: tuple[bytes, bytes], sent: Sent) -> tuple[float, tuple[Array, ...]]:
        """Processor seconds, and what the work gives."""
        begun = time.process_time()
        found = self._holders[what[0]].work(pickle.loads(what[0]), pickle.loads(what[1]), sent)
        return time.process_time() - begun, found


@dataclass(eq=False)
class _Hand:
    """One actor, and what it holds."""

    number: int
    actor: Any
    joining: Any  # its first answer, until it has come
    parts: dict[bytes, Part] = field(default_factory=lambda: defaultdict(Part))
    patience_s: float = FIRST_PATIENCE_S


@dataclass
class _Owned:
    """Of a kind of work: what groups cost, and whose they are."""

    costs: Costs = field(default_factory=Costs)
    owner: Ints = field(default_factory=lambda: np.zeros(0, np.int64))


class Actors:
    """A Spread over actors of a Ray cluster; use it in a `with` block.

    Joins the cluster that RAY_ADDRESS names, or starts one on this machine. Each cycle an actor is sent the newest entry and the state of
    the tracks of its spots and their halo; the windows it has. Spots move when loads are uneven: the coordinator, which has all
    windows, sends those that are missing. What an actor that is lost, or silent for too long, was asked for is done here, and its
    spots go to the others; another actor is asked for and joins when the cluster has a place for it. Work whose arrays cannot be
    cut is done here.
    """

    def __init__(self, count: int) -> None:
        self.count = count  # 0: one for every processor of the cluster
        self._hands: list[_Hand] = []
        self._owned: dict[bytes, _Owned] = defaultdict(_Owned)
        self._started = 0
        self._joined_here = False

    def __enter__(self) -> Actors:
        import ray

        self._joined_here = not ray.is_initialized()
        if self._joined_here:
            own = {} if "RAY_ADDRESS" in os.environ else {"num_cpus": processors(self.count), "include_dashboard": False}
            ray.init(log_to_driver=False, logging_level="ERROR", **own)
        for _ in range(self.count or int(ray.cluster_resources().get("CPU", 1))):
            self._start()
        ray.wait([hand.joining for hand in self._hands], num_returns=len(self._hands), timeout=FIRST_PATIENCE_S)
        if not self._at_hand():
            self.__exit__()
            raise ValueError(f"workers.method = ray: no actor came up within {FIRST_PATIENCE_S:.0f} s; `ray status` says why")
        return self

    def __exit__(self, *_: object) -> None:
        import ray

        for hand in self._hands:
            ray.kill(hand.actor)
        if self._joined_here:
            ray.shutdown()

    def __call__(self, work: Work, settings: Any, arrays: Shared, spots: Groups) -> list[tuple[Array, ...]]:
        """What work(settings, arrays, chunk) gives for chunks that hold every spot once."""
        hands = self._at_hand()
        if len(spots) < 2 or not hands or any(name not in arrays for name in RING):
            return in_turn(work, settings, arrays, spots)
        what, owned = (pickle.dumps(work), pickle.dumps(settings)), self._owned[pickle.dumps(work)]
        expected = owned.costs.expected(spots)
        before = owned.owner if len(owned.owner) == len(spots) else np.full(len(spots), -1)
        owned.owner = owners(before, expected, np.array([hand.number for hand in hands]))
        asked = []
        for hand in hands:
            mine = np.flatnonzero(owned.owner == hand.number)
            if len(mine):
                asked.append((hand, mine, hand.actor.work.remote(what, hand.parts[what[0]].cut(arrays, spots.take(mine)))))
        answers = [self._answer(hand, ref) for hand, _, ref in asked]
        if all(answers):
            part = np.empty(len(spots), np.int64)
            for k, (_, mine, _) in enumerate(asked):
                part[mine] = k
            owned.costs.learn(expected, part, np.array([answer[0] for answer in answers if answer]))
        return [a[1] if a else work(settings, arrays, spots.take(mine)) for a, (_, mine, _) in zip(answers, asked, strict=True)]

    def _answer(self, hand: _Hand, ref: Any) -> Any:
        """What an actor says; none where it is lost, and then another one is asked for. What the work raised is raised."""
        import ray

        try:
            found = ray.get(ref, timeout=hand.patience_s)
        except ray.exceptions.RayTaskError as error:
            raise error.cause from None
        except ray.exceptions.RayError:
            ray.kill(hand.actor)
            self._hands.remove(hand)
            self._start()
            return None
        hand.patience_s = PATIENCE_S
        return found

    def _start(self) -> None:
        import ray

        actor = ray.remote(num_cpus=1, max_restarts=0, scheduling_strategy="SPREAD")(Keeper).remote()
        self._hands.append(_Hand(self._started, actor, actor.version.remote()))
        self._started += 1

    def _at_hand(self) -> list[_Hand]:
        """The actors that have joined. Raises: ValueError where one runs another version of the program."""
        import ray

        waiting = {hand.joining: hand for hand in self._hands if hand.joining is not None}
        ready = ray.wait(list(waiting), num_returns=len(waiting), timeout=0.0)[0] if waiting else []
        for ref in ready:
            hand, here = waiting[ref], version("coastwatch")
            theirs = self._answer(hand, ref)
            if theirs not in (None, here):
                raise ValueError(
                    f"workers.method = ray: got coastwatch {theirs} on a machine of the cluster, needed {here} as here"
                )
            hand.joining, hand.patience_s = None, FIRST_PATIENCE_S
        return [hand for hand in self._hands if hand.joining is None]
