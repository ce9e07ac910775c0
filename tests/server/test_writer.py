"""Jobs run beside what comes after them, one at a time, at most `behind` unfinished; errors come later."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress

import pytest

from coastwatch.server.timing import Stopwatch
from coastwatch.server.writing.writer import Writer

pytestmark = pytest.mark.contract

PATIENCE_S = 30.0


def test_a_job_runs_while_the_caller_goes_on() -> None:
    watch, go = Stopwatch(), threading.Event()
    with Writer[bool](watch, overlap=True) as writer:
        assert writer.wait() is None
        writer.start(lambda: go.wait(PATIENCE_S))
        go.set()  # reached only because `start` did not wait
        assert writer.wait() is True
        assert writer.wait() is None


@pytest.mark.parametrize("overlap", [False, True])
def test_jobs_are_done_in_order_and_all_of_them(overlap: bool) -> None:
    done: list[int] = []
    with Writer[None](Stopwatch(), overlap) as writer:
        for number in range(20):
            writer.wait()
            assert done == list(range(number))
            writer.start(lambda n=number: done.append(n))  # type: ignore[misc]
    assert done == list(range(20))


def test_a_slow_job_delays_only_the_caller_that_is_too_far_ahead() -> None:
    go, done = threading.Event(), []  # type: ignore[var-annotated]
    with Writer[int](Stopwatch(), overlap=True, behind=2) as writer:
        writer.start(lambda: (go.wait(PATIENCE_S), 0)[1])
        assert writer.wait() is None
        writer.start(lambda: 1)
        assert writer.wait() is None
        writer.start(lambda: 2)
        threading.Timer(0.05, lambda: (done.append("went"), go.set())).start()
        assert writer.wait() == 0
        assert done == ["went"]  # the third job was one too many
        found = [writer.wait()]
        while found[-1] != 2:  # at most two are unfinished, so it does not wait for them
            found.append(writer.wait())
        assert [value for value in found if value is not None] == [1, 2]


def start_all(writer: Writer[None], *jobs: Callable[[], None]) -> None:
    for job in jobs:
        writer.start(job)


def test_no_job_is_run_after_one_that_failed() -> None:
    done: list[int] = []
    with pytest.raises(OSError, match="no room"), Writer[None](Stopwatch(), overlap=True, behind=2) as writer:
        start_all(writer, fail, lambda: done.append(1))
    assert done == []


def fail() -> None:
    raise OSError("no room")


def test_what_a_job_raises_is_raised_at_the_next_one() -> None:
    with Writer[None](Stopwatch(), overlap=True) as writer:
        writer.start(fail)
        with pytest.raises(OSError, match="no room"):
            writer.wait()


def test_what_the_last_job_raises_is_raised_in_the_end() -> None:
    with pytest.raises(OSError, match="no room"), Writer[None](Stopwatch(), overlap=True) as writer:
        writer.start(fail)


def test_a_job_is_finished_though_the_caller_fails() -> None:
    done = threading.Event()

    def job() -> None:
        time.sleep(0.05)
        done.set()

    with suppress(KeyboardInterrupt), Writer[None](Stopwatch(), overlap=True) as writer:
        writer.start(job)
        raise KeyboardInterrupt
    assert done.is_set()


def test_seconds_of_a_job_are_its_own_and_stand_in_the_next_row() -> None:
    watch, go = Stopwatch(), threading.Event()
    with Writer[bool](watch, overlap=True) as writer:
        writer.start(lambda: go.wait(PATIENCE_S))
        with watch("tracks"):
            assert set(watch.so_far()) == set()
        watch.lap()
        threading.Timer(0.05, go.set).start()
        writer.wait()
        row = watch.so_far()
        assert set(row) == {"store", "store_wait"}
        assert row["store"] > 0.0
        assert row["store_wait"] > 0.0
        watch.lap()
        assert watch.so_far() == {"store": row["store"]}
    assert watch.seconds["store"].tolist() == [row["store"]]
    assert set(watch.summary()) == {"tracks", "store", "store_wait"}
