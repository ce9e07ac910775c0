"""What every decoder offers, what it is told of its feed, and rows that wait for their cycle."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from coastwatch.batches import Bools, Floats, Ints, RadarVideo, Reports, TrackReports, limits
from coastwatch.formats.intake.faults import Ledger, Tally
from coastwatch.formats.intake.reception_time import TIME_MISSING
from coastwatch.formats.video_state import VideoState

Item = tuple[float, bytes, int]
"""When a line or datagram came, Unix time, NaN: unknown; its bytes; and the number of its sender: of a connection, or of an address."""

FAR_AHEAD_S = 60.0
FAR_JUMP_S, CONFIRMED_BY = 600.0, 10
"""A stamp so far ahead of the one before is believed when so many records in a row have such."""

LONGEST_NAME = 32  # of a source of tracks, as of a sensor of a scenario

MOST_WAITING = 500_000
"""Reports of a feed, of one kind, that wait for their cycle: those of more than a minute of the densest coast. The oldest go first."""

ORDER = {
    "radar": ("sensor", "range_m", "azimuth_deg"),
    "bearing": ("sensor", "contact", "bearing_deg"),
    "tracks": ("sensor", "number", "position_deg"),
    "headings": ("sensor", "heading_deg"),
}
"""Columns by which reports of one time are sorted, by field of `Reports`."""

JUMP = "time far ahead of the reports before"
AHEAD = "time ahead of the clock of this machine, that of arrival taken"
NO_TIME = "time that no clock shows: not of 1970 to 2223"


LATE = "report later than its cycle"
BEFORE_RUN = "report from before the run began"
BROKEN = "defect of its decoder"
DROPPED = "dropped: no room, or too long"


@dataclass(frozen=True)
class FeedSettings:
    """What a format is told of a feed."""

    name: str  # in lists and faults
    text: str  # as it was given
    options: Mapping[str, str] = field(default_factory=dict)
    source: str = ""  # the track source that its tracks are of
    number: int = 0  # among the feeds of its format
    checked: bool = True  # stamps are judged by the clock of this machine
    sender_name: Callable[[int], str] = str  # of the sender of this number, for operators
    on_video: Callable[[RadarVideo], None] = lambda video: None  # is given spokes as they come, before their cycle


@dataclass
class Counts:
    """What became of the reports of a feed."""

    records: int = 0  # used
    late: int = 0  # left out: they came after their cycle
    before_run: int = 0  # left out: of an instant before the first cycle of this run
    dropped: int = 0  # left out: more waited for their cycle than there is room for
    repeated: int = 0  # left out: the same as another one
    set_aside: int = 0  # MMSI that wait for a second report now, beyond the budget of their sender
    no_room: int = 0  # MMSI that waited for one until there was no room for them
    ledger: Ledger = field(default_factory=Ledger)  # of lines and records, counted where they are cut from what came
    radars: dict[str, VideoState] = field(default_factory=dict)  # that send video, by name
    _began_s: float | None = None

    def begin(self) -> None:
        """A run begins."""
        self._began_s = None

    def outdated(self, time_s: Floats, after_s: float) -> Bools:
        """Which reports are of no cycle any more; they are counted. Args: time_s: (M,); after_s: where the cycle begins. (M,)"""
        if self._began_s is None:
            self._began_s = after_s
        is_late, before = np.asarray(time_s <= after_s), int((time_s <= self._began_s).sum())
        self.before_run += before
        self.late += int(is_late.sum()) - before
        return is_late


class Span(Protocol):
    """The times of reports."""

    @property
    def newest_s(self) -> float:
        """Of the newest, -inf before the first."""
        ...

    @property
    def first_s(self) -> float:
        """Of the oldest, inf before the first."""
        ...

    @property
    def ahead_s(self) -> float:
        """How far the newest stamps were ahead of their arrival; NaN: none had one."""
        ...


@dataclass(frozen=True)
class Newest:
    """The times of the reports of several senders."""

    newest_s: float = -math.inf
    first_s: float = math.inf
    ahead_s: float = math.nan  # of the sender that is furthest from its arrival

    @classmethod
    def of(cls, spans: Sequence[Span], before: Newest) -> Newest:
        """Of senders, some of which may be forgotten. Args: before: of the call before."""
        return cls(
            max((before.newest_s, *(span.newest_s for span in spans))),
            min((before.first_s, *(span.first_s for span in spans))),
            max((span.ahead_s for span in spans if math.isfinite(span.ahead_s)), key=abs, default=math.nan),
        )


class Decoder(Protocol):
    """Lines or datagrams of one feed to reports."""

    tally: Tally
    counts: Counts
    checked: bool  # whether its stamps are judged by the clock of this machine

    @property
    def waiting(self) -> int:
        """Records that were read and wait, for their cycle or for more of their message."""
        ...

    @property
    def stamps(self) -> Span:
        """The times of its reports so far."""
        ...

    def decode(self, items: list[Item], reference_s: float | None) -> None:
        """Decode what has come. Args: reference_s: about now, for times of day; None: as each item came."""
        ...

    @property
    def has_dates(self) -> bool:
        """Whether its times need no date of another feed."""
        ...

    def reports_between(self, after_s: float, until_s: float) -> Reports:
        """As `ReportsBetween`."""
        ...


ReportsBetween = Callable[[float, float], Reports]
"""(after_s, until_s) -> the reports with after_s < time <= until_s, in an order that does not depend on their arrival. Older ones are
counted and dropped: late, or of before the run."""


def decode(decoder: Decoder, name: str, items: list[Item], reference_s: float | None) -> None:
    """Decode what has come. Whatever a decoder raises, the other lines are used.

    Args: name: of the feed; reference_s: as of `Decoder.decode`.
    """
    try:
        decoder.decode(items, reference_s)
    except Exception:
        for item in items:
            try:
                decoder.decode([item], reference_s)
            except Exception as error:
                decoder.tally.add(BROKEN, name, f"{type(error).__name__}: {error}")


def newest_rows(time_s: Floats) -> Ints:
    """The rows that stay where more than MOST_WAITING wait: the newest, a tenth fewer than that. In their order."""
    return np.sort(np.argsort(-time_s, kind="stable")[: MOST_WAITING - MOST_WAITING // 10])


class Waiting:
    """Reports that wait for their cycle, by their `received_s`."""

    def __init__(self, counts: Counts, tally: Tally, *kinds: str) -> None:
        """Args: counts, tally: of the feed; kinds: fields of `Reports`, of ORDER."""
        self._counts, self._tally = counts, tally
        self._parts: dict[str, list[Any]] = {kind: [getattr(Reports(), kind)] for kind in kinds}

    @property
    def rows(self) -> int:
        """Reports that wait."""
        return sum(len(part) for parts in self._parts.values() for part in parts)

    def add(self, kind: str, batch: Any) -> None:
        """Keep the reports within bounds until they are asked for."""
        kept, beyond = limits.within(batch)
        for fault, mask in beyond.items():
            self._tally.add(limits.BEYOND + fault, "live", count=int(mask.sum()))
        parts = self._parts[kind]
        if len(kept):
            parts.append(kept)
        if sum(map(len, parts)) > MOST_WAITING:
            every = kept.join(parts)
            stay = newest_rows(every.received_s)
            self._counts.dropped += len(every) - len(stay)
            self._parts[kind] = [every.take(stay)]

    def reports_between(self, after_s: float, until_s: float) -> Reports:
        """The reports of a span, each once, sorted by time and content. Older ones are counted."""
        return Reports(**{kind: self._due(kind, after_s, until_s) for kind in self._parts})

    def _due(self, kind: str, after_s: float, until_s: float) -> Any:
        every = self._parts[kind][0].join(self._parts[kind])
        keep = every.received_s > until_s
        self._parts[kind] = [every.take(keep)]
        reports = every.take(~keep & ~self._counts.outdated(every.received_s, after_s))
        keys = [getattr(reports, name) for name in ORDER[kind]]
        keys = [column for key in keys for column in (key.T if key.ndim > 1 else [key])]
        order = np.lexsort((*keys[::-1], reports.received_s))
        twice = np.zeros(len(order), np.bool_)
        same = np.diff(reports.received_s[order]) == 0.0
        for key in keys:
            same &= key[order[1:]] == key[order[:-1]]
        twice[1:] = same
        self._counts.records += int((~twice).sum())
        self._counts.repeated += int(twice.sum())
        return reports.take(order[~twice])


def track_reports(
    source: object, number: object, time_s: Floats, position_deg: Floats, velocity_m_s: Floats, covariance: Floats | None = None
) -> TrackReports:
    """States of tracks of one source. Args: source: its number, or (M,); number: (M,); covariance: (M, 4, 4); none: not given."""
    n = len(time_s)
    return TrackReports(
        sensor=np.full(n, source, np.int64),
        number=np.asarray(number, np.int64),
        time_s=time_s,
        received_s=time_s,
        position_deg=position_deg.copy(),
        velocity_m_s=velocity_m_s.copy(),
        covariance=np.full((n, 4, 4), np.nan) if covariance is None else covariance,
    )


class Stamps:
    """The stamps of one sender, judged. With the clock of the machine a stamp far ahead is replaced by the time of arrival.

    With the clock of the feeds a jump far ahead is believed once several records in a row agree; until then they are left out.
    A record with a stamp outside `limits.TIMES_S` is left out and counted.
    """

    def __init__(self, name: str, checked: bool, tally: Tally) -> None:
        """Args: name: of the feed; checked: by the clock of the machine."""
        self.newest_s, self.first_s = -math.inf, math.inf  # of what is believed
        self.ahead_s = math.nan  # median of stamp - arrival in the newest batch that has stamps
        self.heard_s = -math.inf  # newest arrival
        self._name, self._checked, self._tally = name, checked, tally
        self._far = self._before = 0  # records in a row that are far ahead, or far before
        self._agreeing = 0  # records near the newest

    def times_s(self, stamp_s: Floats, arrived_s: Floats) -> Floats:
        """The times of records in order of arrival. Args: stamp_s: (M,), NaN: none. Returns: (M,), NaN: not to be used."""
        stamped = np.isfinite(stamp_s)
        none = stamped & ~((stamp_s >= limits.TIMES_S[0]) & (stamp_s <= limits.TIMES_S[1]))
        self._tally.add_rows(NO_TIME, none, lambda i: self._name, lambda i: f"{stamp_s[i]:.6g}")
        stamped &= ~none
        self.heard_s = max(self.heard_s, float(arrived_s.max(initial=-math.inf)))
        if stamped.any():
            self.ahead_s = float(np.median(stamp_s[stamped] - arrived_s[stamped]))
        time_s = np.where(stamped, stamp_s, np.where(none, math.nan, arrived_s))
        if self._checked:
            ahead = time_s > arrived_s + FAR_AHEAD_S
            self._tally.add_rows(AHEAD, ahead, lambda i: self._name, lambda i: f"{time_s[i] - arrived_s[i]:.0f} s", used=True)
            time_s = np.where(ahead, arrived_s, time_s)
        else:
            self._tally.add_rows(TIME_MISSING, np.isnan(time_s) & ~none, lambda i: self._name, lambda i: "")
            time_s = self._without_jumps(time_s)
        self.newest_s = max(self.newest_s, float(np.nanmax(time_s, initial=-math.inf)))
        self.first_s = min(self.first_s, float(np.nanmin(time_s, initial=math.inf)))
        return time_s

    def time_s(self, stamp_s: float, arrived_s: float) -> float:
        """As `times_s`, of one record."""
        if not self._checked and self._agreeing >= CONFIRMED_BY and stamp_s <= self.newest_s + FAR_JUMP_S:
            self._far, self.ahead_s, self.newest_s = 0, stamp_s - arrived_s, max(self.newest_s, stamp_s)
            return stamp_s
        if self._checked and stamp_s <= arrived_s + FAR_AHEAD_S:
            self.ahead_s = stamp_s - arrived_s
            self.newest_s, self.first_s = max(self.newest_s, stamp_s), min(self.first_s, stamp_s)
            return stamp_s
        return float(self.times_s(np.array([stamp_s]), np.array([arrived_s]))[0])

    def _without_jumps(self, time_s: Floats) -> Floats:
        """The times, NaN where one is far ahead of those before and not confirmed."""
        known_s = time_s[np.isfinite(time_s)]
        if not len(known_s):
            return time_s
        if not math.isfinite(self.newest_s):
            self.newest_s = float(np.median(known_s))
        far = _after_jump(time_s, self.newest_s)
        if self._agreeing < CONFIRMED_BY:  # the first stamps may have been the wrong ones
            before = time_s < self.newest_s - FAR_JUMP_S
            self._before = _at_the_end(before, self._before)
            self._agreeing += int((~far & ~before).sum())
            if self._before >= CONFIRMED_BY:
                self.newest_s = self.first_s = float(np.median(time_s[before]))
                far = _after_jump(time_s, self.newest_s)
        self._far = _at_the_end(far, self._far)
        if self._far >= CONFIRMED_BY:
            far[len(far) - min(self._far, len(far)) :] = False
            self._far = 0
        self._tally.add_rows(JUMP, far, lambda i: self._name, lambda i: f"{time_s[i] - self.newest_s:.0f} s")
        return np.where(far, np.nan, time_s)


def _after_jump(time_s: Floats, newest_s: float) -> Bools:
    """Which times are far ahead of the newest one before the first jump. Args: newest_s: before all of them."""
    before_s = np.fmax.accumulate(np.concatenate([[newest_s], time_s]))
    jumps = np.flatnonzero(np.diff(before_s) > FAR_JUMP_S)
    return np.asarray(time_s > before_s[jumps[0]] + FAR_JUMP_S) if len(jumps) else np.zeros(len(time_s), np.bool_)


def _at_the_end(mask: Bools, before: int) -> int:
    """How many in a row are true at the end. Args: before: how many were, before the first of these."""
    false = np.flatnonzero(~mask)
    return int(len(mask) - false[-1] - 1) if len(false) else len(mask) + before
