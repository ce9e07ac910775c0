"""A connection that is made again when it breaks: its state and counters, its waits, and how it notices a lost network."""

from __future__ import annotations

import asyncio
import errno
import logging
import os
import socket
import threading
from collections import Counter, deque
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import TypedDict, Unpack

from coastwatch.server.clock import now_s

LOG = logging.getLogger("coastwatch.serve")

LOST_S = 30
"""A connection whose other side is gone is noticed after so long."""

KEEPALIVE = {"TCP_KEEPIDLE": 15, "TCP_KEEPINTVL": 5, "TCP_KEEPCNT": 3, "TCP_USER_TIMEOUT": 1000 * LOST_S}
"""Seconds of silence, seconds between probes, and probes; milliseconds for which sent bytes may wait for an acknowledgement."""

WITHIN_S = 60.0
"""What is noted of counts that only grow."""


class RadarState(TypedDict):
    """The state of a radar that sends video, as the API answers it. None: not known."""

    name: str
    sac: int
    sic: int
    text: str  # the newest summary that it sent
    silent_s: float
    turn_s: float | None  # of the newest whole turn
    spokes_a_turn: int | None
    cells: int
    cell_m: float | None
    range_m: float | None
    bits: int
    compressed: bool
    parts: int  # messages of a whole spoke
    time_of_day: bool  # whether it is sent, and goes on
    spokes: int
    spokes_lost: int
    parts_lost: int
    out_of_order: int  # messages
    second_sender: int  # messages
    lost_share: float  # of the spokes of the last minute, with those of which a part is missing
    plots_a_turn: float | None  # this and the following: of a live run
    threshold_db: float | None
    detection_probability: float | None  # learnt
    false_plots_a_turn: float | None  # learnt
    troubles: list[str]


class FeedCounts(TypedDict, total=False):
    """What some kinds of feed count."""

    received: int  # lines, datagrams or cycles
    records: int  # used
    refused: int
    late: int
    before_run: int  # reports from before the run began
    dropped: int
    newest_s: float | None  # time of the newest record
    faults: dict[str, int]
    troubles: list[str]
    radars: list[RadarState]  # that send video; of a feed of video alone


class FeedState(FeedCounts):
    """The state of a feed for operators, as the API answers it."""

    name: str
    connected: bool  # there is a connection, or none is needed
    state: str  # connected, not connected, or sending: over UDP, where nobody says whether it arrives
    connections: int
    error: str | None
    bytes: int
    heard_s: float | None  # when something came or was taken last
    silent_s: float


@dataclass(kw_only=True)
class Link:
    """The state and counters of a connection that is made again and again."""

    connected: int = 0  # connections that are open now
    word: str = "connected"  # what an open one is
    connections: int = 0  # made so far
    error: str | None = None  # of the last attempt
    size: int = 0  # bytes
    heard_s: float = 0.0  # when something came or was taken last
    began_s: float = field(default_factory=now_s)

    def opened(self) -> None:
        """A connection has been made."""
        self.connected, self.error, self.connections = 1, None, self.connections + 1

    def moved(self, size: int) -> None:
        """Bytes have come, or were taken by the other side."""
        self.size, self.heard_s = self.size + size, now_s()

    @property
    def silent_s(self) -> float:
        """For how long nothing has come or gone."""
        return now_s() - max(self.heard_s, self.began_s)

    def as_feed(self, name: str, **counts: Unpack[FeedCounts]) -> FeedState:
        """Its state for operators, as of every feed. Args: counts: of this kind of feed."""
        return {
            "name": name,
            "connected": bool(self.connected),
            "state": self.word if self.connected else "not connected",
            "connections": self.connections,
            "error": self.error,
            "bytes": self.size,
            "received": 0,
            "records": 0,
            "refused": 0,
            "late": 0,
            "before_run": 0,
            "dropped": 0,
            "heard_s": self.heard_s or None,
            "silent_s": round(self.silent_s, 1),
            "newest_s": None,
            "faults": {},
            **counts,
        }


