"""Who may ask: the hosts and origins that are answered, and the headers of every answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from coastwatch.operators.api.metrics import Metrics

LOOPBACK = ("127.0.0.1", "::1", "localhost")
SAFE = ("GET", "HEAD", "OPTIONS")
POLICY = (
    "default-src 'self'; worker-src 'self' blob:; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; "
    "connect-src 'self' ws: wss:; frame-ancestors 'none'; base-uri 'none'; form-action 'self'"
)
HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
}


@dataclass(frozen=True)
class Guard:
    """Hosts that the server answers to. Loopback is not private: any page in a browser on this machine can ask it."""

    hosts: Sequence[str] = LOOPBACK

    @property
    def middleware(self) -> Any:
        """The ASGI middleware."""
        return partial(_Middleware, guard=self)

    def refusal(self, method: str, headers: Headers, socket: bool) -> str | None:
        """Why a request is refused; None: it is answered."""
        host = headers.get("host", "")
        if _name(host) not in self.hosts:
            return f"Host: got {host[:80]!r}, needed one of {', '.join(self.hosts)}"
        origin = headers.get("origin")
        if origin is not None and (socket or method not in SAFE) and origin.partition("://")[2] != host:
            return f"Origin: got {origin[:80]!r}, needed the page of this server"
        return None


class _Middleware:
    """Refuses foreign hosts and origins, and adds headers. Pure ASGI: it does not wrap streams."""

    def __init__(self, app: ASGIApp, guard: Guard, metrics: Metrics) -> None:
        self._app, self._guard, self._metrics = app, guard, metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        socket = scope["type"] == "websocket"
        refusal = self._guard.refusal(scope.get("method", "GET"), Headers(scope=scope), socket)
        if refusal is not None and socket:
            await send({"type": "websocket.close", "code": 4403, "reason": ""})  # before accept: HTTP 403
            return
        if refusal is not None:
            await JSONResponse({"detail": refusal}, 403)(scope, receive, self._with_headers(send))
            return
        await self._app(scope, receive, send if socket else self._with_headers(send))

    def _with_headers(self, send: Send) -> Send:
        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
                self._metrics.requests.labels(str(message["status"])).inc()
            await send(message)

        return sending


def _name(host: str) -> str:
    """The name in a Host header, without its port."""
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.rpartition(":")[0] if ":" in host else host
