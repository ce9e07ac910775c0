"""What do the parts of track-to-track association cost a cycle, on one thread and on two, and what against whole arrays of numpy?

    python -m scaling.decisions.association_cycle [--tracks N ...] [--threads N ...] [--cycles 8] [--numpy-up-to N]

Tracks are those of the national picture (scaling/load), windows are full, every cycle goes on from the one before. A line a part: medians
of wall time and of processor time of all threads, in ms, for each number of threads. Gate with screening, and score, run side by side in
blocks: wall time is that of both. "other" is what is left of the step. Below: ns of processor time a pair within the gate, what share of
the pairs screening leaves and what share passes. Last, the same done by whole arrays (`association_plain`: scipy's tree, batched numpy,
scipy's assignment; one thread but for what numpy itself spreads): ms of its parts, how many times the step that is, and whether it took as
many pairs.
"""

from __future__ import annotations

import argparse
import importlib
import os
import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any
from unittest.mock import patch

import numpy as np

from coastwatch.associations import WindowedCovariance
from coastwatch.batches import Spots, Tracks
from coastwatch.kernels import threads as thread_blocks
from coastwatch.stage import in_turn
from coastwatch.workers import spread_over
from scaling.decisions import association_plain
from scaling.load import national

STAGE = "coastwatch.associations.windowed_covariance"
PARTS = (  # where a function is looked up, its name, what it is called here
    ("coastwatch.kernels.geometry.bands", "in_order", "ranks"),
    ("coastwatch.associations.history", "History.extended", "windows"),
    (STAGE, "rows_of_spots", "spots"),
    ("coastwatch.kernels.tables.groups", "parted", "spots"),
    (STAGE, "in_order", "order of pairs"),
    (STAGE, "one_to_one", "one-to-one"),
    (STAGE, "vessels", "vessels"),
)
BLOCKS = {"facts": "facts", "outlines": "outlines", "_score_block": "gate to score"}
INSIDE = (
    ("coastwatch.kernels.association.candidate_pairs", "candidates", " gate, screening"),
    ("coastwatch.kernels.association.pair_score", "windowed_scores", " score"),
)
ORDER = ("ranks", "facts", "windows", "outlines", "spots", "gate to score", *(name for *_, name in INSIDE))
ORDER += ("order of pairs", "one-to-one", "vessels")

Given = list[tuple[Tracks, Spots]]


class Clock:
    """Wall and processor time of parts in a cycle, in ms."""

    def __init__(self) -> None:
        self.wall: dict[str, float] = defaultdict(float)
        self.cpu: dict[str, float] = defaultdict(float)
        self.left = 0

    def run(self, name: str, work: Callable[..., Any], *given: Any, **more: Any) -> Any:
        """work(*given), timed."""
        wall, cpu = time.perf_counter(), time.process_time()
        done = work(*given, **more)
        self.wall[name] += 1e3 * (time.perf_counter() - wall)
        self.cpu[name] += 1e3 * (time.process_time() - cpu)
        return done

    def timed(self, name: str, work: Callable[..., Any], inside: bool) -> Callable[..., Any]:
        """The same function, timed. Args: inside: it runs in threads, of which each has its own processor time."""

        def one(*given: Any, **more: Any) -> Any:
            if not inside:
                return self.run(name, work, *given, **more)
            begun = time.thread_time()
            done = work(*given, **more)
            self.cpu[name] += 1e3 * (time.thread_time() - begun)
            if name == INSIDE[0][2]:
                self.left += len(done[0])
            return done

        return one


def watched(clock: Clock) -> ExitStack:
    """Inside it the parts are timed."""
    stack, in_blocks = ExitStack(), thread_blocks.in_blocks

    def by_kernel(kernel: Any, *given: Any, **more: Any) -> Any:
        name = BLOCKS.get(getattr(kernel, "__name__", ""))
        return in_blocks(kernel, *given, **more) if name is None else clock.run(name, in_blocks, kernel, *given, **more)

    stack.enter_context(patch.object(thread_blocks, "in_blocks", by_kernel))
    for found, inside in ((PARTS, False), (INSIDE, True)):
        for module, path, name in found:
            owner = importlib.import_module(module)
            *outer, last = path.split(".")
            for part in outer:
                owner = getattr(owner, part)
            stack.enter_context(patch.object(owner, last, clock.timed(name, getattr(owner, last), inside)))
    return stack


