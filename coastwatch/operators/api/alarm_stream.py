"""Alarms as server-sent events: on a connection of their own, so that a stalled picture hides none."""

from __future__ import annotations

import asyncio
import json
import secrets
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager, suppress

from coastwatch.operators import export
from coastwatch.operators.api.service import Service
from coastwatch.server.alarm_book import Alarm, Change

SILENCE_S = 15.0
"""Without a change a comment is sent so often."""

TOGETHER = 100
"""Alarms that are made and sent together: the first ones do not wait for thousands of others."""

STOP_S = 0.5
"""How long a stream may wait without looking whether the server ends."""


class AlarmStream:
    """The changes of alarms for any number of listeners. Each has a number of its own, and reads the book of alarms from there on."""

    def __init__(self, service: Service, stopping: Callable[[], bool] = lambda: False) -> None:
        """Args: stopping: whether the server ends; events then end too, so that nobody waits for them."""
        self._service, self._stopping = service, stopping
        self._process = secrets.token_hex(4)  # numbers begin anew with each process, also where the run goes on

    async def events(self, last: str, allowed: Callable[[], bool], recheck_s: float) -> AsyncIterator[bytes]:
        """The events for one listener: what it missed, or every alarm that is known; then changes as they come.

        A listener that is told of event `run` forgets the alarms that it has. Of many changes the most urgent come first. Only the last
        one of them has the number of all, so that a listener that loses its connection among them is told all of them again.
        Args: last: the id of the last event that it has, "run-number-process"; empty: none; allowed: whether the listener may go on,
        asked each recheck_s.
        """
        book = self._service.book
        run, at = self._position(last)
        silent_since_s = looked_s = time.monotonic()
        async with _woken(self._service) as wait:
            while not self._stopping():
                changes = book.since(run, at)
                if changes is None:
                    run, at, alarms = book.snapshot()
                    before = ""  # whoever has a part of them begins again
                    yield _event("run", before if alarms else self._id(run, at), json.dumps({"run": run}))
                else:
                    alarms = list({change.alarm.alarm_id: change.alarm for change in changes}.values())
                    before, at = self._id(run, at), changes[-1].number if changes else at
                alarms.sort(key=lambda alarm: alarm.urgency)
                for first in range(0, len(alarms), TOGETHER):
                    *others, last_one = self._rows(alarms[first : first + TOGETHER])
                    number = self._id(run, at) if first + TOGETHER >= len(alarms) else before
                    yield b"".join([*(_event("alarm", before, data) for data in others), _event("alarm", number, last_one)])
                now_s = time.monotonic()
                if alarms:
                    silent_since_s = now_s
                elif now_s - silent_since_s >= SILENCE_S:
                    yield b": nothing new\n\n"
                    silent_since_s = now_s
                if now_s - looked_s >= recheck_s:
                    looked_s = now_s
                    if not allowed():
                        return
                await wait(STOP_S)

    async def changes(self) -> AsyncIterator[list[Change]]:
        """The changes as they come, the first ones of this run among them. Alarms that are known when a run begins are no changes."""
        book, run, at = self._service.book, self._service.book.run_id, self._service.book.first - 1
        async with _woken(self._service) as wait:
            while True:
                found = book.since(run, at)
                if found is None:
                    run, at = book.run_id, book.first - 1
                    continue
                if found:
                    at = found[-1].number
                    yield found
                await wait(STOP_S)

    def _id(self, run: int, number: int) -> str:
        return f"{run}-{number}-{self._process}"

    def _position(self, last: str) -> tuple[int, int]:
        """Run and number of the id of an event; -1 where it is none of this process."""
        run, _, rest = last.partition("-")
        number, _, process = rest.partition("-")
        if process != self._process or not (run.isdecimal() and number.isdecimal() and len(last) < 40):
            return -1, -1
        return int(run), int(number)

    def _rows(self, alarms: Sequence[Alarm]) -> list[str]:
        """Alarms as JSON."""
        return [json.dumps(row, allow_nan=False) for row in export.as_objects(self._service.rows_of(alarms))]


@asynccontextmanager
async def _woken(service: Service) -> AsyncIterator[Callable[[float], Awaitable[None]]]:
    """A function that waits for the next change of alarms, for so many seconds at most."""
    loop, event = asyncio.get_running_loop(), asyncio.Event()

    def tell() -> None:
        with suppress(RuntimeError):  # the loop has been closed
            loop.call_soon_threadsafe(event.set)

    async def wait(seconds: float) -> None:
        with suppress(TimeoutError):
            await asyncio.wait_for(event.wait(), seconds)
        event.clear()

    end = service.book.listen(tell)
    try:
        yield wait
    finally:
        end()


def _event(name: str, number: str, data: str) -> bytes:
    return f"id: {number}\nevent: {name}\ndata: {data}\n\n".encode()
