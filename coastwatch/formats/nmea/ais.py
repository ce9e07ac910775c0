"""AIS sentences to reports, and back. Several receivers of one coast: a message that two of them heard is used once."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from coastwatch.batches import AisReports, AisStatics, Bools, Ints, Reports, Sensors
from coastwatch.formats import decoding
from coastwatch.formats.decoding import FAR_AHEAD_S, Counts, Item, Newest, Stamps
from coastwatch.formats.format import Format, rounded_deg
from coastwatch.formats.intake.ais_validation import (
    DUPLICATE,
    Acceptance,
    AisIntake,
    AisRows,
    Seen,
    StaticRows,
    repeated_in_stream,
)
from coastwatch.formats.intake.faults import Ledger, Tally
from coastwatch.formats.nmea.messages import Assembler, Messages, messages_where
from coastwatch.formats.nmea.new_vessels import BEYOND, NAME_BEYOND, NewVessels
from coastwatch.formats.nmea.payload import decoded
from coastwatch.formats.nmea.sentence_feed import made_sentence
from coastwatch.formats.nmea.sentences import FURTHER, LinesBefore, ais_sentences

ANY_LATENESS_S = 1e9
"""Stamps are judged when rows come, not in the order of a file."""

MOST_SENDERS = 256
"""Senders of one feed whose clocks are kept; of more, the one that was heard longest ago goes."""

JUDGED_FOR_S = 60.0
"""The clock of a sender that was not heard for so long is not judged any more."""

FAR_CLOCK = "clock sentence far from the clock of this machine, time of arrival taken"

TWICE_WITHIN_S = AisIntake().duplicate_within_s
MOST_SIDES_M = np.array([[511], [511], [63], [63]])  # to bow, stern, port and starboard: ITU-R M.1371-5, annex 8, 3.3.3
NO_COURSE, NO_SPEED, NO_STATUS, NO_HEADING = 360.0, 102.3, 15, 511


class _Sender:
    """What is known of one sender of a feed: its clock, the beginnings of its messages, and the stamps that are believed."""

    def __init__(self, name: str, checked: bool, tally: Tally, ledger: Ledger) -> None:
        self.stamps = Stamps(name, checked, tally)
        self._name, self._checked, self._tally, self._ledger = name, checked, tally, ledger
        self._assembler = Assembler(name, tally)
        self._before = LinesBefore()

    @property
    def waiting(self) -> int:
        """Sentences that wait for others of their messages."""
        return self._assembler.waiting

    def messages(self, items: list[Item], lines_before: int) -> Messages:
        """The messages that are whole, with their times. Args: lines_before: of the feed, for the numbers of lines."""
        lines = [line for _, line, _ in items]
        sentences = ais_sentences(lines, self._name, self._tally, self._ledger, self._before)
        messages = self._assembler.whole([s._replace(line=s.line + lines_before) for s in sentences], False)
        self._ledger.beside[FURTHER] += int(messages.sentences.sum()) - len(messages.line)
        arrived = np.array([when for when, _, _ in items], np.float64)
        at = np.clip(
            messages.line - lines_before - 1, 0, max(len(items) - 1, 0)
        )  # a message may have begun in lines before these
        arrived_s = arrived[at]
        stamp_s = messages.stamp_s
        if self._checked:
            ahead_s = stamp_s - arrived_s
            far = messages.by_clock & (np.abs(ahead_s) > FAR_AHEAD_S)
            self._tally.add_rows(FAR_CLOCK, far, lambda i: self._name, lambda i: f"{ahead_s[i]:.0f} s")
            stamp_s = np.where(far, np.nan, stamp_s)
        time_s = self.stamps.times_s(stamp_s, arrived_s)
        return messages_where(messages._replace(stamp_s=time_s), np.isfinite(time_s))


class AisDecoder:
    """The sentences of one receiver, which several senders may send. A sender disturbs no other one: each has a clock of its own."""

    has_dates = True

    def __init__(self, name: str, feed: int, checked: bool) -> None:
        """Args: feed: its number; checked: stamps are judged by the clock of the machine."""
        self.tally, self.counts = Tally(), Counts()
        self.name, self.checked = name, checked
        self._senders: OrderedDict[int, _Sender] = OrderedDict()  # the one that was heard last is last
        intake = AisIntake(order="time", lateness_s=ANY_LATENESS_S, longest_silence_s=ANY_LATENESS_S)
        self._acceptance = Acceptance(intake, self.tally, lambda line: f"{name}:{line}", feed)
        self._newest = Newest()
        self._lines = 0
        self._rows: list[AisRows] = []
        self._sender_of_row: list[Ints] = []
        self._statics: list[tuple[AisStatics, StaticRows]] = []
        self._alone: Receivers | None = None  # where no other receiver is asked with it

    @property
    def stamps(self) -> Newest:
        """As of `Decoder`, of all senders together."""
        return self._newest

    @property
    def waiting(self) -> int:
        """As of `Decoder`."""
        of_messages = sum(sender.waiting for sender in self._senders.values())
        return of_messages + sum(map(len, self._rows)) + sum(len(rows) for _, rows in self._statics)

    def decode(self, items: list[Item], reference_s: float | None) -> None:
        """As of `Decoder`. A sentence without a time has that of its arrival."""
        by_sender: dict[int, list[Item]] = {}
        for item in items:
            by_sender.setdefault(item[2], []).append(item)
        for number, own in by_sender.items():
            if number not in self._senders:
                self._senders[number] = _Sender(self.name, self.checked, self.tally, self.counts.ledger)
            self._senders.move_to_end(number)
            sender = self._senders[number]
            messages = sender.messages(own, self._lines)
            self._lines += len(own)
            rows, statics, static_rows = decoded(messages, self.name, self.tally)
            self.counts.ledger.read += int(np.isin(static_rows.row, rows.row).sum())  # a message with a position and a name
            self._rows.append(rows)
            self._sender_of_row.append(np.full(len(rows), number, np.int64))
            self._statics.append((statics, static_rows))
        self._bound()
        while len(self._senders) > MOST_SENDERS:
            self._senders.popitem(last=False)
        every = [sender.stamps for sender in self._senders.values()]
        heard_s = max((one.heard_s for one in every), default=0.0)
        self._newest = Newest.of([one for one in every if one.heard_s >= heard_s - JUDGED_FOR_S], self._newest)

    def _bound(self) -> None:
        """Drop the oldest positions, and the oldest names and sizes, where too many wait. They are counted."""
        if sum(map(len, self._rows)) > decoding.MOST_WAITING:
            rows, sender = AisRows.join(self._rows), np.concatenate(self._sender_of_row)
            stay = decoding.newest_rows(rows.stamp_s)
            self.counts.dropped += len(rows) - len(stay)
            self._rows, self._sender_of_row = [rows.take(stay)], [sender[stay]]
        if sum(len(rows) for _, rows in self._statics) > decoding.MOST_WAITING:
            statics, named = self._joined_statics()
            stay = decoding.newest_rows(named.stamp_s)
            self.counts.dropped += len(named) - len(stay)
            self._statics = [_static_part(statics, named.take(stay))]

    def due(self, after_s: float, until_s: float) -> tuple[AisRows, Ints]:
        """The positions of a span, which then wait no longer, and the sender of each. Older ones are counted."""
        rows, sender = AisRows.join(self._rows), np.concatenate([np.zeros(0, np.int64), *self._sender_of_row])
        keep, outdated = rows.stamp_s > until_s, self.counts.outdated(rows.stamp_s, after_s)
        self._rows, self._sender_of_row = ([rows.take(keep)], [sender[keep]]) if keep.any() else ([], [])
        due = ~keep & ~outdated
        return rows.take(due), sender[due]

    def reports_between(self, after_s: float, until_s: float) -> Reports:
        """As `ReportsBetween`, of this receiver alone."""
        self._alone = self._alone or Receivers([self])
        return self._alone.reports_between(after_s, until_s)

    def accepted(self, rows: AisRows, until_s: float, are_used: Callable[[Ints, float], Bools]) -> Reports:
        """The reports of these positions, and names and sizes up to an instant. Args: are_used: which names, by MMSI and time now."""
        statics, static_rows = self._named(until_s)
        mmsi = statics.mmsi[static_rows.static]
        keep = are_used(mmsi, float(static_rows.stamp_s.max(initial=-math.inf)))
        self.tally.add_rows(NAME_BEYOND, ~keep, lambda i: "live", lambda i: f"MMSI {mmsi[i]}")
        reports, named = self._acceptance.block(rows, statics, static_rows if keep.all() else static_rows.take(keep))
        self.counts.records += len(reports) + len(named)
        return Reports(ais=reports, statics=named)

    def _named(self, until_s: float) -> tuple[AisStatics, StaticRows]:
        """Names and sizes up to an instant, also late ones, in order of time and content."""
        statics, rows = self._joined_statics()
        keep = rows.stamp_s > until_s
        self._statics = [_static_part(statics, rows.take(keep))] if keep.any() else []
        rows = rows.take(~keep)
        return statics, rows.take(np.lexsort((rows.digest, statics.mmsi[rows.static], rows.stamp_s)))

    def _joined_statics(self) -> tuple[AisStatics, StaticRows]:
        statics = AisStatics.join([part for part, _ in self._statics])
        start = np.cumsum([0, *(len(part) for part, _ in self._statics)])[:-1].tolist()
        shifted = [replace(named, static=named.static + begin) for (_, named), begin in zip(self._statics, start, strict=True)]
        return statics, StaticRows.join(shifted)


def _static_part(statics: AisStatics, rows: StaticRows) -> tuple[AisStatics, StaticRows]:
    """Some rows with what belongs to them alone."""
    used, row = np.unique(rows.static, return_inverse=True)
    return statics.take(used), replace(rows, static=row)


class Receivers:
    """The receivers of one coast. A message that several of them heard is used once: that of the earliest stamp."""

    def __init__(self, decoders: Sequence[AisDecoder]) -> None:
        self._decoders, self._new = decoders, NewVessels()
        self._seen = Seen.empty()

    def reports_between(self, after_s: float, until_s: float) -> Reports:
        """As `ReportsBetween`, of all of them."""
        parts = [decoder.due(after_s, until_s) for decoder in self._decoders]
        rows = AisRows.join([part for part, _ in parts])
        feed = np.repeat(np.arange(len(parts)), [len(part) for part, _ in parts])
        sender = np.concatenate([np.zeros(0, np.int64), *(senders for _, senders in parts)])
        order = np.lexsort((feed, rows.digest, rows.second, rows.mmsi, rows.stamp_s))
        rows, feed, sender = rows.take(order), feed[order], sender[order]
        again, self._seen = repeated_in_stream(self._seen, rows.digest, rows.mmsi, rows.stamp_s, TWICE_WITHIN_S)
        first = ~again
        is_used = self._new.accepted(rows.mmsi, rows.stamp_s, rows.position_deg, feed, sender)
        waiting, no_room = self._new.set_aside(until_s, len(parts))
        reports = []
        for number, decoder in enumerate(self._decoders):
            own = feed == number
            decoder.counts.set_aside, decoder.counts.no_room = int(waiting[number]), int(no_room[number])
            decoder.tally.add_rows(DUPLICATE, own & ~first, lambda i: "live", lambda i: f"MMSI {rows.mmsi[i]}")
            decoder.tally.add_rows(BEYOND, own & first & ~is_used, lambda i: "live", lambda i: f"MMSI {rows.mmsi[i]}")
            reports.append(decoder.accepted(rows.take(own & first & is_used), until_s, partial(self._new.named, number)))
        return Reports.merged(reports)


def encode(reports: Reports, sensors: Sensors) -> list[bytes]:
    """The sentences of positions, then those of names and sizes, each after a tag block with its time of reception."""
    return [*_position_lines(reports.ais), *_static_lines(reports.statics)]


def _position_lines(reports: AisReports) -> Iterator[bytes]:
    columns = (reports.received_s, reports.time_s, reports.mmsi, *reports.position_deg.T, reports.sog_kn, reports.cog_deg)
    of_class, status, heading = reports.class_b.tolist(), reports.nav_status.tolist(), reports.heading_deg.tolist()
    for k, (received_s, time_s, mmsi, latitude, longitude, sog, cog) in enumerate(
        zip(*(c.tolist() for c in columns), strict=True)
    ):
        message = {
            "msg_type": 18 if of_class[k] else 1,
            "mmsi": mmsi,
            "lat": latitude,
            "lon": longitude,
            "speed": NO_SPEED if math.isnan(sog) else min(sog, 102.2),
            "course": NO_COURSE if math.isnan(cog) else rounded_deg(cog, 1),
            "heading": NO_HEADING if math.isnan(heading[k]) else round(heading[k]) % 360,
            "second": int(time_s) % 60,
        }
        if not of_class[k]:
            message["status"] = NO_STATUS if status[k] < 0 else status[k]
        yield from _sentences(message, received_s)


def _static_lines(statics: AisStatics) -> Iterator[bytes]:
    length, beam = np.rint(np.nan_to_num([statics.length_m, statics.beam_m]))
    middle = np.stack([length - length // 2, length // 2, beam - beam // 2, beam // 2])
    stated = np.rint([statics.to_bow_m, statics.to_stern_m, statics.to_port_m, statics.to_starboard_m])
    sides_m = np.clip(np.where(np.isnan(stated).any(axis=0), middle, stated), 0, MOST_SIDES_M).astype(np.int64).T.tolist()
    for k, (bow, stern, port, starboard) in enumerate(sides_m):
        message = {
            "msg_type": 5,
            "mmsi": int(statics.mmsi[k]),
            "shipname": str(statics.name[k]),
            "callsign": str(statics.call_sign[k]),
            "ship_type": max(int(statics.ship_type[k]), 0),
            "to_bow": bow,
            "to_stern": stern,
            "to_port": port,
            "to_starboard": starboard,
        }
        yield from _sentences(message, float(statics.received_s[k]))


def _sentences(message: dict[str, Any], received_s: float) -> Iterator[bytes]:
    """The sentences of a message, each after a tag block with its time in milliseconds; those of one message are a group."""
    from pyais import encode_dict

    sentences = encode_dict(message, talker_id="AI", sentence_type="VDM", seq_id=message["mmsi"] % 10)
    for number, sentence in enumerate(sentences, 1):
        group = f"g:{number}-{len(sentences)}-{message['mmsi'] % 10_000}," if len(sentences) > 1 else ""
        tag = made_sentence(f"{group}s:sim,c:{round(received_s * 1000)}", "\\")
        yield f"{tag}\\{sentence}".encode()


def _sending_times(lines: Iterable[bytes]) -> Iterator[tuple[int, float]]:
    """As `Format.sending_times`."""
    for sentence in ais_sentences(lines, "", Tally()):
        yield sentence.line, sentence.clock_s if math.isnan(sentence.own_s) else sentence.own_s


AIS = Format(
    "ais",
    decoder=lambda feed, sensors: AisDecoder(feed.name, feed.number, feed.checked),
    report_sources=lambda decoders: [Receivers([one for one in decoders if isinstance(one, AisDecoder)]).reports_between],
    encode=encode,
    encodes=("ais", "statics"),
    sending_times=_sending_times,
    numbered=True,
)
