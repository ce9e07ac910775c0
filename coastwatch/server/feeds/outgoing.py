"""The fused picture to other systems: Cursor on Target, or NMEA TTM and TLL, over UDP or TCP.

A feed keeps the newest picture only and sends at most `rate` messages a second. A vessel that has no turn before the next picture is
counted, and the next picture begins with it: so each has its turn.
"""

from __future__ import annotations

import ipaddress
import logging
import math
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import reduce
from operator import xor
from typing import Any, Protocol, Self
from urllib.parse import parse_qsl, urlsplit
from xml.sax.saxutils import quoteattr

import numpy as np

from coastwatch.batches import Floats
from coastwatch.geodesy import NAUTICAL_MILE_M, difference_m
from coastwatch.server.clock import now_s
from coastwatch.server.feeds.address import AddressError
from coastwatch.server.live_picture import LivePicture

LOG = logging.getLogger("coastwatch.serve")
FORMATS, TRANSPORTS = ("cot", "ttm", "tll"), ("udp", "tcp")
EXAMPLES = "cot+udp://239.2.3.1:6969, cot+tcp://tak.example:8087, ttm+udp://10.0.0.7:10110?site=50.795,-1.105"
RATE = 500.0
TOGETHER_S = 0.1  # messages of so much time are sent together
STALE_CYCLES, FIRST_PERIOD_S = 3, 10.0
FIRST_RETRY_S, LAST_RETRY_S, CONNECT_S = 0.5, 15.0, 5.0
NUMBERS = 1000  # of targets in TTM and TLL
CE90 = 2.146  # radius of 90 % over the standard deviation per axis
UNKNOWN = 9_999_999.0  # of Cursor on Target


@dataclass(frozen=True)
class OutAddress:
    """Where a feed is sent."""

    text: str
    format: str  # of FORMATS
    transport: str  # of TRANSPORTS
    host: str
    port: int
    rate: float = RATE  # messages a second
    site_deg: tuple[float, float] | None = None  # from which TTM gives range and bearing


def parsed_out(text: str) -> OutAddress:
    """The address of cot+udp://239.2.3.1:6969 or ttm+udp://HOST:PORT?site=LAT,LON&rate=200. Raises: AddressError."""
    parts = urlsplit(text)
    format_, _, transport = parts.scheme.partition("+")
    options = dict(parse_qsl(parts.query))
    try:
        port = parts.port or 0
        rate = float(options.get("rate", RATE))
        site = tuple(float(part) for part in options["site"].split(",")) if "site" in options else None
    except ValueError:
        port, rate, site = 0, 0.0, None
    known = format_ in FORMATS and transport in TRANSPORTS and set(options) <= {"rate", "site"}
    if not known or not parts.hostname or not port or not 0.1 <= rate <= 1e5:
        raise AddressError(
            f"out: got {text!r}, needed FORMAT+TRANSPORT://HOST:PORT with FORMAT one of {', '.join(FORMATS)}, TRANSPORT udp or tcp, and "
            f"rate=N behind '?' from 0.1 to 100000 messages a second, e.g. {EXAMPLES}"
        )
    if (format_ == "ttm") != (site is not None) or (site is not None and not _is_place(site)):
        raise AddressError(f"out: got {text!r}, needed site=LAT,LON with ttm alone: range and bearing are from there")
    return OutAddress(text, format_, transport, parts.hostname, port, rate, None if site is None else (site[0], site[1]))


class Encoder(Protocol):
    """A picture to messages, one a vessel."""

    def messages(self, picture: LivePicture, rows: list[int], period_s: float) -> Iterator[bytes]:
        """The messages of these rows of a picture. Args: period_s: between pictures."""
        ...