@dataclass(frozen=True)
class Backoff:
    """Waits between attempts: each is twice as long as the one before, up to the longest."""

    first_s: float
    longest_s: float

    def wait_s(self, failures: int) -> float:
        """How long to wait before the next attempt. Args: failures: in a row, 1 or more."""
        return min(self.first_s * 2.0 ** min(failures - 1, 30), self.longest_s)


@dataclass
class Reconnecting:
    """A connection that is made again and again, with longer and longer waits, but a short one after a session that got somewhere."""

    link: Link
    name: str  # in the log
    waits: Backoff
    reason: Callable[[Exception], str | None] = lambda error: reason_of(error) if isinstance(error, OSError) else None
    """What an operator reads about an error; None: the error is a defect of the program."""
    progress: Callable[[Link], int] = attrgetter("connections")  # a session that makes it greater has got somewhere
    _failures: int = 0  # in a row

    def start(self, session: Callable[[], object], ended: threading.Event) -> threading.Thread:
        """A thread that runs sessions until the event is set, which also ends a wait."""
        thread = threading.Thread(target=self.run, args=(session, ended), name=self.name, daemon=True)
        thread.start()
        return thread

    def run(self, session: Callable[[], object], ended: threading.Event) -> None:
        """Run sessions in this thread until the event is set."""
        while not ended.is_set():
            with self._attempt():
                session()
            ended.wait(self.waits.wait_s(self._failures))

    async def run_async(self, session: Callable[[], Awaitable[object]]) -> None:
        """Run sessions until the task is cancelled."""
        while True:
            with self._attempt():
                await session()
            await asyncio.sleep(self.waits.wait_s(self._failures))

    @contextmanager
    def _attempt(self) -> Iterator[None]:
        """Whatever ends the block is the `error` of the link, which is not connected afterwards."""
        before, is_defect = self.progress(self.link), False
        try:
            yield
        except Exception as error:
            reason = self.reason(error)
            is_defect = reason is None
            if is_defect:
                LOG.exception(f"{self.name} is begun again")
            self.link.error = f"{type(error).__name__}: {error}" if is_defect else reason
        finally:
            self.link.connected = 0
        got_somewhere = self.progress(self.link) > before and not is_defect
        self._failures = 1 if got_somewhere else self._failures + 1


def first_line(path: str) -> str:
    """The token, password or secret in the first line of a file. Raises: OSError that names it; UnicodeDecodeError."""
    with Path(path).open(encoding="utf-8") as file:
        return file.readline().strip()


def notice_loss(connection: socket.socket) -> None:
    """Have the system notice that the other side of a connection is gone; a listening socket passes this on to what it accepts."""
    with suppress(OSError):
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for name, value in KEEPALIVE.items():
            if hasattr(socket, name):  # not all systems have each
                connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


def reason_of(error: OSError) -> str:
    """What is wrong with an address, in the words of the system: asyncio adds the address as a tuple."""
    if isinstance(error, socket.gaierror) or error.errno is None:
        nothing_said = "no answer in time" if isinstance(error, TimeoutError) else type(error).__name__
        return str(error.strerror or error) or nothing_said
    reason = os.strerror(error.errno)
    return f"{reason}: is another program listening there?" if error.errno == errno.EADDRINUSE else reason


class LastMinute:
    """Counts by name, as they were at the instants of the last minute. Another thread may ask while one notes."""

    def __init__(self, fewest: int = 1) -> None:
        """Args: fewest: notes that are kept in any case, however old."""
        self._fewest = fewest
        self._notes: deque[tuple[float, Counter[str]]] = deque()

    def note(self, at_s: float, **counts: int) -> None:
        """Note the counts. Where one is less than before, its source began anew, and so does the minute. Args: at_s: now."""
        now = Counter(counts)
        if self._notes and not self._notes[-1][1] <= now:
            self._notes = deque()
        self._notes.append((at_s, now))
        while len(self._notes) > self._fewest and self._notes[0][0] < at_s - WITHIN_S:
            self._notes.popleft()

    def change(self, newest: int | None = None) -> Counter[str]:
        """By how much each count grew; nothing where none is noted. Args: newest: notes that are compared; None: all."""
        notes = list(self._notes)
        if newest is not None:
            notes = notes[-newest:]
        return notes[-1][1] - notes[0][1] if notes else Counter()
