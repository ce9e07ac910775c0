"""Cycles of tracks of a region to its centres over WebSocket: in order, a few at a time, each once."""

from __future__ import annotations

import asyncio
import json
from contextlib import suppress

from starlette.websockets import WebSocket

from coastwatch.operators.api.hub import NOT_READ_S, NOT_READING, first_done
from coastwatch.server.regions.link import Outgoing, Position
from coastwatch.server.regions.message import PROTOCOL
from coastwatch.server.regions.publisher import Publisher

NO_TRACKS, BAD_MESSAGE = 4404, 4400
"""Close codes."""


async def serve_tracks(socket: WebSocket, publisher: Publisher | None, had: Position, from_s: float) -> None:
    """Send cycles to one centre until it leaves or does not read. Args: had: the last cycle that it has; from_s: as of `Publisher`."""
    offered = socket.scope.get("subprotocols", [])
    await socket.accept(subprotocol=PROTOCOL if PROTOCOL in offered else None)
    if publisher is None:
        await socket.close(NO_TRACKS, "this server sends no tracks: it needs --role region")
        return
    loop, wake = asyncio.get_running_loop(), asyncio.Event()

    def tell() -> None:
        with suppress(RuntimeError):  # the loop has been closed
            loop.call_soon_threadsafe(wake.set)

    outgoing, stop = Outgoing(had), publisher.listen(tell)
    try:
        await first_done(_send(socket, publisher, outgoing, from_s, wake), _listen(socket, outgoing, wake))
    finally:
        stop()


async def _send(socket: WebSocket, publisher: Publisher, outgoing: Outgoing, from_s: float, wake: asyncio.Event) -> None:
    while True:
        wake.clear()
        cycles = []
        if outgoing.room:
            cycles = await asyncio.to_thread(publisher.after, outgoing.position, outgoing.room, from_s)
        for position, message in cycles:
            try:
                await asyncio.wait_for(socket.send_bytes(message), NOT_READ_S)
            except TimeoutError:
                with suppress(Exception):  # it may be gone by now
                    await asyncio.wait_for(socket.close(NOT_READING, "nothing was read for 30 s"), 1.0)
                return
            outgoing.sent(position)
        if not cycles:
            await wake.wait()


async def _listen(socket: WebSocket, outgoing: Outgoing, wake: asyncio.Event) -> None:
    """Take acknowledgements until the centre leaves."""
    while True:
        try:
            answer = json.loads(await socket.receive_text())
            outgoing.acknowledged(Position(str(answer["run"]), int(answer["seq"])))
        except (ValueError, KeyError, TypeError):
            await socket.close(BAD_MESSAGE, f'needed {{"run": "...", "seq": 1}}, as in {PROTOCOL}')
            return
        wake.set()