class CursorOnTarget:
    """Events of Cursor on Target 2.0. A vessel is stale after three cycles. Source: MITRE, Cursor on Target, event schema 2.0."""

    def messages(self, picture: LivePicture, rows: list[int], period_s: float) -> Iterator[bytes]:
        """As of `Encoder`."""
        table = picture.rows(np.array(rows, np.int64))
        names = ("vessel_id", "latitude_deg", "longitude_deg", "sog_kn", "cog_deg", "major_m", "mmsi", "name")
        now, stale = _iso(picture.time_s), _iso(picture.time_s + STALE_CYCLES * period_s)
        for vessel, latitude, longitude, sog, cog, major, mmsi, name in zip(
            *(table.array(n).tolist() for n in names), strict=True
        ):
            ce = CE90 * major if math.isfinite(major) else UNKNOWN
            call = name or (f"{mmsi:09d}" if mmsi >= 0 else f"vessel {vessel}")
            moving = ""
            if math.isfinite(sog) and math.isfinite(cog):
                moving = f'<track course="{cog:.1f}" speed="{sog * NAUTICAL_MILE_M / 3600.0:.2f}"/>'
            yield (
                f'<event version="2.0" uid="coastwatch-{picture.run_id}-{vessel}" type="a-u-S-X" how="m-f" time="{now}" '
                f'start="{now}" stale="{stale}"><point lat="{latitude:.7f}" lon="{longitude:.7f}" hae="{UNKNOWN}" ce="{ce:.1f}" '
                f'le="{UNKNOWN}"/><detail><contact callsign={quoteattr(call)}/>{moving}</detail></event>\n'
            ).encode()


class Targets:
    """TTM or TLL sentences. A vessel keeps its target number, 0 to 999, while it is in the picture."""

    def __init__(self, site_deg: tuple[float, float] | None) -> None:
        """Args: site_deg: of TTM; None: TLL."""
        self._site = site_deg
        self._numbers: dict[int, int] = {}

    def messages(self, picture: LivePicture, rows: list[int], period_s: float) -> Iterator[bytes]:
        """As of `Encoder`. Vessels beyond the last number are left out."""
        every = picture.array("vessel_id").tolist()
        self._numbers = {vessel: self._numbers[vessel] for vessel in every if vessel in self._numbers}
        free = iter(sorted(set(range(NUMBERS)) - set(self._numbers.values())))
        for vessel in every:
            if vessel not in self._numbers and (number := next(free, None)) is not None:
                self._numbers[vessel] = number
        table = picture.rows(np.array(rows, np.int64))
        names = ("vessel_id", "sog_kn", "cog_deg", "name")
        of = zip(picture.positions_deg()[rows], zip(*(table.array(n).tolist() for n in names), strict=True), strict=True)
        clock = datetime.fromtimestamp(picture.time_s, UTC).strftime("%H%M%S.%f")[:9]
        for place, (vessel, sog, cog, name) in of:
            number = self._numbers.get(vessel)
            if number is not None:
                yield self._sentence(
                    number, place, (sog, cog), "".join(c for c in name or "" if c.isalnum() or c == " "), clock
                )

    def _sentence(self, number: int, place: Floats, motion: tuple[float, float], name: str, clock: str) -> bytes:
        if self._site is None:
            return _sentence(
                f"CWTLL,{number:02d},{_angle(place[0], 'N', 'S', 2)},{_angle(place[1], 'E', 'W', 3)},{name},{clock},T,"
            )
        east, north = difference_m(place, np.array(self._site)).tolist()
        miles, bearing = math.hypot(east, north) / NAUTICAL_MILE_M, math.degrees(math.atan2(east, north)) % 360.0
        said = f"{motion[0]:.1f},{motion[1]:.1f},T" if math.isfinite(motion[0] + motion[1]) else ",,"
        return _sentence(f"CWTTM,{number:02d},{miles:.3f},{bearing:.2f},T,{said},,,N,{name},T,,{clock},A")


