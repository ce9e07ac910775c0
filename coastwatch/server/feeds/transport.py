"""Bytes of live feeds over TCP, UDP and files: asyncio in a thread of its own, with one bounded inbox for each feed.

A full inbox stops the reading of a stream, so that its sender waits. Of datagrams and messages of MQTT the oldest are dropped then, and
counted.
"""

from __future__ import annotations

import asyncio
import ipaddress
import logging
import os
import socket
import sys
import threading
from collections import OrderedDict, deque
from collections.abc import Callable, Coroutine, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from importlib.util import find_spec
from itertools import count
from pathlib import Path
from typing import Any, Self

from coastwatch.errors import AddressError
from coastwatch.formats.decoding import Item
from coastwatch.formats.registry import FORMATS
from coastwatch.server.clock import now_s
from coastwatch.server.feeds.address import MQTT_PORTS, Address
from coastwatch.server.link import LOST_S, Backoff, Link, Reconnecting, first_line, notice_loss, reason_of

MOST_ITEMS = 200_000
"""Lines or datagrams that may wait in an inbox."""

MOST_BYTES = 64 << 20
"""Their bytes together."""

MOST_SENDERS = 200
"""Connections to one feed that listens: more would take the file handles of the others."""

MOST_ADDRESSES = 4_096
"""Senders of datagrams to one feed that are told apart."""

LONGEST_LINE = 65_536
READ_BYTES = 65_536
RETRY = Backoff(0.5, 15.0)
FULL_WAIT_S, TAIL_WAIT_S = 0.02, 0.2
MARK_BYTES = 256  # before the place of reading, compared to notice that a file was emptied and has grown past that place again
FORMER_S = 5.0  # how long a file that was renamed must not have grown before it is closed
MOST_AT_ONCE = 256  # datagrams of a feed, before the other feeds have their turn
DATAGRAM_BUFFER = 4 << 20  # bytes that the system may hold while Python computes

LOG = logging.getLogger("coastwatch.serve")


@dataclass
class Inbox(Link):
    """What a feed has received and nobody has taken yet, and its counters."""

    address: Address
    received: int = 0  # lines or datagrams
    dropped: int = 0  # lines too long, datagrams that had no room
    port: int = 0  # on which it listens
    buffer: int = 0  # bytes that the system holds for it while nobody reads; 0: of a stream
    _items: deque[Item] = field(default_factory=deque)
    _put_bytes: int = 0  # written by the thread that receives
    _taken_bytes: int = 0  # written by the thread that takes
    _dropped_bytes: int = 0  # written by the thread that receives
    _numbers: Iterator[int] = field(default_factory=count)
    _senders: OrderedDict[tuple[object, ...], int] = field(default_factory=OrderedDict)  # by address, the newest last

    @property
    def is_full(self) -> bool:
        """Whether it takes nothing more for now."""
        return len(self._items) >= MOST_ITEMS or self._put_bytes - self._taken_bytes - self._dropped_bytes >= MOST_BYTES

    def new_sender(self) -> int:
        """The number of a sender that has just connected."""
        return next(self._numbers)

    def sender_at(self, address: tuple[object, ...]) -> int:
        """The number of the sender of datagrams at an address."""
        if address not in self._senders:
            self._senders[address] = self.new_sender()
            if len(self._senders) > MOST_ADDRESSES:
                self._senders.popitem(last=False)
        self._senders.move_to_end(address)
        return self._senders[address]

    def sender_name(self, number: int) -> str:
        """The address of a sender of datagrams, for operators."""
        known = next((address for address, own in list(self._senders.items()) if own == number), None)
        return f"sender {number}" if known is None else ":".join(map(str, known[:2]))

    def drop_oldest(self) -> None:
        """Make room for a datagram or message."""
        with suppress(IndexError):  # the other thread has just taken it
            while self.is_full:
                self._dropped_bytes += len(self._items.popleft()[1])
                self.dropped += 1

    def put(self, lines: list[bytes], size: int, sender: int) -> None:
        """Add lines or datagrams that have just come. Args: size: bytes received."""
        at_s = now_s()
        self.size, self.heard_s = self.size + size, at_s
        self._put_bytes += sum(map(len, lines))
        self._items.extend((at_s, line, sender) for line in lines)
        self.received += len(lines)  # last: what is counted is there for the other thread

    def pop_first(self, most: int) -> list[Item]:
        """The first of what waits, in order of arrival."""
        items: list[Item] = []
        with suppress(IndexError):
            while len(items) < most:
                items.append(self._items.popleft())
                self._taken_bytes += len(items[-1][1])  # at once: the other thread drops what has no room
        return items


