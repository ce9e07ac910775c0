"""Alarms as server-sent events: on a connection of their own, so that a stalled picture hides none."""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from typing import Any

from coastwatch.operators import export
from coastwatch.operators.api.service import NoPictureYet, Service
from coastwatch.store import Rows, StoreError

KEPT, MOST_ALARMS = 2000, 1000
LOOK_S, SILENCE_S = 1.0, 15.0
CHANGING = ("lasted_s",)
"""Columns that change with every cycle, and are no news."""


class AlarmStream:
    """The changes of alarms, each with a number. One task looks for them while anybody listens, and at once after an acknowledgement."""

    def __init__(self, service: Service, stopping: Callable[[], bool] = lambda: False) -> None:
        """Args: stopping: whether the server ends; events then end too, so that nobody waits for them."""
        self._service, self._stopping, self._run = service, stopping, 0
        self._loop: asyncio.AbstractEventLoop | None = None
        self._listeners: set[asyncio.Event] = set()
        service.acknowledged = self._look_soon
        self._news: deque[tuple[int, str]] = deque(maxlen=KEPT)  # number and row as JSON
        self._known: dict[str, str] = {}
        self._number, self._looked_at = 0, -math.inf
        self._looking = asyncio.Lock()

    async def events(self, last: str, allowed: Callable[[], bool], recheck_s: float) -> AsyncIterator[bytes]:
        """The events for one listener: what it missed, or all that lasts or is not acknowledged; then news as they come.

        Args: last: the id of the last event that it has, "run-number"; empty: none; allowed: whether the listener may go on, asked each
        recheck_s.
        """
        self._loop = asyncio.get_running_loop()
        woken = asyncio.Event()
        self._listeners.add(woken)
        try:
            async for event in self._events(last, allowed, recheck_s, woken):
                yield event
        finally:
            self._listeners.discard(woken)

    async def _events(
        self, last: str, allowed: Callable[[], bool], recheck_s: float, woken: asyncio.Event
    ) -> AsyncIterator[bytes]:
        await self._look()
        run, _, number = last.partition("-")
        at = int(number) if run == str(self._run) and number.isdecimal() else -1
        if at < 0 or (self._news and at < self._news[0][0] - 1):
            for row in list(self._known.values()):
                said = json.loads(row)
                if said["end_utc"] is None or said["acknowledged_utc"] is None:
                    yield self._event(self._number, row)
            at = self._number
        silent_s, looked_at = 0.0, time.monotonic()
        while not self._stopping():
            if time.monotonic() - looked_at >= recheck_s:
                looked_at = time.monotonic()
                if not allowed():
                    return
            await self._look()
            news = [(k, row) for k, row in self._news if k > at]
            for k, row in news:
                yield self._event(k, row)
                at = k
            silent_s = 0.0 if news else silent_s + LOOK_S
            if silent_s >= SILENCE_S:
                yield b": nothing new\n\n"
                silent_s = 0.0
            with suppress(TimeoutError):
                await asyncio.wait_for(woken.wait(), LOOK_S)
            woken.clear()

    async def changes(self) -> AsyncIterator[tuple[str, dict[str, Any]]]:
        """Each alarm as it begins, "opened", and as it ends, "closed", with its row.

        Alarms that are there when a run is first seen are new only if this process has computed the run from its first cycle.
        """
        run, at, told = 0, 0, dict[str, bool]()  # alarm_id and whether its end has been told
        while True:
            await self._look()
            if self._run != run:
                run, told = self._run, {}
                if not self._service.computed_all():
                    told = {key: json.loads(row)["end_utc"] is not None for key, row in self._known.items()}
            for number, row in list(self._news):
                if number <= at:
                    continue
                at, alarm = number, json.loads(row)
                key, ended = alarm["alarm_id"], alarm["end_utc"] is not None
                if key not in told:
                    told[key] = False
                    yield "opened", alarm
                if ended and not told[key]:
                    yield "closed", alarm
                told[key] = ended
            told = {key: ended for key, ended in told.items() if key in self._known}
            await asyncio.sleep(LOOK_S)

    def _look_soon(self) -> None:
        """Have the alarms read at once. It may be called in any thread."""
        if self._loop is not None:
            with suppress(RuntimeError):  # the loop has been closed
                self._loop.call_soon_threadsafe(self._wake)

    def _wake(self) -> None:
        self._looked_at = -math.inf
        for listener in self._listeners:
            listener.set()

    async def _look(self) -> None:
        """Read the alarms, at most once a second for all listeners."""
        async with self._looking:
            now = asyncio.get_running_loop().time()
            if now - self._looked_at < 0.9 * LOOK_S:
                return
            self._looked_at = now
            with suppress(StoreError, NoPictureYet):  # the database may come back
                self._take(await asyncio.to_thread(self._read))

    def _read(self) -> tuple[int, Rows]:
        return self._service.hub.run, self._service.alarms({}, None, MOST_ALARMS)

    def _take(self, found: tuple[int, Rows]) -> None:
        run, rows = found
        if run != self._run:
            self._run, self._known = run, {}
            self._news.clear()
        for said in reversed(export.as_objects(rows)):  # oldest first
            text = json.dumps(said, allow_nan=False)
            before = self._known.get(said["alarm_id"])
            if before is None or _lasting(json.loads(before)) != _lasting(said):
                self._number += 1
                self._news.append((self._number, text))
            self._known[said["alarm_id"]] = text
        there = set(rows.column("alarm_id"))
        self._known = {key: text for key, text in self._known.items() if key in there}

    def _event(self, number: int, row: str) -> bytes:
        return f"id: {self._run}-{number}\nevent: alarm\ndata: {row}\n\n".encode()


def _lasting(row: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in row.items() if name not in CHANGING}
