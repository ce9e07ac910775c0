"""Web hooks: a POST of JSON to other systems for each alarm that begins or ends. They never hold up a cycle or a viewer."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from typing import Any

import httpx

from coastwatch.operators.api.alarm_stream import AlarmStream
from coastwatch.operators.api.metrics import Metrics
from coastwatch.operators.api.webhook_settings import WebHook, signature

WAITING, TIME_OUT_S = 1000, 10.0
RETRY_AFTER_S = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 60.0)
AGAIN = (408, 425, 429)
"""Refusals after which the same message may be taken later."""


class _Sender:
    """The messages to one hook, in order. When too many wait, the oldest are dropped and counted."""

    def __init__(self, hook: WebHook, metrics: Metrics, retry_after_s: Sequence[float]) -> None:
        self.hook, self._retry_after_s = hook, retry_after_s
        self._waiting: asyncio.Queue[tuple[str, bytes]] = asyncio.Queue(WAITING)
        self._count = {name: metrics.webhooks.labels(hook.name, name) for name in ("sent", "retried", "failed", "dropped")}

    def take(self, what: str, alarm: dict[str, Any]) -> None:
        """Let a message wait, if the hook wants this kind. Args: what: opened or closed."""
        if self.hook.kinds and alarm["kind"] not in self.hook.kinds:
            return
        if self._waiting.full():
            self._waiting.get_nowait()
            self._count["dropped"].inc()
        self._waiting.put_nowait((f"{alarm['alarm_id']}-{what}", json.dumps({"event": what, "alarm": alarm}).encode()))

    async def run(self) -> None:
        """Send for ever."""
        async with httpx.AsyncClient(timeout=TIME_OUT_S, follow_redirects=False) as client:
            while True:
                await self._send(client, *await self._waiting.get())

    async def _send(self, client: httpx.AsyncClient, number: str, body: bytes) -> None:
        """Send one message, again while nobody takes it. A refusal that will not change ends it at once."""
        for wait_s in (*self._retry_after_s, None):
            status = await self._post(client, number, body)
            if 200 <= status < 300:
                self._count["sent"].inc()
                return
            if wait_s is None or (300 <= status < 500 and status not in AGAIN):
                self._count["failed"].inc()
                return
            self._count["retried"].inc()
            await asyncio.sleep(wait_s)

    async def _post(self, client: httpx.AsyncClient, number: str, body: bytes) -> int:
        """The status of the answer; 0: there was none."""
        stamp = str(int(time.time()))
        headers = {"Content-Type": "application/json", "X-Coastwatch-Delivery": number, "X-Coastwatch-Timestamp": stamp}
        if self.hook.secret:
            headers["X-Coastwatch-Signature"] = signature(self.hook.secret, stamp, body)
        try:
            return (await client.post(self.hook.url, content=body, headers=headers)).status_code
        except (httpx.HTTPError, httpx.InvalidURL, OSError):
            return 0


@asynccontextmanager
async def sending(
    hooks: Sequence[WebHook], alarms: AlarmStream, metrics: Metrics, retry_after_s: Sequence[float] = RETRY_AFTER_S
) -> AsyncIterator[None]:
    """Send alarms to the hooks while the block runs."""
    senders = [_Sender(hook, metrics, retry_after_s) for hook in hooks]

    async def follow() -> None:
        async for what, alarm in alarms.changes():
            for sender in senders:
                sender.take(what, alarm)

    tasks = [asyncio.create_task(job) for job in ([follow()] if senders else [])]
    tasks += [asyncio.create_task(sender.run()) for sender in senders]
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        for task in tasks:
            with suppress(asyncio.CancelledError):
                await task
