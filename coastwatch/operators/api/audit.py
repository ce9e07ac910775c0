"""Who changed what through the API: one row for each request that changed something, written before its answer is sent."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable

from starlette.types import Message, Receive, Scope, Send

from coastwatch.errors import StoreError
from coastwatch.store import Change

LOG = logging.getLogger("coastwatch.serve")
MOST_BYTES = 2000
"""Bytes of a body that are kept."""


class Audit:
    """Notes changes. `write` stores one; it may raise StoreError."""

    def __init__(self, write: Callable[[Change], None]) -> None:
        self._write = write

    def noting(self, scope: Scope, receive: Receive, send: Send) -> tuple[Receive, Send]:
        """`receive` and `send` of a request that may change something: they note it if its answer says that it was done."""
        body = bytearray()

        async def receiving() -> Message:
            message = await receive()
            body.extend(message.get("body", b"")[: MOST_BYTES - len(body)])
            return message

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start" and message["status"] < 400:
                await asyncio.to_thread(self._note, scope, bytes(body), message["status"])
            await send(message)

        return receiving, sending

    def _note(self, scope: Scope, body: bytes, status: int) -> None:
        state, client = scope["state"], str((scope.get("client") or ("unknown",))[0])
        text = body.decode("utf-8", "replace").replace("\0", "")
        change = Change(time.time(), state["who"], state["role"], client, scope["method"], scope["path"], status, text)
        fields = {"who": change.who, "method": change.method, "path": change.path, "status": status, "client": client}
        LOG.info("change", extra={"fields": fields})
        try:
            self._write(change)
        except StoreError as error:  # the change is done; the log has it
            LOG.error("change not noted in the database: %s", error, extra={"fields": fields})
