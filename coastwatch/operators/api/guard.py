"""Who may ask: hosts and origins, tokens and roles, limits; and the headers of every answer. Pure ASGI: it does not wrap streams."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from http.cookies import CookieError, SimpleCookie
from typing import Any

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from coastwatch.operators.api.metrics import Metrics
from coastwatch.operators.api.tokens import ROLES, Limits, Token, Tokens
from coastwatch.operators.api.wire import PROTOCOL

LOOPBACK = ("127.0.0.1", "::1", "localhost")
SAFE = ("GET", "HEAD", "OPTIONS")
COOKIE, SESSION = "coastwatch", "/session"
PROTECTED = ("/api/", "/metrics", "/readyz")
"""Beginnings of the paths that need a token. The page itself does not: it has no data, and asks for the token."""

LARGEST_BODY, MOST_SOCKETS = 1 << 20, 8
TOKEN_NEEDED, TOO_MANY_SOCKETS = 4401, 4429
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
    """Without tokens only these hosts are answered, and everybody on this machine is an admin. Loopback is not private: any page in a
    browser on this machine can ask it, so hosts and origins are checked. With tokens each request needs one.
    """

    hosts: Sequence[str] = LOOPBACK
    tokens: Tokens | None = None
    secure: bool = False  # the cookie is sent over TLS only

    @property
    def middleware(self) -> Any:
        """The ASGI middleware."""
        return partial(_Middleware, guard=self)

    def refusal(self, method: str, headers: Headers, socket: bool) -> str | None:
        """Why a request is refused by its host or origin; None: it is not."""
        host = headers.get("host", "")
        if self.tokens is None and _name(host) not in self.hosts:
            return f"Host: got {host[:80]!r}, needed one of {', '.join(self.hosts)}"
        origin = headers.get("origin")
        if origin is not None and (socket or method not in SAFE) and origin.partition("://")[2] != host:
            return f"Origin: got {origin[:80]!r}, needed the page of this server"
        return None

    def token_of(self, headers: Headers) -> Token | None:
        """The valid token that a request has: in `Authorization`, the cookie, or the subprotocols of a socket."""
        assert self.tokens is not None
        scheme, _, given = headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            return self.tokens.of(given.strip())
        offered = [part.strip() for part in headers.get("sec-websocket-protocol", "").split(",")]
        bearer = next((part.removeprefix("bearer.") for part in offered if part.startswith("bearer.")), None)
        return self.tokens.of(_cookie(headers) if bearer is None else bearer)

    def session(self, given: str) -> Response:
        """The answer to a token that was typed into the page: a cookie, or 401."""
        found = self.tokens.of(given) if self.tokens is not None else None
        if found is None:
            return JSONResponse({"detail": "the token is not valid"}, 401)
        answer = JSONResponse({"name": found.name, "role": found.role})
        answer.set_cookie(COOKIE, given, httponly=True, samesite="strict", secure=self.secure, path="/")
        return answer


class _Middleware:
    """Refuses what the guard refuses, and adds headers."""

    def __init__(self, app: ASGIApp, guard: Guard, metrics: Metrics) -> None:
        self._app, self._guard, self._metrics = app, guard, metrics
        self._limits, self._sockets = Limits(), Counter[str]()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            await self._socket(scope, receive, send)
        else:
            sending = self._with_headers(send)
            refused = self._refused(scope)
            if refused is not None:
                await refused(scope, receive, sending)
            else:
                await self._app(scope, _limited(receive), sending)

    def _refused(self, scope: Scope) -> Response | None:
        """The answer to a request that is refused; None: it goes on, with its role and name in `scope["state"]`."""
        headers, path, method = Headers(scope=scope), scope["path"], scope["method"]
        foreign = self._guard.refusal(method, headers, False)
        if foreign is not None:
            return JSONResponse({"detail": foreign}, 403)
        length = headers.get("content-length", "0")
        if not length.isdecimal() or int(length) > LARGEST_BODY:
            return JSONResponse({"detail": f"got a body of {length[:20]} bytes, needed at most {LARGEST_BODY}"}, 413)
        scope.setdefault("state", {}).update(role="admin", who="loopback")
        if self._guard.tokens is None:
            return None
        token = self._guard.token_of(headers)
        who = token.name if token else str((scope.get("client") or ("unknown",))[0])
        wait_s = self._limits.wait_s(who)
        if wait_s:
            return JSONResponse({"detail": "too many requests"}, 429, {"Retry-After": str(math.ceil(wait_s))})
        if path == SESSION or not path.startswith(PROTECTED):
            return None
        if token is None:
            return JSONResponse({"detail": "a token is needed"}, 401, {"WWW-Authenticate": "Bearer"})
        needed = "viewer" if method in SAFE else "operator"
        if ROLES.index(token.role) < ROLES.index(needed):
            return JSONResponse({"detail": f"needs the role {needed}, has {token.role}"}, 403)
        scope["state"].update(role=token.role, who=token.name)
        return None

    async def _socket(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = Headers(scope=scope)
        if self._guard.refusal("GET", headers, True) is not None:
            await send({"type": "websocket.close", "code": 4403, "reason": ""})  # before accept: HTTP 403
            return
        if self._guard.tokens is None:
            await self._app(scope, receive, send)
            return
        token = self._guard.token_of(headers)
        code = TOKEN_NEEDED if token is None else TOO_MANY_SOCKETS if self._sockets[token.name] >= MOST_SOCKETS else 0
        if token is None or code:
            await _closed(scope, receive, send, code)
            return
        self._sockets[token.name] += 1
        try:
            await self._app(scope, receive, send)
        finally:
            self._sockets[token.name] -= 1

    def _with_headers(self, send: Send) -> Send:
        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
                self._metrics.requests.labels(str(message["status"])).inc()
            await send(message)

        return sending


async def _closed(scope: Scope, receive: Receive, send: Send, code: int) -> None:
    """Accept a socket and close it: closed before, the page could not read the code."""
    await receive()
    protocol = PROTOCOL if PROTOCOL in scope.get("subprotocols", []) else None
    await send({"type": "websocket.accept", "subprotocol": protocol, "headers": []})
    await send({"type": "websocket.close", "code": code, "reason": ""})


def _limited(receive: Receive) -> Receive:
    """Receives at most LARGEST_BODY bytes of a body without a length; then the sender seems to have gone."""
    taken = 0

    async def receiving() -> Message:
        nonlocal taken
        message = await receive()
        taken += len(message.get("body", b""))
        return message if taken <= LARGEST_BODY else {"type": "http.disconnect"}

    return receiving


def _cookie(headers: Headers) -> str:
    try:
        found = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    except CookieError:
        return ""
    return "" if found is None else found.value


def _name(host: str) -> str:
    """The name in a Host header, without its port."""
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.rpartition(":")[0] if ":" in host else host
