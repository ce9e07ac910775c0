"""The alarms of a run in memory: those that last or wait for acknowledgement, and what has changed, with a number for each change.

Page, stream and web hooks read them here, so they go on without the database. SQL answers for the past.
"""

from __future__ import annotations

import re
import threading
from collections import deque
from collections.abc import Iterable, Sequence
from itertools import islice
from typing import Literal, NamedTuple

import numpy as np

from coastwatch.alarms import EventMemory
from coastwatch.batches import ALARM_KINDS, BegunEvents, EventChanges, EventSpans
from coastwatch.batches.kinds import EVENT_KINDS, IS_ALARM, PRIORITIES
from coastwatch.server.listeners import Listeners
from coastwatch.store import Acknowledgement, AlarmKey, Beginnings, Rows, State

MOST_ENDED = 20_000
"""Alarms that have ended and are kept: the oldest acknowledged ones go first, then the least urgent."""

MOST_CHANGES = 50_000
"""Changes that are kept for those who read them later."""

ALARM_ID = re.compile(r"(-?\d{1,18})-([a-z_]{1,32})-(\d{1,15})(?:-(\d{1,18}))?")

What = Literal["opened", "closed", "returned", "acknowledged"]


class Alarm(NamedTuple):
    """One alarm. The columns from `mmsi` on are of its vessel when it began."""

    vessel_id: int
    kind: str
    subject: int  # number of the zone or sensor, or id of the other vessel; 0: none
    start_s: float
    end_s: float | None  # None: it lasts
    gaps: int  # how often it has ended and returned
    mmsi: int | None
    name: str | None
    latitude_deg: float | None
    longitude_deg: float | None
    sog_kn: float | None
    evidence: str
    acknowledged_by: str | None
    acknowledged_s: float | None
    note: str | None

    @property
    def alarm_id(self) -> str:
        """What tells it from the other alarms of the run, as a text."""
        return id_of(AlarmKey(*self[:4]))

    @property
    def lasts(self) -> bool:
        return self.end_s is None

    @property
    def is_acknowledged(self) -> bool:
        return self.acknowledged_s is not None

    @property
    def urgency(self) -> tuple[int, float]:
        """Smaller for what comes first: by priority, then the newest."""
        return PRIORITIES[self.kind], -self.start_s

    def has(self, state: State) -> bool:
        """Whether it is one of those that are asked for."""
        waits = not self.is_acknowledged
        return {"all": True, "lasting": self.lasts, "unacknowledged": waits, "waiting": self.lasts or waits}[state]

    def changes(self, before: Alarm | None) -> list[What]:
        """What has happened to it between two looks at the database. Args: before: as it was at the first; None: not there."""
        changes: list[What] = []
        if before is None:
            changes.append("opened")
        elif self.gaps != before.gaps and (not before.lasts or self.lasts):
            changes.append("returned")
        if not self.lasts and (before is None or before.lasts or self.end_s != before.end_s):
            changes.append("closed")
        if self.is_acknowledged and (before is None or not before.is_acknowledged):
            changes.append("acknowledged")
        return changes


class Change(NamedTuple):
    """A change of an alarm."""

    number: int  # from 1 on, in order
    what: What
    alarm: Alarm  # as it was then


def id_of(key: AlarmKey) -> str:
    """The text that stands for an alarm."""
    return f"{key.vessel_id}-{key.kind}-{round(key.start_s * 1000)}" + (f"-{key.subject}" if key.subject else "")


def key_of(alarm_id: str) -> AlarmKey | None:
    """The alarm of a text, its start to the millisecond; None: it is none."""
    match = ALARM_ID.fullmatch(alarm_id)
    if match is None or match[2] not in ALARM_KINDS:
        return None
    return AlarmKey(int(match[1]), match[2], int(match[4] or 0), int(match[3]) / 1000.0)


