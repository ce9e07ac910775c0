"""How large a request may be, and how many large answers are computed at a time. What is too large is refused before it is read."""

from __future__ import annotations

import asyncio
import re
from contextlib import AsyncExitStack
from typing import NamedTuple
from urllib.parse import parse_qs
from weakref import WeakValueDictionary

from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LARGEST_HEAD = 65_536
"""Bytes of a request line with its headers; also of the trailers of a body."""

LARGEST_TARGET = 8192
"""Bytes of a path with its query."""

MOST_PARAMETERS = 64
"""Parameters of a query."""

LARGEST_BODY = 262_144
"""Bytes of a body. A zone with the most corners takes 50,000, with indentation 100,000."""

MOST_VALUES = 8192
"""Values of a body of JSON, about: its commas and brackets. A zone with the most corners has 4,000."""

LARGEST_MESSAGE = 65_536
"""Bytes of a message from a viewer."""

MOST_FRAGMENTS = 1024
"""Frames of a message from a viewer."""

LARGEST_EXTRA = LARGEST_BODY + 2 * LARGEST_HEAD
"""Bytes of a connection between two answers: a body with its head, chunk sizes and trailers. More end the connection."""

AT_A_TIME = 1
"""Large answers that are computed at a time: another thread of Python takes as much from the cycles as each cycle has."""

WAIT_S = 10.0
"""For so long a request waits for its turn: a page that asks for a few pages of 10,000 vessels at once gets all of them."""

LARGE = re.compile(r"/api/v1/(picture|frame|vessels/[^/]+/(history|decided))")
"""Paths of answers of many rows. One of 1,000 rows asked for ten times is as much as one of 10,000."""

OF_THE_PAST = "/api/v1/vessels"
"""A path whose answer is large with `at`: the picture of an instant is read from the database."""


class TooLarge(NamedTuple):
    """Why a request is refused."""

    status: int
    detail: str


def too_large(scope: Scope) -> TooLarge | None:
    """Why the head of a request is refused; None: it is not."""
    query: bytes = scope.get("query_string", b"")
    target = len(scope.get("raw_path") or b"") + len(query)
    if target > LARGEST_TARGET:
        return TooLarge(414, f"got a path and query of {target} bytes, needed at most {LARGEST_TARGET}")
    parameters = query.count(b"&") + 1
    if parameters > MOST_PARAMETERS:
        return TooLarge(400, f"query: got {parameters} parameters, needed at most {MOST_PARAMETERS}")
    size = sum(len(name) + len(value) for name, value in scope["headers"])
    if size > LARGEST_HEAD:
        return TooLarge(431, f"got headers of {size} bytes, needed at most {LARGEST_HEAD}")
    length = next((value for name, value in scope["headers"] if name == b"content-length"), b"0")
    if not length.isdigit() or len(length) > 18 or int(length) > LARGEST_BODY:
        return TooLarge(413, f"got a body of {length[:20].decode('ascii', 'replace')} bytes, needed at most {LARGEST_BODY}")
    return None


def has_too_many_values(body: bytes) -> bool:
    """Whether a body of JSON has more values than any that is meant; commas in texts count too."""
    return body.count(b",") + body.count(b"[") + body.count(b"{") > MOST_VALUES


def is_large(scope: Scope) -> bool:
    """Whether a request is one for a large answer."""
    path = scope["path"]
    return bool(LARGE.fullmatch(path)) or (path == OF_THE_PAST and "at" in parse_qs(scope["query_string"].decode("latin-1")))


class LargeAnswerQueue:
    """Has large answers wait: of each name one is computed, and of all names AT_A_TIME. So one name does not keep out the others."""

    def __init__(self, app: ASGIApp) -> None:
        self._app, self._all = app, asyncio.Semaphore(AT_A_TIME)
        self._own: WeakValueDictionary[str, asyncio.Lock] = WeakValueDictionary()  # of names that ask now

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """As of ASGI. The next one begins when an answer is made: who reads slowly holds up nobody.

        Whether a client has gone is not asked: that would read on, and what it sends ahead of its answers is bounded.
        """
        if scope["type"] != "http" or not is_large(scope):
            await self._app(scope, receive, send)
            return
        own = self._own.setdefault(scope["state"]["who"], asyncio.Lock())
        async with AsyncExitStack() as place:
            try:
                async with asyncio.timeout(WAIT_S):
                    await place.enter_async_context(own)
                    await place.enter_async_context(self._all)
            except TimeoutError:
                detail = f"large answers: other ones were computed for {WAIT_S:g} s, ask again, for fewer at a time"
                await JSONResponse({"detail": detail}, 429, {"Retry-After": f"{WAIT_S:.0f}"})(scope, receive, send)
                return

            async def sending(message: Message) -> None:
                await place.aclose()
                await send(message)

            await self._app(scope, receive, sending)
