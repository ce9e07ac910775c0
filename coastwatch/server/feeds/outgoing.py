"""The fused picture to other systems: Cursor on Target, NMEA TTM and TLL, or ASTERIX, over UDP or TCP.

A feed keeps the newest picture only and sends at most `rate` messages a second. A vessel that has no turn before the next picture is
counted, and the next picture begins with it: so each has its turn. So are those of pictures that nobody took in time.
"""

from __future__ import annotations

import math
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Self
from urllib.parse import parse_qsl, urlsplit

import numpy as np

from coastwatch.errors import AddressError
from coastwatch.formats.format import OutSettings, Vessels, parsed_site
from coastwatch.formats.registry import FORMATS, PICTURES
from coastwatch.server.link import Backoff, FeedState, Link, Reconnecting
from coastwatch.server.live_picture import LivePicture
from coastwatch.spelling import did_you_mean

TRANSPORTS = ("udp", "tcp")
EXAMPLES = "cot+udp://239.2.3.1:6969, cot+tcp://tak.example:8087, ttm+udp://10.0.0.7:10110?site=50.795,-1.105"
RATE = 500.0
TOGETHER_S = 0.1  # messages of so much time are sent together
FIRST_PERIOD_S = 10.0
RETRY, CONNECT_S = Backoff(0.5, 15.0), 5.0


@dataclass(frozen=True)
class OutAddress:
    """Where a feed is sent."""

    text: str
    format: str  # of PICTURES
    transport: str  # of TRANSPORTS
    host: str
    port: int
    rate: float = RATE  # messages a second
    site_deg: tuple[float, float] | None = None  # from which TTM gives range and bearing


def parsed_out(text: str) -> OutAddress:
    """The address of cot+udp://239.2.3.1:6969 or ttm+udp://HOST:PORT?site=LAT,LON&rate=200. Raises: AddressError."""
    parts = urlsplit(text, allow_fragments=False)
    format_, _, transport = parts.scheme.partition("+")
    options = dict(parse_qsl(parts.query, keep_blank_values=True))
    if format_ in PICTURES and (unknown := sorted(set(options) - {"rate", "site"})):
        known = "rate, site" if FORMATS[format_].needs_site else "rate"
        raise AddressError(
            f"out: got the option {unknown[0]} in {text!r}, needed one of {known}{did_you_mean(unknown[0], ('rate', 'site'))}"
        )
    try:
        port = parts.port or 0
        rate = float(options.get("rate", RATE))
    except ValueError:
        port, rate = 0, 0.0
    is_usable = format_ in PICTURES and transport in TRANSPORTS
    if not is_usable or not parts.hostname or not port or parts.path not in ("", "/") or not 0.1 <= rate <= 1e5:
        raise AddressError(
            f"out: got {text!r}, needed FORMAT+TRANSPORT://HOST:PORT with FORMAT one of {', '.join(PICTURES)}, TRANSPORT udp or tcp, and "
            f"rate=N behind '?' from 0.1 to 100000 messages a second, e.g. {EXAMPLES}"
        )
    if FORMATS[format_].in_datagrams and transport != "udp":
        raise AddressError(f"out: got {text!r}, needed {format_}+udp: {format_.upper()} is sent in datagrams")
    site = parsed_site(options.get("site", ""))
    if FORMATS[format_].needs_site != (site is not None) or ("site" in options and site is None):
        raise AddressError(f"out: got {text!r}, needed site=LAT,LON with ttm alone: range and bearing are from there")
    return OutAddress(text, format_, transport, parts.hostname, port, rate, site)


