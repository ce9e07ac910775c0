"""What writing a cycle and asking for one vessel cost, on any database: the figures of coastwatch/store/README.md.

Run: .venv/bin/python scaling/decisions/store_figures.py URL [VESSELS CYCLES]...     (the URL is of an empty database)
The sea is that of tests/store/store_world.py; one vessel in eleven is left out and the others stay, as at sea from one cycle to the next.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "store"))

import store_world as world

from coastwatch import store as kept

EDGE = 20
"""Cycles at the start and at the end whose medians are compared: the end must not be slower."""


def took_ms(act: Callable[[], Any]) -> tuple[float, Any]:
    """Milliseconds that a call took, and what it gave."""
    begun = time.perf_counter()
    given = act()
    return (time.perf_counter() - begun) * 1e3, given


def measure(url: str, vessels: int, cycles: int) -> None:
    """Write a run and read it back, printing one line a figure."""
    same = world.cycle_of(0, vessels)
    with kept.open_store(url) as store:
        run = world.begin(store)
        made = (replace(same, time_s=world.instant_s(number)) for number in range(cycles))
        ms = [
            took_ms(lambda n=n, c=c: world.write(store, run, n, vessels, cycle=c, checkpoint=None))[0]
            for n, c in enumerate(made)
        ]
        print(f"{store.engine.dialect.name}, {len(same.picture)} vessels, {len(same.members)} tracks, {cycles} cycles")
        print(f"  write a cycle: first {statistics.median(ms[:EDGE]):.1f} ms, last {statistics.median(ms[-EDGE:]):.1f} ms")
        vessel = int(same.picture.vessel_id[len(same.picture) // 2])
        for name, act in {
            "track": lambda: kept.track(store, run, vessel),
            "track again": lambda: kept.track(store, run, vessel + 1),
            "picture now": lambda: kept.picture(store, run),
            "picture at an instant": lambda: kept.picture(store, run, world.instant_s(cycles // 2)),
            "question dark_vessels": lambda: kept.operator_query(store, "dark_vessels"),
            "question closest_pairs": lambda: kept.operator_query(store, "closest_pairs"),
        }.items():
            print(f"  {name}: {took_ms(act)[0]:.1f} ms")


if __name__ == "__main__":
    sizes = [int(text) for text in sys.argv[2:]] or [1000, 100]
    for k in range(0, len(sizes), 2):
        measure(sys.argv[1], sizes[k], sizes[k + 1])
