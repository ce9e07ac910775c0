"""Ranges of a kernel over threads: each taken once, errors told, nothing left behind."""

from __future__ import annotations

import os
import sys
import threading
import time
from functools import partial

import pytest

from coastwatch.kernels.threads import MOST_NICE, NICE, blocks, in_blocks, over_threads, threads

pytestmark = pytest.mark.contract


@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_every_range_is_taken_once_and_told_in_order(count: int) -> None:
    taken: list[tuple[int, int]] = []

    def kernel(low: int, high: int, factor: int) -> int:
        taken.append((low, high))
        return factor * low

    with threads(count):
        ranges = blocks(1000, 1)
        for _ in range(300):  # a helper that comes late finds the work of the next call, or none
            taken.clear()
            assert in_blocks(kernel, 1000, 3, least=1) == [3 * low for low, _ in ranges]
            assert sorted(taken) == ranges
    assert len(ranges) == (1 if count == 1 else 4 * count)


def test_helpers_take_part() -> None:
    met, names = threading.Barrier(3), set()

    def kernel(low: int, high: int) -> None:
        names.add(threading.current_thread().name)
        if low < 3:
            met.wait(20.0)  # which nobody passes alone

    with threads(3):
        in_blocks(kernel, 12, least=1)
    assert len(names) == 3


@pytest.mark.parametrize("who", ["caller", "helper"])
def test_an_error_of_any_thread_is_raised_when_all_have_stopped(who: str) -> None:
    caller, running = threading.current_thread(), set()

    def kernel(low: int, high: int) -> None:
        running.add(threading.current_thread())
        mine = "caller" if threading.current_thread() is caller else "helper"
        if mine == who:
            raise ValueError(f"of the {mine}")
        time.sleep(0.05)
        running.discard(threading.current_thread())

    with threads(2):
        with pytest.raises(ValueError, match=f"of the {who}"):
            in_blocks(kernel, 80, least=1)
        assert [thread for thread in running if (thread is caller) != (who == "caller")] == []
        assert in_blocks(lambda low, high: high - low, 80, least=1) == [10] * 8


@pytest.mark.parametrize("count", [1, 2, 5])
def test_calls_side_by_side_use_one_thread_each_and_a_call_alone_all(count: int) -> None:
    def call(k: int) -> tuple[int, int, list[int]]:
        return k, len(blocks(1000, 1)), in_blocks(lambda low, high: high - low, 1000, least=1)

    with threads(count):
        ranges = len(blocks(1000, 1))
        for calls in (7, 2):
            assert over_threads([partial(call, k) for k in range(calls)]) == [
                (k, ranges if count == 1 else 1, [1000]) for k in range(calls)
            ]
        assert over_threads([partial(call, 3)])[0][1] == ranges
        assert over_threads([]) == []
        with pytest.raises(ZeroDivisionError):
            over_threads([lambda: 1 // 0, lambda: 1])
        assert len(blocks(1000, 1)) == ranges


def test_threads_end_with_the_block() -> None:
    before = threading.active_count()
    with threads(4), threads(2):
        assert len(blocks(1000, 1)) == 8
        in_blocks(lambda low, high: None, 1000, least=1)
        assert threading.active_count() == before + 1
    assert threading.active_count() == before
    assert blocks(1000, 1) == [(0, 1000)]


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux gives each thread a priority of its own")
def test_helpers_give_way_and_the_caller_does_not() -> None:
    ranks: dict[int, int] = {}
    own = threading.get_native_id()

    def kernel(low: int, high: int) -> None:
        time.sleep(0.01)
        ranks[threading.get_native_id()] = os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    with threads(2):
        in_blocks(kernel, 40, least=1)
    before = os.getpriority(os.PRIO_PROCESS, own)
    assert ranks.pop(own) == before
    assert list(ranks.values()) == [min(before + NICE, MOST_NICE)]
