"""Simulations and recordings over the sockets of live feeds, at 1 to 60 times the speed of the clock: a load generator and a demo."""

from __future__ import annotations

import math
import re
import socket
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from coastwatch.batches import Reports, Sensors
from coastwatch.errors import AddressError, InputError
from coastwatch.formats.intake.faults import Tally
from coastwatch.formats.intake.timestamps import nearest_s
from coastwatch.formats.registry import ENCODED, FORMATS
from coastwatch.sensors.recorded.nmea.feed import lines_of
from coastwatch.sensors.recorded.wire.captures import is_capture
from coastwatch.sensors.recorded.wire.stream import WireFile, items_of
from coastwatch.server.feeds.address import MQTT_PORTS, Address
from coastwatch.server.link import Backoff, Link, Reconnecting

if TYPE_CHECKING:
    from coastwatch.scenario import Scenario  # it loads all stages

STEP_S = 0.2
"""Reports of so much time are sent together."""

VIDEO_STEP_S = 0.04
"""The same of video, which would fill the buffers of the system."""

LINES_A_DATAGRAM = 10
AIS_SENTENCE = re.compile(rb"![A-Z]{2}VD[MO],")
"""It may stand behind a tag block or a time."""

CONNECT_S, LISTEN_S = 20.0, 2.0  # how long it is tried to connect, and how long at a time
SOON_S = 0.5  # until it is said that it is tried again
END_S = 0.1  # for the end of a connection: longer only while it connects, which nobody has to wait for
RETRY = Backoff(0.1, 0.5)
Batch = tuple[float, Callable[[Address], list[bytes]]]
"""An instant, and what is sent up to it over an address."""


class Sender(Protocol):
    """An open feed. `send` takes whole lines or datagrams."""

    def send(self, items: list[bytes]) -> None: ...


