"""How fast is this machine at this minute? `python -m scaling.decisions.ceiling`.

A shared machine is faster at one hour than at another. Figures of a cycle mean little without the speed of the same minute. It
prints bytes a second of a triad, and of windows of 640 bytes read at random. Beside them stand those of a quiet machine of this
kind. The last kernel is a chain, in which each step waits for the last.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numba import njit

LONG, WINDOWS, WINDOW, CHAIN, REPEATS = 10_000_000, 200_000, 80, 20_000_000, 7
QUIET = {("triad", 1): 16.7, ("triad", 2): 32.6, ("random windows", 1): 12.6, ("random windows", 2): 26.1}  # GB/s


@njit(nogil=True)
def _triad(a, b, c):  # type: ignore[no-untyped-def]
    for i in range(len(a)):
        a[i] = b[i] + 3.0 * c[i]


@njit(nogil=True)
def _windows(table, row):  # type: ignore[no-untyped-def]
    total = 0.0
    for r in row:
        for k in range(0, table.shape[1], 8):
            total += table[r, k]
    return total


@njit(nogil=True)
def _chain(count):  # type: ignore[no-untyped-def]
    x = 1.0
    for _ in range(count):
        x = x * 1.0000001 + 1e-9
    return x


def least_s(work: Callable[..., Any], given: list[tuple[Any, ...]]) -> float:
    """The least time of several in which threads, one an entry of `given`, all do their work."""
    best = float("inf")
    with ThreadPoolExecutor(len(given)) as pool:
        for _ in range(REPEATS):
            begun = time.perf_counter()
            for done in [pool.submit(work, *one) for one in given]:
                done.result()
            best = min(best, time.perf_counter() - begun)
    return best


def main() -> None:
    """Print a line for each kernel and number of threads."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    rng = np.random.default_rng(1)
    table, row = np.ones((WINDOWS, WINDOW)), rng.integers(0, WINDOWS, WINDOWS)
    arrays = [tuple(np.ones(LONG) for _ in range(3)) for _ in range(2)]
    print(f"# load {os.getloadavg()[0]:.1f}, {os.cpu_count()} processors")
    for threads in (1, 2):
        for name, work, given, size, unit in (
            ("triad", _triad, arrays, 24 * LONG, "GB/s"),
            ("random windows", _windows, [(table, row)] * 2, 8 * WINDOW * WINDOWS, "GB/s"),
            ("chain", _chain, [(CHAIN,)] * 2, CHAIN, "G/s"),
        ):
            rate = threads * size / least_s(work, given[:threads]) / 1e9
            quiet = QUIET.get((name, threads))
            beside = f", {100 * rate / quiet:.0f} % of {quiet} GB/s when quiet" if quiet else ""
            print(f"{name:<15} {threads} threads {rate:7.2f} {unit}{beside}")


if __name__ == "__main__":
    main()
