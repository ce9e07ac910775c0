"""What the routes of the API share: the newest picture, the database, and where the pictures come from."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, TimeoutError as NotDoneYet
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol, TypeVar

from coastwatch import store
from coastwatch.batches.kinds import PRIORITIES
from coastwatch.errors import StoreError
from coastwatch.operators import presentation
from coastwatch.operators.api.audit import Audit
from coastwatch.operators.api.hub import Hub
from coastwatch.operators.api.metrics import Metrics
from coastwatch.server.alarm_book import Alarm, AlarmBook, key_of
from coastwatch.server.feeds.outgoing import OutFeed
from coastwatch.server.link import FeedState
from coastwatch.server.live import RunAbout
from coastwatch.server.live_picture import LivePicture, of_store
from coastwatch.server.live_video import LiveVideo
from coastwatch.server.regions.publisher import Publisher
from coastwatch.server.run import version
from coastwatch.server.troubles import Trouble, of_outs
from coastwatch.server.writing.live_writer import NotYetStored
from coastwatch.spelling import utc_text
from coastwatch.store import Acknowledgement, Asked, Beginnings, Rows, Store
from coastwatch.store.acknowledgements import SAME_START_S
from coastwatch.store.bbox import Box

WAIT_FOR_STORE_S = 1.0
"""How long a request that changes something waits for the database. If it takes longer the change is written later."""

READY_WITHIN_S, READY_WITHIN_PERIODS = 30.0, 10.0
"""A live picture that is older is not ready: the longer of both."""

ALARM_COLUMNS = (
    "alarm_id", "vessel_id", "kind", "subject", "start_s", "end_s", "lasted_s", "gaps", "mmsi", "name", "latitude_deg",
    "longitude_deg", "sog_kn", "evidence", "acknowledged_by", "acknowledged_s", "note", "priority",
)  # fmt: skip
PastKey = tuple[int, int, Box | None, tuple[int, int] | None]  # run, cycle, box; run and cycle of the newest picture
T = TypeVar("T")


class WrittenLater(StoreError):
    """A change was not written in time. It will be."""


class NoPictureYet(Exception):
    """There is no picture to answer from; the message says why."""


class Source(Protocol):
    """Where pictures come from."""

    live: bool  # whether this process computes them
    failed: bool  # for good: the process is to end

    def error(self) -> str | None:
        """Why there is no newer picture, if something is wrong."""
        ...

    def feeds(self) -> Sequence[FeedState]:
        """The feeds with their counters."""
        ...

    def cycle_s(self) -> float | None:
        """How long the last cycle took."""
        ...

    def counts(self) -> dict[str, float]:
        """Of a live run: cycles, cycles_late, late_s and others."""
        ...

    @property
    def alarms(self) -> AlarmBook:
        """The alarms of the run."""
        ...

    def troubles(self) -> list[Trouble]:
        """What an operator should know."""
        ...

    def now_s(self) -> float:
        """Now, by the clock that the times of its pictures are of."""
        ...

    def about(self) -> RunAbout | None:
        """What is known of the run without the database; None: nothing."""
        ...

    def later(self, job: Callable[[], T]) -> Future[T]:
        """Have a change written to the database, in order with the cycles."""
        ...


class Counted(Protocol):
    """What has the counters of a feed."""

    def counters(self) -> FeedState:
        """Its state for operators."""
        ...


class Reread(Protocol):
    """What has files that may change while the server runs."""

    def reread(self) -> None:
        """Read them again. What is wrong is a trouble."""
        ...


@dataclass
class Service:
    """The parts of a running server. `run_id` is of the newest picture."""

    store: Store
    source: Source = field(init=False)
    metrics: Metrics = field(default_factory=Metrics)
    hub: Hub = field(init=False)
    audit: Audit = field(init=False)
    publisher: Publisher | None = None  # of a region's tracks
    video: LiveVideo | None = None  # of the radars of a live run
    outs: Sequence[OutFeed] = ()  # to which each picture is sent
    journals: Sequence[Counted] = ()  # to which the tracks of this region are published
    end: Callable[[], None] = lambda: None  # ends the server
    asked: list[Callable[[], list[Trouble]]] = field(default_factory=list)  # others who may have troubles
    files: Sequence[Reread] = ()  # what is read again at SIGHUP
    _about: tuple[int, RunAbout] | None = None  # of a run in the database
    _past: tuple[PastKey, LivePicture] | None = None  # the picture of the past that was asked for last

    def __post_init__(self) -> None:
        self.hub = Hub(self.metrics)
        self.audit = Audit(lambda change: self.write(partial(store.note_change, self.store, change)))
        self.metrics.ask(lambda: (self.ready()[0], self.source.counts(), self.feeds(), self.troubles()))

    def receive(self, picture: LivePicture) -> None:
        """Take a picture of the source. It may be called in any thread, one call at a time."""
        cycle_s = self.source.cycle_s()
        if cycle_s is not None:
            self.metrics.cycle.observe(cycle_s)
        self.metrics.picture(picture, self.source.now_s())
        self.hub.receive(picture)
        for output in self.outs:
            output.receive(picture)

    def picture(self) -> LivePicture:
        """The newest picture. Raises: NoPictureYet."""
        if self.hub.picture is None:
            raise NoPictureYet(self.source.error() or "there is no picture yet")
        return self.hub.picture

    def picture_of(self, run_id: int, cycle: int, time_s: float, area: Box | None) -> LivePicture:
        """The picture of a cycle in the database, in a box or whole.

        The one asked for last is kept until there is a newer live picture: pages of one instant are of one reading.
        Raises: StoreError.
        """
        newest = self.hub.picture
        key = run_id, cycle, area, None if newest is None else (newest.run_id, newest.cycle)
        kept = self._past
        if kept is None or kept[0] != key:
            kept = self._past = key, of_store(self.store, run_id, cycle, time_s, time_s, area)
        return kept[1]

    def version_of_picture(self) -> tuple[int, int, int]:
        """A value that changes with each new picture. Raises: NoPictureYet."""
        picture = self.picture()
        return self.hub.run, picture.run_id, picture.cycle

    def changes(self, limit: int, offset: int) -> tuple[Rows, int]:
        """Who changed what, the newest first, and how many changes there are. Raises: StoreError."""
        changes, total = store.changes(self.store, limit, offset)
        return presentation.in_operator_units(changes), total

    def run_id(self) -> int:
        """The run of the newest picture. Raises: NoPictureYet."""
        return self.picture().run_id

    def run_at(self, at_s: float | None) -> int:
        """The run that has an instant; none: that of the newest picture. Raises: NoPictureYet, StoreError."""
        return self.run_id() if at_s is None else store.run_at(self.store, self.run_id(), at_s)

    def run_row(self, at_s: float | None = None) -> presentation.Run:
        """The row of the run that has an instant, as it is now. Args: as of `run_at`. Raises: NoPictureYet, StoreError."""
        return presentation.run(self.store, self.run_at(at_s))

    def feeds(self) -> list[FeedState]:
        """The feeds with their counters."""
        return [*self.source.feeds(), *self._out_feeds()]

    def _out_feeds(self) -> list[FeedState]:
        return [output.counters() for output in (*self.outs, *self.journals)]

    @property
    def book(self) -> AlarmBook:
        """The alarms of the run in memory."""
        return self.source.alarms

    def write(self, job: Callable[[], T]) -> T:
        """Have a change written to the database. Returns: what the job returns.

        Raises: the error of the job; WrittenLater: the database is away.
        """
        try:
            return self.source.later(job).result(WAIT_FOR_STORE_S)
        except NotDoneYet as error:
            raise WrittenLater("the database is away: the change is written when it is back") from error

    def alarms(self, asked: Asked, run_id: int) -> tuple[Rows, int]:
        """Some alarms of a run, the most urgent first, then the newest, and how many there are.

        Those that last or wait for acknowledgement come from memory, also where the database is away. Raises: StoreError.
        """
        book, times = self.book, (asked.from_s, asked.to_s)
        if asked.state == "all" or times != (None, None) or book.forgotten or book.run_id != run_id:
            stored, total = store.alarms(self.store, run_id, asked)
            return self.rows_of([Alarm(*row) for row in stored.rows]), total
        every = [alarm for alarm in book.alarms(asked.state) if alarm.kind in asked.kinds]
        return self.rows_of(every[asked.offset : asked.offset + asked.limit]), len(every)

    def rows_of(self, alarms: Sequence[Alarm]) -> Rows:
        """Alarms in the units of an operator, with the names of their vessels as far as they are known."""
        picture = self.hub.picture
        now_s, statics = (0.0, {}) if picture is None else (picture.time_s, picture.statics)
        rows = []
        for one in alarms:
            name = one.name
            if name is None and one.mmsi is not None and one.mmsi in statics:
                name = statics[one.mmsi][0]
            lasted_s = max((now_s if one.end_s is None else one.end_s) - one.start_s, 0.0)
            rows.append((one.alarm_id, *one[:5], lasted_s, *one[5:7], name, *one[8:], PRIORITIES[one.kind]))
        return presentation.in_operator_units(Rows(ALARM_COLUMNS, rows))

    def acknowledge(self, alarm_id: str, name: str, note: str, who: str) -> Rows | None:
        """Acknowledge an alarm. Returns: its row; None where there is no such alarm. Args: name: of the person; who: of the token.

        Raises: StoreError: it is not in memory, and the database is away.
        """
        key, by = key_of(alarm_id), Acknowledgement(time.time(), name, note, who)
        if key is None:
            return None
        alarm = self.book.acknowledge(alarm_id, by)
        run_id = self.run_id() if alarm is None else self.book.run_id  # its first alarms are here before its first picture

        def job() -> None:
            if not store.acknowledge(self.store, run_id, key, by) and alarm is not None:
                raise NotYetStored(f"alarm {alarm_id} is not stored")  # its cycle is about to be

        try:
            self.write(job)
        except StoreError:
            if alarm is None:
                raise
        if alarm is None:
            rows, _ = store.alarms(self.store, run_id, Asked(key=key))
            alarm = next((Alarm(*row) for row in rows.rows), None)
        return None if alarm is None else self.rows_of([alarm])

    def acknowledge_all(self, chosen: Beginnings, name: str, note: str, who: str) -> int:
        """Acknowledge every alarm of these beginnings that nobody has acknowledged. Returns: how many. Raises: StoreError."""
        by = Acknowledgement(time.time(), name, note, who)
        in_memory = self.book.acknowledge_all(chosen, by, SAME_START_S)
        run_id = self.book.run_id if in_memory else self.run_id()
        written = 0

        def job() -> int:
            nonlocal written
            written += store.acknowledge_all(self.store, run_id, chosen, by)
            if written < in_memory:
                raise NotYetStored(f"{in_memory - written} alarms are not stored")  # their cycle is about to be
            return written

        with suppress(WrittenLater):
            return max(in_memory, self.write(job))
        return in_memory

    def troubles(self) -> list[Trouble]:
        """What an operator should know, the serious first."""
        troubles = [*self.source.troubles(), *of_outs(self._out_feeds(), self.source.now_s())]
        troubles += [trouble for ask in self.asked for trouble in ask()]
        about = self.source.about()
        if self.hub.picture is not None and self.source.live and about is not None:
            oldest_s = max(READY_WITHIN_S, READY_WITHIN_PERIODS * about.period_s)
            if (waited_s := self.metrics.waited_s) > oldest_s:
                troubles.append(Trouble("picture", "", None, f"no picture has come for {waited_s:.0f} s", True))
        return sorted(troubles, key=lambda trouble: not trouble.is_serious)

    def ready(self) -> tuple[bool, dict[str, object]]:
        """Whether there is a picture of now, and why not. A trouble that is not serious is said, and does not count."""
        picture, error, troubles = self.hub.picture, self.source.error(), self.troubles()
        serious = next(
            (f"{trouble.name}: {trouble.text}" if trouble.name else trouble.text for trouble in troubles if trouble.is_serious),
            None,
        )
        state = error or ("there is no picture yet" if picture is None else serious or "ready")
        run, cycle = (None, None) if picture is None else (picture.run_id, picture.cycle)
        body = {"status": state, "run": run, "cycle": cycle, "age_s": round(self.metrics.age_s, 3)}
        return state == "ready", {**body, "troubles": [_trouble_row(trouble) for trouble in troubles]}

    def status(self) -> dict[str, object]:
        """The run, its newest picture and its age, and what is wrong. Raises: NoPictureYet; StoreError of a database that is followed."""
        picture, about, cycle_s, error = self.picture(), self.about(), self.source.cycle_s(), self.source.error()
        run_status = "running" if error is None else "failed"
        if not self.source.live:
            run_status = store.run_status(self.store, picture.run_id)
        return {
            "run": picture.run_id,
            "scenario": about.scenario,
            "title": about.title,
            "run_status": run_status,
            "version": version(),
            "live": self.source.live,
            "run_id": self.hub.run,
            "seq": self.hub.newest_seq,
            "cycle": picture.cycle,
            "time_utc": utc_text(picture.time_s),
            "server_utc": utc_text(time.time()),
            "age_s": round(self.metrics.age_s, 3),
            "period_s": about.period_s,
            "cycle_ms": None if cycle_s is None else round(cycle_s * 1e3, 1),
            "vessels": len(picture),
            "by_kind": {str(kind): int((picture.kind == kind).sum()) for kind in range(8)},
            "viewers": len(self.hub.viewers),
            "area": about.area,
            "error": error,
            "alarms": {"run": self.book.run_id, "change": self.book.number},  # of the newest event of the stream
            "troubles": [_trouble_row(trouble) for trouble in self.troubles()],
            "late": sum(feed.get("late", 0) for feed in self.source.feeds()),
            **{name: round(value, 3) for name, value in self.source.counts().items()},
        }

    def about(self) -> RunAbout:
        """What does not change in the run of the newest picture. Raises: NoPictureYet, StoreError."""
        run_id, about = self.run_id(), self.source.about()
        if about is not None:
            return about
        if self._about is None or self._about[0] != run_id:
            row = presentation.run(self.store, run_id)
            self._about = run_id, RunAbout(row["scenario"], row["title"], row["period_s"], row["settings"].get("area"))
        return self._about[1]


def _trouble_row(trouble: Trouble) -> dict[str, object]:
    since = None if trouble.since_s is None else utc_text(trouble.since_s)
    return {"kind": trouble.kind, "name": trouble.name, "since_utc": since, "text": trouble.text, "serious": trouble.is_serious}