class Receiver:
    """Receives all feeds in a thread. Use it in a `with` block."""

    def __init__(self, addresses: list[Address]) -> None:
        """Raises: AddressError: a package is missing."""
        if any(address.transport in MQTT_PORTS for address in addresses) and find_spec("aiomqtt") is None:
            raise AddressError("feed: got an MQTT feed, needed the package aiomqtt: pip install 'coastwatch[mqtt]'")
        self.inboxes = [Inbox(address) for address in addresses]
        self._opened = threading.Event()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread = threading.Thread(target=lambda: asyncio.run(self._receive()), name="feeds")
        self._failed: OSError | None = None

    def __enter__(self) -> Self:
        self._thread.start()
        self._opened.wait()
        if self._failed is not None:
            self._thread.join()
            raise self._failed
        return self

    def __exit__(self, *unused: object) -> None:
        if self._loop is not None:
            with suppress(RuntimeError):  # it has ended
                self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join()

    async def _receive(self) -> None:
        self._loop, self._ended = asyncio.get_running_loop(), asyncio.Event()
        closers: list[asyncio.AbstractServer | _Datagrams] = []
        tasks: list[asyncio.Task[None]] = []
        try:
            for inbox in self.inboxes:
                if inbox.address.transport in ("listen", "udp"):
                    closers.append(await _opened(inbox))
                else:
                    again = Reconnecting(inbox, f"feed {inbox.address.name}", RETRY)
                    read = partial(READERS[inbox.address.transport], inbox)
                    tasks.append(asyncio.create_task(again.run_async(read)))
        except OSError as error:
            self._failed = error
        except Exception as error:  # else the start would wait for ever
            self._failed = OSError(f"feeds: {type(error).__name__}: {error}")
        self._opened.set()
        try:
            if self._failed is None:
                await self._ended.wait()
        finally:
            for closer in closers:
                closer.close()
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)


async def _opened(inbox: Inbox) -> asyncio.AbstractServer | _Datagrams:
    """A listening socket of a feed. Raises: OSError that names its address."""
    address = inbox.address
    try:
        if address.transport == "listen":
            room = _Room(inbox)
            server = await asyncio.start_server(room.accepted, address.host, address.port, limit=READ_BYTES)
            inbox.port = server.sockets[0].getsockname()[1]
            return server
        receiver = await _bound(address)
    except OSError as error:
        raise OSError(f"feed {address.text}: {reason_of(error)}") from error
    except UnicodeError as error:
        raise OSError(f"feed {address.text}: got {address.host!r}, which is no name of a machine: {error}") from error
    inbox.port, inbox.connected = receiver.getsockname()[1], 1
    with suppress(OSError):
        receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, DATAGRAM_BUFFER)
    granted = receiver.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
    inbox.buffer = granted // 2 if sys.platform == "linux" else granted  # Linux says twice what it gives
    if inbox.buffer < DATAGRAM_BUFFER:
        LOG.warning(
            f"feed {address.name}: the system grants a receive buffer of {inbox.buffer >> 10} kB, wanted {DATAGRAM_BUFFER >> 10}: "
            f"datagrams are lost while this machine is busy; `sysctl -w net.core.rmem_max={DATAGRAM_BUFFER}` allows it"
        )
    return _Datagrams(inbox, receiver)


async def _bound(address: Address) -> socket.socket:
    """A socket that takes datagrams sent to an address of this machine or to a multicast group. Raises: OSError, UnicodeError."""
    where: tuple[Any, ...] = (address.host, address.port)
    family, kind, proto = socket.AF_INET, socket.SOCK_DGRAM, 0
    if not address.is_group:
        found = await asyncio.get_running_loop().getaddrinfo(address.host, address.port, type=kind)
        family, kind, proto, _, where = found[0]
    receiver = socket.socket(family, kind, proto)
    try:
        if address.is_group:
            receiver.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # others of this machine may listen too
        receiver.bind(where)
        if address.is_group:
            group, own = (ipaddress.IPv4Address(one).packed for one in (address.host, address.interface or "0.0.0.0"))
            receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group + own)
        receiver.setblocking(False)
    except OSError:
        receiver.close()
        raise
    return receiver


