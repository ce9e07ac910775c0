"""Writes the cycles of a live run. The run never waits for it: while the database is away cycles wait, then all but the newest are skipped.

What begins and ends, names and acknowledgements are kept of every cycle and written later. Of a skipped cycle the picture is missing.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Self

from coastwatch.batches.struct import size_bytes
from coastwatch.server.timing import Stopwatch
from coastwatch.server.writer import STAGE
from coastwatch.store import CycleRecord, ForCentres, NoSuchRunError, SkippedCycle, StoreError, Written

LOG = logging.getLogger("coastwatch.serve")

MOST_WAITING, MOST_BYTES = 40, 256 << 20
"""Cycles that wait for the database, and their bytes: of more, only the newest keeps its picture."""

MOST_EVENTS, MOST_MESSAGES = 200_000, 200
"""Of skipped cycles: events, and messages for other centres, that wait. The oldest go first."""

MOST_LATER, MOST_ATTEMPTS = 10_000, 5
"""Changes by operators that wait for the database, and how often one is tried that the database refuses."""

ROOM, ROOM_S = 20, 1.0
"""A run that catches up waits while more cycles than this wait, unless the one in writing takes longer than this."""

RETRY_S = (0.5, 1.0, 2.0, 4.0, 8.0, 15.0)
CLOSE_S = 20.0
"""How long the end of a run tries to write what waits."""


@dataclass
class WriterState:
    """How far the database is behind."""

    error: str | None = None  # why the last attempt failed; None: it did not
    since_s: float | None = None  # monotonic time since when attempts fail
    waiting: int = 0  # cycles
    not_stored: int = 0  # pictures that were skipped since the start
    failures: int = 0  # attempts
    forgotten: int = 0  # events, and changes by operators, that had no room or were refused
    warning: str | None = None  # what an operator should see to
    log_bytes: int = 0  # of the write-ahead log of an SQLite database


@dataclass(frozen=True)
class _Waiting:
    """A cycle that waits."""

    record: CycleRecord
    size_bytes: int


@dataclass
class _Later:
    """A change by an operator, to be written once the cycles up to a number are."""

    after: int
    job: Callable[[], Any]
    done: Future[Any]
    attempts: int = 0


class LiveWriter:
    """Writes records in order, in a thread. Use it in a `with` block, which ends when all is written or cannot be."""

    def __init__(
        self,
        watch: Stopwatch,
        write: Callable[[CycleRecord], Written],
        announce: Callable[[CycleRecord], None],
        retry_s: Sequence[float] = RETRY_S,
        catches_up: Callable[[], bool] = lambda: False,
    ) -> None:
        """Args:
        write: may raise StoreError. announce: called once for each record, when it is written or the database is away.
        catches_up: whether the run computes cycles faster than time passes. It may wait then, so that none is skipped.
        """
        self.state = WriterState()
        self.lost: NoSuchRunError | None = None  # the run was deleted: nothing can be written of it any more
        self._watch, self._write, self._announce, self._retry_s = watch, write, announce, tuple(retry_s)
        self._catches_up, self._writing_since_s = catches_up, time.monotonic()
        self._waiting: deque[_Waiting] = deque()
        self._carried: tuple[SkippedCycle, ...] = ()  # from before the records that wait
        self._later: deque[_Later] = deque()
        self._newest = self._written = self._announced = -1  # numbers of cycles
        self._failed_in_a_row = 0
        self._changed = threading.Condition()
        self._close_by_s: float | None = None  # monotonic time; None: it is not to close
        self._thread = threading.Thread(target=self._run, name="store", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, kind: Any, *unused: object) -> None:
        """Raises: StoreError: not all could be written."""
        with self._changed:
            self._close_by_s = time.monotonic() + CLOSE_S
            self._changed.notify_all()
        self._thread.join()
        if self._waiting and kind is None:
            raise StoreError(f"{len(self._waiting)} cycles could not be stored at the end: {self.state.error}")

    @property
    def is_idle(self) -> bool:
        """Whether all records are written."""
        return not self._waiting

    def wait_for_room(self) -> str | None:
        """As of `writer.CycleWriter`: there is always room, but a run that catches up waits for a database that takes its cycles."""
        if self._catches_up():
            with self._changed:
                self._changed.wait_for(lambda: len(self._waiting) <= ROOM or not self._takes_cycles(), ROOM_S)
        return self.state.warning

    def _takes_cycles(self) -> bool:
        return self.state.error is None and time.monotonic() - self._writing_since_s < ROOM_S

    def put(self, record: CycleRecord) -> None:
        """Have a record written. Raises: NoSuchRunError: somebody has deleted the run."""
        if self.lost is not None:
            raise self.lost
        with self._changed:
            if record.checkpoint is not None:  # of older ones nobody has use
                self._waiting = deque(replace(one, record=replace(one.record, checkpoint=None)) for one in self._waiting)
            size = size_bytes(record.cycle) + size_bytes(record.reports) + len(record.for_centres.message or b"")
            self._waiting.append(_Waiting(record, size))
            self._newest = record.number
            self._skip()
            self.state.waiting = len(self._waiting)
            self._changed.notify_all()
        if self.state.error is not None:
            self._announce_waiting()

    def later(self, job: Callable[[], Any]) -> Future[Any]:
        """Have a job run in the thread that writes, once all cycles until now are written."""
        made = _Later(self._newest, job, Future())
        with self._changed:
            self._later.append(made)
            if len(self._later) > MOST_LATER:
                self._give_up(self._later.popleft(), StoreError(f"more than {MOST_LATER} changes wait for the database"))
            self._changed.notify_all()
        return made.done

    def _skip(self) -> None:
        """Keep the picture of the newest record alone where too much waits. The first record may be in writing: it stays."""
        size = sum(one.size_bytes for one in self._waiting)
        if len(self._waiting) < 3 or (len(self._waiting) <= MOST_WAITING and size <= MOST_BYTES):
            return
        first, *others, newest = self._waiting
        gone = [part for one in others for part in (*one.record.merged, one.record.skipped())]
        merged = (*_bounded(gone, self.state), *newest.record.merged)
        self._waiting = deque([first, replace(newest, record=replace(newest.record, merged=merged))])
        self.state.not_stored += len(others)

    def _run(self) -> None:
        while self._has_work():
            try:
                if self._due():
                    self._do_later()
                else:
                    self._write_first()
                with self._changed:
                    self.state.error = self.state.since_s = None
                    self._failed_in_a_row = 0
            except NoSuchRunError as error:
                self._lose(error)
            except StoreError as error:
                self._failed(str(error))
                if not self._wait_to_retry():
                    return
            except Exception as error:  # a defect: what is written about the picture must not end it
                LOG.exception("a cycle cannot be stored")
                self._failed(f"{type(error).__name__}: {error}")
                self._drop_first()

    def _lose(self, error: NoSuchRunError) -> None:
        """Leave all that waits, as there is no run of which it could be."""
        with self._changed:
            self.state.forgotten += sum(len(one.record.cycle.events) for one in self._waiting)
            self.state.not_stored += len(self._waiting)
            self.lost, self.state.waiting, self._carried = error, 0, ()
            self._waiting.clear()
            self._changed.notify_all()
        self._failed(str(error))

    def _has_work(self) -> bool:
        """Wait for work. Returns: False: all is done, and the writer is to close."""
        with self._changed:
            while not (self._waiting or self._due()):
                if self._close_by_s is not None:
                    return False
                self._changed.wait()
            return True

    def _due(self) -> bool:
        """Whether a job is to be done before the next record. After a failure records come first: they show that the database is back."""
        if not self._later or (self._failed_in_a_row and self._waiting):
            return False
        return self._later[0].after <= self._written or not self._waiting

    def _write_first(self) -> None:
        """Raises: StoreError."""
        record = self._waiting[0].record
        began_s, self._writing_since_s = time.perf_counter(), time.monotonic()
        written = self._write(replace(record, merged=(*self._carried, *record.merged)))
        self._watch.late(STAGE, time.perf_counter() - began_s)
        with self._changed:
            self._waiting.popleft()
            self._written, self._carried = record.number, ()
            self.state.waiting, self.state.warning = len(self._waiting), written.warning
            self.state.log_bytes = written.log_bytes
            self._changed.notify_all()
        self._announce_one(record)

    def _do_later(self) -> None:
        """Raises: StoreError: the database may be away."""
        waiting = self._later[0]
        waiting.attempts += 1
        try:
            made = waiting.job()
            if not waiting.done.cancelled():
                waiting.done.set_result(made)
        except Exception as error:
            if isinstance(error, StoreError) and waiting.attempts < MOST_ATTEMPTS:
                raise
            self._give_up(waiting, error)
        with self._changed:
            self._later.popleft()

    def _give_up(self, waiting: _Later, error: Exception) -> None:
        self.state.forgotten += 1
        if not waiting.done.cancelled():
            waiting.done.set_exception(error)

    def _drop_first(self) -> None:
        """Leave the picture of the first record; if the rest of it fails too, all of it."""
        with self._changed:
            if not self._waiting:  # a change by an operator failed
                return
            record = self._waiting.popleft().record
            carried = (*self._carried, *record.merged, record.skipped())
            if self._failed_in_a_row > 1:
                self.state.forgotten += sum(len(one.events) for one in carried)
                carried = tuple(SkippedCycle(one.number, one.time_s, one.why, one.counts) for one in carried)
            self._carried, self._written = carried, record.number
            self.state.not_stored += 1
            self.state.waiting = len(self._waiting)
        self._announce_one(record)

    def _failed(self, said: str) -> None:
        with self._changed:
            self.state.error, self.state.failures = said, self.state.failures + 1
            self.state.since_s = self.state.since_s or time.monotonic()
            self._failed_in_a_row += 1
            self._changed.notify_all()
        self._announce_waiting()

    def _wait_to_retry(self) -> bool:
        """Wait before the next attempt. Returns: False: the writer is to close, and its time is over."""
        wait_s = self._retry_s[min(self._failed_in_a_row, len(self._retry_s)) - 1]
        until_s = time.monotonic() + wait_s
        with self._changed:
            while (left_s := until_s - time.monotonic()) > 0.0:
                if self._close_by_s is not None:
                    left_s = min(left_s, self._close_by_s - time.monotonic(), self._retry_s[0])
                    self._changed.wait(max(left_s, 0.0))
                    break
                self._changed.wait(left_s)
            return self._close_by_s is None or time.monotonic() < self._close_by_s

    def _announce_waiting(self) -> None:
        """Announce the records that wait for a database that is away."""
        for one in list(self._waiting):
            self._announce_one(one.record)

    def _announce_one(self, record: CycleRecord) -> None:
        with self._changed:
            if record.number <= self._announced:
                return
            self._announced = record.number
        with suppress(Exception):  # other centres ask again
            self._announce(record)


def _bounded(skipped: list[SkippedCycle], state: WriterState) -> list[SkippedCycle]:
    """Skipped cycles without what has no room: the oldest events, and the oldest messages for other centres."""
    events, out = 0, []
    for age, one in enumerate(reversed(skipped)):
        kept = one
        events += len(one.events)
        if events > MOST_EVENTS and len(one.events):
            state.forgotten += len(one.events)
            kept = replace(kept, events=type(one.events).empty())
        if age >= MOST_MESSAGES and one.for_centres.message is not None:
            kept = replace(kept, for_centres=ForCentres(None, one.for_centres.intake))
        out.append(kept)
    return out[::-1]
