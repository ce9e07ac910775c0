"""Cycles of tracks of a region to its centres, and what all streams of the API share: a viewer that does not read is closed."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from coastwatch.server.listeners import woken_by
from coastwatch.server.regions.link import Outgoing, Position
from coastwatch.server.regions.message import PROTOCOL, PROTOCOLS
from coastwatch.server.regions.publisher import Publisher

NOT_READ_S = 30.0
"""A viewer that has not taken a message after this time is closed."""

BAD_MESSAGE, NO_TRACKS, NOT_READING = 4400, 4404, 4408
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
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError):  # the last two: 1e999 as a number; 60,000 `[`
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


async def serve_tracks(socket: WebSocket, publisher: Publisher | None, had: Position, from_s: float) -> None:
    """Send cycles of tracks to one centre, in order, a few at a time, each once, until it leaves or does not read.

    Args: had: the last cycle that it has; from_s: as of `Publisher`.
    """
    offered = socket.scope.get("subprotocols", [])
    await socket.accept(subprotocol=next((name for name in PROTOCOLS if name in offered), None))
    if publisher is None:
        await socket.close(NO_TRACKS, "this server sends no tracks: it needs --role region")
        return
    outgoing = Outgoing(had)
    async with woken_by(publisher.listen) as wake:

        def acknowledge(text: str) -> None:
            answer = json.loads(text)
            outgoing.acknowledged(Position(str(answer["run"]), int(answer["seq"])))
            wake.set()

        async def sending() -> None:
            while True:
                wake.clear()
                cycles = []
                if outgoing.room:
                    cycles = await asyncio.to_thread(publisher.after, outgoing.position, outgoing.room, from_s)
                for position, message in cycles:
                    if not await sent_in_time(socket, message):
                        return
                    outgoing.sent(position)
                if not cycles:
                    await wake.wait()

        needed = f'needed {{"run": "...", "seq": 1}}, as in {PROTOCOL}'
        await first_done(sending(), take_messages(socket, acknowledge, needed))
