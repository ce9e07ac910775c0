"""The cycles of tracks of a region for its centres: the newest in memory, older ones from its database."""

from __future__ import annotations

import threading
from collections import deque

import numpy as np

from coastwatch import store
from coastwatch.batches import Sensors
from coastwatch.centre import Cycle
from coastwatch.server.listeners import Listeners
from coastwatch.server.regions.link import IN_FLIGHT, Position
from coastwatch.server.regions.message import MessageError, RegionCycle, encode, radar_tracks, run_number
from coastwatch.store import Store

IN_MEMORY = 2 * IN_FLIGHT

Message = tuple[Position, bytes]


class Publisher:
    """Makes the messages of a run, and gives them to those who ask. All of it may be called in any thread."""

    def __init__(self, opened: Store) -> None:
        self._store = opened
        self._newest: deque[Message] = deque(maxlen=IN_MEMORY)
        self._runs: dict[int, str] = {}
        self._listeners = Listeners()
        self.listen = self._listeners.listen
        """As of `Listeners`: a function is called after each new cycle."""
        self._lock = threading.Lock()

    def message(self, run_id: int, number: int, cycle: Cycle, sensors: Sensors, merged: int = 0) -> bytes:
        """The message of a cycle, to be stored with it. Args: merged: cycles before it that are computed in it."""
        mine = np.asarray(cycle.tracks.source < len(sensors.region_names))
        tracks = radar_tracks(cycle.tracks, mine)
        return encode(RegionCycle(self._run(run_id), number + 1, cycle.time_s, tracks, merged))

    def written(self, run_id: int, number: int, message: bytes) -> None:
        """A cycle is in the database: those who wait are told."""
        with self._lock:
            self._newest.append((Position(self._run(run_id), number + 1), message))
        self._listeners.tell()

    def after(self, position: Position, count: int, from_s: float) -> list[Message]:
        """The messages after the last one that a centre has, at most so many.

        Args: from_s: where it has none of a run that is known here, it gets those of the newest run that end after this instant.
        """
        with self._lock:
            newest = list(self._newest)
        at = next((k for k, (sent, _) in enumerate(newest) if sent == position), None)
        if at is not None:
            return newest[at + 1 : at + 1 + count]
        try:
            run_id, cycle = run_number(position.run), position.seq - 1
            is_known = store.run_key(self._store, run_id) == position.run
        except MessageError:  # of no run
            is_known = False
        if not is_known:  # or of another database
            start = store.journal_start(self._store, from_s)
            if start is None:
                return []
            run_id, cycle = start
        rows = store.journal_after(self._store, run_id, cycle, count)
        return [(Position(self._run(row.run_id), row.cycle + 1), row.message) for row in rows]

    def _run(self, run_id: int) -> str:
        if run_id not in self._runs:
            self._runs[run_id] = store.run_key(self._store, run_id) or f"{run_id}@"
        return self._runs[run_id]
