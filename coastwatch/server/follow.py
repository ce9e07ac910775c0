"""Follows a database: a thread that reads the picture whenever a run has written a new one."""

from __future__ import annotations

import threading
from collections.abc import Callable

from coastwatch import store
from coastwatch.server.live_picture import LivePicture, of_store
from coastwatch.store import Store, StoreError

POLL_S = 1.0
OnPicture = Callable[[LivePicture], None]


class Follower:
    """Reads the newest picture of a run, or of the latest run, until it is closed. Use it in a `with` block."""

    def __init__(self, opened: Store, run_id: int | None, on_picture: OnPicture, poll_s: float = POLL_S) -> None:
        self.error: str | None = None  # why the last attempt failed
        self._store, self._run_id, self._on_picture, self._poll_s = opened, run_id, on_picture, poll_s
        self._seen: tuple[int, int] | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._follow, name="follow", daemon=True)

    def __enter__(self) -> Follower:
        self._thread.start()
        return self

    def __exit__(self, *unused: object) -> None:
        self._stop.set()
        self._thread.join()

    def _follow(self) -> None:
        while not self._stop.is_set():
            try:
                self._look()
                self.error = None
            except StoreError as error:  # a database that is away may come back
                self.error = str(error)
            self._stop.wait(self._poll_s)

    def _look(self) -> None:
        """Read the picture if there is a newer one."""
        found = store.newest_picture(self._store, self._run_id)
        if found is None or found[:2] == self._seen:
            return
        self._on_picture(of_store(self._store, *found))
        self._seen = found[:2]
