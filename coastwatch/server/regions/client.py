"""The connection of a centre to one of its regions: a thread that connects again and goes on after the last cycle that it has."""

from __future__ import annotations

import json
import re
import ssl
import threading
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.util import find_spec
from operator import attrgetter
from pathlib import Path
from typing import Self
from urllib.parse import parse_qsl, urlencode, urlsplit

from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidURI
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from coastwatch.errors import AddressError
from coastwatch.formats.decoding import LONGEST_NAME
from coastwatch.server.link import Backoff, Link, Reconnecting, first_line
from coastwatch.server.regions.link import IN_FLIGHT, Incoming, Position
from coastwatch.server.regions.message import LARGEST_MESSAGE, PROTOCOLS, MessageError, RegionCycle, decode

PATH = "/api/v1/tracks/stream"
RETRY, CONNECT_S, CLOSE_S = Backoff(0.25, 5.0), 10.0, 2.0
CLOSED = {4401: "it does not know the token", 4404: "it is no region: --role region", 4408: "this centre did not read"}
"""Why a region closed a connection, by its code."""

STREAM_SCHEMES, STREAM = ("nats", "tls"), re.compile(r"[A-Za-z0-9_-]{1,32}")
"""Of addresses of NATS, and of what a region calls itself there."""

TRACKS = "tracks+"
"""How an address of `--out` begins that is of the tracks of a region."""

OF_OUT = "tracks+nats://HOST:PORT/NAME or tracks+tls://HOST:PORT/NAME, with token-file=, ca-file=, user= and password-file= behind '?'"
OF_REGION = (
    "ws://HOST:PORT or wss://HOST:PORT, with name=, token-file= and ca-file= behind '?', e.g. "
    "wss://north.example:8100?name=north&token-file=north.token; or nats://HOST:PORT/NAME or tls://HOST:PORT/NAME, also with user= and "
    "password-file="
)


@dataclass(frozen=True)
class RegionAddress:
    """A region that a centre connects to, or the stream of NATS that has its cycles."""

    url: str  # ws://host:port or wss://host:port; nats:// or tls://
    name: str  # of its track source
    token_file: str | None = None  # a file whose first line is the token
    ca_file: str | None = None  # certificates to trust, PEM; none: those of the system
    stream: str = ""  # of NATS: what the region calls itself there
    user: str | None = None  # of NATS
    password_file: str | None = None  # of NATS

    @property
    def where(self) -> str:
        """Host and port."""
        return urlsplit(self.url).netloc


def parsed_region(given: str, *, is_out: bool = False) -> RegionAddress:
    """The region of wss://host:8100?name=north&token-file=north.token&ca-file=ca.pem, or of nats://host:4222/north.

    Args: is_out: it is of `--out`, such as tracks+nats://host:4222/north. Raises: AddressError that names the option.
    """
    text = given.removeprefix(TRACKS) if is_out else given
    got, schemes = (
        f"{'out' if is_out else 'region'}: got {given!r}",
        STREAM_SCHEMES if is_out else ("ws", "wss", *STREAM_SCHEMES),
    )
    parts = urlsplit(text, allow_fragments=False)
    of_stream = parts.scheme in STREAM_SCHEMES
    options, stream = dict(parse_qsl(parts.query, keep_blank_values=True)), parts.path.strip("/") if of_stream else ""
    try:
        good = parts.scheme in schemes and bool(parts.hostname) and (parts.port or 1) > 0
    except ValueError:
        good = False
    unknown = sorted(set(options) - {"name", "token-file", "ca-file"} - ({"user", "password-file"} if of_stream else set()))
    if not good or unknown or parts.username or (parts.path not in ("", "/") and not STREAM.fullmatch(stream)):
        wrong = f" (unknown: {', '.join(unknown)})" if unknown else ""
        raise AddressError(f"{got}{wrong}, needed {OF_OUT if is_out else OF_REGION}, NAME of letters, digits, - and _")
    if of_stream and not stream:
        raise AddressError(f"{got}, needed the name of the region in its stream: {TRACKS * is_out}nats://HOST:PORT/NAME")
    if of_stream and find_spec("nats") is None:
        raise AddressError(f"{got}, needed the package nats-py: pip install 'coastwatch[nats]'")
    name = options.get("name", stream or parts.netloc)[:LONGEST_NAME]
    return RegionAddress(
        f"{parts.scheme}://{parts.netloc}",
        name,
        token_file=options.get("token-file"),
        ca_file=options.get("ca-file"),
        stream=stream,
        user=options.get("user"),
        password_file=options.get("password-file"),
    )


