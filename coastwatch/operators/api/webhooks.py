"""Web hooks: a POST of JSON to other systems for each alarm that begins, ends or returns. They never hold up a cycle or a viewer."""

from __future__ import annotations

import asyncio
import hashlib
import heapq
import hmac
import logging
import time
from collections import deque
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from typing import NamedTuple
from urllib.parse import urlsplit

import httpx2 as httpx

from coastwatch.batches import ALARM_KINDS
from coastwatch.batches.kinds import DISTRESS
from coastwatch.errors import InputError
from coastwatch.operators.api.alarms import PORTION, AlarmStream, as_json
from coastwatch.operators.api.service import Service
from coastwatch.server.alarm_book import Change
from coastwatch.server.link import Backoff, first_line, reason_of
from coastwatch.server.troubles import Trouble

LOG = logging.getLogger("coastwatch.serve")
WAITING, TIME_OUT_S = 50_000, 10.0
"""Messages that wait for one hook, and how long it may take to answer one."""

MOST_ANSWER = 1 << 14
"""Bytes of the text of an answer that are read. None of them is used."""

RETRY, MOST_RETRIES = Backoff(1.0, 60.0), 7
MOST_DISTRESS = 50
"""Messages of distress that are sent beside the others. More of them wait in their line, and are first there."""

AGAIN = (408, 425, 429)
"""Refusals after which the same message may be taken later."""

TOLD = ("opened", "closed", "returned")
"""Changes of which a hook is told."""


@dataclass(frozen=True)
class WebHook:
    """Who is told of which alarms."""

    url: str
    kinds: tuple[str, ...] = ()  # of alarms; none: all
    secret: str = ""  # signs each message; empty: no signature

    @property
    def name(self) -> str:
        """Host and port: a path or a query may hold a secret."""
        return urlsplit(self.url).netloc.rpartition("@")[2]


def checked(hook: WebHook) -> WebHook:
    """The hook, if it can work. Raises: InputError."""
    if urlsplit(hook.url).scheme not in ("http", "https") or not hook.name:
        raise InputError(f"webhook: got {hook.name or hook.url[:40]!r}, needed an address such as https://host/path")
    if "#" in hook.url:  # HTTP sends nothing of what is behind it
        raise InputError(f"webhook {hook.name}: got '#' in its address, needed %23 for one that is meant")
    unknown = [kind for kind in hook.kinds if kind not in ALARM_KINDS]
    if unknown:
        raise InputError(f"webhook {hook.name}: kinds: got {unknown[0]!r}, needed some of {', '.join(ALARM_KINDS)}")
    return hook


def signature(secret: str, timestamp: str, body: bytes) -> str:
    """The value of X-Coastwatch-Signature: "sha256=" and HMAC-SHA256 of timestamp, point and body."""
    return "sha256=" + hmac.new(secret.encode(), timestamp.encode() + b"." + body, hashlib.sha256).hexdigest()


def secret_of(path: str | None) -> str:
    """The secret in the first line of a file; empty: no file. Raises: InputError that names the file."""
    if path is None:
        return ""
    try:
        secret = first_line(path)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from error
    if not secret:
        raise InputError(f"{path}: got an empty first line, needed the secret that signs messages to web hooks")
    return secret


class _Message(NamedTuple):
    """A message to a hook. The most urgent comes first, then the oldest."""

    priority: int
    number: int  # of the change
    alarm_id: str
    name: str
    body: bytes
    attempts: int = 0


