"""What does the association work of a cycle take in turn, over threads, over processes, on Ray? What `workers.method = "auto"` rests on.

python -m scaling.decisions.workers [TRACKS [WORKERS [CYCLES [ray]]]]: over the national picture; CYCLES fill the windows first. All ways
take turns in one run, each repeat a cycle further in a sea that has stopped. `ray`: on a cluster that is started here; "ray, far" are the
same actors as if they were on other machines, which are sent what they need.
"""

import os
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import numpy as np

from coastwatch.batches import Array, Floats
from coastwatch.kernels.threads import threads
from coastwatch.stage import Groups, Shared, Spread, Work, in_turn, room_of
from coastwatch.workers import spread_over
from coastwatch.workers.processes import Processes
from coastwatch.workers.ray import Actors
from scaling.load import national
from scaling.load.processes import page_faults, processor_s

SETTLING, REPEATS = 5, 9
Call = tuple[Work, Any, dict[str, Any], Groups]


def call_of_a_cycle(count: int, cycles: int) -> Call:
    """What the associator asks its Spread for after so many cycles."""
    world = national.build_world(count, 1)
    scenario = national.scenario_of(world, {})
    state, sensors = national.initial_state(world), scenario.sensors()
    spots_memory, memory, asked = scenario.spots.init(), scenario.associations.init(), []

    def noted(work: Work, settings: Any, arrays: Shared, spots: Groups) -> list[tuple[Array, ...]]:
        asked[:] = [(work, settings, dict(arrays), spots)]
        return in_turn(work, settings, arrays, spots)

    with spread_over("threads", 0):
        for cycle in range(cycles):
            state, received = national.next_cycle(world, state, sensors)
            tracks = scenario.alignment.step(received.tracks, world.time_s(cycle))
            spots_memory, spots = scenario.spots.step(spots_memory, tracks)
            memory, _ = scenario.associations.step(memory, tracks, spots, noted)
    return asked[0]


def a_cycle_further(arrays: dict[str, Any], room: Callable[..., Array]) -> dict[str, Any]:
    """The arrays of the next cycle, if nothing has moved, made where the Spread wants them: the ring has one entry more."""

    def made(array: Array) -> Array:
        out = room(array.shape, array.dtype)
        out[...] = array
        return out

    window, count = arrays["chain"].shape[1] + 1, len(arrays["row"])
    chain = np.column_stack([np.arange(count, dtype=np.int32), arrays["chain"][:, :-1]])
    length = np.minimum(arrays["length"] + 1, window).astype(arrays["length"].dtype)
    new = {name: made(a) for name, a in {**arrays, "chain": chain, "length": length}.items() if name != "ring"}
    return {**new, "ring": (*arrays["ring"], made(arrays["ring"][-1]))[-window:]}


def _cost(spread: Spread, call: Call) -> tuple[list[tuple[Array, ...]], Floats]:
    """What a Spread gives; seconds: wall, processor here, processor of all processes; page faults of all. What it takes to ask for what
    others did, milliseconds of wall and processor, is left out."""
    work, settings, arrays, spots = call
    others, pages = processor_s() - time.process_time(), page_faults()
    here, begun = time.process_time(), time.perf_counter()
    parts = spread(work, settings, arrays, spots)
    wall, here = time.perf_counter() - begun, time.process_time() - here
    return parts, np.array([wall, here, here + processor_s() - time.process_time() - others, page_faults() - pages])


def _sorted(parts: list[tuple[Array, ...]]) -> list[bytes]:
    first, second, score = (np.concatenate([part[k] for part in parts]) for k in range(3))
    order = np.lexsort((second, first))
    return [column[order].tobytes() for column in (first, second, score)]


def _ways(workers: int, with_ray: bool, open_: ExitStack) -> dict[str, tuple[int, Spread]]:
    ways: dict[str, tuple[int, Spread]] = {"in turn": (1, in_turn), "threads": (workers, in_turn)}
    ways["processes"] = workers, open_.enter_context(Processes(workers))
    if with_ray:
        ways["ray"] = workers, open_.enter_context(Actors(workers))
        far = Actors(workers)
        far._hands = ways["ray"][1]._at_hand()  # type: ignore[attr-defined]
        ways["ray, far"] = workers, far
        open_.callback(far._ground.close)
    return ways


def main(count: int, workers: int, cycles: int, with_ray: bool) -> None:
    work, settings, arrays, spots = call_of_a_cycle(count, cycles)
    took: dict[str, list[Floats]] = {}
    with ExitStack() as open_:
        ways = _ways(workers, with_ray, open_)
        each = dict.fromkeys(ways, arrays)
        for repeat in range(SETTLING + REPEATS):
            found = []
            for way, (number, spread) in ways.items():
                each[way] = a_cycle_further(each[way], room_of(spread))
                for hand in getattr(spread, "_hands", []):
                    hand.here = way == "ray"
                with threads(number):
                    parts, cost = _cost(spread, (work, settings, each[way], spots))
                found.append(_sorted(parts))
                if repeat >= SETTLING:  # compiled, started, windows sent, costs learnt
                    took.setdefault(way, []).append(cost)
            assert all(one == found[0] for one in found)
    _report(count, len(spots), workers, took)


def _report(count: int, spots: int, workers: int, took: dict[str, list[Floats]]) -> None:
    print(f"{count} tracks, {spots} spots, {workers} workers, load {os.getloadavg()[0]:.1f}; ms")
    alone = np.median(took["in turn"], axis=0)
    for way, each in took.items():
        wall, here_s, all_s, pages = np.median(each, axis=0)
        gain, least = alone[0] / wall, 1e3 * min(np.array(each)[:, 0])
        print(
            f"{way:<10} median {1e3 * wall:8.1f} ({gain:.2f}x)  least {least:8.1f}  "
            f"processor {1e3 * here_s:8.1f} here, {1e3 * all_s:8.1f} in all  page faults {pages:6.0f}"
        )


if __name__ == "__main__":
    given = [a for a in sys.argv[1:] if a != "ray"]
    main(*(int(a) for a in [*given, *("100000", "2", "20")[len(given) :]]), with_ray="ray" in sys.argv)
