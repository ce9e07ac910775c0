"""Alarms over the API: as rows, as server-sent events on a connection of their own, and acknowledged by operators."""

from __future__ import annotations

import asyncio
import json
import logging
import re
import secrets
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import suppress
from typing import Annotated

from fastapi import APIRouter, HTTPException, Path, Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from coastwatch import store
from coastwatch.batches import ALARM_KINDS
from coastwatch.batches.kinds import ZONE_KINDS
from coastwatch.operators import export, presentation
from coastwatch.operators.api.answers import (
    REFUSALS,
    ROWS,
    As,
    Form,
    In,
    Limit,
    Offset,
    Text,
    answer,
    page_headers,
    parsed_span,
)
from coastwatch.operators.api.service import Service
from coastwatch.operators.api.validation import CheckedRoute
from coastwatch.server.alarm_book import Alarm, Change
from coastwatch.server.listeners import woken_by
from coastwatch.spelling import ONE_LINE
from coastwatch.store import Asked, Beginnings, State

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

ALL_KINDS = "alarms"
MOST_ZONE = 10**9
LARGEST = 2**31 - 1

router = APIRouter(prefix="/api/v1", responses=REFUSALS, route_class=CheckedRoute)


class ChosenAlarms(BaseModel):
    """Which alarms."""

    model_config = ConfigDict(extra="forbid")

    format: Form | None = None
    state: State = "all"  # waiting: lasting or not acknowledged
    kind: Text = None
    start: Annotated[str | None, Field(alias="from", max_length=40)] = None
    end: Annotated[str | None, Field(alias="to", max_length=40)] = None
    run: Annotated[int | None, Field(ge=1, le=LARGEST)] = None  # none: the newest of the server that holds the times
    limit: Limit = 1000
    offset: Offset = 0


@router.get("/alarms", responses=ROWS)
def alarms(request: Request, service: In, form: As, chosen: Annotated[ChosenAlarms, Query()]) -> Response:
    """The alarms, the most urgent first, then the newest: distress, silent sensors, danger, others. `Link` has the next page.

    An alarm is every flag but coasting and stationary, and every kind of `[alarms]`, from when until when it held. Times before
    the run began are answered from the run of the server that holds them; `warning` says where others hold some of them too.
    """
    if chosen.kind is not None and chosen.kind not in (ALL_KINDS, *ALARM_KINDS):
        raise HTTPException(400, f"kind: got {chosen.kind!r}, needed one of {', '.join((ALL_KINDS, *ALARM_KINDS))}")
    kinds = ALARM_KINDS if chosen.kind in (None, ALL_KINDS) else (str(chosen.kind),)
    from_s, to_s = parsed_span(chosen.start, chosen.end)
    run_id, warning = chosen.run or service.run_id(), ""
    if not store.has_run(service.store, run_id):
        raise HTTPException(404, f"run: got {run_id}, needed one of /api/v1/runs")
    if chosen.run is None and (from_s, to_s) != (None, None):
        held = store.runs_between(service.store, run_id, from_s, to_s)
        run_id, warning = held[0], presentation.of_other_runs(held, run_id)
    rows, total = service.alarms(Asked(chosen.state, kinds, from_s, to_s, limit=chosen.limit, offset=chosen.offset), run_id)
    headers = page_headers(request, total, chosen.offset, chosen.limit)
    head: dict[str, object] = {"run": run_id, "total": total}
    if warning:
        head["warning"] = headers["X-Warning"] = warning
    return answer(rows, form, "alarms", head, headers)


class Acknowledged(BaseModel):
    """Who acknowledges an alarm."""

    model_config = ConfigDict(extra="forbid", str_strip_whitespace=True)

    name: Annotated[str, Field(min_length=1, max_length=64, pattern=ONE_LINE)]
    note: Annotated[str, Field(max_length=500, pattern=ONE_LINE)] = ""


class AcknowledgedTogether(Acknowledged):
    """Who acknowledges which alarms."""

    kind: Annotated[str | None, Field(max_length=40)] = None
    zone: Annotated[int, Field(ge=1, le=MOST_ZONE)] | None = None
    start: Annotated[str, Field(alias="from", max_length=40)]
    end: Annotated[str, Field(alias="to", max_length=40)]


@router.post("/alarms/acknowledge")
def acknowledge_together(which: AcknowledgedTogether, request: Request, service: In) -> dict[str, int]:
    """Acknowledge, with one name and note, every alarm that began between two instants: of a kind, of a zone, or all."""
    if which.kind is not None and which.kind not in ALARM_KINDS:
        raise HTTPException(400, f"kind: got {which.kind!r}, needed one of {', '.join(ALARM_KINDS)}")
    from_s, to_s = parsed_span(which.start, which.end)
    kinds = [each for each in ALARM_KINDS if which.kind in (None, each) and (which.zone is None or each in ZONE_KINDS)]
    chosen = Beginnings(kinds, which.zone, from_s or 0.0, to_s or 0.0)
    return {"acknowledged": service.acknowledge_all(chosen, which.name, which.note, request.state.who)}


@router.post("/alarms/{alarm_id}/acknowledge")
def acknowledge(
    alarm_id: Annotated[str, Path(max_length=80)], by: Acknowledged, request: Request, service: In
) -> dict[str, object]:
    """Acknowledge an alarm with a name and a note. The first one counts, and its row is the audit. Returns: the alarm."""
    rows = service.acknowledge(alarm_id, by.name, by.note, request.state.who)
    if rows is None or not rows.rows:
        raise HTTPException(404, f"alarm: got {alarm_id!r}, needed an alarm_id of /api/v1/alarms")
    (alarm,) = export.as_objects(rows)
    return alarm


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
        """The changes as they come, the first ones of this run among them. Alarms that are known when a run begins are no changes, but
        for those that the process before this one may not have sent.
        """
        book, run, at = self._service.book, -1, 0
        async with woken_by(self._service.book.listen) as wake:
            while True:
                changes = book.since(run, at)
                if changes is None:
                    is_new, run, at = book.run_id != run, book.run_id, book.first - 1
                    if is_new and book.repeated:  # not to one that fell behind: it was told
                        yield list(book.repeated)
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