class AlarmBook:
    """The alarms of one run. All of it may be called in any thread."""

    def __init__(self) -> None:
        self.run_id = -1
        self.forgotten = 0  # ended alarms that were not acknowledged, and had no room: they are in the database only
        self._alarms: dict[str, Alarm] = {}
        self._changes: deque[Change] = deque(maxlen=MOST_CHANGES)
        self._number, self._first = 0, 1  # of the newest change, and of the first one since `begin`
        self.repeated: tuple[Change, ...] = ()  # changes before `begin` that somebody may not have been told
        self._lock = threading.Lock()
        self._listeners = Listeners()
        self.listen = self._listeners.listen
        """As of `Listeners`: a function is called after each change."""

    @property
    def number(self) -> int:
        """The number of the newest change."""
        return self._number

    @property
    def first(self) -> int:
        """The number of the oldest change that is kept."""
        return self._changes[0].number if self._changes else self._first

    def begin(self, run_id: int, alarms: Iterable[Alarm] = (), repeat_from_s: float = np.inf) -> None:
        """Forget all, and hold the alarms that are known of a run. They are no news, but readers take all alarms again.

        Args: repeat_from_s: changes from then on are in `repeated`: the process before this one may not have sent them to web hooks.
        """
        alarms = list(alarms)
        with self._lock:
            self.repeated = tuple(_changes_from(repeat_from_s, alarms))
            self._number += run_id == self.run_id  # who has all changes until now has not these alarms
            self.run_id, self._alarms = run_id, {alarm.alarm_id: alarm for alarm in alarms}
            self._changes.clear()
            self._first = self._number + 1
        self._listeners.tell()

    def apply(self, changes: EventChanges) -> None:
        """Take what a cycle has changed in the events."""
        news: list[tuple[What, Alarm]] = []
        with self._lock:
            for alarm_id, end_s in _alarm_ends(changes.ended):
                if (ended := self._alarms.get(alarm_id)) is not None:
                    news.append(("closed", ended._replace(end_s=end_s)))
            for alarm_id, _ in _alarm_ends(changes.returned):
                if (back := self._alarms.get(alarm_id)) is not None:
                    news.append(("returned", back._replace(end_s=None, gaps=back.gaps + 1)))
            news += [("opened", alarm) for alarm in _begun(changes.begun)]
            self._note(news)
        if news:
            self._listeners.tell()

    def forget_ended(self, before_s: float) -> None:
        """Drop the alarms that ended before a time: the database deletes them then, and nobody could acknowledge them."""
        with self._lock:
            gone = [alarm_id for alarm_id, alarm in self._alarms.items() if alarm.end_s is not None and alarm.end_s < before_s]
            for alarm_id in gone:
                del self._alarms[alarm_id]

    def compare(self, rows: Rows) -> None:
        """Take alarms as the database has them now. Args: rows: columns as of `Alarm`."""
        news: list[tuple[What, Alarm]] = []
        with self._lock:
            for row in rows.rows:
                alarm = Alarm(*row)
                before = self._alarms.get(alarm.alarm_id)
                news += [(what, alarm) for what in alarm.changes(before)]
            self._note(news)
        if news:
            self._listeners.tell()

    def acknowledge(self, alarm_id: str, by: Acknowledgement) -> Alarm | None:
        """Acknowledge an alarm; the first one counts. Returns: it; None: it is not here."""
        with self._lock:
            alarm = self._alarms.get(alarm_id)
            if alarm is None or alarm.is_acknowledged:
                return alarm
            done = _acknowledged(alarm, by)
            self._note([("acknowledged", done)])
        self._listeners.tell()
        return done

    def take_acknowledged(self, run_id: int, found: Iterable[tuple[AlarmKey, Acknowledgement]]) -> None:
        """Take what the database has, of any server. The first acknowledgement counts."""
        with self._lock:
            here = [(self._alarms.get(id_of(key)), by) for key, by in found] if run_id == self.run_id else []
            news = [_acknowledged(alarm, by) for alarm, by in here if alarm is not None and not alarm.is_acknowledged]
            self._note([("acknowledged", alarm) for alarm in news])
        if news:
            self._listeners.tell()

    def acknowledge_all(self, chosen: Beginnings, by: Acknowledgement, slack_s: float) -> int:
        """Acknowledge each alarm of these beginnings that nobody has. Returns: how many. Args: slack_s: starts are given so exactly."""
        with self._lock:
            alarms = [
                alarm
                for alarm in self._alarms.values()
                if not alarm.is_acknowledged
                and alarm.kind in chosen.kinds
                and chosen.subject in (None, alarm.subject)
                and chosen.first_s - slack_s <= alarm.start_s <= chosen.last_s + slack_s
            ]
            self._note([("acknowledged", _acknowledged(alarm, by)) for alarm in alarms])
        if alarms:
            self._listeners.tell()
        return len(alarms)

    def alarms(self, state: State = "all") -> list[Alarm]:
        """The alarms, the most urgent first, then the newest."""
        _, _, every = self.snapshot()
        return sorted((alarm for alarm in every if alarm.has(state)), key=lambda alarm: alarm.urgency)

    def snapshot(self) -> tuple[int, int, list[Alarm]]:
        """The run, the number of the newest change, and all alarms as they are after it, in any order."""
        with self._lock:
            return self.run_id, self._number, list(self._alarms.values())

    def since(self, run_id: int, number: int) -> list[Change] | None:
        """The changes after a number; None: they are not here any more, or of another run, and the reader begins with `alarms`."""
        with self._lock:
            if run_id != self.run_id or not self.first - 1 <= number <= self._number:
                return None
            if number == self._number:
                return []
            return list(islice(self._changes, len(self._changes) - (self._number - number), None))

    def _note(self, news: Sequence[tuple[What, Alarm]]) -> None:
        for what, alarm in news:
            self._number += 1
            self._alarms[alarm.alarm_id] = alarm
            self._changes.append(Change(self._number, what, alarm))
        ended = [alarm for alarm in self._alarms.values() if not alarm.lasts] if len(self._alarms) > MOST_ENDED else []
        if len(ended) <= MOST_ENDED:
            return
        ended.sort(key=lambda alarm: (alarm.is_acknowledged, *alarm.urgency))
        for alarm in ended[MOST_ENDED - MOST_ENDED // 10 :]:
            self.forgotten += not alarm.is_acknowledged
            del self._alarms[alarm.alarm_id]


def _changes_from(from_s: float, alarms: Iterable[Alarm]) -> Iterable[Change]:
    """The beginnings and newest ends of alarms from a time on, by time. Their numbers are less than those of all others."""
    found: list[tuple[float, What, Alarm]]
    found = [(alarm.start_s, "opened", alarm._replace(end_s=None, gaps=0)) for alarm in alarms if alarm.start_s >= from_s]
    found += [(alarm.end_s, "closed", alarm) for alarm in alarms if alarm.end_s is not None and alarm.end_s >= from_s]
    found.sort(key=lambda one: one[0])
    return (Change(k - len(found), what, alarm) for k, (_, what, alarm) in enumerate(found))


def known_of(rows: Rows, memory: EventMemory) -> list[Alarm]:
    """The alarms of a run that goes on from a checkpoint, as they were then: some have ended or returned later.

    Args: rows: of the database, that began before the checkpoint; memory: of the events, at the checkpoint.
    """
    spans = memory.spans(np.arange(len(memory.key)))
    end_s = {alarm_id: None if np.isnan(end) else end for alarm_id, end in _alarm_ends(spans)}
    alarms = [Alarm(*row) for row in rows.rows]
    return [alarm._replace(end_s=end_s.get(alarm.alarm_id, alarm.end_s)) for alarm in alarms]


def _alarm_ends(spans: EventSpans) -> Iterable[tuple[str, float]]:
    """The text and the end of each span that is of an alarm."""
    rows = np.flatnonzero(IS_ALARM[spans.kind])
    columns = spans.vessel_id, spans.kind, spans.subject, spans.start_s, spans.end_s
    for vessel_id, kind, subject, start_s, end_s in zip(*(column[rows].tolist() for column in columns), strict=True):
        yield id_of(AlarmKey(vessel_id, EVENT_KINDS[kind], subject, start_s)), end_s


def _begun(begun: BegunEvents) -> Iterable[Alarm]:
    rows = np.flatnonzero(IS_ALARM[begun.kind])
    columns = begun.vessel_id, begun.kind, begun.subject, begun.start_s, begun.mmsi, begun.position_deg, begun.speed_kn
    values = (column[rows].tolist() for column in (*columns, begun.evidence))
    for vessel_id, kind, subject, start_s, mmsi, (latitude, longitude), speed_kn, evidence in zip(*values, strict=True):
        yield Alarm(
            vessel_id,
            EVENT_KINDS[kind],
            subject,
            start_s,
            end_s=None,
            gaps=0,
            mmsi=mmsi if mmsi >= 0 else None,
            name=None,
            latitude_deg=latitude,
            longitude_deg=longitude,
            sog_kn=None if np.isnan(speed_kn) else speed_kn,
            evidence=evidence,
            acknowledged_by=None,
            acknowledged_s=None,
            note=None,
        )


def _acknowledged(alarm: Alarm, by: Acknowledgement) -> Alarm:
    return alarm._replace(acknowledged_by=by.name, acknowledged_s=by.at_s, note=by.note)
