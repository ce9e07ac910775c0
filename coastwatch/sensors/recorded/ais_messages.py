"""AIS sentences to decoded rows: joins the parts of a message and decodes its payload with pyais."""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from pyais.messages import AISSentence

from coastwatch.sensors.recorded.faults import SET_ASIDE, Tally
from coastwatch.sensors.recorded.nmea_sentences import CHECKSUM, HALF_A_LINE, ReceivedSentence

EMPTY = "empty payload"
LONE_PART = "lone part of a message"
UNDECODABLE = "undecodable"
CUT_PAYLOAD = "payload too short"
OTHER_MESSAGE = SET_ASIDE + "other message"
NO_VESSEL = {4: SET_ASIDE + "base station", 9: SET_ASIDE + "search and rescue aircraft", 21: SET_ASIDE + "aid to navigation"}

POSITION_BITS = {
    1: 143,
    2: 143,
    3: 143,
    18: 139,
    19: 139,
    27: 94,
}  # needed: up to the second, or the course if there is no second
STATIC_BITS = {5: 270, 19: 301, 24: 160}  # needed: up to the dimensions, or the name of part A
PART_LINES = 1000  # largest distance between the parts of one message
PART_SECONDS = 30.0  # and largest time between them
NAME_LENGTH, CALL_SIGN_LENGTH = 20, 7

PositionRow = tuple[int, int, int, int, float, float, float, float, bool, int]
"""Line, number of the message, UTC second, MMSI, latitude, longitude, SOG, COG, class B, digest."""

StaticRow = tuple[int, int, int, int, str, str, int, float, float]
"""Line, number of the message, digest, MMSI, name, call sign, type, length, beam."""


class Message(NamedTuple):
    """One whole message."""

    line: int
    own_s: float
    clock_s: float
    sentence: AISSentence


class _Part(NamedTuple):
    line: int
    own_s: float
    clock_s: float
    parts: dict[int, AISSentence]


def whole(sentences: Iterable[ReceivedSentence], name: str, tally: Tally) -> Iterator[Message]:
    """The messages in the sentences; a message in several parts follows its last part."""
    open_parts: dict[tuple[Any, ...], _Part] = {}
    newest: dict[tuple[Any, ...], bytes] = {}
    for line, raw, own_s, clock_s, station in sentences:
        try:
            sentence = AISSentence(raw)
        except Exception:  # a sentence that pyais cannot parse must not stop the feed
            tally.add(HALF_A_LINE if raw.count(b",") < 6 else UNDECODABLE, f"{name}:{line}", raw)
            continue
        if not sentence.is_valid:
            tally.add(CHECKSUM, f"{name}:{line}", raw)
        elif not sentence.payload:
            tally.add(EMPTY, f"{name}:{line}", raw)
        elif sentence.frag_cnt == 1:
            yield Message(line, own_s, clock_s, sentence)
        else:
            slot = (sentence.seq_id, sentence.channel, sentence.frag_cnt, sentence.type)
            if sentence.frag_num == 1 or station:
                newest[slot] = station
            joined = _join(
                open_parts,
                (*slot, newest.get(slot, b"")),
                ReceivedSentence(line, raw, own_s, clock_s, station),
                sentence,
                name,
                tally,
            )
            if joined is not None:
                yield joined
    for part in open_parts.values():
        _count_lone(part, name, tally)


def _join(
    open_parts: dict[tuple[Any, ...], _Part],
    slot: tuple[Any, ...],
    at: ReceivedSentence,
    sentence: AISSentence,
    name: str,
    tally: Tally,
) -> Message | None:
    """The message that this part completes, if any. Parts that cannot belong to it are counted as lone."""
    part = open_parts.pop(slot, None)
    if part is not None and (
        sentence.frag_num in part.parts or at.line - part.line > PART_LINES or abs(at.own_s - part.own_s) > PART_SECONDS
    ):
        _count_lone(part, name, tally)
        part = None
    if part is None:
        part = _Part(at.line, at.own_s, at.clock_s, {})
    part.parts[sentence.frag_num] = sentence
    if math.isnan(part.own_s):
        part = part._replace(own_s=at.own_s)
    if len(part.parts) < sentence.frag_cnt:
        open_parts[slot] = part
        return None
    joined = AISSentence.assemble_from_iterable([part.parts[k] for k in sorted(part.parts)])
    return Message(part.line, part.own_s, part.clock_s, joined)


def _count_lone(part: _Part, name: str, tally: Tally) -> None:
    tally.add(LONE_PART, f"{name}:{part.line}", next(iter(part.parts.values())).raw, len(part.parts))


def digest_of(payload: bytes) -> int:
    """A number that is equal for equal payloads, in every process."""
    return zlib.crc32(payload)


def rows_of(message: Message, number: int, name: str, tally: Tally) -> tuple[PositionRow | None, StaticRow | None]:
    """The position row and the static row of a message, None for either that it does not have. Other messages are counted."""
    line, sentence = message.line, message.sentence
    kind = sentence.ais_id
    if kind not in POSITION_BITS and kind not in STATIC_BITS:
        tally.add(NO_VESSEL.get(kind, OTHER_MESSAGE), f"{name}:{line}", sentence.raw)
        return None, None
    bits = len(sentence.bv)
    if bits < POSITION_BITS.get(kind, 0) or (kind != 19 and bits < STATIC_BITS.get(kind, 0)):
        tally.add(CUT_PAYLOAD, f"{name}:{line}", sentence.raw)
        return None, None
    try:
        fields: Any = sentence.decode()
    except Exception:  # a message that pyais cannot decode must not stop the feed
        tally.add(UNDECODABLE, f"{name}:{line}", sentence.raw)
        return None, None
    digest = digest_of(sentence.payload)
    position: PositionRow | None = None
    if kind in POSITION_BITS:
        second = -1 if kind == 27 else fields.second
        sog = fields.speed if kind != 27 or fields.speed < 63.0 else math.nan
        mmsi = int(fields.mmsi)
        position = (line, number, second, mmsi, fields.lat, fields.lon, sog, fields.course, kind in (18, 19), digest)
    static = _static(fields, line, number, digest) if bits >= STATIC_BITS.get(kind, bits + 1) else None
    return position, static


def _static(fields: Any, line: int, number: int, digest: int) -> StaticRow:
    length = (getattr(fields, "to_bow", 0) or 0) + (getattr(fields, "to_stern", 0) or 0)
    beam = (getattr(fields, "to_port", 0) or 0) + (getattr(fields, "to_starboard", 0) or 0)
    return (
        line,
        number,
        digest,
        int(fields.mmsi),
        _text(getattr(fields, "shipname", ""), NAME_LENGTH),
        _text(getattr(fields, "callsign", ""), CALL_SIGN_LENGTH),
        int(getattr(fields, "ship_type", 0) or 0) or -1,
        float(length) if length else math.nan,
        float(beam) if beam else math.nan,
    )


def _text(value: str | None, length: int) -> str:
    return (value or "").partition("@")[0].strip()[:length]
