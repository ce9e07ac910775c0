"""Connections that send no whole request, send without end, or do not read: they are closed, as uvicorn waits for them for ever.

The protocol of uvicorn is wrapped, not changed: asyncio tells the wrapper what comes, and the application that a request is whole. It is
the one of h11, which bounds heads and trailers; that of httptools keeps all that comes. INTERFACE.md has the limits in a table.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, cast
from weakref import WeakValueDictionary

from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame

from coastwatch.operators.api.bounds import LARGEST_EXTRA, MOST_FRAGMENTS

HEAD_S = 10.0
"""A request line and its headers have to be here after so long."""

UNREAD_S = 30.0
"""A connection from which nothing was read for so long, while an answer waits, is closed."""

MOST_WAITING = 512
"""Connections that may send the beginning of a request at a time. One more closes the one that has waited longest."""

MOST_PONGS = 1000
"""Answers to pings that may wait for a viewer that does not read."""

SLOW, LARGE = "408", "413"
"""Why a connection is closed, as a status of HTTP."""

Client = tuple[str | int, ...]
"""Address and port of the other end; empty: a socket of the file system."""


class SlowRequestGuard:
    """An application that knows which connections wait for a request. Its `protocol` closes those that wait too long."""

    def __init__(self, app: ASGIApp, closed: Callable[[str], None], head_s: float = HEAD_S, most: int = MOST_WAITING) -> None:
        """Args: closed: called for each connection that is closed, with SLOW or LARGE."""
        self._app, self._closed, self._head_s, self._most = app, closed, head_s, most
        self._waiting: dict[Client, tuple[asyncio.Transport, asyncio.TimerHandle]] = {}  # the longest waiting first
        self._answered: set[Client] = set()  # have a request that is being answered
        self._connections: WeakValueDictionary[Client, _Watched] = WeakValueDictionary()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        client = tuple(scope.get("client") or ())
        self.forget(client)
        self._answered.add(client)
        self._begin_count(client)
        try:
            await self._app(scope, receive, send)
        finally:
            self._answered.discard(client)
            self._begin_count(client)

    @property
    def protocol(self) -> type[asyncio.Protocol]:
        """What uvicorn makes for each connection."""
        guard = self

        class Watched(_Watched):
            def __init__(self, **given: Any) -> None:
                super().__init__(H11Protocol(**given), guard)

        return Watched

    def opened(self, client: Client, connection: _Watched) -> None:
        """There is a new connection."""
        self._connections[client] = connection

    def wait_for(self, client: Client, transport: asyncio.Transport) -> None:
        """Bytes may come on a connection. If it has no request and does not wait yet, it has so long to send one."""
        if client in self._answered or client in self._waiting:
            return
        if len(self._waiting) >= self._most:
            self._close(next(iter(self._waiting)))
        timer = asyncio.get_running_loop().call_later(self._head_s, self._close, client)
        self._waiting[client] = transport, timer

    def forget(self, client: Client) -> None:
        """A connection waits no longer: its request is whole, or it is gone."""
        if client in self._waiting:
            _, timer = self._waiting.pop(client)
            timer.cancel()

    def end(self, client: Client, transport: asyncio.Transport, why: str) -> None:
        """Close a connection. Args: why: SLOW or LARGE."""
        self.forget(client)
        if not transport.is_closing():
            self._closed(why)
        transport.abort()  # also one that is closing, and waits until its last bytes are read

    def _close(self, client: Client) -> None:
        self.end(client, self._waiting[client][0], SLOW)

    def _begin_count(self, client: Client) -> None:
        connection = self._connections.get(client)
        if connection is not None:
            connection.received = 0


class _Watched(asyncio.Protocol):
    """The protocol of a connection, which is told all that comes."""

    _client: Client
    _transport: asyncio.Transport

    def __init__(self, inner: asyncio.Protocol, guard: SlowRequestGuard) -> None:
        self.received = 0  # bytes since a request or an answer was whole
        self._inner, self._guard = inner, guard
        self._unread: asyncio.TimerHandle | None = None
        self._left = 0  # bytes that waited at the last look

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._client = tuple((transport.get_extra_info("peername") or ())[:2])
        self._transport = cast(asyncio.Transport, transport)
        self._guard.opened(self._client, self)
        self._guard.wait_for(self._client, self._transport)
        self._inner.connection_made(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        self._guard.forget(self._client)
        self._stop_looking()
        self._inner.connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        self.received += len(data)
        if self.received > LARGEST_EXTRA + len(data):  # a request that came with them may be whole by now
            self._guard.end(self._client, self._transport, LARGE)
            return
        self._guard.wait_for(self._client, self._transport)
        try:
            self._inner.data_received(data)
        except Exception:  # rubbish behind a request whose answer has begun
            self._guard.end(self._client, self._transport, LARGE)

    def eof_received(self) -> bool | None:
        return self._inner.eof_received()

    def pause_writing(self) -> None:
        self._look_soon()
        self._inner.pause_writing()

    def resume_writing(self) -> None:
        self._stop_looking()
        self._inner.resume_writing()

    def _look_soon(self) -> None:
        self._left = self._transport.get_write_buffer_size()
        self._unread = asyncio.get_running_loop().call_later(UNREAD_S, self._end_if_unread)

    def _end_if_unread(self) -> None:
        """Close the connection if nothing was read since the last look."""
        if self._transport.get_write_buffer_size() >= self._left:
            self._guard.end(self._client, self._transport, SLOW)
        else:
            self._look_soon()

    def _stop_looking(self) -> None:
        if self._unread is not None:
            self._unread.cancel()


class Frames(WebSocketsSansIOProtocol):
    """The protocol of a socket of uvicorn. A message has so many frames, and so many pongs wait for whoever does not read.

    A head that the library of sockets refuses is answered. uvicorn would leave its connection open, and fail when the server ends.
    """

    _pongs = 0

    def data_received(self, data: bytes) -> None:
        """Take what has come."""
        super().data_received(data)
        if self.conn.handshake_exc is not None and not self.handshake_initiated:
            self.handshake_initiated = self.handshake_complete = self.close_sent = True
            self.transport.write(b"".join(self.conn.data_to_send()))
            self.transport.close()

    async def send(self, message: Any) -> None:
        """Send what the application answers."""
        await super().send(message)
        if message["type"] == "websocket.http.response.body" and self.close_sent:
            self.handshake_complete = True  # else uvicorn logs an error for each socket that is refused

    def handle_cont(self, event: Frame) -> None:
        """Take a later frame of a message."""
        if len(self.frames) >= MOST_FRAGMENTS:
            self.transport.abort()
            return
        super().handle_cont(event)

    def handle_ping(self) -> None:
        """Answer a ping."""
        self._pongs = 0 if self.writable.is_set() else self._pongs + 1
        if self._pongs > MOST_PONGS:
            self.transport.abort()
            return
        super().handle_ping()