class _Sender:
    """The messages to one hook, the most urgent first. When too many wait, the least urgent ones are dropped and counted."""

    def __init__(self, hook: WebHook, service: Service, retry: Backoff) -> None:
        self.hook, self._retry = hook, retry
        self._waiting: list[_Message] = []  # a heap
        self._distress: dict[str, deque[_Message]] = {}  # by alarm: what waits, and the first of it is being sent
        self._tasks: set[asyncio.Task[None]] = set()
        self._woken = asyncio.Event()
        self._client = httpx.AsyncClient(timeout=TIME_OUT_S, follow_redirects=False)
        counts = ("sent", "retried", "failed", "dropped")
        self._count = {name: service.metrics.webhooks.labels(hook.name, name) for name in counts}
        self._failures, self._failing_since_s, self._reason = 0, 0.0, ""  # deliveries since the last that was taken
        self._tries_again = True  # the one that failed last

    def troubles(self) -> list[Trouble]:
        """That deliveries fail, until one is taken."""
        if not self._failures:
            return []
        deliveries = "1 delivery" if self._failures == 1 else f"{self._failures} deliveries"
        text = f"{deliveries} failed, the last: {self._reason}; {'' if self._tries_again else 'not '}tried again"
        return [Trouble("webhook", self.hook.name, self._failing_since_s, text, False)]

    def enqueue(self, messages: Sequence[tuple[str, _Message]]) -> None:
        """Let messages wait, if the hook wants their kinds. Distress waits for no message of another alarm.

        Args: messages: with the kind of the alarm.
        """
        for kind, message in messages:
            if self.hook.kinds and kind not in self.hook.kinds:
                continue
            if message.alarm_id in self._distress:
                self._distress[message.alarm_id].append(message)
            elif message.priority == DISTRESS and len(self._distress) < MOST_DISTRESS:
                self._distress[message.alarm_id] = deque([message])
                task = asyncio.get_running_loop().create_task(self._deliver(message.alarm_id))
                self._tasks.add(task)
                task.add_done_callback(self._tasks.discard)
            else:
                heapq.heappush(self._waiting, message)
        if len(self._waiting) > WAITING:
            kept = heapq.nsmallest(WAITING * 9 // 10, self._waiting)  # sorted, and so a heap
            self._count["dropped"].inc(len(self._waiting) - len(kept))
            self._waiting = kept
        if self._waiting:
            self._woken.set()

    async def run(self) -> None:
        """Send for ever. A message that nobody takes is sent again, after more urgent ones that came since."""
        try:
            while True:
                while not self._waiting:
                    self._woken.clear()
                    await self._woken.wait()
                message = heapq.heappop(self._waiting)
                again_after_s = await self._send(message)
                if again_after_s is not None:
                    heapq.heappush(self._waiting, message._replace(attempts=message.attempts + 1))
                    await asyncio.sleep(again_after_s)
        finally:
            for task in self._tasks:
                task.cancel()
            await asyncio.gather(*self._tasks, return_exceptions=True)
            await self._client.aclose()

    async def _deliver(self, alarm_id: str) -> None:
        """Send the messages of one alarm in their order, each until it is taken or refused for good."""
        waiting = self._distress[alarm_id]
        while waiting:
            message = waiting[0]
            while (again_after_s := await self._send(message)) is not None:
                message = message._replace(attempts=message.attempts + 1)
                await asyncio.sleep(again_after_s)
            waiting.popleft()
        del self._distress[alarm_id]

    async def _send(self, message: _Message) -> float | None:
        """Send a message. Returns: seconds until it is to be sent again; None: it was taken, or refused for good."""
        try:
            status, reason = await self._post(self._client, message)
        except Exception as error:  # an error of one message ends no other
            LOG.exception("a message cannot be sent to a web hook", extra={"fields": {"webhook": self.hook.name}})
            self._failed(type(error).__name__, again=False)
            return None
        if 200 <= status < 300:
            self._count["sent"].inc()
            self._failures = 0
            return None
        again = message.attempts < MOST_RETRIES and (not 300 <= status < 500 or status in AGAIN)
        self._failed(reason, again=again)
        return self._retry.wait_s(message.attempts + 1) if again else None

    def _failed(self, reason: str, *, again: bool) -> None:
        """Note that a delivery failed. Args: again: whether its message is sent again."""
        self._count["retried" if again else "failed"].inc()
        if not self._failures:
            self._failing_since_s = time.time()
        self._failures, self._reason, self._tries_again = self._failures + 1, reason, again

    async def _post(self, client: httpx.AsyncClient, message: _Message) -> tuple[int, str]:
        """The status of the answer, and what it says; 0: there was none, and why."""
        stamp = str(int(time.time()))
        headers = {"Content-Type": "application/json", "X-Coastwatch-Delivery": message.name, "X-Coastwatch-Timestamp": stamp}
        if self.hook.secret:
            headers["X-Coastwatch-Signature"] = signature(self.hook.secret, stamp, message.body)
        status, reason = 0, ""
        try:
            async with (
                asyncio.timeout(TIME_OUT_S),
                client.stream("POST", self.hook.url, content=message.body, headers=headers) as answer,
            ):
                status, size = answer.status_code, 0
                async for part in answer.aiter_raw():  # a short answer is read, so that the connection can be used again
                    size += len(part)
                    if size > MOST_ANSWER:
                        break
        except (httpx.HTTPError, httpx.InvalidURL, OSError) as error:  # a timeout is an OSError
            reason = _reason_of(error)
        return status, f"it answered {status}" if status else reason


@asynccontextmanager
async def sending(
    hooks: Sequence[WebHook], alarms: AlarmStream, service: Service, retry: Backoff = RETRY
) -> AsyncIterator[None]:
    """Send alarms to the hooks while the block runs."""
    senders = [_Sender(hook, service, retry) for hook in hooks]

    async def follow() -> None:
        async for changes in alarms.changes():
            due = sorted((change for change in changes if change.what in TOLD), key=lambda change: change.alarm.urgency)
            for k in range(0, len(due), PORTION):
                messages = _messages(service, due[k : k + PORTION])
                for sender in senders:
                    sender.enqueue(messages)
                await asyncio.sleep(0.0)

    tasks = [asyncio.create_task(job) for job in ([follow()] if senders else [])]
    tasks += [asyncio.create_task(sender.run()) for sender in senders]
    asked = [sender.troubles for sender in senders]
    service.asked += asked
    try:
        yield
    finally:
        for ask in asked:
            service.asked.remove(ask)
        for task in tasks:
            task.cancel()
        for task in tasks:
            with suppress(asyncio.CancelledError):
                await task


def _reason_of(error: BaseException) -> str:
    """Why there was no answer, in the words of the system where it has any."""
    reason = str(error) or type(error).__name__
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, TimeoutError | httpx.TimeoutException):
            return f"no answer within {TIME_OUT_S:g} s"
        if isinstance(cause, OSError) and cause.errno is not None:
            return reason_of(cause)
        cause = cause.__cause__ or cause.__context__
    return reason


def _messages(service: Service, changes: Sequence[Change]) -> list[tuple[str, _Message]]:
    """A message for each change, with the kind of its alarm."""
    messages = []
    for change, text in zip(changes, as_json(service, [change.alarm for change in changes]), strict=True):
        if text is not None:
            word, alarm, alarm_id = change.what, change.alarm, change.alarm.alarm_id
            body = f'{{"event": "{word}", "alarm": {text}}}'.encode()
            name = f"{alarm_id}-{word}" + (f"-{alarm.gaps}" if alarm.gaps else "")
            messages.append((alarm.kind, _Message(alarm.urgency[0], change.number, alarm_id, name, body)))
    return messages
