"""Writes the cycles of a live run. While the database is away cycles wait, then all but the newest are skipped.

A run waits for it only while it catches up. What begins and ends, names and acknowledgements are kept of every cycle and written later.
Of a skipped cycle the picture is missing.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Self, TypeVar

from coastwatch.batches import AisStatics, EventChanges
from coastwatch.batches.struct import size_bytes
from coastwatch.errors import StoreError
from coastwatch.server.link import Backoff
from coastwatch.server.timing import Stopwatch
from coastwatch.server.writing.skipped_cycles import bounded, rows
from coastwatch.server.writing.writer import STAGE
from coastwatch.store import CycleRecord, ForCentres, NoSuchRunError, SkippedCycle, Written

T = TypeVar("T")
LOG = logging.getLogger("coastwatch.serve")

MOST_WAITING, MOST_BYTES = 40, 256 << 20
"""Cycles that wait for the database, and their bytes: of more, only the newest keeps its picture."""

MOST_LATER, MOST_ATTEMPTS = 10_000, 5
"""Changes by operators that wait for the database, and how often one is tried that is refused while cycles are written."""

ROOM, ROOM_S = 20, 1.0
"""A run that catches up waits while more cycles than this wait, unless the one in writing takes longer than this."""

IDLE_S = 30.0
"""A writer without cycles notes that the run is there after so long: else readers on other machines would take it to have died."""

RETRY = Backoff(0.5, 15.0)
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
    failed_s: float | None = None  # monotonic time of the last one
    last_error: str = ""  # why it failed
    forgotten: int = 0  # events, and changes by operators, that had no room or were refused
    warning: str | None = None  # what an operator should see to
    log_bytes: int = 0  # of the write-ahead log of an SQLite database


@dataclass(frozen=True)
class _Waiting:
    """A cycle that waits."""

    record: CycleRecord
    size_bytes: int


class NotYetStored(StoreError):
    """Raised by a change whose subject is not stored yet: it is tried again after the next cycle."""


@dataclass(eq=False)
class _Later:
    """A change by an operator, to be written once the cycles up to a number are."""

    after: int
    job: Callable[[], Any]
    done: Future[Any]
    attempts: int = 0
    written: int = -2  # the newest cycle that was written at the last attempt; -2: there was none


class LiveWriter:
    """Writes records in order, in a thread. Use it in a `with` block, which ends when all is written or cannot be."""

    def __init__(
        self,
        watch: Stopwatch,
        write: Callable[[CycleRecord], Written],
        announce: Callable[[CycleRecord], None],
        retry: Backoff = RETRY,
        catches_up: Callable[[], bool] = lambda: False,
        before: LiveWriter | None = None,
        idle: Callable[[], None] = lambda: None,
    ) -> None:
        """Args:
        write: may raise StoreError. announce: called once for each record, when it is written or the database is away.
        catches_up: whether the run computes cycles faster than time passes. It may wait then, so that none is skipped.
        before: the writer of the attempt before. Its counts go on here. Changes that wait in it are written after the first record.
        idle: called each IDLE_S without a record; may raise StoreError.
        """
        was: WriterState = WriterState() if before is None else before.state
        self.state: WriterState = replace(was, error=None, since_s=None, waiting=0, warning=None, log_bytes=0)
        self.lost: NoSuchRunError | None = None  # the run was deleted: nothing can be written of it any more
        self._watch, self._write, self._announce, self._retry = watch, write, announce, retry
        self._idle = idle
        self._catches_up, self._writing_since_s = catches_up, time.monotonic()
        self._waiting: deque[_Waiting] = deque()
        self._carried: tuple[SkippedCycle, ...] = ()  # from before the records that wait
        changes = () if before is None else before._handed_over()
        self._later = deque(replace(one, after=0, written=-2) for one in changes)
        self._newest = self._written = self._announced = -1  # numbers of cycles
        self._failed_in_a_row = 0
        self._changed = threading.Condition()
        self._close_by_s: float | None = None  # monotonic time; None: it is not to close
        self._thread = threading.Thread(target=self._run, name="store", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, kind: object, *unused: object) -> None:
        """Raises: StoreError: not all could be written."""
        with self._changed:
            self._close_by_s = time.monotonic() + CLOSE_S
            self._changed.notify_all()
        self._thread.join()
        lost = [part.events for one in self._waiting for part in one.record.merged]
        lost += [one.record.cycle.events for one in self._waiting] + [part.events for part in self._carried]
        self.state.forgotten += sum(map(len, lost))
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
                self._changed.wait_for(
                    lambda: (
                        len(self._waiting) <= ROOM
                        or self.state.error is not None
                        or time.monotonic() - self._writing_since_s >= ROOM_S
                    ),
                    ROOM_S,
                )
        return self.state.warning

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

    def later(self, job: Callable[[], T]) -> Future[T]:
        """Have a job run in the thread that writes, once all cycles until now are written. A closed writer keeps it for the next one.

        Args: job: may raise NotYetStored, to be run again after the next cycle.
        """
        with self._changed:
            waiting = _Later(self._newest, job, Future())
            self._later.append(waiting)
            if len(self._later) > MOST_LATER:
                self._give_up(self._later.popleft(), StoreError(f"more than {MOST_LATER} changes wait for the database"))
            self._changed.notify_all()
        return waiting.done

    def end_changes(self, error: StoreError) -> None:
        """Try the changes that wait in a closed writer once more, until the database refuses one. Give up the rest.

        Args: error: for these.
        """
        away = self.state.error is not None
        for one in self._handed_over():
            try:
                if away or (self._waiting and one.after > self._written):
                    raise error
                _finish(one, one.job())
            except Exception as refused:
                away = away or refused.__cause__ is not None
                self._give_up(one, refused)

    def _handed_over(self) -> deque[_Later]:
        """The changes that wait. They are not here any more."""
        with self._changed:
            waiting, self._later = self._later, deque()
        return waiting

    def _skip(self) -> None:
        """Keep the picture of the newest record alone where too much waits. The first record may be in writing: it stays."""
        size = sum(one.size_bytes for one in self._waiting)
        if len(self._waiting) < 3 or (len(self._waiting) <= MOST_WAITING and size <= MOST_BYTES):
            return
        first, *others, newest = self._waiting
        gone = [part for one in others for part in (*one.record.merged, one.record.skipped())]
        kept, forgotten = bounded(gone)
        self.state.forgotten += forgotten
        merged = (*kept, *newest.record.merged)
        self._waiting = deque([first, replace(newest, record=replace(newest.record, merged=merged))])
        self.state.not_stored += len(others)

    def _run(self) -> None:
        while self._has_work():
            try:
                if (due := self._due()) is not None:
                    self._do_later(due)
                elif self._waiting:
                    self._write_first()
                else:
                    self._idle()
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
            self._written = self._newest  # changes that wait for its cycles wait no longer
            self._waiting.clear()
            self._changed.notify_all()
        self._failed(str(error))

    def _has_work(self) -> bool:
        """Wait for work, IDLE_S at most. Returns: False: all is done, and the writer is to close."""
        until_s = time.monotonic() + IDLE_S
        with self._changed:
            while not self._waiting and self._due() is None:
                if self._close_by_s is not None:
                    return False
                if (left_s := until_s - time.monotonic()) <= 0.0:
                    break
                self._changed.wait(left_s)
            return True

    def _due(self) -> _Later | None:
        """The job that is to be done before the next record. After a failure records come first: they show that the database is back."""
        with self._changed:  # nobody adds one meanwhile
            if self._failed_in_a_row and self._waiting:
                return None
            return next((one for one in self._later if one.after <= self._written), None)

    def _write_first(self) -> None:
        """Raises: StoreError."""
        record = self._waiting[0].record
        began_s, self._writing_since_s = time.perf_counter(), time.monotonic()
        written = self._write(replace(record, merged=rows((*self._carried, *record.merged))))
        self._watch.late(STAGE, time.perf_counter() - began_s)
        with self._changed:
            self._waiting.popleft()
            self._written, self._carried = record.number, ()
            self.state.waiting, self.state.warning = len(self._waiting), written.warning
            self.state.log_bytes = written.log_bytes
            self._changed.notify_all()
        self._announce_one(record)

    def _do_later(self, one: _Later) -> None:
        """Raises: StoreError: the database may be away."""
        try:
            _finish(one, one.job())
        except Exception as error:
            if self._may_try_again(one, error):
                if isinstance(error, NotYetStored):
                    return
                raise
            self._give_up(one, error)
        with self._changed, suppress(ValueError):  # it was given up for want of room
            self._later.remove(one)

    def _may_try_again(self, one: _Later, error: Exception) -> bool:
        """Whether a job that failed is tried again. Errors of a driver count only where cycles were written between them."""
        if not isinstance(error, StoreError) or isinstance(error, NoSuchRunError):
            return False
        if one.written != self._written or error.__cause__ is None:
            one.attempts, one.written = one.attempts + 1, self._written
        if isinstance(error, NotYetStored):
            one.after = self._written + 1
        return one.attempts < MOST_ATTEMPTS

    def _give_up(self, one: _Later, error: Exception) -> None:
        self.state.forgotten += 1
        if not one.done.done():
            one.done.set_exception(error)

    def _drop_first(self) -> None:
        """Leave the picture of the first record; if the rest of it fails too, all of it."""
        with self._changed:
            if not self._waiting:  # a change by an operator failed
                return
            record = self._waiting.popleft().record
            carried = (*self._carried, *record.merged, record.skipped())
            if self._failed_in_a_row > 1:
                self.state.forgotten += sum(len(one.events) for one in carried)
                nothing = {
                    "events": EventChanges.empty(),
                    "statics": AisStatics.empty(),
                    "heard": {},
                    "for_centres": ForCentres(),
                }
                carried = tuple(replace(one, **nothing) for one in carried)  # type: ignore[arg-type]
            self._carried, self._written = carried, record.number
            self.state.not_stored += 1
            self.state.waiting = len(self._waiting)
        self._announce_one(record)

    def _failed(self, error: str) -> None:
        with self._changed:
            self.state.error, self.state.failures = error, self.state.failures + 1
            self.state.last_error, self.state.failed_s = error, time.monotonic()
            self.state.since_s = self.state.since_s or time.monotonic()
            self._failed_in_a_row += 1
            self._changed.notify_all()
        self._announce_waiting()

    def _wait_to_retry(self) -> bool:
        """Wait before the next attempt. Returns: False: the writer is to close, and its time is over."""
        until_s = time.monotonic() + self._retry.wait_s(self._failed_in_a_row)
        with self._changed:
            while (left_s := until_s - time.monotonic()) > 0.0:
                if self._close_by_s is not None:
                    left_s = min(left_s, self._close_by_s - time.monotonic(), self._retry.first_s)
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


def _finish(one: _Later, result: object) -> None:
    if not one.done.done():
        one.done.set_result(result)
