"""Frames to viewers: the newest picture, the last deltas, and one mark for each viewer instead of a queue."""

from __future__ import annotations

import asyncio
import json
import secrets
import threading
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field
from starlette.websockets import WebSocket

from coastwatch.batches import Array
from coastwatch.operators.api.metrics import Metrics
from coastwatch.operators.api.streaming import first_done, sent_in_time, take_messages
from coastwatch.operators.api.wire import PROTOCOL, RING, UNKNOWN_SOG, Encoder, Frame, since
from coastwatch.server.live_picture import LivePicture
from coastwatch.store.bbox import inside

SILENCE_S = 10.0
"""Without a new frame a heartbeat is sent so often."""

NEEDED = f"needed JSON with bbox, kinds, min_sog and flags, as in {PROTOCOL}"
Degrees = Annotated[float, Field(ge=-180.0, le=180.0)]


class Subset(BaseModel):
    """The vessels that a viewer asks for."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    bbox: tuple[Degrees, Degrees, Degrees, Degrees] | None = None  # south, west, north, east
    kinds: Annotated[int, Field(ge=0, le=7)] = 7  # any of these bits; 7: also vessels that nobody sees now
    min_sog: Annotated[float, Field(ge=0.0)] = 0.0  # knots
    flags: Annotated[int, Field(ge=0, le=255)] = 0  # any of these bits; 0: all vessels

    def ids(self, frame: Frame) -> Array:
        """The ids of a frame with 0 for vessels that are left out. (S,)"""
        vessels, wanted = frame.vessels, frame.ids != 0
        if self.bbox is not None:
            wanted &= inside(frame.position_deg.T, self.bbox)
        if self.kinds != 7:
            wanted &= (vessels["kind"] & self.kinds) != 0
        if self.min_sog > 0.0:
            wanted &= (vessels["sog"] >= self.min_sog * 100.0) & (vessels["sog"] != UNKNOWN_SOG)
        if self.flags:
            wanted &= (vessels["flag"] & self.flags) != 0
        return np.where(wanted, frame.ids, 0)


@dataclass(eq=False)
class Viewer:
    """What one viewer has."""

    run: int
    seq: int  # of the last message; 0: nothing
    subset: Subset | None = None  # None: all vessels
    ids: Array | None = None  # (S,) that it has, where it asked for a subset
    version: int = 1  # of its frames
    wake: asyncio.Event = field(default_factory=asyncio.Event)

    def message(self, frames: deque[Frame]) -> bytes:
        """The message that brings it to the newest frame; it is marked as sent."""
        frame = frames[-1]
        last = next((f for f in frames if f.seq == self.seq), None) if self.run == frame.run and self.seq else None
        if self.subset is None:
            base = 0 if last is None else last.seq
            made = self.version, base
            if last is not None and made not in frame.messages:  # made once for all viewers that have the same frame
                frame.messages[made] = frame.delta(base, last.ids, frame.ids, since(frames, base), self.version)
            data = frame.messages[made] if last is not None else frame.full(self.version)
        else:
            now = self.subset.ids(frame)
            before = np.zeros(0, np.uint32) if last is None or self.ids is None else self.ids
            base = 0 if last is None or self.ids is None else self.seq
            data = frame.delta(base, before, now, since(frames, self.seq), self.version)
            self.ids = now
        self.run, self.seq = frame.run, frame.seq
        return data

    def ask(self, text: str) -> None:
        """Take the vessels that a message of the viewer asks for. Raises: ValueError."""
        wish = json.loads(text)
        self.subset = Subset.model_validate(wish) if wish != {} else None
        self.run = self.seq = 0
        self.ids = None
        self.wake.set()


class Hub:
    """The newest picture and its viewers."""

    def __init__(self, metrics: Metrics) -> None:
        self.picture: LivePicture | None = None
        self.run = self.newest_seq = 0
        self.frames: deque[Frame] = deque(maxlen=RING + 1)
        self.viewers: set[Viewer] = set()
        self._metrics, self._encoder, self._of_run = metrics, Encoder(0), -1
        self._loop: asyncio.AbstractEventLoop | None = None
        self._early: tuple[LivePicture, Frame] | None = None  # from before the loop ran
        self._opening = threading.Lock()

    def open(self) -> None:
        """Begin to send frames in the running event loop."""
        with self._opening:
            self._loop = asyncio.get_running_loop()
            if self._early is not None:
                self._publish(*self._early)

    def receive(self, picture: LivePicture) -> None:
        """Take a picture and send it to all viewers. It may be called in any thread, one call at a time."""
        if picture.run_id != self._of_run:
            self._of_run, run = picture.run_id, secrets.randbelow(2**32 - 1) + 1
            self._encoder = Encoder(run)
        frame = self._encoder.frame(picture)
        with self._opening:
            if self._loop is None:
                self._early = picture, frame
                return
        with suppress(RuntimeError):  # the loop has been closed
            self._loop.call_soon_threadsafe(self._publish, picture, frame)

    def _publish(self, picture: LivePicture, frame: Frame) -> None:
        if frame.run != self.run:
            self.frames.clear()
        self.picture, self.run = picture, frame.run
        if self.frames:
            self.frames[-1] = self.frames[-1].past()
        self.frames.append(frame)
        self.newest_seq = frame.seq
        for viewer in self.viewers:
            viewer.wake.set()

    async def serve(self, socket: WebSocket, run: int, seq: int, version: int = 1) -> None:
        """Send frames to one viewer until it leaves or does not read.

        Args: run, seq: of the last frame that it has; version: of the frames.
        """
        viewer = Viewer(run, seq, version=version)
        self.viewers.add(viewer)
        self._metrics.viewers.set(len(self.viewers))
        try:
            await first_done(self._send(socket, viewer), take_messages(socket, viewer.ask, NEEDED))
        finally:
            self.viewers.discard(viewer)
            self._metrics.viewers.set(len(self.viewers))

    async def _send(self, socket: WebSocket, viewer: Viewer) -> None:
        while True:
            viewer.wake.clear()
            if self.frames and (viewer.run, viewer.seq) != (self.run, self.frames[-1].seq):
                skipped = self.frames[-1].seq - viewer.seq - 1 if viewer.run == self.run and viewer.seq else 0
                data = viewer.message(self.frames)
                self._metrics.sent(data, skipped)
                if not await self._send_one(socket, data):
                    return
                continue
            try:
                await asyncio.wait_for(viewer.wake.wait(), SILENCE_S)
            except TimeoutError:
                if self.frames and not await self._send_one(socket, self.frames[-1].heartbeat(viewer.version)):
                    return

    async def _send_one(self, socket: WebSocket, data: bytes) -> bool:
        """As `sent_in_time`, counted."""
        in_time = await sent_in_time(socket, data)
        self._metrics.slow_closed.inc(not in_time)
        return in_time