class _Datagrams:
    """Datagrams of one feed, of lines or of ASTERIX. Many are read at a time: of video come thousands a second."""

    def __init__(self, inbox: Inbox, receiver: socket.socket) -> None:
        """Args: receiver: does not block."""
        self._inbox, self._receiver, self._whole = inbox, receiver, FORMATS[inbox.address.format].in_datagrams
        self._buffer = memoryview(bytearray(READ_BYTES))  # `recvfrom` would take so much for each, and leave holes in memory
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(receiver, self._read)

    def close(self) -> None:
        """Take nothing more."""
        self._loop.remove_reader(self._receiver)
        self._receiver.close()

    def _read(self) -> None:
        """Take what waits, at most so much that other feeds have their turn."""
        with suppress(OSError):  # nothing more waits
            for _ in range(MOST_AT_ONCE):
                size, address = self._receiver.recvfrom_into(self._buffer)
                data = bytes(self._buffer[:size])
                if self._inbox.is_full:
                    self._inbox.drop_oldest()
                self._inbox.put([data] if self._whole else data.splitlines(), len(data), self._inbox.sender_at(address))


class _Room:
    """The senders that are connected to a feed that listens. Where there is no room, the one that is silent longest goes."""

    def __init__(self, inbox: Inbox) -> None:
        self._inbox = inbox
        self._silent: OrderedDict[int, asyncio.StreamWriter] = (
            OrderedDict()
        )  # by sender, the one that was heard last at the end

    async def accepted(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Read one sender that has connected."""
        inbox, sender = self._inbox, self._inbox.new_sender()
        if len(self._silent) >= MOST_SENDERS:
            _, longest = self._silent.popitem(last=False)
            longest.close()
            inbox.error = f"more than {MOST_SENDERS} senders: the one that was silent longest was closed"
        self._silent[sender] = writer
        inbox.connections, inbox.connected = inbox.connections + 1, len(self._silent)
        notice_loss(writer.get_extra_info("socket"))

        def heard() -> None:
            if sender in self._silent:
                self._silent.move_to_end(sender)

        try:
            await _read_stream(inbox, reader, sender, heard)
        except Exception as error:
            inbox.error = str(error) or type(error).__name__
        except asyncio.CancelledError:
            pass  # the receiver ends; Python 3.11 would print a traceback for a handler that was cancelled
        finally:
            self._silent.pop(sender, None)
            inbox.connected = len(self._silent)
            writer.close()


async def _connected(inbox: Inbox) -> None:
    """Connect to a sender and read it until it is gone. Raises: OSError."""
    try:
        reader, writer = await asyncio.open_connection(inbox.address.host, inbox.address.port, limit=READ_BYTES)
    except UnicodeError as error:
        raise OSError(f"{inbox.address.host!r} is no name of a machine: {error}") from error
    inbox.opened()
    notice_loss(writer.get_extra_info("socket"))
    try:
        await _read_stream(inbox, reader, inbox.new_sender())
        inbox.error = "the sender closed the connection"
    finally:
        writer.close()


async def _read_stream(
    inbox: Inbox, reader: asyncio.StreamReader, sender: int, heard: Callable[[], None] = lambda: None
) -> None:
    """Read lines to the end of a stream. A line that is too long is dropped up to its end. Args: heard: called when something came."""
    rest = b""
    while data := await reader.read(READ_BYTES):
        heard()
        rest = _put_lines(inbox, rest + data, len(data), sender)
        while inbox.is_full:
            await asyncio.sleep(FULL_WAIT_S)
    _put_last_line(inbox, rest, sender)


def _put_lines(inbox: Inbox, data: bytes, size: int, sender: int) -> bytes:
    """Put the whole lines into the inbox. Returns: the beginning of the next one."""
    *lines, rest = data.split(b"\n")
    good = [line for line in lines if len(line) <= LONGEST_LINE]
    inbox.dropped += len(lines) - len(good)
    inbox.put(good, size, sender)
    return rest if len(rest) <= LONGEST_LINE else rest[: LONGEST_LINE + 1]  # so long that it is dropped, whatever follows


def _put_last_line(inbox: Inbox, rest: bytes, sender: int) -> None:
    """Put a line into the inbox whose end will not come any more. Args: rest: what came of it, maybe nothing."""
    if rest:
        _put_lines(inbox, rest + b"\n", 0, sender)


class GrowingFile:
    """A file that another program writes. It stays open when it is renamed or deleted, so that its end is not lost."""

    def __init__(self, path: Path, sender: int, at_start: bool) -> None:
        """Args: sender: number of who sends its lines; at_start: read it from its beginning, else from its end on. Raises: OSError."""
        self._file = os.open(path, os.O_RDONLY)
        status = os.fstat(self._file)
        self.identity = status.st_dev, status.st_ino
        self.sender = sender
        self.rest = b""  # the beginning of a line whose end has not come
        self.grown_s = 0.0  # when something came last, by any clock
        self._position = 0 if at_start else status.st_size
        self._looked: tuple[int, int] | None = None  # size and time of modification at the last look
        self._mark = self._before()

    def is_emptied(self) -> bool:
        """Whether the file was emptied since the last look. Then it is read from its beginning. Raises: OSError."""
        status = os.fstat(self._file)
        looked = status.st_size, status.st_mtime_ns
        if looked == self._looked:
            return False
        emptied = status.st_size < self._position or self._before() != self._mark
        self._looked = looked
        if emptied:
            self._position, self._mark = 0, b""
        return emptied

    def read_added(self, most: int) -> bytes:
        """What was added, up to so many bytes. Raises: OSError."""
        data = os.pread(self._file, most, self._position)
        if data:
            self._position += len(data)
            self._mark = (self._mark + data)[-MARK_BYTES:]
        return data

    def close(self) -> None:
        """Give the file back."""
        os.close(self._file)

    def _before(self) -> bytes:
        begin = max(self._position - MARK_BYTES, 0)
        return os.pread(self._file, self._position - begin, begin)


async def _tailed(inbox: Inbox) -> None:
    """Read what is added to a file, from its end on; from the beginning where the file is replaced or `from=start` is given.

    A file that was renamed is read to its end before the one in its place, and a while longer: who writes it may still have it open.
    """
    loop, path, at_start = asyncio.get_running_loop(), Path(inbox.address.path), inbox.address.options.get("from") == "start"
    files: list[GrowingFile] = []  # the newest is last
    try:
        while True:
            try:
                status = os.stat(path)
                if not files or files[-1].identity != (status.st_dev, status.st_ino):
                    files.append(GrowingFile(path, inbox.new_sender(), at_start or bool(files)))
                    inbox.connections += 1
                inbox.connected, inbox.error = 1, None
            except OSError as error:
                inbox.connected, inbox.error = 0, str(error.strerror or error)
                at_start = True  # a file that comes is read whole
            try:
                while any(_read_added(file, inbox, loop.time()) for file in files):
                    await asyncio.sleep(0)
            except OSError as error:
                inbox.connected, inbox.error = 0, str(error.strerror or error)
            for file in files[:-1]:
                if loop.time() - file.grown_s >= FORMER_S:
                    _put_last_line(inbox, file.rest, file.sender)
                    file.close()
                    files.remove(file)
            await asyncio.sleep(TAIL_WAIT_S)
    finally:
        for file in files:
            file.close()


def _read_added(file: GrowingFile, inbox: Inbox, at_s: float) -> bool:
    """Whether something was added to a file: it is in the inbox then. A full inbox waits. Args: at_s: now. Raises: OSError."""
    if inbox.is_full:
        return False
    if file.is_emptied():
        _put_last_line(inbox, file.rest, file.sender)
        file.rest, file.sender = b"", inbox.new_sender()
        inbox.connections += 1
    data = file.read_added(16 * READ_BYTES)
    file.rest = _put_lines(inbox, file.rest + data, len(data), file.sender)
    file.grown_s = at_s if data or not file.grown_s else file.grown_s
    return bool(data)


async def _subscribed(inbox: Inbox) -> None:
    """Take the messages of an MQTT topic, whole lines each, until the broker is gone. Raises: OSError."""
    from aiomqtt import Client, Message, MqttError, TLSParameters  # of the extra `mqtt`

    address, sender = inbox.address, inbox.new_sender()

    class Taken(asyncio.Queue[Message]):
        """Messages go into the inbox as they come: aiomqtt cannot stop reading, and a bounded queue of it drops what nobody counts."""

        def put_nowait(self, item: Message) -> None:
            data = item.payload if isinstance(item.payload, bytes) else str(item.payload).encode()
            if inbox.is_full:
                inbox.drop_oldest()
            _put_lines(inbox, data.rstrip(b"\r\n") + b"\n", len(data), sender)

    tls = TLSParameters(ca_certs=address.options.get("ca-file")) if address.transport == "mqtts" else None
    try:
        path, user = address.options.get("password-file"), address.options.get("user")
        password = None if path is None else first_line(path)
        async with Client(
            address.host,
            address.port,
            username=user,
            password=password,
            tls_params=tls,
            keepalive=LOST_S // 2,  # a question after so long, and no answer for as long
            queue_type=Taken,
        ) as client:
            await client.subscribe(address.path, qos=1)
            inbox.opened()
            async for _ in client.messages:  # there is none: it ends with the connection
                pass
    except (MqttError, OSError) as error:
        raise OSError(str(error)) from error


Reader = Callable[[Inbox], Coroutine[Any, Any, None]]

READERS: dict[str, Reader] = {"tcp": _connected, "file": _tailed, "mqtt": _subscribed, "mqtts": _subscribed}
"""What receives a feed that does not listen, by transport."""
