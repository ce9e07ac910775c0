"""Turns of large answers: few are computed at a time, since they share the processor with the cycles. Small ones wait for none."""

from __future__ import annotations

import asyncio
import re
from contextlib import AsyncExitStack
from urllib.parse import parse_qs
from weakref import WeakValueDictionary

from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

AT_A_TIME = 1
"""Large answers that are computed at a time: another thread of Python takes as much from the cycles as each cycle has."""

WAIT_S = 10.0
"""For so long a request waits for its turn: a page that asks for a few pages of 10,000 vessels at once gets all of them."""

LARGE = re.compile(r"/api/v1/(picture|frame|vessels/[^/]+/(history|decided))")
"""Paths of answers of many rows. One of 1,000 rows asked for ten times is as much as one of 10,000."""

OF_THE_PAST = "/api/v1/vessels"
"""A path whose answer is large with `at`: the picture of an instant is read from the database."""


def is_large(scope: Scope) -> bool:
    """Whether a request is one for a large answer."""
    path = scope["path"]
    return bool(LARGE.fullmatch(path)) or (path == OF_THE_PAST and "at" in parse_qs(scope["query_string"].decode("latin-1")))


class Turns:
    """Has large answers wait for their turn: of each name one, and of all names AT_A_TIME. So one name does not keep out the others."""

    def __init__(self, app: ASGIApp) -> None:
        self._app, self._all = app, asyncio.Semaphore(AT_A_TIME)
        self._own: WeakValueDictionary[str, asyncio.Lock] = WeakValueDictionary()  # of names that ask now

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """As of ASGI. A turn ends when the answer is made: who reads slowly holds up nobody."""
        if scope["type"] != "http" or not is_large(scope):
            await self._app(scope, receive, send)
            return
        own = self._own.setdefault(scope["state"]["who"], asyncio.Lock())
        async with AsyncExitStack() as turn:
            try:
                async with asyncio.timeout(WAIT_S):
                    await turn.enter_async_context(own)
                    await turn.enter_async_context(self._all)
            except TimeoutError:
                detail = f"large answers: other ones were computed for {WAIT_S:g} s, ask again, for fewer at a time"
                await JSONResponse({"detail": detail}, 429, {"Retry-After": f"{WAIT_S:.0f}"})(scope, receive, send)
                return

            async def sending(message: Message) -> None:
                await turn.aclose()
                await send(message)

            await self._app(scope, receive, sending)
