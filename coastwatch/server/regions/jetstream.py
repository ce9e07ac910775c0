"""The cycles of a region over a stream of NATS JetStream: it keeps them for any number of centres, which resume by run and seq.

The stream `coastwatch-NAME` has a subject for each cycle, `coastwatch.tracks.NAME.RUN.SEQ`. A cycle is one message of
`coastwatch.tracks.v2`, cut into parts where the server takes no message of its size.
"""

from __future__ import annotations

import asyncio
import ssl
import threading
import time
from collections import deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from typing import Self

import nats
from nats.aio.client import Client
from nats.aio.msg import Msg
from nats.errors import Error, NoServersError
from nats.js import JetStreamContext
from nats.js.api import AckPolicy, ConsumerConfig, DeliverPolicy, StreamConfig
from nats.js.errors import NotFoundError

from coastwatch.errors import StoreError
from coastwatch.server.link import LOST_S, FeedState, Link, Reconnecting, first_line, reason_of
from coastwatch.server.listeners import woken_by
from coastwatch.server.regions.client import (
    CLOSE_S,
    CONNECT_S,
    RETRY,
    Connection,
    RegionAddress,
    token_of,
)
from coastwatch.server.regions.link import IN_FLIGHT, NOTHING, Position
from coastwatch.server.regions.message import MessageError, decode
from coastwatch.server.regions.publisher import Publisher

PART = "Coastwatch-Part"
"""Header of a message: the number of its part from 1 on, and how many parts the cycle has, `2/3`."""

HEADERS_BYTES = 4096  # of a message, kept free of its cycle
POLL_S = 0.5  # how long it is waited for a message before the end of the run is looked for
TOGETHER = 8  # messages that are asked for at once
SHORTEST_S = 60.0  # for which a stream keeps a cycle
FORGOTTEN_S = 300.0  # after which the server forgets a centre that asks for nothing
PINGS = 2  # without an answer, after which the connection is lost: that is noticed after LOST_S
OTHERS_S, LEAST_OTHERS = 60.0, 3  # so many messages of other senders in so long are a trouble: a restart leaves fewer
QUIET_S = 5.0  # without a message, after which a centre asks whether the server still knows it


def stream_of(name: str) -> str:
    """The stream of a region."""
    return f"coastwatch-{name}"


def subject_of(name: str, position: Position) -> str:
    """The subject of a cycle of a region."""
    return f"coastwatch.tracks.{name}.{position.run}.{position.seq}"


def position_of(subject: str) -> Position:
    """The cycle that a subject is of. Raises: MessageError: it is of none."""
    *_, run, seq = subject.split(".")
    if not seq.isdecimal():
        raise MessageError(f"subject: got {subject[:80]!r}, needed coastwatch.tracks.NAME.RUN.SEQ")
    return Position(run, int(seq))


