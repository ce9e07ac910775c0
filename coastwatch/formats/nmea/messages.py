"""AIS sentences to whole messages: joins parts, and verifies checksums of many sentences at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from coastwatch.batches import Bools, Floats, Ints
from coastwatch.formats.intake.faults import Tally
from coastwatch.formats.nmea.sentences import CHECKSUM, HALF_A_LINE, ReceivedSentence

EMPTY = "empty payload"
LONE_PART = "lone part of a message"
UNDECODABLE = "undecodable"

FIELDS = 7  # of a sentence: tag, parts, part, message, channel, payload, fill bits with checksum
LONGEST_PAYLOAD = 200
LONGEST_SENTENCE = 256
"""Characters. NMEA 0183 says 82, but some loggers write a whole message into one: the payload above, and room for their own fields."""

LONGEST_CHANNEL, LONGEST_NUMBER = 4, 4  # characters: A, B, 1, 2 or the name of a channel, 2087; 0 to 9, by some gateways more
FILL_BITS = {str(k).encode(): k for k in range(6)}
PARTS = {str(k).encode(): k for k in range(1, 10)}
PART_LINES = 1000  # largest distance between the parts of one message
PART_SECONDS = 30.0  # and largest time between them
MOST_SLOTS = 1024  # kinds of messages of several parts whose station is remembered: number, channel, parts, VDM or VDO
HEX = np.array([int(chr(c), 16) if chr(c) in "0123456789abcdefABCDEF" else 256 for c in range(256)])


class Messages(NamedTuple):
    """Whole messages, in the order in which they were complete."""

    line: Ints  # of the first part
    stamp_s: Floats  # time of the message, or of the last clock sentence before it; NaN: none
    own: Bools  # of the own ship (VDO)
    payload: list[bytes]
    bits: Ints  # of the payload
    raw: list[bytes]  # the sentences
    by_clock: Bools  # the time is of a clock sentence
    sentences: Ints  # of the message


def messages_where(messages: Messages, keep: Bools) -> Messages:
    """The messages where a mask is true. Args: keep: (M,)."""
    if keep.all():
        return messages
    rows = np.flatnonzero(keep)
    some = rows.tolist()
    return Messages._make([c[row] for row in some] if isinstance(c, list) else c[rows] for c in messages)


class _Sentence(NamedTuple):
    """What a sentence says of its message."""

    parts: int  # of the message
    part: int
    fill_bits: int
    payload: bytes
    slot: tuple[bytes, ...]  # equal for the parts of a message


class _Open(NamedTuple):
    """A message of which parts are missing."""

    line: int
    own_s: float
    clock_s: float
    parts: dict[int, tuple[_Sentence, bytes]]


class Assembler:
    """Joins the sentences of a file to messages. It keeps open messages from one call to the next."""

    def __init__(self, name: str, tally: Tally) -> None:
        self._name, self._tally = name, tally
        self._open: dict[tuple[bytes, ...], _Open] = {}
        self._newest: dict[tuple[bytes, ...], bytes] = {}

    @property
    def waiting(self) -> int:
        """Sentences that wait for others of their messages."""
        return sum(len(message.parts) for message in self._open.values())

    def whole(self, sentences: Sequence[ReceivedSentence], last: bool) -> Messages:
        """The messages that these sentences complete. Other sentences are counted.

        Args: last: the file ends here, so open messages stay without their other parts.
        """
        line: list[int] = []
        stamp: list[float] = []
        own: list[bool] = []
        payload: list[bytes] = []
        bits: list[int] = []
        raws: list[bytes] = []
        by_clock: list[bool] = []
        count: list[int] = []
        for received, right in zip(sentences, checksums_are_right([s.sentence for s in sentences]).tolist(), strict=True):
            raw = received.sentence
            sentence = _parsed(raw)
            if sentence is None or not right or not sentence.payload:
                self._refuse(received, sentence, right)
                continue
            where, own_s, clock_s, text, fill_bits = received.line, received.own_s, received.clock_s, sentence.payload, 0
            if sentence.parts == 1:
                fill_bits = sentence.fill_bits
            else:
                joined = self._join(received, sentence)
                if joined is None:
                    continue
                parts = [joined.parts[k] for k in sorted(joined.parts)]
                where, own_s, clock_s = joined[:3]
                text, fill_bits = b"".join(part.payload for part, _ in parts), parts[-1][0].fill_bits
                raw = b"\n".join(whole for _, whole in parts)
            line.append(where)
            stamp.append(clock_s if math.isnan(own_s) else own_s)
            own.append(raw[3:6] == b"VDO")
            payload.append(text)
            bits.append(6 * len(text) - fill_bits)
            raws.append(raw)
            by_clock.append(math.isnan(own_s))
            count.append(sentence.parts)
        self._expire(math.inf if last else sentences[-1].line if sentences else -math.inf)
        return Messages(
            np.array(line, np.int64),
            np.array(stamp, np.float64),
            np.array(own, np.bool_),
            payload,
            np.array(bits, np.int64),
            raws,
            np.array(by_clock, np.bool_),
            np.array(count, np.int64),
        )

    def _refuse(self, received: ReceivedSentence, sentence: _Sentence | None, right: bool) -> None:
        raw = received.sentence
        kind = EMPTY if right else CHECKSUM
        if sentence is None:
            kind = HALF_A_LINE if len(raw) <= LONGEST_SENTENCE and raw.count(b",") < FIELDS - 1 else UNDECODABLE
        self._tally.add(kind, f"{self._name}:{received.line}", raw)

    def _join(self, at: ReceivedSentence, sentence: _Sentence) -> _Open | None:
        """The message that this part completes, if any. Parts that cannot belong to it are counted as lone."""
        if sentence.part == 1 or at.station:
            self._newest.pop(sentence.slot, None)
            self._newest[sentence.slot] = at.station
            if len(self._newest) > MOST_SLOTS:
                del self._newest[next(iter(self._newest))]
        slot = (*sentence.slot, self._newest.get(sentence.slot, b""))
        message = self._open.pop(slot, None)
        if message is not None and (
            sentence.part in message.parts
            or at.line - message.line > PART_LINES
            or abs(at.own_s - message.own_s) > PART_SECONDS
        ):
            self._count_lone(message)
            message = None
        if message is None:
            message = _Open(at.line, at.own_s, at.clock_s, {})
        message.parts[sentence.part] = sentence, at.sentence
        if math.isnan(message.own_s):
            message = message._replace(own_s=at.own_s)
        if len(message.parts) == sentence.parts:
            return message
        self._open[slot] = message
        return None

    def _expire(self, line: float) -> None:
        """Drop and count open messages that no later part can complete. Args: line: the newest one; infinite: the file ends here."""
        while self._open:
            slot, oldest = next(iter(self._open.items()))
            if line - oldest.line <= PART_LINES:
                return
            self._count_lone(self._open.pop(slot))

    def _count_lone(self, waiting: _Open) -> None:
        self._tally.add(LONE_PART, f"{self._name}:{waiting.line}", next(iter(waiting.parts.values()))[1], len(waiting.parts))


def _parsed(raw: bytes) -> _Sentence | None:
    """The fields of a sentence; None for one that has not its form (IEC 61162-1)."""
    if len(raw) > LONGEST_SENTENCE:
        return None
    fields = raw.split(b",")
    if len(fields) < FIELDS or not raw.isascii():
        return None
    tag, count, part, message, channel, payload = fields[:6]
    padding = fields[-1][:-3]
    counted, number, fill = PARTS.get(count), PARTS.get(part), FILL_BITS.get(padding, 0)
    if counted is None or number is None or number > counted or len(payload) > LONGEST_PAYLOAD:
        return None
    if len(message) > LONGEST_NUMBER or len(channel) > LONGEST_CHANNEL:
        return None
    if (message and not message.isdigit()) or (not fill and padding != b"0" and padding.isdigit()):
        return None
    return _Sentence(counted, number, fill, payload, (message, channel, count, tag[3:]) if counted > 1 else ())


def checksums_are_right(sentences: Sequence[bytes]) -> Bools:
    """Whether the two hexadecimal digits at the end of each sentence are the exclusive or of what is between ! and *. (M,)

    Args: sentences: each ends with * and two characters, and is at least six long.
    """
    if not sentences:
        return np.zeros(0, np.bool_)
    text = np.frombuffer(b"".join(sentences), np.uint8)
    end = np.cumsum(np.fromiter(map(len, sentences), np.int64, len(sentences)))
    start = np.concatenate([[0], end[:-1]])
    edges = np.stack([start + 1, end - 3], axis=-1).ravel()
    checksum = np.bitwise_xor.reduceat(text, edges)[::2]
    return np.asarray(checksum == 16 * HEX[text[end - 2]] + HEX[text[end - 1]])