def send(
    batches: Iterator[Batch],
    addresses: list[Address],
    speed: float,
    stop: threading.Event,
    *,
    now: bool = False,
    began: threading.Event | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> dict[str, int]:
    """Send everything at this speed. Returns: lines or datagrams sent by feed.

    Args: stop: ends it after what is being sent; now: the instants are those of the clock, else the first one is now; began: is set when
    every feed is there and the first reports are sent; say: is given a sentence where nobody is there yet.
    Raises: OSError where nobody can be reached.
    """
    sent = {address.text: 0 for address in addresses}
    with ExitStack() as stack:
        senders = [(address, _opened(address, stack, say)) for address in addresses]
        origin: tuple[float, float] | None = None
        for instant_s, encode in batches:
            if began is not None:
                began.set()
            origin = origin or (instant_s, instant_s if now else time.time())
            if stop.wait(max(origin[1] + (instant_s - origin[0]) / speed - time.time(), 0.0)):
                break
            for address, sender in senders:
                items = encode(address)
                sender.send(items)
                sent[address.text] += len(items)
    return sent


def of_scenario(scenario: Scenario, sensors: Sensors, formats: Collection[str], *, now: bool) -> Iterator[Batch]:
    """The reports of a scenario's input by arrival.

    Args: formats: to which they are sent; now: shift a simulation so that it begins now. What was made while it was computed is left
    out, but for names and sizes: a server would count it as late.
    """
    plan = scenario.plan()
    if now:
        plan = plan.model_copy(update={"start_s": float(math.ceil(time.time()))})
    recording = scenario.input.load(sensors, scenario.seed, plan)
    numbers = defaultdict[str, Counter[bytes]](Counter)
    encode, step_s = partial(_encoded, _kinds(formats), sensors, numbers), VIDEO_STEP_S if "video" in formats else STEP_S
    before_s, stop_s = plan.start_s, plan.instant_s(plan.cycles - 1)
    begin_s = float(math.floor(time.time())) if now else before_s
    if begin_s > before_s:
        named = Reports(statics=recording.reports.between(before_s, begin_s).statics)
        yield begin_s, partial(encode, named)
        before_s = begin_s
    while before_s < stop_s:
        until_s = before_s + step_s
        yield until_s, partial(encode, recording.reports.between(before_s, until_s))
        before_s = until_s


def _kinds(formats: Collection[str]) -> dict[str, list[str]]:
    """The kinds of reports that each format carries: a kind that several could carry goes by the one that carries least else."""
    encoded_kinds = {name: FORMATS[name].encodes for name in formats}
    least = {
        kind: min(len(own) for own in encoded_kinds.values() if kind in own)
        for kinds in encoded_kinds.values()
        for kind in kinds
    }
    return {name: [kind for kind in kinds if len(kinds) == least[kind]] for name, kinds in encoded_kinds.items()}


def _encoded(
    kinds: dict[str, list[str]], sensors: Sensors, numbers: dict[str, Counter[bytes]], reports: Reports, address: Address
) -> list[bytes]:
    """What a feed carries of some reports. Args: numbers: of the messages sent so far by each sensor, by feed."""
    own = Reports(**{kind: getattr(reports, kind) for kind in kinds[address.format]})
    messages, renumber = encoded(own, address, sensors), FORMATS[address.format].renumber
    return messages if renumber is None else renumber(messages, numbers[address.text])


def of_file(path: Path, formats: Sequence[str]) -> Iterator[Batch]:
    """The messages of a recording, as they are: of a capture by the times of its packets, else lines or video by their time stamps.

    Lines without a time go with the one before. Args: formats: to which they are sent. Raises: InputError: no feed can carry the file,
    or AIS alone is asked for, and it has no sentence of it.
    """
    if is_capture(path):
        capture = WireFile(str(path), formats[0], path)
        if set(formats) == {"ais"} and not any(AIS_SENTENCE.search(line) for _, line, _ in items_of(capture, Tally())):
            raise InputError(f"feed: {path}: got no AIS sentence in its packets, needed !AIVDM or !AIVDO")
        packets = items_of(capture, Tally())
        return ((when_s, partial(_constant, formats, [message])) for when_s, message, _ in packets)
    name = next((name for name in formats if FORMATS[name].sending_times is not None), "")
    if not name:
        with_stamps = " or ".join(name for name, one in FORMATS.items() if one.sending_times is not None)
        raise InputError(f"feed: got {path} for {', '.join(formats)}, needed a feed of {with_stamps}, or a capture (PCAP)")
    if FORMATS[name].in_datagrams:
        return _of_blocks(path, name)
    if not any(AIS_SENTENCE.search(line) for line in lines_of(path, Tally())):
        count = sum(1 for _ in lines_of(path, Tally()))
        raise InputError(f"feed: {path}: got no AIS sentence in {count} lines, needed !AIVDM or !AIVDO")
    return _of_lines(path, name)


def _of_lines(path: Path, name: str) -> Iterator[Batch]:
    """The lines of a file by their time stamps, as they are read. Args: name: of their format."""
    times, time_s = FORMATS[name].sending_times, -math.inf
    assert times is not None
    sent, waiting = 0, list[bytes]()

    def lines() -> Iterator[bytes]:
        for line in lines_of(path, Tally()):
            waiting.append(line.rstrip(b"\r\n"))
            yield waiting[-1]

    for number, stamp_s in times(lines()):
        if stamp_s > time_s:
            before = number - 1 - sent
            if math.isfinite(time_s) and before:
                yield time_s, partial(_constant, [name], waiting[:before])
                del waiting[:before]
                sent += before
            time_s = stamp_s
    if waiting:
        yield max(time_s, 0.0), partial(_constant, [name], waiting)


def _of_blocks(path: Path, name: str) -> Iterator[Batch]:
    """The blocks of a file without packets by their time of day, which goes on over midnight. Raises: InputError: none has one."""
    times, time_s, first = FORMATS[name].sending_times, math.nan, list[bytes]()  # blocks before the first time of day
    assert times is not None
    for _, block, _ in items_of(WireFile(str(path), name, path), Tally()):
        of_day_s = next((stamp_s for _, stamp_s in times([block])), math.nan)
        if math.isfinite(of_day_s):
            time_s = nearest_s(of_day_s, time_s) if math.isfinite(time_s) else of_day_s
        first.append(block)
        if math.isfinite(time_s):
            yield time_s, partial(_constant, [name], first)
            first = []
    if first:
        raise InputError(f"feed: {path}: got {name} without time of day, needed one in some block, or a capture (PCAP)")


def _constant(formats: Sequence[str], messages: list[bytes], address: Address) -> list[bytes]:
    return messages if address.format in formats else []


def encoded(reports: Reports, address: Address, sensors: Sensors) -> list[bytes]:
    """The reports that a feed of this format carries, as its lines or datagrams."""
    encode = FORMATS[address.format].encode
    return [] if encode is None else encode(reports, sensors)


class _Datagrams:
    def __init__(self, address: Address, stack: ExitStack) -> None:
        self._whole, self._to = FORMATS[address.format].in_datagrams, (address.host, address.port)
        self._socket = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        if address.interface:
            self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(address.interface))

    def send(self, items: list[bytes]) -> None:
        step = 1 if self._whole else LINES_A_DATAGRAM
        for low in range(0, len(items), step):
            with suppress(ConnectionRefusedError):  # nobody listens yet
                self._socket.sendto(b"\r\n".join(items[low : low + step]), self._to)


