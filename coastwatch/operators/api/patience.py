"""Connections that send no whole request: they are closed, since uvicorn waits for the rest of a request for ever.

The protocol of uvicorn is wrapped, not changed: asyncio tells the wrapper what comes, and the application that a request is whole.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.protocols.http.auto import AutoHTTPProtocol

HEAD_S = 10.0
"""A request line and its headers have to be here after so long."""

MOST_WAITING = 512
"""Connections that may send the beginning of a request at a time. One more closes the one that has waited longest."""

Client = tuple[str, int]


class Patience:
    """An application that knows which connections wait for a request. Its `protocol` closes those that wait too long."""

    def __init__(self, app: ASGIApp, closed: Callable[[], None], head_s: float = HEAD_S, most: int = MOST_WAITING) -> None:
        """Args: closed: called for each connection that is closed."""
        self._app, self._closed, self._head_s, self._most = app, closed, head_s, most
        self._waiting: dict[Client, tuple[asyncio.Transport, asyncio.TimerHandle]] = {}  # the longest waiting first
        self._answered: set[Client] = set()  # have a request that is being answered

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        client = tuple(scope.get("client") or ())
        self.forget(client)
        self._answered.add(client)
        try:
            await self._app(scope, receive, send)
        finally:
            self._answered.discard(client)

    @property
    def protocol(self) -> type[asyncio.Protocol]:
        """What uvicorn makes for each connection."""
        patience = self

        class Watched(_Watched):
            def __init__(self, **given: Any) -> None:
                super().__init__(AutoHTTPProtocol(**given), patience)

        return Watched

    def wait_for(self, client: Any, transport: asyncio.Transport) -> None:
        """Bytes may come on a connection. If it has no request and does not wait yet, it has so long to send one."""
        if client in self._answered or client in self._waiting:
            return
        if len(self._waiting) >= self._most:
            self._close(next(iter(self._waiting)))
        timer = asyncio.get_running_loop().call_later(self._head_s, self._close, client)
        self._waiting[client] = transport, timer

    def forget(self, client: Any) -> None:
        """A connection waits no longer: its request is whole, or it is gone."""
        found = self._waiting.pop(client, None)
        if found is not None:
            found[1].cancel()

    def _close(self, client: Client) -> None:
        transport = self._waiting[client][0]
        self.forget(client)
        if not transport.is_closing():
            self._closed()
            transport.abort()


class _Watched(asyncio.Protocol):
    """The protocol of a connection, which is told all that comes."""

    def __init__(self, inner: Any, patience: Patience) -> None:
        self._inner, self._patience = inner, patience
        self._client: Any = ()
        self._transport: Any = None

    def connection_made(self, transport: Any) -> None:
        self._client, self._transport = tuple((transport.get_extra_info("peername") or ())[:2]), transport
        self._patience.wait_for(self._client, transport)
        self._inner.connection_made(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        self._patience.forget(self._client)
        self._inner.connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        self._patience.wait_for(self._client, self._transport)
        self._inner.data_received(data)

    def eof_received(self) -> bool | None:
        found: bool | None = self._inner.eof_received()
        return found

    def pause_writing(self) -> None:
        self._inner.pause_writing()

    def resume_writing(self) -> None:
        self._inner.resume_writing()
