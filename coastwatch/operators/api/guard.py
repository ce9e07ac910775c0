"""Who may ask: hosts and origins, tokens, trusted proxy and roles, limits; and the headers of every answer.

Pure ASGI: it does not wrap streams.
"""

from __future__ import annotations

import asyncio
import logging
import math
import resource
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from http.cookies import CookieError, SimpleCookie
from ipaddress import IPv6Address, ip_address

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.responses import JSONResponse, Response
from starlette.routing import Match, Mount
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket

from coastwatch.operators.api.audit import Audit
from coastwatch.operators.api.bounds import LARGEST_BODY, too_large
from coastwatch.operators.api.certificate import Certificate
from coastwatch.operators.api.metrics import Metrics
from coastwatch.operators.api.people import FILES_A_SECOND, FILES_AT_ONCE, Limits, Person, Tokens, TrustedProxy
from coastwatch.server.troubles import Trouble

LOG = logging.getLogger("coastwatch.serve")
LOOPBACK = ("127.0.0.1", "::1", "localhost")
SAFE, CHANGES = ("GET", "HEAD", "OPTIONS"), ("POST", "PUT", "PATCH", "DELETE")
METHODS = (*SAFE, *CHANGES)
COOKIE, SESSION = "coastwatch", "/session"
PROTECTED = ("/api/", "/metrics", "/readyz")
"""Beginnings of the paths that need a token. The page itself does not: it has no data, and asks for the token."""

FOR_ADMINS = ("/api/v1/audit",)
"""Beginnings of the paths that a viewer or operator may not read."""

MOST_SOCKETS = MOST_STREAMS = 8
"""Of one token or user."""

MOST_OPEN = 2000
"""Sockets and streams of alarms in all, if this process may open twice as many files."""

STREAM = "/api/v1/alarms/stream"
RETRY_AFTER_S = 30
BODY_S = 30.0
"""The body of a request has to be here after so long."""

BEARER = "bearer."
"""How a subprotocol with the token of a socket begins."""

TOKEN_NEEDED, TOO_MANY_SOCKETS = 4401, 4429
LOGGED = (401, 403, 413, 414, 429, 431, 500)
"""Answers that are warned of in the log. 503 is not among them: `logs.Watch` says why."""

RECHECK_S = 60.0
"""The token of an open socket is looked at again so often."""

HERE = Person("loopback", "admin")
"""Who asks where no token is needed."""

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


