"""Per-spot work over machines, on Ray: actors that hold the windows of their spots."""

from __future__ import annotations

import os
import pickle
from collections import defaultdict
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from coastwatch.batches import Array, Ints
from coastwatch.stage import CUT, Groups, Shared, Work, in_turn
from coastwatch.workers.blocks import Blocks, Ground
from coastwatch.workers.costs import Costs, along
from coastwatch.workers.keeping import Keeper, version
from coastwatch.workers.owners import owners
from coastwatch.workers.processors import processors
from coastwatch.workers.serving import ROW, START, Call
from coastwatch.workers.windows import Part

PATIENCE_S = 10.0  # with an actor that says nothing; its work is then done here
FIRST_PATIENCE_S = 120.0  # the first answer of an actor compiles what it needs


@dataclass(eq=False)
class _Hand:
    """One actor, and what it holds."""

    number: int
    actor: Any
    joining: Any  # its first answer, until it has come
    here: bool = False  # on the machine of the coordinator, whose memory it can read
    parts: dict[str, Part] = field(default_factory=lambda: defaultdict(Part))
    patience_s: float = FIRST_PATIENCE_S


class _Kind:
    """Of a kind of work: what groups cost, whose they are, and the blocks that its arrays lie in."""

    def __init__(self, ground: Ground) -> None:
        self.costs, self.owner, self.blocks = Costs(), np.zeros(0, np.int64), Blocks(ground)


class Actors:
    """A Spread over actors of a Ray cluster; use it in a `with` block.

    Joins the cluster that RAY_ADDRESS names, or starts one on this machine. Each cycle an actor is sent the newest entry and the state
    of the tracks of its spots and their halo; the windows it has. An actor on this machine reads all that in the memory of the
    coordinator instead. Spots move when loads are uneven: the coordinator, which has all windows, sends those that are missing. What an
    actor that is lost, or silent for too long, was asked for is done here, and its spots go to the others; another actor is asked for
    and joins when the cluster has a place for it. Work whose arrays cannot be cut is done here.
    """

    def __init__(self, count: int) -> None:
        self.count = count  # 0: one for every processor of the cluster
        self._hands: list[_Hand] = []
        self._ground = Ground()
        self._kinds: dict[str, _Kind] = defaultdict(lambda: _Kind(self._ground))
        self._started = 0
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
        ray.wait([hand.joining for hand in self._hands], num_returns=len(self._hands), timeout=FIRST_PATIENCE_S)
        if not self._at_hand():
            self.__exit__()
            raise ValueError(f"workers.method = ray: no actor came up within {FIRST_PATIENCE_S:.0f} s; `ray status` says why")
        return self

    def __exit__(self, *_: object) -> None:
        import ray

        for hand in self._hands:
            ray.kill(hand.actor)
        if self._own_cluster:
            ray.shutdown()
        for kind in self._kinds.values():
            kind.blocks.close()
        self._ground.close()

    def room(self, shape: int | tuple[int, ...], dtype: Any = np.float64) -> Array:
        """An array, as of np.empty, that actors on this machine can read where it lies."""
        return self._ground.room(shape, dtype)

    def __call__(self, work: Work, settings: Any, arrays: Shared, spots: Groups) -> list[tuple[Array, ...]]:
        """What work(settings, arrays, chunk) gives for chunks that hold every spot once."""
        hands = self._at_hand()
        if len(spots) < 2 or not hands or any(name not in arrays for name in CUT):
            return in_turn(work, settings, arrays, spots)
        name = f"{work.__module__}.{work.__qualname__}"
        kind = self._kinds[name]
        expected = kind.costs.expected(spots)
        before = kind.owner if len(kind.owner) == len(spots) else np.full(len(spots), -1)
        kind.owner = owners(before, expected, np.array([hand.number for hand in hands]), along(arrays, spots))
        asked = [(hand, mine) for hand in hands if len(mine := np.flatnonzero(kind.owner == hand.number))]
        sent = self._sent(name, (work, settings), arrays, spots, asked)
        answers = [self._answer(hand, ref) for (hand, _), ref in zip(asked, sent, strict=True)]
        if all(answers):
            part = np.empty(len(spots), np.int64)
            for k, (_, mine) in enumerate(asked):
                part[mine] = k
            kind.costs.learn(expected, part, np.array([answer[0] for answer in answers]))
        return [a[1] if a else work(settings, arrays, spots.take(mine)) for a, (_, mine) in zip(answers, asked, strict=True)]

    def _sent(
        self, name: str, what: tuple[Work, Any], arrays: Shared, spots: Groups, asked: list[tuple[_Hand, Ints]]
    ) -> list[Any]:
        """Asks each hand for its groups, those far away first. Returns: the answers to come, in the order of `asked`."""
        pickled, refs = pickle.dumps(what), {}
        places: dict[str, Any] = {}
        for hand, mine in sorted(asked, key=lambda each: each[0].here):
            if hand.here:
                places = places or self._kinds[name].blocks.publish({**arrays, ROW: spots.row, START: spots.start})
                refs[hand] = hand.actor.read.remote(Call(pickled, places, self._ground.names), mine)
            else:
                refs[hand] = hand.actor.work.remote(name, pickled, hand.parts[name].cut(arrays, spots.take(mine)))
        return [refs[hand] for hand, _ in asked]

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
        self._hands.append(_Hand(self._started, actor, actor.joined.remote()))
        self._started += 1

    def _at_hand(self) -> list[_Hand]:
        """The actors that have joined. Raises: ValueError where one runs another version of the program."""
        import ray

        waiting = {hand.joining: hand for hand in self._hands if hand.joining is not None}
        ready = ray.wait(list(waiting), num_returns=len(waiting), timeout=0.0)[0] if waiting else []
        here = ray.get_runtime_context().get_node_id() if ready else ""
        for ref in ready:
            hand = waiting[ref]
            answer = self._answer(hand, ref)
            if answer and answer[1] != version():
                raise ValueError(
                    f"workers.method = ray: got coastwatch {answer[1]} on node {answer[0]}, needed {version()} as here"
                )
            hand.joining, hand.here, hand.patience_s = None, bool(answer) and answer[0] == here, FIRST_PATIENCE_S
        return [hand for hand in self._hands if hand.joining is None]
