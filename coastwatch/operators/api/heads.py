"""HEAD: answered as GET, without the body. The framework gives its routes GET alone, and monitors probe with HEAD."""

from __future__ import annotations

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from coastwatch.operators.api.guard import methods_of


class Heads:
    """Has the application answer GET where HEAD is asked of a path that has GET. Files of the page know HEAD themselves."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """As of ASGI."""
        if scope["type"] != "http" or scope["method"] != "HEAD" or "GET" not in methods_of(scope):
            await self._app(scope, receive, send)
            return

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":  # a stream would never end: its answer ends at once
                await send(message)
                await send({"type": "http.response.body"})

        await self._app({**scope, "method": "GET"}, receive, sending)