class OutFeed(Link):
    """Sends pictures to one address in a thread. Use it in a `with` block."""

    def __init__(self, address: OutAddress) -> None:
        if address.transport == "udp":
            super().__init__(word="sending")
        else:
            super().__init__(error="not connected yet")
        self.address = address
        self.sent = self.skipped = 0
        pictures = FORMATS[address.format].pictures
        if pictures is None:
            raise AddressError(f"out: got {address.text!r}, needed a format of {', '.join(PICTURES)}")
        self._encoder = pictures(OutSettings(address.site_deg))
        self._newest: tuple[LivePicture, float] | None = None  # not begun yet; and the time between pictures
        self._lock = threading.Lock()  # of it and of what was skipped
        self._before_s, self._next = math.nan, 0
        self._wake, self._ended = threading.Event(), threading.Event()

    def __enter__(self) -> Self:
        self._thread = Reconnecting(self, f"out {self.address.text}", RETRY).start(self._session, self._ended)
        return self

    def __exit__(self, *unused: object) -> None:
        self._ended.set()
        self._wake.set()
        self._thread.join(CONNECT_S + 1.0)

    def receive(self, picture: LivePicture) -> None:
        """Send this picture from now on. It may be called in any thread."""
        period_s = picture.time_s - self._before_s
        with self._lock:
            self.skipped += len(self._newest[0]) if self._newest else 0
            self._newest = picture, period_s if period_s > 0.0 else FIRST_PERIOD_S
        self._before_s = picture.time_s
        self._wake.set()

    def counters(self) -> FeedState:
        """Its state for operators, as of a feed that is received."""
        return self.as_feed(f"out {self.address.text}", records=self.sent, dropped=self.skipped)

    def _session(self) -> None:
        """Send pictures until the feed ends. Raises: OSError: the connection is gone."""
        together = max(int(self.address.rate * TOGETHER_S), 1)
        with _connection(self.address) as connection:
            self.opened()
            while not self._ended.is_set():
                self._wake.wait()
                self._wake.clear()
                with self._lock:
                    newest, self._newest = self._newest, None
                if newest is None:
                    continue
                picture, period_s = newest
                first = int(np.searchsorted(picture.array("vessel_id"), self._next))  # the vessel that is next
                left = [*range(first, len(picture)), *range(first)]
                try:
                    while left and not self._wake.is_set():
                        begun, rows = time.monotonic(), left[:together]
                        self._send_some(connection, self._encoder.messages(_vessels(picture, rows, period_s)))
                        left = left[together:]
                        self._next = int(picture.array("vessel_id")[rows[-1]]) + 1
                        self._ended.wait(max(begun + len(rows) / self.address.rate - time.monotonic(), 0.0))
                finally:
                    with self._lock:
                        self.skipped += len(left)

    def _send_some(self, connection: socket.socket, messages: Iterator[bytes]) -> None:
        some = list(messages)
        if self.address.transport == "tcp":
            connection.sendall(b"".join(some))
        else:
            for message in some:
                with suppress(ConnectionRefusedError):  # nobody listens yet
                    connection.send(message)
        self.sent += len(some)
        self.moved(sum(map(len, some)))


def _vessels(picture: LivePicture, rows: list[int], period_s: float) -> Vessels:
    """These rows of a picture, as formats take them. Args: period_s: between pictures."""
    table = picture.rows(np.array(rows, np.int64))
    return Vessels(
        picture.run_id,
        picture.time_s,
        period_s,
        every_id=picture.array("vessel_id"),
        vessel_id=table.array("vessel_id"),
        position_deg=picture.positions_deg()[rows],
        sog_kn=table.array("sog_kn"),
        cog_deg=table.array("cog_deg"),
        major_m=table.array("major_m"),
        minor_m=table.array("minor_m"),
        orientation_deg=table.array("orientation_deg"),
        mmsi=table.array("mmsi"),
        name=table.array("name").tolist(),
    )


def _connection(address: OutAddress) -> socket.socket:
    """A socket that sends to an address. Raises: OSError."""
    if address.transport == "tcp":
        return socket.create_connection((address.host, address.port), timeout=CONNECT_S)
    family, kind, proto, _, where = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_DGRAM)[0]
    connection = socket.socket(family, kind, proto)
    try:
        connection.connect(where)
    except OSError:
        connection.close()
        raise
    return connection