def check_files(address: RegionAddress) -> None:
    """Raises: AddressError where a file that an address names is not there."""
    named = ("token-file", address.token_file), ("ca-file", address.ca_file), ("password-file", address.password_file)
    for option, path in named:
        if path is not None and not Path(path).is_file():
            raise AddressError(f"region {address.name}: got {option}={path}, needed a file that is there")


def token_of(address: RegionAddress) -> str | None:
    """The token of a region's file. Raises: OSError that names the file."""
    return None if address.token_file is None else first_line(address.token_file)


@dataclass
class Connection(Link):
    """A region as a centre sees it: what has come and nobody has taken, and counters. Use it in a `with` block."""

    address: RegionAddress
    from_s: float = 0.0  # where nothing is known of the region, cycles that end before are not wanted
    incoming: Incoming = field(default_factory=Incoming)
    refused: int = 0  # messages that are no cycle
    _waiting: deque[RegionCycle] = field(default_factory=deque)
    _ended: threading.Event = field(default_factory=threading.Event)
    _socket: ClientConnection | None = None
    _thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        # only a region that sent something has shown a sign of life: it may close a connection at once
        again = Reconnecting(self, f"region {self.address.name}", RETRY, _reason, attrgetter("size"))
        self._thread = again.start(self._next_session, self._ended)
        return self

    def __exit__(self, *unused: object) -> None:
        self._ended.set()
        if self._socket is not None:
            self._socket.close()
        if self._thread is not None:
            self._thread.join(CLOSE_S)  # it may be connecting; nothing waits for it then

    def next(self) -> RegionCycle | None:
        """The oldest cycle that nobody has taken, which is then acknowledged; None: there is none."""
        try:
            cycle = self._waiting.popleft()
        except IndexError:
            return None
        self._acknowledge(Position(cycle.run, cycle.seq))
        return cycle

    def _acknowledge(self, position: Position) -> None:
        """Tell the region. It is told again by the position after a reconnection, so a failure needs no mend."""
        socket = self._socket
        if socket is not None:
            with suppress(ConnectionClosed, OSError):
                socket.send(json.dumps({"run": position.run, "seq": position.seq}))

    def _next_session(self) -> None:
        while len(self._waiting) >= IN_FLIGHT:  # the region may send as many again
            if self._ended.wait(RETRY.first_s):
                return
        try:
            self._session()
        except MessageError:
            self.refused += 1
            raise
        finally:
            self._socket = None

    def _session(self) -> None:
        """Connect and take messages until the connection ends. Raises: what `_reason` names."""
        run, seq = self.incoming.position
        query = {"run": run, "seq": seq, "from_s": self.from_s}
        token = token_of(self.address)
        context = None
        if self.address.url.startswith("wss"):
            context = ssl.create_default_context(cafile=self.address.ca_file)
        with connect(
            f"{self.address.url}{PATH}?{urlencode(query)}",
            subprotocols=[Subprotocol(name) for name in PROTOCOLS],
            additional_headers={} if token is None else {"Authorization": f"Bearer {token}"},
            ssl=context,
            open_timeout=CONNECT_S,
            max_size=LARGEST_MESSAGE,
            compression=None,
            proxy=None,
        ) as self._socket:
            self.opened()
            for message in self._socket:  # the region sends no more than IN_FLIGHT that are not acknowledged
                if isinstance(message, str):
                    raise MessageError(f"got the text {message[:40]!r}, needed a cycle of tracks")
                cycle = decode(message)
                self.moved(len(message))
                if self.incoming.received(Position(cycle.run, cycle.seq), cycle.merged):
                    self._waiting.append(cycle)
                else:
                    self._acknowledge(Position(cycle.run, cycle.seq))


def _reason(error: Exception) -> str | None:
    """Why a region is not connected; None: a defect."""
    if isinstance(error, ConnectionClosed):
        code = error.rcvd.code if error.rcvd else 1006
        return f"the region closed the connection: {CLOSED.get(code) or (error.rcvd and error.rcvd.reason) or code}"
    is_expected = isinstance(error, MessageError | OSError | InvalidHandshake | InvalidURI | TimeoutError)
    return (str(error) or type(error).__name__) if is_expected else None