def cycles(count: int, number: int) -> tuple[WindowedCovariance, Any, Given]:
    """The method of the national picture, its memory when windows are full, and the cycles that follow."""
    world = national.build_world(count, 1)
    scenario = national.scenario_of(world, {})
    state, sensors, method = national.initial_state(world), scenario.sensors(), scenario.associations
    memory, past, given = method.init(), scenario.spots.init(), []
    for cycle in range(method.window + 1 + number):
        state, received = national.next_cycle(world, state, sensors)
        tracks = scenario.alignment.step(received.tracks, world.time_s(cycle))
        past, spots = scenario.spots.step(past, tracks)
        if cycle <= method.window:
            memory, _ = method.step(memory, tracks, spots, in_turn)
        else:
            given.append((tracks, spots))
    return method, memory, given


def median(clocks: list[Clock], kind: str, name: str) -> float:
    return float(np.median([getattr(clock, kind)[name] for clock in clocks]))


def measured(method: WindowedCovariance, memory: Any, given: Given, count: int) -> tuple[list[Clock], Any]:
    """A clock a cycle, and what the first cycle found."""
    clocks, answers = [], []
    with spread_over("threads", count) as spread:
        for tracks, spots in given:
            clock = Clock()
            with watched(clock):
                memory, found = clock.run("step", method.step, memory, tracks, spots, spread)
            clocks.append(clock)
            answers.append(found)
    return clocks, answers[0]


def table(numbers: list[int], runs: list[list[Clock]]) -> list[str]:
    lines = [" " * 16 + "".join(f"   wall ({n})    cpu ({n})" for n in numbers)]
    for name in (*ORDER, "other", "step"):
        line = f"{name:<16}"
        for clocks in runs:
            for kind in ("wall", "cpu"):
                value = median(clocks, kind, name)
                if name == "other":
                    parts = [part for part in ORDER if not part.startswith(" ")]
                    value = median(clocks, kind, "step") - sum(median(clocks, kind, part) for part in parts)
                line += f"{'-':>12}" if kind == "wall" and name.startswith(" ") else f"{value:12.2f}"
        lines.append(line)
    return lines


def report(count: int, numbers: list[int], number: int, with_numpy: bool) -> str:
    """All figures of one size."""
    method, memory, given = cycles(count, number)
    runs, found = [], None
    for threads_ in numbers:
        clocks, found = measured(method, memory, given, threads_)
        runs.append(clocks)
    assert found is not None
    step, left = median(runs[0], "cpu", "step"), runs[0][0].left
    lines = [f"# {len(given[0][0])} tracks, {found.tested} pairs within the gate, load {os.getloadavg()[0]:.1f}"]
    lines += table(numbers, runs)
    lines.append(
        f"{1e6 * step / found.tested:.0f} ns a pair; screening leaves {100 * left / found.tested:.1f} %, "
        f"{100 * len(found.first) / found.tested:.1f} % are taken"
    )
    if with_numpy:
        windows = association_plain.windows_of(method.step(memory, *given[0], in_turn)[0].history)
        clock = Clock()
        taken = clock.run("step", association_plain.step, method, given[0][0], windows, clock.run)
        parts = ", ".join(f"{name} {ms:.0f}" for name, ms in clock.wall.items() if name != "step")
        wall, cpu = clock.wall["step"] / median(runs[0], "wall", "step"), clock.cpu["step"] / step
        lines.append(
            f"whole arrays: {parts} ms; {wall:.0f} times the wall time of the step on {numbers[0]}, {cpu:.0f} times the "
            f"processor time; {taken} pairs taken, here {len(found.first)}"
        )
    return "\n".join(lines)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tracks", type=int, nargs="+", default=[100_000])
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--cycles", type=int, default=8)
    parser.add_argument("--numpy-up-to", type=int, default=100_000, help="tracks beyond which numpy is not run")
    asked = parser.parse_args()
    for count in asked.tracks:
        print(report(count, asked.threads, asked.cycles, count <= asked.numpy_up_to), flush=True)


if __name__ == "__main__":
    main()
