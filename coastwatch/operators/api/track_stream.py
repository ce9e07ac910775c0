"""Cycles of tracks of a region to its centres over WebSocket: in order, a few at a time, each once."""

from __future__ import annotations

import asyncio
import json

from starlette.websockets import WebSocket

from coastwatch.operators.api.streaming import first_done, sent_in_time, take_messages
from coastwatch.server.listeners import woken_by
from coastwatch.server.regions.link import Outgoing, Position
from coastwatch.server.regions.message import PROTOCOL, PROTOCOLS
from coastwatch.server.regions.publisher import Publisher

NO_TRACKS = 4404
"""Close code."""


async def serve_tracks(socket: WebSocket, publisher: Publisher | None, had: Position, from_s: float) -> None:
    """Send cycles to one centre until it leaves or does not read. Args: had: the last cycle that it has; from_s: as of `Publisher`."""
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
