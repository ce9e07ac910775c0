"""What does the association work of a cycle take in turn, over threads and over processes? What `workers.method = "auto"` rests on.

python -m scaling.decisions.workers [TRACKS [WORKERS [CYCLES]]]: over the national picture; CYCLES fill the windows first. All ways take
turns in one run; every repeat is given new arrays where a new cycle would have them.
"""

import os
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from coastwatch.batches import Array, Floats
from coastwatch.kernels.threads import threads
from coastwatch.stage import Groups, Shared, Spread, Work, in_turn, room_of
from coastwatch.workers import spread_over
from coastwatch.workers.processes import Processes
from scaling.load import national
from scaling.load.processes import processor_s

REPEATS = 9
Call = tuple[Work, Any, dict[str, Any], Groups]


def call_of_a_cycle(count: int, cycles: int) -> Call:
    """What the associator asks its Spread for after so many cycles."""
    world = national.lay_world(count, 1)
    scenario = national.scenario_of(world, {})
    state, sensors = national.first(world), scenario.sensors()
    spots_memory, memory, asked = scenario.spots.init(), scenario.associations.init(), []

    def noted(work: Work, settings: Any, arrays: Shared, spots: Groups) -> list[tuple[Array, ...]]:
        asked[:] = [(work, settings, dict(arrays), spots)]
        return in_turn(work, settings, arrays, spots)

    with spread_over("threads", 0):
        for cycle in range(cycles):
            state, received = national.receive(world, state, sensors)
            tracks = scenario.alignment.step(received.tracks, world.time_s(cycle))
            spots_memory, spots = scenario.spots.step(spots_memory, tracks)
            memory, _ = scenario.associations.step(memory, tracks, spots, noted)
    return asked[0]


def as_in_a_new_cycle(arrays: dict[str, Any], room: Callable[..., Array]) -> dict[str, Any]:
    """Copies of all arrays, and in tuples of the newest, made where the Spread wants them."""

    def copied(array: Array) -> Array:
        out = room(array.shape, array.dtype)
        out[...] = array
        return out

    return {k: (*v[:-1], copied(v[-1])) if isinstance(v, tuple) else copied(v) for k, v in arrays.items()}


def timed(call: Call, spread: Spread) -> tuple[Floats, list[bytes]]:
    """Seconds by the clock, of this process's and of all processes' processor time; and what came out, sorted."""
    work, settings, arrays, spots = call
    arrays = as_in_a_new_cycle(arrays, room_of(spread))
    before = _clocks()
    parts = spread(work, settings, arrays, spots)
    took = _clocks() - before
    first, second, score = (np.concatenate([part[k] for part in parts]) for k in range(3))
    order = np.lexsort((second, first))
    return took, [column[order].tobytes() for column in (first, second, score)]


def _clocks() -> Floats:
    return np.array([time.perf_counter(), time.process_time(), processor_s()])


def main(count: int, workers: int, cycles: int) -> None:
    call = call_of_a_cycle(count, cycles)
    found, took = timed(call, in_turn)[1], {}
    with Processes(workers) as pool:
        ways: dict[str, tuple[int, Spread]] = {
            "in turn": (1, in_turn),
            "threads": (workers, in_turn),
            "processes": (workers, pool),
        }
        for repeat in range(REPEATS + 3):
            for way, (number, spread) in ways.items():
                with threads(number):
                    cost, same = timed(call, spread)
                assert same == found
                if repeat >= 3:  # compiled, started, laid, measured
                    took.setdefault(way, []).append(cost)
    print(
        f"{count} tracks, {len(call[3])} spots, {len(found[0]) // 8} pairs, {workers} workers, load {os.getloadavg()[0]:.1f}; ms"
    )
    alone = np.median(took["in turn"], axis=0)
    for way, each in took.items():
        wall, here_s, all_s = 1e3 * np.median(each, axis=0)
        gain, least = 1e3 * alone[0] / wall, 1e3 * min(np.array(each)[:, 0])
        print(
            f"{way:<10} median {wall:8.1f} ({gain:.2f}x)  least {least:8.1f}  processor {here_s:8.1f} here, {all_s:8.1f} in all"
        )


if __name__ == "__main__":
    main(*(int(a) for a in [*sys.argv[1:], *("100000", "2", "20")[len(sys.argv) - 1 :]]))