def room(files: int) -> int:
    """How many sockets and streams may be open in all. Args: files: that this process may open."""
    return min(MOST_OPEN, files // 2)


@dataclass(frozen=True)
class Guard:
    """Without tokens and proxy only these hosts are answered, and everybody on this machine is an admin. Loopback is not private: any
    page in a browser on this machine can ask it, so hosts and origins are checked. Else each request needs a token or the proxy.
    """

    hosts: Sequence[str] = LOOPBACK
    tokens: Tokens | None = None
    proxy: TrustedProxy | None = None
    secure: bool = False  # the cookie is sent over TLS only
    certificate: Certificate | None = None  # of https
    recheck_s: float = RECHECK_S
    limits: Callable[[], Limits] = Limits
    file_limits: Callable[[], Limits] = partial(Limits, FILES_A_SECOND, FILES_AT_ONCE)
    most_open: int = field(
        default_factory=lambda: room(resource.getrlimit(resource.RLIMIT_NOFILE)[0])
    )  # sockets and streams of alarms in all

    @property
    def middleware(self) -> partial[_Middleware]:
        """The ASGI middleware."""
        return partial(_Middleware, guard=self)

    @property
    def is_open(self) -> bool:
        """Whether this machine is answered without a token."""
        return self.tokens is None and self.proxy is None

    def troubles(self) -> list[Trouble]:
        """What is wrong with the files of tokens and certificate."""
        return [trouble for one in self.files() for trouble in one.troubles()]

    def files(self) -> list[Certificate | Tokens]:
        """What is read again while the server runs."""
        return [one for one in (self.certificate, self.tokens) if one is not None]

    def refusal(self, method: str, headers: Headers, socket: bool) -> str | None:
        """Why a request is refused by its host or origin; None: it is not."""
        host = headers.get("host", "")
        if self.is_open and _name(host) not in self.hosts:
            return f"Host: got {host[:80]!r}, needed one of {', '.join(self.hosts)}"
        origin = headers.get("origin")
        if origin is not None and (socket or method not in SAFE) and origin.partition("://")[2] != host:
            return f"Origin: got {origin[:80]!r}, needed the page of this server"
        return None

    def person(self, client: str, headers: Headers) -> Person | None:
        """Who asks; None: nobody that is known. Args: client: address of the other end of the connection."""
        if self.is_open:
            return HERE
        if self.proxy is not None and (person := self.proxy.person(client, headers)) is not None:
            return person
        if self.tokens is None:
            return None
        scheme, _, token = headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            token = token.strip()
        else:
            offered = [part.strip() for part in headers.get("sec-websocket-protocol", "").split(",")]
            bearers = [part.removeprefix(BEARER) for part in offered if part.startswith(BEARER)]
            token = bearers[0] if bearers else _cookie(headers)
        return self.tokens.person(token)

    def session(self, token: str) -> Response:
        """The answer to a token that was typed into the page: a cookie, or 401."""
        person = None if self.tokens is None else self.tokens.person(token)
        if person is None:
            return JSONResponse({"detail": "the token is not valid"}, 401)
        answer = JSONResponse({"name": person.name, "role": person.role})
        answer.set_cookie(COOKIE, token, httponly=True, samesite="strict", secure=self.secure, path="/")
        return answer


class _Middleware:
    """Refuses what the guard refuses, adds headers, and has every change noted."""

    def __init__(self, app: ASGIApp, guard: Guard, metrics: Metrics, audit: Audit) -> None:
        self._app, self._guard, self._metrics, self._audit = app, guard, metrics, audit
        self._limits, self._file_limits = guard.limits(), guard.file_limits()
        self._open: dict[str, Counter[str]] = {"sockets": Counter(), "streams of alarms": Counter()}  # of each name

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket":
            await self._socket(scope, receive, send)
            return
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        send = self._with_headers(scope, send)
        refused = self._refused(scope)
        if refused is not None:
            await refused(scope, receive, send)
            return
        receive, send = _limited(receive, send)
        if scope["method"] not in SAFE and scope["path"].startswith("/api/"):
            receive, send = self._audit.noting(scope, receive, send)
        if scope["path"] != STREAM:
            await self._app(scope, receive, send)
            return
        answer = self._no_room("streams of alarms", scope["state"]["who"], MOST_STREAMS)
        if answer is not None:
            await answer(scope, receive, send)
            return
        with self._counted("streams of alarms", scope["state"]["who"]):
            await self._app(scope, receive, send)

    def _no_room(self, what: str, name: str, most: int) -> Response | None:
        """The answer where there is no room for one more socket or stream. Args: most: of one name."""
        retry = {"Retry-After": str(RETRY_AFTER_S)}
        if not self._guard.is_open and self._open[what][name] >= most:
            return JSONResponse({"detail": f"{what}: {name} has {most} open, needed at most {most}: close one"}, 429, retry)
        if sum(count.total() for count in self._open.values()) >= self._guard.most_open:
            full = f"{what}: the server has {self._guard.most_open} sockets and streams open, which is all it takes"
            return JSONResponse({"detail": full}, 503, retry)
        return None

    @contextmanager
    def _counted(self, what: str, name: str) -> Iterator[None]:
        """Count a socket or stream while it is open."""
        count = self._open[what]
        count[name] += 1
        try:
            yield
        finally:
            count[name] -= 1
            if not count[name]:
                del count[name]

    def _asking(self, scope: Scope, limits: Limits) -> Person | Response | None:
        """Who sends a request or opens a socket; None: nobody that is known; or the answer to one that nobody may send."""
        headers, client, is_socket = Headers(scope=scope), _client(scope), scope["type"] == "websocket"
        large = too_large(scope)
        if large is not None:
            return JSONResponse({"detail": large.detail}, large.status)
        foreign = self._guard.refusal(scope.get("method", "GET"), headers, is_socket)
        if foreign is not None:
            return JSONResponse({"detail": foreign}, 403)
        person = self._guard.person(client, headers)
        who = f"address {client}" if person is None else f"name {person.name}"
        if person is None:
            with suppress(ValueError):  # a socket of the file system has no address
                address = ip_address(client)
                if isinstance(address, IPv6Address):  # one client has every address of a network of 64 bits
                    who = f"address {address.ipv4_mapped or int(address) >> 64}"
        wait_s = 0.0 if self._guard.is_open else limits.wait_s(who)
        if wait_s:
            return JSONResponse({"detail": "too many requests"}, 429, {"Retry-After": str(math.ceil(wait_s))})
        return person

    def _refused(self, scope: Scope) -> Response | None:
        """The answer to a request that is refused; None: it goes on, with its role and name in `scope["state"]`."""
        path, method = scope["path"], scope["method"]
        needed = None  # the role
        if path != SESSION and path.startswith(PROTECTED):
            needed = "operator" if method in CHANGES else "admin" if path.startswith(FOR_ADMINS) else "viewer"
        is_file = needed is None and method in SAFE and path != SESSION
        person = self._asking(scope, self._file_limits if is_file else self._limits)
        if isinstance(person, Response):
            return person
        if person is None and needed is not None:
            detail = "a token is needed"
            if self._guard.proxy is not None:
                detail = "a user in the group coastwatch-viewer, coastwatch-operator or coastwatch-admin is needed, or a token"
            return JSONResponse({"detail": detail}, 401, {"WWW-Authenticate": "Bearer"})
        if person is not None and needed is not None and not person.may(needed):
            methods = methods_of(scope)
            if not methods or method in methods:  # else the application answers 405 to anybody
                return JSONResponse({"detail": f"needs the role {needed}, has {person.role}"}, 403)
        person = person or Person("", "viewer")
        allowed = partial(self._is_allowed, _client(scope), Headers(scope=scope), needed)
        scope.setdefault("state", {}).update(
            role=person.role, who=person.name, allowed=allowed, recheck_s=self._guard.recheck_s
        )
        return None

    def _is_allowed(self, client: str, headers: Headers, needed: str | None) -> bool:
        """Whether a request that was allowed would be so now. Where that cannot be said it is not."""
        try:
            person = self._guard.person(client, headers)
        except Exception:
            LOG.exception("a token cannot be looked at again")
            return False
        return needed is None or (person is not None and person.may(needed))

    async def _socket(self, scope: Scope, receive: Receive, send: Send) -> None:
        person, socket = self._asking(scope, self._limits), WebSocket(scope, receive, send)
        if isinstance(person, Response):
            if person.status_code == 429:
                _warn_of_socket(scope, 429)
            if person.status_code != 403 and "websocket.http.response" in scope.get("extensions", {}):
                await socket.send_denial_response(person)
            else:
                await socket.close(4403 if person.status_code == 403 else TOO_MANY_SOCKETS)  # before accept: HTTP 403
            return
        if person is None or self._no_room("sockets", person.name, MOST_SOCKETS) is not None:
            code = TOKEN_NEEDED if person is None else TOO_MANY_SOCKETS
            if not _is_before_sign_in(scope):
                _warn_of_socket(scope, code)
            offered = scope.get("subprotocols", [])  # closed before it is accepted, the page could not read the code
            await socket.accept(subprotocol=next((name for name in offered if not name.startswith(BEARER)), None))
            await socket.close(code)
            return
        with self._counted("sockets", person.name):
            if self._guard.is_open:
                await self._app(scope, receive, send)
                return
            allowed = partial(self._is_allowed, _client(scope), Headers(scope=scope), "viewer")
            every_s = self._guard.recheck_s
            await _while_allowed(self._app, scope, receive, send, allowed=allowed, every_s=every_s)

    def _with_headers(self, scope: Scope, send: Send) -> Send:
        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers, status = MutableHeaders(scope=message), message["status"]
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
                self._metrics.requests.labels(str(status)).inc()
                if status in LOGGED and not (status == 401 and _is_before_sign_in(scope)):
                    about = {"method": scope["method"], "path": scope["path"][:200], "status": status, "client": _client(scope)}
                    LOG.warning("request refused" if status < 500 else "request failed", extra={"fields": about})
            await send(message)

        return sending


def _warn_of_socket(scope: Scope, code: int) -> None:
    about = {"path": scope["path"][:200], "code": code, "client": _client(scope)}
    LOG.warning("socket refused", extra={"fields": about})


def _is_before_sign_in(scope: Scope) -> bool:
    """Whether a request offers neither a token nor a cookie and is no sign-in, as those of a page that is about to ask for a token."""
    headers = Headers(scope=scope)
    offers = "authorization" in headers or any(name.startswith(BEARER) for name in scope.get("subprotocols", ()))
    return scope["path"] != SESSION and not offers and not _cookie(headers)


def methods_of(scope: Scope) -> list[str]:
    """The methods that routes take for the path of a request; the files of the page do not count."""
    routes = [route for route in scope["app"].routes if not isinstance(route, Mount)]
    taken = [m for m in METHODS if any(route.matches({**scope, "method": m})[0] is Match.FULL for route in routes)]
    return [m for m in METHODS if m in taken or (m == "HEAD" and "GET" in taken)]  # as `Heads` answers it


async def _while_allowed(
    app: ASGIApp, scope: Scope, receive: Receive, send: Send, *, allowed: Callable[[], bool], every_s: float
) -> None:
    """Run the application of a socket. Once it is not allowed any more, close it with TOKEN_NEEDED."""
    refused = asyncio.Event()

    async def look() -> None:
        with suppress(Exception):  # whoever cannot be looked at is not allowed
            while allowed():
                await asyncio.sleep(every_s)
        refused.set()
        with suppress(Exception):  # it may be closed by now
            await send({"type": "websocket.close", "code": TOKEN_NEEDED, "reason": ""})

    async def receiving() -> Message:
        message, refusal = asyncio.ensure_future(receive()), asyncio.ensure_future(refused.wait())
        try:
            await asyncio.wait((message, refusal), return_when=asyncio.FIRST_COMPLETED)
            return {"type": "websocket.disconnect", "code": TOKEN_NEEDED} if refused.is_set() else message.result()
        finally:
            message.cancel()
            refusal.cancel()

    async def sending(message: Message) -> None:
        if not refused.is_set():
            await send(message)

    looking = asyncio.ensure_future(look())
    try:
        await app(scope, receiving, sending)
    finally:
        looking.cancel()


def _limited(receive: Receive, send: Send) -> tuple[Receive, Send]:
    """Receives a body of at most LARGEST_BODY bytes, within BODY_S. Else it raises what answers 413 or 408.

    Where the answer has begun the sender seems to have gone.
    """
    received, whole, begun = 0, False, False
    until_s = asyncio.get_running_loop().time() + BODY_S

    def refusal(status: int, detail: str) -> Message:
        if begun:
            return {"type": "http.disconnect"}
        raise HTTPException(status, detail, {"Connection": "close"})

    async def receiving() -> Message:
        nonlocal received, whole
        try:
            async with asyncio.timeout_at(None if whole else until_s):
                message = await receive()
        except TimeoutError:
            return refusal(408, f"the body did not come within {BODY_S:g} s")
        received += len(message.get("body", b""))
        whole = whole or not message.get("more_body", False)
        if received > LARGEST_BODY:
            return refusal(413, f"got a body of more than {LARGEST_BODY} bytes, needed at most {LARGEST_BODY}")
        return message

    async def sending(message: Message) -> None:
        nonlocal begun
        begun = True
        await send(message)

    return receiving, sending


def _client(scope: Scope) -> str:
    """The address of the other end of a connection."""
    return str((scope.get("client") or ("unknown",))[0])


def _cookie(headers: Headers) -> str:
    try:
        cookies = SimpleCookie(headers.get("cookie", ""))
    except CookieError:
        return ""
    return cookies[COOKIE].value if COOKIE in cookies else ""


def _name(host: str) -> str:
    """The name in a Host header, without its port."""
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.rpartition(":")[0] if ":" in host else host
