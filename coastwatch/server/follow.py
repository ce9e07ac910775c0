"""Follows a database: a thread that reads the picture and the changes of alarms whenever a run has written a new one."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Self, TypeVar

from coastwatch import store
from coastwatch.errors import StoreError
from coastwatch.server.alarm_book import MOST_ENDED, Alarm, AlarmBook
from coastwatch.server.link import FeedState
from coastwatch.server.live_picture import LivePicture, of_store
from coastwatch.server.troubles import Trouble
from coastwatch.store import Cursor, Store

LOG = logging.getLogger("coastwatch.serve")
POLL_S = 1.0
T = TypeVar("T")
OnPicture = Callable[[LivePicture], None]


class Follower:
    """Reads the newest picture of a run, or of the latest run, until it is closed. Use it in a `with` block.

    It is a source of pictures for `operators.api.service`, as a live run is.
    """

    live = failed = False

    def __init__(self, opened: Store, run_id: int | None, on_picture: OnPicture, poll_s: float = POLL_S) -> None:
        self.alarms = AlarmBook()
        self._error: str | None = None  # why the last attempt failed
        self._store, self._run_id, self._on_picture, self._poll_s = opened, run_id, on_picture, poll_s
        self._seen: tuple[int, int] | None = None
        self._cursor: Cursor | None = None  # up to where changes of alarms were read; None: they are read anew
        self._stop, self._woken = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._follow, name="follow", daemon=True)
        self._changes = ThreadPoolExecutor(1, "changes")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *unused: object) -> None:
        self._changes.shutdown(wait=False, cancel_futures=True)
        self._stop.set()
        self._woken.set()
        self._thread.join()

    def error(self) -> str | None:
        """As of `operators.api.service.Source`, and so are the functions below."""
        return self._error

    def feeds(self) -> Sequence[FeedState]:
        return ()

    def cycle_s(self) -> float | None:
        return None

    def counts(self) -> dict[str, float]:
        return {}

    def troubles(self) -> list[Trouble]:
        return []

    def about(self) -> None:
        """Nothing is known of the run without the database."""

    def now_s(self) -> float:
        return time.time()

    def later(self, job: Callable[[], T]) -> Future[T]:
        future = self._changes.submit(job)
        future.add_done_callback(lambda _: self._woken.set())
        return future

    def _follow(self) -> None:
        while not self._stop.is_set():
            try:
                self._read_changes()
                self._error = None
            except StoreError as error:  # a database that is away may come back
                self._error = str(error)
            except Exception as error:  # of one look: the next one may succeed
                LOG.exception("the database cannot be followed")
                self._error = f"{type(error).__name__}: {error}"
            self._woken.wait(self._poll_s)
            self._woken.clear()

    def _read_changes(self) -> None:
        """Read the picture if there is a newer one, and what has changed of the alarms."""
        newest = store.newest_picture(self._store, self._run_id)
        if newest is None:
            return
        run_id = newest[0]  # alarms come first: they wait for no picture, and a large one takes seconds
        before = self._cursor if self.alarms.run_id == run_id else None
        rows, now = store.changed_alarms(self._store, run_id, before, MOST_ENDED)
        if before is not None and (now.process != before.process or now.cycle < before.cycle):
            before = None  # the run has begun again at an older cycle
            rows, now = store.changed_alarms(self._store, run_id, None, MOST_ENDED)
        if before is None:
            self.alarms.begin(run_id, (Alarm(*row) for row in rows.rows))
        else:
            self.alarms.compare(rows)
        self._cursor = now
        if newest[:2] != self._seen:
            self._on_picture(of_store(self._store, *newest))
            self._seen = newest[:2]
