"""What all streams of the API share: a viewer that does not read is closed, and one end ends both sides."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

NOT_READ_S = 30.0
"""A viewer that has not taken a message after this time is closed."""

BAD_MESSAGE, NOT_READING = 4400, 4408
"""Close codes."""


async def sent_in_time(socket: WebSocket, data: bytes) -> bool:
    """Whether the other side took the message in time; else it is closed."""
    try:
        await asyncio.wait_for(socket.send_bytes(data), NOT_READ_S)
    except TimeoutError:
        with suppress(Exception):  # it may be gone by now
            await asyncio.wait_for(socket.close(NOT_READING, "nothing was read for 30 s"), 1.0)
        return False
    return True


async def take_messages(socket: WebSocket, take: Callable[[str], object], needed: str) -> None:
    """Take what the other side says, until it leaves. A message that `take` refuses closes the socket. Args: needed: in its place."""
    while True:
        try:
            take(await socket.receive_text())
        except (ValueError, KeyError, TypeError):
            await socket.close(BAD_MESSAGE, needed)
            return


async def first_done(*jobs: Awaitable[Any]) -> None:
    """Run jobs until the first one ends, then stop the others. A viewer that leaves is no error."""
    tasks = [asyncio.ensure_future(job) for job in jobs]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            with suppress(WebSocketDisconnect, RuntimeError, OSError):
                task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