class _Stream(Link):
    """A stream that is opened again when it breaks. What is sent while nobody is there is lost, and delays no other feed."""

    def __init__(self, address: Address, stack: ExitStack, say: Callable[[str], None]) -> None:
        """Args: say: as of `send`. Raises: OSError that names the address: nobody was there in CONNECT_S."""
        super().__init__()
        self._address = address
        self._socket: socket.socket | None = None
        self._there, self._broken, self._ended = threading.Event(), threading.Event(), threading.Event()
        self._thread = Reconnecting(self, f"send {address.text}", RETRY).start(self._session, self._ended)
        stack.callback(self._close)
        if not self._there.wait(SOON_S):
            say(f"{address.text}: {self.error or 'nobody is there yet'}; it is tried again for {CONNECT_S:.0f} s")
            if not self._there.wait(CONNECT_S - SOON_S):
                raise OSError(f"{address.text}: {self.error}")

    def send(self, items: list[bytes]) -> None:
        if items and (connection := self._socket) is not None:
            try:
                connection.sendall(b"\r\n".join([*items, b""]))
            except OSError:
                self._socket = None
                self._broken.set()

    def _session(self) -> None:
        """Hold a connection until sending fails. Raises: OSError: nobody is there."""
        self._broken.clear()
        with _connection(self._address) as self._socket:
            self.opened()
            self._there.set()
            if not self._ended.is_set():
                self._broken.wait()

    def _close(self) -> None:
        self._ended.set()
        self._broken.set()
        self._thread.join(END_S)


class _File:
    def __init__(self, address: Address, stack: ExitStack) -> None:
        self._file = stack.enter_context(Path(address.path).open("ab"))  # noqa: SIM115 (the stack closes it)

    def send(self, items: list[bytes]) -> None:
        if items:
            self._file.write(b"\r\n".join([*items, b""]))
            self._file.flush()


def _opened(address: Address, stack: ExitStack, say: Callable[[str], None]) -> Sender:
    if address.transport in MQTT_PORTS or FORMATS[address.format].encode is None:
        encoders = " or ".join(", ".join(ENCODED).rsplit(", ", 1))
        raise AddressError(f"feed: got {address.text!r}, needed a feed of {encoders} that is not MQTT, to send to it")
    if address.transport == "udp":
        return _Datagrams(address, stack)
    return _File(address, stack) if address.transport == "file" else _Stream(address, stack, say)


def _connection(address: Address) -> socket.socket:
    """A stream: to a listener, or of the first that connects. Raises: OSError: nobody is there."""
    if address.transport == "listen":
        with socket.create_server((address.host, address.port)) as server:
            server.settimeout(LISTEN_S)
            try:
                connection = server.accept()[0]
            except TimeoutError as error:
                raise OSError(f"nobody has connected in {CONNECT_S:.0f} s") from error
    else:
        connection = socket.create_connection((address.host, address.port), timeout=LISTEN_S)
    connection.settimeout(CONNECT_S)  # of each sending
    return connection
