"""The two ends of a link from a region to a centre, without sockets: events in, decisions out.

A region sends its cycles in order, at most IN_FLIGHT that are not acknowledged. A centre names the last cycle that it has when it
connects, so that each cycle is used once, whatever was lost in between.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

IN_FLIGHT = 4


class LinkError(ValueError):
    """The other side does not keep to the protocol; the message says how."""


class Position(NamedTuple):
    """The last cycle of a region that somebody has; seq 0: none of the run; an empty run: nothing at all."""

    run: str
    seq: int


NOTHING = Position("", 0)


@dataclass
class Outgoing:
    """What a region has sent to one centre."""

    position: Position = NOTHING  # of the last cycle that was sent, or that the centre had
    _flight: deque[Position] = field(default_factory=deque)

    @property
    def room(self) -> int:
        """How many cycles may be sent now."""
        return IN_FLIGHT - len(self._flight)

    def sent(self, cycle: Position) -> None:
        """A cycle was sent. Raises: LinkError: there was no room."""
        if self.room <= 0:
            raise LinkError(f"got a cycle to send, needed at most {IN_FLIGHT} that are not acknowledged")
        self.position = cycle
        self._flight.append(cycle)

    def acknowledged(self, cycle: Position) -> None:
        """The centre has taken all cycles up to one. One that came by an earlier connection changes nothing."""
        if cycle in self._flight:
            while self._flight.popleft() != cycle:
                pass


@dataclass
class Incoming:
    """What a centre has received of one region."""

    position: Position = NOTHING  # of the last cycle
    missing: int = 0  # cycles that the region did not have any more
    repeated: int = 0  # cycles that came again, and were left out
    returned: int = 0  # how often a run came again after another one: a region begins new ones only, so there are two senders
    former: Position = NOTHING  # of the last cycle of the run before
    _skipped: int = 0  # cycles at the beginning of this run that are counted as missing

    def received(self, cycle: Position, merged: int = 0) -> bool:
        """Whether a cycle is new; one that came before is left out. A gap is counted. Args: merged: cycles before it that are in it."""
        run, seq = cycle
        known = next((one for one in (self.position, self.former) if one.run == run), None)
        if known is not None and seq <= known.seq:
            self.repeated += 1
            return False
        missing = max(seq - 1 - merged - (known.seq if known else 0), 0) if self.position.run else 0
        if run != self.position.run:
            if known is not None:
                self.returned += 1
                self.missing -= self._skipped  # of the beginning of another sender
            self.former, self._skipped = self.position, missing if known is None else 0
        self.missing += missing
        self.position = cycle
        return True
