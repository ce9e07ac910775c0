"""Alarms as server-sent events: on a connection of their own, so that a stalled picture hides none."""

from __future__ import annotations

import asyncio
import json
import logging
import re
import secrets
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import suppress

from coastwatch.operators import export
from coastwatch.operators.api.service import Service
from coastwatch.operators.api.streaming import woken_by
from coastwatch.server.alarm_book import Alarm, Change

SILENCE_S = 15.0
"""Without a change a comment is sent so often."""

PORTION = 100
"""Alarms that are sent at a time. Then others come first that are more urgent."""

PROCESS = secrets.token_hex(4)
"""Stands in the id of each event: numbers begin anew with each process, also where the run goes on."""

EVENT_ID = re.compile(rf"(\d{{1,18}})-(\d{{1,18}})-{PROCESS}")
"""Run, number of the change, process."""

LOG = logging.getLogger("coastwatch.serve")
STOP_S = 0.5
"""How long a stream may wait without looking whether the server ends."""


class AlarmStream:
    """The changes of alarms for any number of listeners. Each has a number of its own, and reads the book of alarms from there on."""

    def __init__(self, service: Service, stopping: Callable[[], bool] = lambda: False) -> None:
        """Args: stopping: whether the server ends; events then end too, so that nobody waits for them."""
        self._service, self._stopping = service, stopping

    async def events(self, last: str, allowed: Callable[[], bool], recheck_s: float) -> AsyncIterator[bytes]:
        """The events for one listener: what it missed, or every alarm that is known; then changes as they come.

        A listener that is told of event `run` forgets the alarms that it has. Of all that wait the most urgent come first, also of
        those that come while a long list is sent. Only the last one of them has the number of all, so that a listener that loses its
        connection among them is told all of them again.
        Args: last: the id of the last event that it has, "run-number"; empty: none; allowed: whether the listener may go on, asked each
        recheck_s.
        """
        book = self._service.book
        event = EVENT_ID.fullmatch(last)  # else of another process, or there is none
        run, at = (int(event[1]), int(event[2])) if event else (-1, -1)
        mark, waiting, order = f"{run}-{at}", dict[str, Alarm](), list[str]()  # order: the most urgent last
        silent_since_s = looked_s = time.monotonic()
        async with woken_by(self._service.book.listen) as wake:
            while not self._stopping():
                changes = [] if book.run_id < 0 else book.since(run, at)  # before a run there are no alarms, and none are gone
                if changes is None:
                    run, at, alarms = book.snapshot()
                    waiting = {alarm.alarm_id: alarm for alarm in alarms}
                    mark = "" if waiting else f"{run}-{at}"  # whoever has a part of them begins again
                    yield _event("run", mark, json.dumps({"run": run}))
                elif changes:
                    waiting |= {change.alarm.alarm_id: change.alarm for change in changes}
                    at = changes[-1].number
                if changes is None or changes:
                    order = sorted(waiting, key=lambda alarm_id: waiting[alarm_id].urgency, reverse=True)
                portion = [waiting.pop(order.pop()) for _ in range(min(PORTION, len(order)))]
                before, mark = mark, mark if waiting else f"{run}-{at}"
                texts = [text for text in as_json(self._service, portion) if text is not None]
                if texts:
                    marks = [before] * (len(texts) - 1) + [mark]
                    yield b"".join(_event("alarm", mark, text) for mark, text in zip(marks, texts, strict=True))
                now_s = time.monotonic()
                if portion:
                    silent_since_s = now_s
                elif now_s - silent_since_s >= SILENCE_S:
                    yield b": nothing new\n\n"
                    silent_since_s = now_s
                if now_s - looked_s >= recheck_s:
                    looked_s = now_s
                    if not allowed():
                        return
                await (asyncio.sleep(0.0) if waiting else _wait(wake, STOP_S))

    async def changes(self) -> AsyncIterator[list[Change]]:
        """The changes as they come, the first ones of this run among them. Alarms that are known when a run begins are no changes."""
        book, run, at = self._service.book, self._service.book.run_id, self._service.book.first - 1
        async with woken_by(self._service.book.listen) as wake:
            while True:
                changes = book.since(run, at)
                if changes is None:
                    run, at = book.run_id, book.first - 1
                    continue
                if changes:
                    at = changes[-1].number
                    yield changes
                await _wait(wake, STOP_S)


def as_json(service: Service, alarms: Sequence[Alarm]) -> list[str | None]:
    """Each alarm as an object of JSON; None: it cannot be written, which the log has. One of them holds up no other."""
    try:
        return [json.dumps(row, allow_nan=False) for row in export.as_objects(service.rows_of(alarms))]
    except Exception:
        if len(alarms) > 1:
            return [text for alarm in alarms for text in as_json(service, [alarm])]
        LOG.exception("an alarm cannot be sent", extra={"fields": {"alarm": [alarm.alarm_id for alarm in alarms]}})
        return [None] * len(alarms)


async def _wait(wake: asyncio.Event, seconds: float) -> None:
    """Wait for the next change of alarms, for so many seconds at most."""
    with suppress(TimeoutError):
        await asyncio.wait_for(wake.wait(), seconds)
    wake.clear()


def _event(name: str, number: str, data: str) -> bytes:
    shown = f"{number}-{PROCESS}" if number else ""
    return f"id: {shown}\nevent: {name}\ndata: {data}\n\n".encode()
