"""Radar video to viewers: sectors of the newest turn over a WebSocket, and one turn as a picture."""

from __future__ import annotations

import asyncio
import io
import json
import struct
import zlib
from collections.abc import Sequence
from functools import lru_cache
from typing import Annotated

import numpy as np
from fastapi import APIRouter, HTTPException, Path, Response
from pydantic import BaseModel, ConfigDict, Field
from starlette.websockets import WebSocket

from coastwatch.operators.api.answers import REFUSALS, In
from coastwatch.operators.api.streaming import first_done, sent_in_time, take_messages
from coastwatch.operators.api.validation import CheckedRoute
from coastwatch.server.listeners import woken_by
from coastwatch.server.live_video import RANGES, ROWS, SECTORS, SHADES, LiveVideo, Sector
from coastwatch.spelling import utc_text

PROTOCOL = "coastwatch.video.v1"
HEADER = struct.Struct("<4sBBHIIIBBHH6xdddf4x")
"""Magic, version, kind, radar, run, number, begun, place, sectors, rows, ranges, time, latitude, longitude, range."""

MAGIC, VERSION, SECTOR, HEARTBEAT = b"CWV1", 1, 1, 5
DEFLATE_LEVEL = 6
SILENCE_S = 10.0
"""Without a new sector a heartbeat is sent so often."""

NO_VIDEO = 4404
"""Close code."""

NO_RADARS = "there is no radar video here: it needs a live run of a scenario with radars"
WAIT_S, LOOK_S = 10.0, 0.1
"""How long a request for one turn waits for it, and how often it looks."""

router = APIRouter(prefix="/api/v1", responses=REFUSALS, route_class=CheckedRoute)


class Wish(BaseModel):
    """The radars that a viewer asks for."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    radars: Annotated[list[str], Field(max_length=256)]


@lru_cache(maxsize=256)
def message(run: int, sector: Sector) -> bytes:
    """A sector as a message, the same for all viewers."""
    latitude, longitude = sector.site_deg
    head = HEADER.pack(
        MAGIC, VERSION, SECTOR, sector.radar, run, sector.number, sector.begun, sector.place, SECTORS, ROWS, RANGES,
        sector.time_s, latitude, longitude, sector.range_m,
    )  # fmt: skip
    return head + zlib.compress(sector.cells, DEFLATE_LEVEL)


def heartbeat(run: int) -> bytes:
    """A message without a sector."""
    return HEADER.pack(MAGIC, VERSION, HEARTBEAT, 0, run, 0, 0, 0, SECTORS, ROWS, RANGES, 0.0, 0.0, 0.0, 0.0)


async def serve_video(socket: WebSocket, video: LiveVideo | None, run: int, number: int) -> None:
    """Send sectors to one viewer until it leaves or does not read. Args: run, number: of the last sector that it has."""
    await socket.accept(subprotocol=PROTOCOL if PROTOCOL in socket.scope.get("subprotocols", []) else None)
    if video is None or not video.names:
        await socket.close(NO_VIDEO, NO_RADARS)
        return
    await socket.send_text(json.dumps({"run": video.run, "radars": video.names}))
    seen: dict[int, int] = {}  # by radar that is asked for, the number of its last sector
    first = number if run == video.run else 0  # what it has of the radars that it asks for first
    async with woken_by(video.listen) as wake:

        def ask(text: str) -> None:
            nonlocal first
            radars = [video.names.index(name) for name in Wish.model_validate_json(text).radars]
            kept = {radar: seen.get(radar, first) for radar in radars}
            seen.clear()
            seen.update(kept)
            first = 0
            wake.set()

        async def sending() -> None:
            while True:
                wake.clear()
                video.ask(seen)
                if sectors := video.since(seen):  # again after each one: a slow viewer gets the newest of each sector alone
                    if not await sent_in_time(socket, message(video.run, sectors[0])):
                        return
                    if sectors[0].radar in seen:
                        seen[sectors[0].radar] = sectors[0].number
                    continue
                try:
                    await asyncio.wait_for(wake.wait(), SILENCE_S)
                except TimeoutError:
                    if not await sent_in_time(socket, heartbeat(video.run)):
                        return

        needed = f'needed {{"radars": ["..."]}} with names of radars, as in {PROTOCOL}'
        await first_done(sending(), take_messages(socket, ask, needed))


@router.get("/video/{radar}.png", response_class=Response, responses={200: {"content": {"image/png": {}}}})
async def picture(radar: Annotated[str, Path(max_length=64)], service: In) -> Response:
    """The newest turn of a radar's video: azimuths from north down, ranges to the right, grey by level over the noise.

    The far edge is in `X-Range-M`, the time of the newest spoke in `X-Time`. The answer waits for a turn where nobody has
    looked at this radar.
    """
    video = service.video
    if video is None or radar not in video.names:
        raise HTTPException(
            404,
            NO_RADARS if video is None or not video.names else f"radar: got {radar!r}, needed one of {', '.join(video.names)}",
        )
    number, loop = video.names.index(radar), asyncio.get_running_loop()
    until_s = loop.time() + WAIT_S
    while (turn := video.turn(number)) is None and loop.time() < until_s:
        video.ask([number])
        await asyncio.sleep(LOOK_S)
    if turn is None:
        text = (
            f"no whole turn of video of radar {radar} can be drawn: none came within {WAIT_S:g} s, or its heading is not known"
        )
        raise HTTPException(503, text)
    video.ask([number])
    headers = {"X-Range-M": f"{turn[0].range_m:.1f}", "X-Time": utc_text(max(sector.time_s for sector in turn))}
    return Response(await asyncio.to_thread(_png, turn), media_type="image/png", headers=headers)


def _png(turn: Sequence[Sector]) -> bytes:
    from PIL import Image  # takes a while, and few ask for it

    grey, out = np.concatenate([sector.levels() for sector in turn]) * np.uint8(255 // SHADES), io.BytesIO()
    Image.fromarray(grey).save(out, "PNG")
    return out.getvalue()