class OutFeed:
    """Sends pictures to one address in a thread. Use it in a `with` block."""

    def __init__(self, address: OutAddress) -> None:
        self.address = address
        self.sent = self.size = self.skipped = self.connections = 0
        self.connected, self.error = False, None if address.transport == "udp" else "not connected yet"
        self._encoder: Encoder = CursorOnTarget() if address.format == "cot" else Targets(address.site_deg)
        self._newest: tuple[LivePicture, float] | None = None  # and the time between pictures
        self._before_s, self._next, self._heard_s = math.nan, 0, 0.0
        self._began_s = now_s()
        self._wake, self._ended = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"out {address.format}", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *unused: object) -> None:
        self._ended.set()
        self._wake.set()
        self._thread.join(CONNECT_S + 1.0)

    def receive(self, picture: LivePicture) -> None:
        """Send this picture from now on. It may be called in any thread."""
        period_s = picture.time_s - self._before_s
        self._newest = picture, period_s if period_s > 0.0 else FIRST_PERIOD_S
        self._before_s = picture.time_s
        self._wake.set()

    def counters(self) -> dict[str, Any]:
        """Its state for operators, as of a feed that is received."""
        return {
            "name": f"out {self.address.text}",
            "connected": self.connected,
            "connections": self.connections,
            "error": self.error,
            "bytes": self.size,
            "received": 0,
            "records": self.sent,
            "refused": 0,
            "late": 0,
            "dropped": self.skipped,
            "heard_s": self._heard_s or None,
            "silent_s": round(now_s() - max(self._heard_s, self._began_s), 1),
            "newest_s": None,
            "faults": {},
        }

    def _run(self) -> None:
        wait_s = FIRST_RETRY_S
        while not self._ended.is_set():
            try:
                with _connection(self.address) as connection:
                    self.connected, self.error, wait_s = True, None, FIRST_RETRY_S
                    self.connections += 1
                    self._send(connection)
            except OSError as error:
                self.error = str(error.strerror or error)
            except Exception as error:  # of one picture: the next one may be sent
                LOG.exception(f"out {self.address.text} is begun again")
                self.error = f"{type(error).__name__}: {error}"
            finally:
                self.connected = False
            self._ended.wait(wait_s)
            wait_s = min(2.0 * wait_s, LAST_RETRY_S)

    def _send(self, connection: socket.socket) -> None:
        """Send pictures until the feed ends. Raises: OSError: the connection is gone."""
        together = max(int(self.address.rate * TOGETHER_S), 1)
        while not self._ended.is_set():
            self._wake.wait()
            self._wake.clear()
            if self._newest is None:
                continue
            picture, period_s = self._newest
            left = self._in_turn(picture)
            while left and not self._wake.is_set():
                begun, rows, left = time.monotonic(), left[:together], left[together:]
                self._send_some(connection, self._encoder.messages(picture, rows, period_s))
                self._next = int(picture.array("vessel_id")[rows[-1]]) + 1
                self._ended.wait(max(begun + len(rows) / self.address.rate - time.monotonic(), 0.0))
            self.skipped += len(left)

    def _in_turn(self, picture: LivePicture) -> list[int]:
        """The rows of a picture, beginning with the vessel that is next."""
        first = int(np.searchsorted(picture.array("vessel_id"), self._next))
        return [*range(first, len(picture)), *range(first)]

    def _send_some(self, connection: socket.socket, messages: Iterator[bytes]) -> None:
        some = list(messages)
        if self.address.transport == "tcp":
            connection.sendall(b"".join(some))
        else:
            for message in some:
                with suppress(ConnectionRefusedError):  # nobody listens yet
                    connection.send(message)
        self.sent += len(some)
        self.size += sum(map(len, some))
        self._heard_s = now_s()


def _connection(address: OutAddress) -> socket.socket:
    """A socket that sends to an address. Raises: OSError."""
    if address.transport == "tcp":
        return socket.create_connection((address.host, address.port), timeout=CONNECT_S)
    family, kind, proto, _, where = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_DGRAM)[0]
    made = socket.socket(family, kind, proto)
    try:
        if family == socket.AF_INET and ipaddress.ip_address(where[0]).is_multicast:
            made.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)
        made.connect(where)
    except OSError:
        made.close()
        raise
    return made


def _sentence(body: str) -> bytes:
    return f"${body}*{reduce(xor, body.encode()):02X}\r\n".encode()


def _angle(degrees: float, positive: str, negative: str, width: int) -> str:
    """Degrees and minutes as NMEA has them: 5047.7000,N."""
    minutes = round(abs(float(degrees)) * 60.0, 4)
    whole = int(minutes // 60)
    return f"{whole:0{width}d}{minutes - 60 * whole:07.4f},{positive if degrees >= 0 else negative}"


def _iso(time_s: float) -> str:
    return datetime.fromtimestamp(time_s, UTC).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z"


def _is_place(site: tuple[float, ...]) -> bool:
    return len(site) == 2 and abs(site[0]) < 85.0 and abs(site[1]) <= 180.0
