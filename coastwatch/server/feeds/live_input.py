"""Live feeds as the input of a run: reports by the time they were made, not by the time they came.

A cycle takes the reports of its span of time. It begins once none of them can be outstanding: `lateness_s` after its end by the clock
of this machine, or when every feed has sent something so much newer. What comes later is counted and dropped. So the picture does not
depend on the order in which reports came.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Literal, Self

from coastwatch.batches import Fault, FileContent, RadarVideo, Recording, Reports, Sensors, TrackReports
from coastwatch.formats.asterix.video_feed import VIDEO
from coastwatch.formats.decoding import (
    AHEAD,
    BEFORE_RUN,
    DROPPED,
    FAR_AHEAD_S,
    LATE,
    NO_TIME,
    Decoder,
    Item,
    decode,
)
from coastwatch.formats.intake.faults import refused
from coastwatch.formats.registry import FORMATS, decoders_of
from coastwatch.scenario import Scenario
from coastwatch.server.clock import CLOCK, ClockSet, now_s
from coastwatch.server.feeds.address import Address
from coastwatch.server.feeds.transport import Inbox, Receiver
from coastwatch.server.input import Positions
from coastwatch.server.link import FeedState, LastMinute
from coastwatch.server.regions.client import RegionAddress
from coastwatch.server.regions.intake import RegionIntake, resumed
from coastwatch.server.video_health import VideoHealth
from coastwatch.stage import Plan
from coastwatch.store import Intake
from coastwatch.store.runs import ENDLESS

Clock = Literal["wall", "feeds"]
POLL_S = 0.05
SILENT_S = 5.0
"""With the clock of the feeds: a feed from which nothing has come for so long is not waited for."""

BEGIN_RECORDS, BEGIN_S = 10, 2.0
"""With the clock of the feeds a run begins when so many records have come, or after so long: the first stamp may be wrong."""

AHEAD_OF_CYCLE_S = 60.0
"""With the clock of the feeds: a feed that is so far ahead of the cycle is not read for now, so that its sender waits."""

LEAST_THROWN, THROWN_SHARE = 10, 0.2
"""A feed is in trouble when so many of its reports in a minute were thrown away, and this share of all; or when it used none."""

MANY_SET_ASIDE = 1_000
"""A feed is in trouble while more of its MMSI wait for a second report, and are not in the picture."""

FIRST_S = 0.0
"""Before the first cycle of any region: one cycle of each is taken."""

PART = 5_000
"""Lines or datagrams of a feed that are decoded at a time."""

HELD_UP = 0.5
"""Periods for which decoding may hold up a cycle that is due, or as long as the cycle before took. What is left waits in its inbox."""


class _Feed:
    """One feed: what it received, and its decoder."""

    def __init__(self, inbox: Inbox, decoder: Decoder) -> None:
        self.inbox, self.decoder = inbox, decoder
        self.items: list[Item] = []  # received and not yet decoded
        self._last_minute = LastMinute()
        self._video = VideoHealth(decoder.counts.radars)

    def decode(self, reference_s: float | None) -> None:
        """Decode what has come. Args: as of `Decoder.decode`."""
        items, self.items = self.items, []
        decode(self.decoder, self.inbox.address.name, items, reference_s)

    def look(self) -> None:
        """Note the counts, for `troubles`."""
        at_s, counts, tally = now_s(), self.decoder.counts, self.decoder.tally
        self._last_minute.note(
            at_s,
            used=counts.records,
            late=counts.late,
            before_run=counts.before_run,
            dropped=self.inbox.dropped + counts.dropped,
            not_read=sum(fault.count for fault in _not_used(tally.faults())),
            ahead=tally.count(AHEAD),
            no_time=tally.count(NO_TIME),
            no_room=counts.no_room,
        )
        self._video.look(at_s)

    def troubles(self) -> list[str]:
        """What is wrong with what it sends."""
        sentences, ahead_s = [], self.decoder.stamps.ahead_s
        is_off = self.decoder.checked and abs(ahead_s) > FAR_AHEAD_S
        if is_off:
            sentence = f"its clock is {abs(ahead_s):.0f} s {'ahead' if ahead_s > 0.0 else 'behind'}"
            sentences.append(sentence + (": the time of arrival is taken" if ahead_s > 0.0 else ""))
        n = self._last_minute.change()
        used, thrown = n["used"], n["late"] + n["before_run"]
        if n["ahead"] and not is_off:
            sentences.append(
                f"{n['ahead']} stamps of the last minute were ahead of the clock of this machine: the time of arrival is taken"
            )
        if n["no_time"]:
            sentences.append(f"{n['no_time']} records of the last minute are not used: {NO_TIME}")
        if not used and n["not_read"] - n["no_time"] >= LEAST_THROWN:
            most = max(_not_used(self.decoder.tally.faults()), key=lambda fault: fault.count)
            why = f"{most.kind}: {most.example}" if most.example else most.kind
            sentences.append(f"none of the {n['not_read']} records of the last minute could be used, most often: {why}")
        if n["dropped"]:
            sentences.append(
                f"{n['dropped']} lines, datagrams or reports were dropped in the last minute: too long, or no room"
            )
        if thrown >= LEAST_THROWN and thrown > THROWN_SHARE * (thrown + used):
            why = "they came after their cycle"
            if n["before_run"] > n["late"]:
                why = "they are from before the run began. A recording needs --clock feeds"
            sentences.append(f"{thrown} of {thrown + used} reports of the last minute were thrown away: {why}")
        return sentences + _of_new_mmsi(self.decoder.counts.set_aside, n["no_room"])

    def counters(self) -> FeedState:
        """Its state for operators."""
        inbox, decoder = self.inbox, self.decoder
        newest_s = decoder.stamps.newest_s
        faults = decoder.tally.faults()
        state = inbox.as_feed(
            inbox.address.name,
            received=inbox.received,
            records=decoder.counts.records,
            refused=sum(fault.count for fault in _not_used(faults)),
            late=decoder.counts.late,
            before_run=decoder.counts.before_run,
            dropped=inbox.dropped + decoder.counts.dropped,
            newest_s=newest_s if math.isfinite(newest_s) else None,
            faults={fault.kind: fault.count for fault in faults},
            troubles=self.troubles(),
        )
        if inbox.address.format == VIDEO.name:
            state["radars"] = self._video.states(now_s())
        return state


class LiveInput:
    """Feeds and regions as the input of a live run. Use it in a `with` block, in which it receives."""

    def __init__(
        self,
        addresses: list[Address],
        sensors: Sensors,
        *,
        regions: Sequence[RegionAddress] = (),
        clock: Clock = "wall",
        lateness_s: float = 2.0,
        on_video: Callable[[RadarVideo], None] = lambda video: None,
    ) -> None:
        """Args: regions: each is the track source of its name; on_video: as of `FeedSettings`. Raises: AddressError."""
        self._clock, self._lateness_s = clock, lateness_s
        self._region_addresses, self._regions = regions, list[RegionIntake]()
        self._sources = {str(name): number for number, name in enumerate(sensors.track_sources.name)}
        self._stack, self._of_regions = ExitStack(), ExitStack()
        self._has_begun = False
        self._period_s, self._decoded_s = 0.0, now_s()  # of a cycle; when decoding ended last
        self._receiver = Receiver(addresses)
        feeds = [
            (address.format, replace(address.settings(clock == "wall"), sender_name=inbox.sender_name, on_video=on_video))
            for address, inbox in zip(addresses, self._receiver.inboxes, strict=True)
        ]
        decoders, self._report_sources = decoders_of(feeds, sensors)
        self._feeds = [_Feed(inbox, decoder) for inbox, decoder in zip(self._receiver.inboxes, decoders, strict=True)]
        self._names = tuple(address.name for address in addresses if FORMATS[address.format].numbered)

    @property
    def dateless(self) -> list[str]:
        """The feeds whose times of day take the date of this machine, as nothing else has one: with the clock of the feeds."""
        if self._clock == "wall" or self._region_addresses or any(feed.decoder.has_dates for feed in self._feeds):
            return []
        return [feed.inbox.address.text for feed in self._feeds]

    @property
    def ports(self) -> list[int]:
        """The port on which each feed listens; 0: it does not."""
        return [inbox.port for inbox in self._receiver.inboxes]

    def __enter__(self) -> Self:
        self._stack.enter_context(self._receiver)
        return self

    def __exit__(self, *unused: object) -> None:
        self._of_regions.close()
        self._stack.close()

    def begin(
        self,
        scenario: Scenario,
        sensors: Sensors,
        seed: int,
        stop: threading.Event,
        positions: Positions,
    ) -> tuple[Recording, Plan]:
        """As of `Input`. With the clock of the feeds the run begins with the first report, whatever `start_utc` of the scenario says.

        A centre that has regions and no feeds ends its first cycle with the first one of them.
        """
        start_s = float(math.floor(now_s()))
        from_s = start_s if self._clock == "wall" else 0.0
        self._of_regions.close()  # of a run before this one
        self._regions = []
        for feed in self._feeds:
            feed.decoder.counts.begin()
        for address in self._region_addresses:
            connection = self._of_regions.enter_context(resumed(address, positions, from_s))
            self._regions.append(RegionIntake(connection, self._sources[address.name], self._clock == "wall"))
        if self._clock == "feeds":
            self._wait_for_first(stop)
            first_s = self._newest_s() if self._has_begun and self._feeds else self._first_s()
            if math.isfinite(first_s):
                start_s = math.floor(first_s) - 1.0 if self._feeds else round(first_s - scenario.period_s, 6)
        self._has_begun, self._period_s = True, scenario.period_s
        return Recording(self, feeds=self._names), Plan(start_s=start_s, period_s=scenario.period_s, cycles=ENDLESS)

    def _wait_for_first(self, stop: threading.Event) -> None:
        """Wait for the first records of feeds, or the first cycle of a region; without feeds of each region."""
        before_s = None
        while not stop.is_set():
            for region in self._regions:
                region.receive(FIRST_S)
            self._decode_feeds(math.inf, math.inf)
            if math.isfinite(self._first_s()) and (
                self._feeds or all(math.isfinite(region.first_s) for region in self._regions)
            ):
                before_s = before_s or time.monotonic()
                of_feeds = sum(feed.inbox.received for feed in self._feeds)
                if self._regions or of_feeds >= BEGIN_RECORDS or time.monotonic() - before_s > BEGIN_S:
                    return
            stop.wait(POLL_S)

    def due_s(self, until_s: float) -> float:
        """As `Input.due_s`."""
        return until_s + self._lateness_s if self._clock == "wall" else now_s()

    def wait(self, until_s: float, stop: threading.Event) -> bool:
        """As `Input.wait`."""
        for feed in self._feeds:
            feed.look()
        while not stop.is_set():
            self._decode(until_s, self.due_s(until_s))
            self._adopt_clock()
            left_s = self.due_s(until_s) - now_s()
            if (self._clock == "wall" and left_s <= 0.0) or (self._clock == "feeds" and self._have_passed(until_s)):
                return True
            stop.wait(min(max(left_s, 0.001), POLL_S) if self._clock == "wall" else POLL_S)
        return False

    def _adopt_clock(self) -> None:
        """Go on by the clock of the machine after it was set, where the stamps of the feeds say that it is right now.

        Raises: ClockSet: the run begins again by it.
        """
        if self._clock != "wall" or not (step_s := CLOCK.step_s):
            return
        ahead = [feed.decoder.stamps.ahead_s for feed in self._feeds if math.isfinite(feed.decoder.stamps.ahead_s)]
        agree = sum(abs(ahead_s - step_s) < min(abs(ahead_s), FAR_AHEAD_S) for ahead_s in ahead)
        if agree > len(ahead) / 2:
            CLOCK.adopt()
            raise ClockSet(f"the clock of this machine was set by {step_s:+.0f} s, and the feeds agree with it")

    def between(self, after_s: float, until_s: float) -> Reports:
        """As `ReportStream.between`."""
        self._decode(until_s, now_s() + max(HELD_UP * self._period_s, now_s() - self._decoded_s))
        reports = Reports.merged([source(after_s, until_s) for source in self._report_sources])
        if not self._regions:
            return reports
        of_regions = [region.reports_between(after_s, until_s) for region in self._regions]
        return replace(reports, tracks=TrackReports.join([reports.tracks, *of_regions]))

    def intake(self) -> list[Intake]:
        """As `Input.intake`."""
        return [one for region in self._regions for one in region.intake()]

    def faults(self) -> tuple[Fault, ...]:
        """As `ReportStream.faults`, with what was late or dropped."""
        faults = [fault for feed in self._feeds for fault in feed.decoder.tally.faults()]
        for feed in self._feeds:
            counts = feed.decoder.counts
            counted = (LATE, counts.late), (BEFORE_RUN, counts.before_run), (DROPPED, feed.inbox.dropped + counts.dropped)
            faults += [Fault(kind, count, feed.inbox.address.name, "") for kind, count in counted if count]
        return (*faults, *(fault for region in self._regions for fault in region.faults()))

    def contents(self) -> tuple[FileContent, ...]:
        """As `ReportStream.contents`: there are no files."""
        return ()

    def rest(self, after_s: float) -> int:
        """As `ReportStream.rest`: a live input has no end."""
        return 0

    def feeds(self) -> Sequence[FeedState]:
        """As `Input.feeds`."""
        return [*(feed.counters() for feed in self._feeds), *(region.counters() for region in self._regions)]

    def _decode(self, until_s: float, stop_s: float) -> None:
        """Decode what has come since the last call.

        Args: until_s: of regions no cycles after the first that ends then or later; stop_s: as of `_decode_feeds`.
        """
        for region in self._regions:
            region.receive(until_s)
        self._decode_feeds(until_s, stop_s)

    def _decode_feeds(self, until_s: float, stop_s: float) -> None:
        """Decode what waits, a part of each feed in turn: a feed that is flooded holds up no other one.

        Args: stop_s: with the clock of the machine, what is left after this Unix time waits; a part of each feed is decoded.
        """
        about_s = self._newest_s()
        while True:
            decoded = 0
            for feed in sorted(self._feeds, key=lambda feed: not feed.decoder.has_dates):
                if self._clock == "feeds" and feed.decoder.stamps.newest_s > until_s + self._lateness_s + AHEAD_OF_CYCLE_S:
                    continue
                feed.items = feed.items or feed.inbox.pop_first(PART)
                if feed.items and not self._waits_for_a_date(feed, about_s):
                    decoded += len(feed.items)
                    feed.decode(about_s if self._clock == "feeds" and math.isfinite(about_s) else None)
                    about_s = max(about_s, feed.decoder.stamps.newest_s)
            if not decoded or (self._clock == "wall" and now_s() >= stop_s):
                self._decoded_s = now_s()
                return

    def _waits_for_a_date(self, feed: _Feed, about_s: float) -> bool:
        """Whether a feed with times of day alone is to wait for the first report of a feed with dates, for `SILENT_S` at most.

        Args: about_s: time of the newest report of all feeds, -inf before the first.
        """
        if self._clock == "wall" or math.isfinite(about_s) or feed.decoder.has_dates:
            return False
        return any(other.decoder.has_dates for other in self._feeds) and now_s() - feed.items[0][0] <= SILENT_S

    def _first_s(self) -> float:
        of_feeds = (feed.decoder.stamps.first_s for feed in self._feeds)
        return min((*of_feeds, *(region.first_s for region in self._regions)), default=math.inf)

    def _newest_s(self) -> float:
        return max((feed.decoder.stamps.newest_s for feed in self._feeds), default=-math.inf)

    def _have_passed(self, until_s: float) -> bool:
        """Whether every feed that sends has sent something newer than an instant and the lateness; false if none sends.

        Regions send in order, and have all their cycles again when they return: each is waited for, and without lateness.
        """
        if any(region.newest_s < until_s for region in self._regions):
            return False
        late = [feed for feed in self._feeds if feed.decoder.stamps.newest_s < until_s + self._lateness_s]
        return all(feed.inbox.silent_s > SILENT_S for feed in late) and (len(late) < len(self._feeds) or bool(self._regions))


def _not_used(faults: tuple[Fault, ...]) -> tuple[Fault, ...]:
    """The faults whose records are not used."""
    return tuple(fault for fault in refused(faults) if not fault.used)


def _of_new_mmsi(set_aside: int, no_room: int) -> list[str]:
    """What is wrong with new MMSI. Args: set_aside: those that wait now; no_room: those of the last minute for which there was none."""
    sentences = []
    if set_aside > MANY_SET_ASIDE:
        why = "they are beyond the budget of new ones and wait for a second report that agrees"
        sentences.append(f"{set_aside} MMSI are not in the picture: {why}")
    if no_room:
        sentences.append(f"{no_room} MMSI of the last minute were forgotten before their second report: too many wait for one")
    return sentences
