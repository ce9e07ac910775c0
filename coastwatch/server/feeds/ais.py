"""AIS sentences of live feeds to reports. Several receivers of one coast: a message that two of them heard is used once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from coastwatch.batches import AisStatics, Bools, Floats, Ints, Reports
from coastwatch.sensors.recorded.ais_validation import DUPLICATE, Acceptance, AisIntake, AisRows, StaticRows
from coastwatch.sensors.recorded.faults import Tally
from coastwatch.sensors.recorded.nmea.messages import Assembler
from coastwatch.sensors.recorded.nmea.payload import decoded
from coastwatch.sensors.recorded.nmea.sentences import ais_sentences
from coastwatch.sensors.recorded.reception_time import repeated
from coastwatch.server.feeds.decoding import Counts, plausible_s
from coastwatch.server.feeds.transport import Item

ANY_LATENESS_S = 1e9
"""Stamps are judged when rows come, not in the order of a file."""

TWICE_WITHIN_S = AisIntake().duplicate_within_s


class AisDecoder:
    """The sentences of one receiver."""

    def __init__(self, name: str, feed: int, checked: bool) -> None:
        """Args: feed: its number; checked: stamps far ahead of the clock are not believed."""
        self.tally, self.counts = Tally(), Counts()
        self.newest_s, self.first_s = -math.inf, math.inf
        self.name, self._checked = name, checked
        self._assembler = Assembler(name, self.tally)
        intake = AisIntake(order="time", lateness_s=ANY_LATENESS_S, longest_silence_s=ANY_LATENESS_S)
        self._acceptance = Acceptance(intake, self.tally, lambda line: f"{name}:{line}", feed)
        self._ahead: list[Item] = []  # lines that belong to the next sentence
        self._clock: list[Item] = []  # the last clock sentence
        self._lines = 0
        self._rows: list[AisRows] = []
        self._statics: list[tuple[AisStatics, StaticRows]] = []

    def take(self, items: list[Item], reference_s: float | None) -> None:
        """As of `Decoder`. A sentence without a time has that of its arrival."""
        items = [*self._clock, *self._ahead, *items]
        self._clock, self._ahead = [], []
        while items and _is_ahead(items[-1][1]):
            self._ahead.insert(0, items.pop())
        self._clock = [item for item in items if item[1][3:6] in (b"ZDA", b"RMC")][-1:]
        if not items:
            return
        first, self._lines = self._lines, self._lines + len(items)
        found = ais_sentences([line for _, line in items], self.name, self.tally)
        messages = self._assembler.whole([s._replace(line=s.line + first) for s in found], False)
        arrived = np.array([when for when, _ in items], np.float64)
        at = np.clip(messages.line - first - 1, 0, len(items) - 1)  # a message may have begun in lines before these
        stamp = plausible_s(messages.stamp_s, arrived[at], self._checked, self.tally, self.name)
        rows, statics, static_rows = decoded(messages._replace(stamp_s=stamp), self.name, self.tally)
        self._rows.append(rows)
        self._statics.append((statics, static_rows))
        self.newest_s = max(self.newest_s, float(stamp.max(initial=-math.inf)))
        self.first_s = min(self.first_s, float(stamp.min(initial=math.inf)))

    def due(self, after_s: float, until_s: float) -> AisRows:
        """The positions of a span, which then wait no longer. Older ones are counted."""
        rows = AisRows.join(self._rows)
        keep, outdated = rows.stamp_s > until_s, self.counts.outdated(rows.stamp_s, after_s)
        self._rows = [rows.take(keep)] if keep.any() else []
        return rows.take(~keep & ~outdated)

    def accepted(self, rows: AisRows, until_s: float) -> Reports:
        """The reports of these positions, and names and sizes up to an instant."""
        reports, named = self._acceptance.block(rows, *self._named(until_s))
        self.counts.records += len(reports) + len(named)
        return replace(Reports.empty(), ais=reports, statics=named)

    def _named(self, until_s: float) -> tuple[AisStatics, StaticRows]:
        """Names and sizes up to an instant, also late ones, in order of time and content."""
        statics = AisStatics.join([found for found, _ in self._statics])
        start = np.cumsum([0, *(len(found) for found, _ in self._statics)])[:-1].tolist()
        shifted = [replace(of, static=of.static + begin) for (_, of), begin in zip(self._statics, start, strict=True)]
        rows = StaticRows.join(shifted)
        keep = rows.stamp_s > until_s
        self._statics = [(statics, rows.take(keep))] if keep.any() else []
        rows = rows.take(~keep)
        return statics, rows.take(np.lexsort((rows.digest, statics.mmsi[rows.static], rows.stamp_s)))


class Receivers:
    """The receivers of one coast. A message that several of them heard is used once: that of the earliest stamp."""

    def __init__(self, decoders: Sequence[AisDecoder]) -> None:
        self._decoders = decoders
        self._seen = np.zeros((0, 2), np.int64), np.zeros(0)  # digest and MMSI of messages, and their times

    def cut(self, after_s: float, until_s: float) -> Reports:
        """As `Cut`, of all of them."""
        parts = [decoder.due(after_s, until_s) for decoder in self._decoders]
        rows, of = AisRows.join(parts), np.repeat(np.arange(len(parts)), [len(part) for part in parts])
        order = np.lexsort((of, rows.digest, rows.second, rows.mmsi, rows.stamp_s))
        rows, of = rows.take(order), of[order]
        first = self._first(np.stack([rows.digest, rows.mmsi], 1), rows.stamp_s)
        found = []
        for number, decoder in enumerate(self._decoders):
            own = of == number
            decoder.tally.add_rows(DUPLICATE, own & ~first, lambda i: "live", lambda i: f"MMSI {rows.mmsi[i]}")
            found.append(decoder.accepted(rows.take(own & first), until_s))
        return Reports.merged(found) if found else Reports.empty()

    def _first(self, message: Ints, time_s: Floats) -> Bools:
        """Which messages are heard for the first time. Args: (M, 2) digest and MMSI, (M,), later than those of the calls before."""
        every, when = (np.concatenate([old, new]) for old, new in zip(self._seen, (message, time_s), strict=True))
        again = repeated(tuple(every.T), when, TWICE_WITHIN_S)
        recent = when >= when.max(initial=-math.inf) - TWICE_WITHIN_S
        self._seen = every[recent], when[recent]
        return np.asarray(~again[len(every) - len(message) :])


def _is_ahead(line: bytes) -> bool:
    """Whether a line is a tag block or time alone, which belongs to the next line."""
    line = line.strip()
    return line.startswith(b"$PGHP") or (line.startswith(b"\\") and b"!" not in line and b"$" not in line)