def part_of(headers: dict[str, str] | None) -> tuple[int, int]:
    """The number of a part and how many there are. Raises: MessageError."""
    number, _, count = (headers or {}).get(PART, "").partition("/")
    if not (number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
        raise MessageError(f"header {PART}: got {number[:20]!r}, needed a part such as 2/3")
    return int(number), int(count)


@asynccontextmanager
async def _opened(address: RegionAddress) -> AsyncIterator[Client]:
    """A connection that is not made again when it breaks. Raises: OSError."""
    context = ssl.create_default_context(cafile=address.ca_file) if address.ca_file else None

    errors: list[Exception] = []

    async def note(error: Exception) -> None:
        errors.append(error)

    try:
        client = await nats.connect(
            address.url,
            error_cb=note,
            name="coastwatch",
            allow_reconnect=False,
            max_reconnect_attempts=1,  # here of the first connection
            reconnect_time_wait=0,
            connect_timeout=int(CONNECT_S),
            ping_interval=LOST_S // (PINGS + 1),
            max_outstanding_pings=PINGS,
            token=token_of(address),
            user=address.user,
            password=None if address.password_file is None else first_line(address.password_file),
            tls=context,
        )
    except NoServersError as none:
        error = errors[-1] if errors else none
        raise OSError(f"{address.where}: {reason_of(error) if isinstance(error, OSError) else error}") from error
    try:
        yield client
    finally:
        with suppress(Error, OSError):
            await client.close()


class Subscription(Connection):
    """A region as a centre sees it: as `Connection`, with cycles of a stream. The stream keeps what is not taken."""

    _parts: list[bytes]

    def _session(self) -> None:
        """As of `Connection`."""
        try:
            asyncio.run(self._receive_cycles())
        except Error as error:
            raise OSError(str(error) or type(error).__name__) from error

    def _acknowledge(self, position: Position) -> None:
        """The stream needs none: the centre keeps its position with its cycles."""

    async def _receive_cycles(self) -> None:
        name, self._parts = self.address.stream, []
        async with _opened(self.address) as client:
            stream = client.jetstream()
            try:
                begin, newest = await self._first(stream)
                wanted = ConsumerConfig(
                    deliver_policy=DeliverPolicy.ALL if begin is None else DeliverPolicy.BY_START_SEQUENCE,
                    opt_start_seq=begin,
                    ack_policy=AckPolicy.NONE,
                    inactive_threshold=FORGOTTEN_S,
                )
                asked = f"coastwatch.tracks.{name}.>"
                messages = await stream.pull_subscribe(asked, stream=stream_of(name), config=wanted)
            except NotFoundError as error:
                raise OSError(f"the server has no stream {stream_of(name)}: the region makes it") from error
            self.opened()
            try:
                await self._take(client, messages, begin is not None, newest)
            finally:
                if client.is_connected and wanted.name is not None:
                    with suppress(Error, OSError):
                        await stream.delete_consumer(stream_of(name), wanted.name)

    async def _take(self, client: Client, messages: JetStreamContext.PullSubscription, begun: bool, newest: str) -> None:
        """Take what comes until the run ends.

        Args: begun, newest: as of `_received`. Raises: Error; OSError: the connection is lost, or the server has forgotten the centre.
        """
        came_s = time.monotonic()
        while not self._ended.is_set():
            if not client.is_connected:
                raise OSError("the connection is lost")
            if len(self._waiting) >= IN_FLIGHT:
                await asyncio.sleep(POLL_S / 10.0)
                continue
            with suppress(TimeoutError):  # nats-py raises its own, or that of asyncio
                for message in await messages.fetch(TOGETHER, timeout=POLL_S):
                    begun, came_s = self._received(message, begun, newest), time.monotonic()
            if client.is_connected and time.monotonic() - came_s > QUIET_S:
                await self._still_known(messages)
                came_s = time.monotonic()

    async def _still_known(self, messages: JetStreamContext.PullSubscription) -> None:
        """A consumer that is gone looks like a stream without new cycles. Raises: Error; OSError: it is gone, a new session is needed."""
        try:
            await messages.consumer_info()
        except NotFoundError:
            stream = stream_of(self.address.stream)
            raise OSError(f"the server has forgotten this centre, or has no stream {stream}: it is asked again") from None

    async def _first(self, stream: JetStreamContext) -> tuple[int | None, str]:
        """Where the stream goes on after the last cycle that is known, None: it is not there; and the newest run. Raises: Error."""
        name, position = self.address.stream, self.incoming.position
        if position.seq:
            with suppress(NotFoundError):
                last = await stream.get_last_msg(stream_of(name), subject_of(name, position))
                return (last.seq or 0) + 1, position.run
        state = (await stream.stream_info(stream_of(name))).state
        if not state.messages:
            return None, ""
        newest = await stream.get_msg(stream_of(name), state.last_seq)
        return None, position_of(newest.subject or "").run

    def _received(self, message: Msg, begun: bool, newest: str) -> bool:
        """Take a part of a cycle. Returns: whether cycles are wanted whatever run they are of.

        Args: begun: so before; if not, those of the run that is known, and of the newest run after `from_s`.
        """
        try:
            position, (number, count) = position_of(message.subject), part_of(message.headers)
            is_same_run = position.run == self.incoming.position.run
            if not (begun or is_same_run or newest in ("", position.run)):
                return False
            self._parts = [*self._parts, message.data] if number == len(self._parts) + 1 else [message.data][: number == 1]
            if len(self._parts) < count or number < count:
                return begun
            cycle, self._parts = decode(b"".join(self._parts)), []
            if Position(cycle.run, cycle.seq) != position:
                raise MessageError(f"cycle: got {cycle.run} {cycle.seq} as {message.subject}")
        except MessageError as error:
            self.refused, self.error, self._parts = self.refused + 1, str(error), []
            return begun
        if not (begun or is_same_run or cycle.time_s > self.from_s):
            return False
        self.moved(len(message.data) * count)
        if self.incoming.received(position, cycle.merged):
            self._waiting.append(cycle)
        return True


@dataclass
class Journal(Link):
    """Publishes the cycles of a region to its stream, in a thread. Use it in a `with` block."""

    address: RegionAddress
    publisher: Publisher
    keep_s: float  # for which a stream that is made here keeps its cycles
    error: str | None = field(default="not connected yet", kw_only=True)
    published: int = 0  # cycles
    missing: int = 0  # cycles that the journal of the region did not have any more
    _sequence: int = 0  # of the last message in the stream
    _others: deque[tuple[float, int]] = field(
        default_factory=lambda: deque(maxlen=100)
    )  # when, messages of other senders before it
    _ended: threading.Event = field(default_factory=threading.Event)
    _thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        again = Reconnecting(self, f"the journal {self.address.stream}", RETRY, _reason)
        self._thread = again.start(lambda: asyncio.run(self._publish()), self._ended)
        return self

    def __exit__(self, *unused: object) -> None:
        self._ended.set()
        if self._thread is not None:
            self._thread.join(CLOSE_S)

    def counters(self) -> FeedState:
        """Its state for operators, as of a feed."""
        others = sum(count for when_s, count in list(self._others) if time.monotonic() - when_s < OTHERS_S)
        said = f"{others} messages of the last minute in {stream_of(self.address.stream)} are of another sender"
        return self.as_feed(
            f"out tracks+{self.address.url}/{self.address.stream}",
            records=self.published,
            dropped=self.missing,
            troubles=[f"{said}: each region needs a NAME of its own"] if others >= LEAST_OTHERS else [],
        )

    async def _publish(self) -> None:
        async with woken_by(self.publisher.listen) as wake, _opened(self.address) as client:
            stream = client.jetstream()
            position = await self._last(stream)
            self.opened()
            while not self._ended.is_set():
                wake.clear()
                cycles = await asyncio.to_thread(self.publisher.after, position, IN_FLIGHT, 0.0)
                for cycle, message in cycles:
                    await self._put(stream, cycle, message, client.max_payload - HEADERS_BYTES)
                    self.missing += cycle.seq - 1 - position.seq if cycle.run == position.run else 0
                    position = cycle
                if not cycles:
                    with suppress(asyncio.TimeoutError):
                        await asyncio.wait_for(wake.wait(), POLL_S)
                    if not client.is_connected:
                        raise OSError("the connection is lost")

    async def _last(self, stream: JetStreamContext) -> Position:
        """The last whole cycle in the stream, which is made if there is none. Raises: Error."""
        name = self.address.stream
        try:
            state = (await stream.stream_info(stream_of(name))).state
        except NotFoundError:
            subjects = [f"coastwatch.tracks.{name}.>"]
            await stream.add_stream(StreamConfig(stream_of(name), subjects=subjects, max_age=max(self.keep_s, SHORTEST_S)))
            self._sequence = 0
            return NOTHING
        self._sequence = state.last_seq
        if not state.messages:
            return NOTHING
        last = await stream.get_msg(stream_of(name), state.last_seq)
        position, (number, count) = position_of(last.subject or ""), part_of(last.headers)
        return position if number == count else Position(position.run, position.seq - 1)

    async def _put(self, stream: JetStreamContext, cycle: Position, message: bytes, most: int) -> None:
        """Publish a cycle in parts of at most so many bytes. The server leaves out what it has had a short time ago. Raises: Error."""
        parts = [message[k : k + most] for k in range(0, len(message), most)]
        for number, part in enumerate(parts, 1):
            headers = {PART: f"{number}/{len(parts)}", "Nats-Msg-Id": f"{cycle.run}/{cycle.seq}/{number}"}
            name = self.address.stream
            taken = await stream.publish(subject_of(name, cycle), part, stream=stream_of(name), headers=headers)
            if not taken.duplicate:
                if (others := taken.seq - 1 - self._sequence) > 0:
                    self._others.append((time.monotonic(), others))
                self._sequence = taken.seq
        self.published += 1
        self.moved(len(message))


def _reason(error: Exception) -> str | None:
    """Why a journal is not connected; None: a defect."""
    is_expected = isinstance(error, Error | MessageError | OSError | StoreError)
    return (str(error) or type(error).__name__) if is_expected else None
