"""The cycles of a region as reports of a track source: each is used in the cycle of the centre in whose span it ends, once."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from coastwatch.batches import Fault, TrackReports, limits
from coastwatch.formats.decoding import FAR_AHEAD_S
from coastwatch.server.clock import now_s
from coastwatch.server.link import FeedState, LastMinute
from coastwatch.server.regions.client import Connection, RegionAddress
from coastwatch.server.regions.link import NOTHING, Incoming, Position
from coastwatch.server.regions.message import RegionCycle
from coastwatch.store import Intake

MISSING = "cycle of the region that it did not have any more"
LATE = "cycle of the region later than its cycle here"
AHEAD = "cycle of the region ahead of the clock of this machine, time of arrival taken"
WITHOUT = "cycle without tracks of the region"

LEAST_THROWN, THROWN_SHARE = 3, 0.2
"""A region is in trouble when so many of its cycles in a minute were late, and this share."""

LEAST_RETURNED = 2
"""There are two senders when so many changes in a minute were to the run before."""

FEWEST_LOOKS = 5
"""Cycles here that are judged in any case, however long they are. A region none of whose cycles was late in them is well again."""


class RegionIntake:
    """The cycles of one region that wait for their cycle here."""

    def __init__(self, connection: Connection, source: int, checked: bool) -> None:
        """Args: source: number of its track source; checked: its times are judged by the clock of this machine."""
        self.connection, self._source, self._checked = connection, source, checked
        self.ahead, self._ahead_s = 0, 0.0  # cycles of a time far ahead, and how far the newest cycle was
        self.newest_s, self.first_s = -math.inf, math.inf
        self.late = self.used = self.without = 0
        self._beyond: dict[str, int] = {}  # states of tracks that are none, by kind
        self._waiting: list[tuple[RegionCycle, float]] = []  # and how long after its end it came
        self._late_s = 0.0  # how long after its end the newest late cycle came
        self._intake: list[Intake] = []
        self._last_minute = LastMinute(FEWEST_LOOKS + 1)
        self._last_minute.note(now_s())
        self._last = connection.incoming.position  # the last cycle that was used

    @property
    def name(self) -> str:
        """Name of its track source."""
        return self.connection.address.name

    def receive(self, until_s: float) -> None:
        """Take what has come, until a cycle ends at this instant or later. What follows stays with the region: memory is bounded."""
        while self.newest_s < until_s and (cycle := self.connection.next()) is not None:
            at_s = now_s()
            self._ahead_s = cycle.time_s - at_s
            if self._checked and self._ahead_s > FAR_AHEAD_S:  # its time is that of its arrival
                self.ahead += 1
                cycle = replace(cycle, time_s=max(at_s, self.newest_s))
            self._waiting.append((cycle, -self._ahead_s))
            self.newest_s = max(self.newest_s, cycle.time_s)
            self.first_s = min(self.first_s, cycle.time_s)

    def reports_between(self, after_s: float, until_s: float) -> TrackReports:
        """The tracks of the cycles that end in a span. Older ones are late: counted and left out."""
        came = [one for one in self._waiting if one[0].time_s <= until_s]
        self._waiting = [one for one in self._waiting if one[0].time_s > until_s]
        due = [cycle for cycle, _ in came]
        self._late_s = next((late_s for cycle, late_s in reversed(came) if cycle.time_s <= after_s), self._late_s)
        used = [cycle for cycle in due if cycle.time_s > after_s]
        self.late, self.used = self.late + len(due) - len(used), self.used + len(used)
        self.without += not used
        self._look()
        self._intake = [self._of_run([c for c in due if c.run == run], after_s) for run in dict.fromkeys(c.run for c in due)]
        reports = TrackReports.join([cycle.reports(self._source) for cycle in used])
        kept, beyond = limits.within(reports)
        for kind, mask in beyond.items():
            self._beyond[kind] = self._beyond.get(kind, 0) + int(mask.sum())
        return kept

    def _of_run(self, cycles: list[RegionCycle], after_s: float) -> Intake:
        """What these cycles of one run are. A region that was killed computes some cycles again, merged: used ones do not count again."""
        run, first, last = cycles[0].run, cycles[0].seq - cycles[0].merged, cycles[-1].seq
        if run == self._last.run:
            first = max(first, self._last.seq + 1)
        self._last = Position(run, last)
        return Intake(self.name, run, first, last, sum(cycle.time_s <= after_s for cycle in cycles))

    def intake(self) -> list[Intake]:
        """What the newest `reports_between` used, by run of the region."""
        return self._intake

    def faults(self) -> list[Fault]:
        """What was late, missing or away."""
        missing = self.connection.incoming.missing
        counted = [(LATE, self.late), (MISSING, missing), (WITHOUT, self.without), (AHEAD, self.ahead)]
        counted += [(limits.BEYOND + kind, count) for kind, count in self._beyond.items()]
        return [Fault(kind, count, f"region {self.name}", self.connection.error or "") for kind, count in counted if count]

    def _look(self) -> None:
        """Note the counts, for `troubles`."""
        self._last_minute.note(now_s(), used=self.used, late=self.late, returned=self.connection.incoming.returned)

    def troubles(self) -> list[str]:
        """What is wrong with its runs, and with the times of its cycles."""
        change, sentences = self._last_minute.change(), list[str]()
        incoming = self.connection.incoming
        if change["returned"] >= LEAST_RETURNED:
            runs = f"{incoming.former.run} and {incoming.position.run}"
            sentences.append(f"two senders: cycles of the runs {runs} come in turn. Each region needs a name of its own")
        if not self._checked:
            return sentences
        if self._ahead_s > FAR_AHEAD_S:
            sentences.append(f"its clock is {self._ahead_s:.0f} s ahead: the time of arrival is taken")
        used, late = change["used"], change["late"]
        goes_on = self._last_minute.change(FEWEST_LOOKS + 1)["late"] > 0
        if goes_on and late >= LEAST_THROWN and late > THROWN_SHARE * (late + used):
            sentences.append(
                f"{late} of its last {late + used} cycles were left out: the newest of them came {self._late_s:.0f} s after its end, "
                f"later than --lateness allows. Its clock may be behind, or its line too slow"
            )
        return sentences

    def counters(self) -> FeedState:
        """Its state for operators, as of a feed."""
        link = self.connection
        return link.as_feed(
            f"region {self.name}",
            received=link.incoming.position.seq,
            records=self.used,
            refused=link.refused,
            late=self.late,
            dropped=link.incoming.missing,
            newest_s=self.newest_s if math.isfinite(self.newest_s) else None,
            faults={fault.kind: fault.count for fault in self.faults()},
            troubles=self.troubles(),
        )


def resumed(address: RegionAddress, positions: Mapping[str, tuple[str, int]], from_s: float) -> Connection:
    """The connection to a region, which goes on after what is known of it."""
    incoming = Incoming(Position(*positions.get(address.name, NOTHING)))
    if not address.stream:
        return Connection(address, from_s, incoming)
    from coastwatch.server.regions.jetstream import Subscription  # of the extra `nats`

    return Subscription(address, from_s, incoming)
