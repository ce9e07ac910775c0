"""Lines of a recording to AIS sentences, each with its time and the station that received it."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

from coastwatch.formats.intake.faults import SET_ASIDE, Ledger, Tally
from coastwatch.formats.intake.timestamps import (
    checksum_is_right,
    clock_s,
    leading_time_s,
    pghp_s,
    tag_block,
    trailing_time_s,
)

HALF_A_LINE = "half a line"
NO_CHECKSUM = "without checksum"
NOT_A_SENTENCE = "not a sentence"
CHECKSUM = "checksum"
TAG_CHECKSUM = "tag block checksum"
TAG_CUT = "tag block without end"
PREFIX = "unreadable prefix"
OTHER_SENTENCE = SET_ASIDE + "other sentence"
OF_OTHERS = "times and tag blocks of other lines"
FURTHER = "further sentences of messages"
OF_OWN_SHIP = "position, motion and heading of own ship"

REMEMBERED_GROUPS = 4096
AIS_SENTENCES = (b"VDM", b"VDO")
COMMAS = {
    b"VDM": 6, b"VDO": 6, b"TTM": 13, b"TLL": 7, b"RMC": 11, b"GGA": 14, b"GLL": 6, b"VTG": 8, b"HDT": 2, b"THS": 2, b"OSD": 9,
}  # fmt: skip
"""Of a whole sentence, at least, by its formatter."""

BACKSLASH, BANG = b"\\", b"!"
BARE = b"!$"  # a line that starts with one of these has no prefix
TAGGED = re.compile(rb"\\([^\\]+)\\(![^*!$\\]{2}([A-Z]{3}),[^*\\]*\*..)", re.DOTALL)
"""The usual line: one tag block, then one sentence, and nothing after it."""

TIMES_OF_JSON = ("toa", "rxuxtime", "rxtime")
"""Of a message of AIS-catcher: as its source says, by its own clock as Unix time, and that as 20260714033320."""
MOST_PARTS, LONGEST_TIME = 9, 32  # sentences of one message; characters of its time


class ReceivedSentence(NamedTuple):
    """One AIS sentence of a recording."""

    line: int
    sentence: bytes  # from the ! to the checksum
    own_s: float  # time stamp of the sentence; NaN: none
    clock_s: float  # of the last clock sentence before it; NaN: none
    station: bytes  # source of the tag block or number of its group; empty: none


class _Prefix(NamedTuple):
    """Time, station and group before a sentence."""

    time_s: float = math.nan
    station: bytes = b""
    group: bytes = b""


NO_PREFIX = _Prefix()


@dataclass
class LinesBefore:
    """What the lines of a sender so far say of its next sentences, for lines that come in several calls."""

    clock_s: float = math.nan  # of the last clock sentence; NaN: none
    prefix: _Prefix = NO_PREFIX  # of lines that belong to the next sentence


def ais_sentences(
    lines: Iterable[bytes], name: str, tally: Tally, ledger: Ledger | None = None, before: LinesBefore | None = None
) -> Iterator[ReceivedSentence]:
    """As `wanted_sentences`, of AIS."""
    return wanted_sentences(lines, name, tally, AIS_SENTENCES, ledger, before)


def wanted_sentences(
    lines: Iterable[bytes],
    name: str,
    tally: Tally,
    wanted: tuple[bytes, ...],
    ledger: Ledger | None = None,
    before: LinesBefore | None = None,
) -> Iterator[ReceivedSentence]:
    """The sentences with these formatters among the lines, in order. Other lines are counted in the tally.

    A $PGHP line, or a tag block alone on its line, belongs to the next sentence. A sentence of a group without a time of
    its own takes that of the group.
    Args: ledger: counts the lines that are neither blank nor comments, and those of times and tag blocks among them; before: of
    the calls before, and brought up to date at the end of these lines.
    """
    ledger = Ledger() if ledger is None else ledger
    before = LinesBefore() if before is None else before
    clock, waiting = before.clock_s, before.prefix
    groups: dict[bytes, float] = {}
    for number, raw in _unwrapped(lines):
        line = raw.strip()
        if not line or line[:1] == b"#":
            continue
        ledger.read += 1
        usual = TAGGED.fullmatch(line) if waiting is NO_PREFIX else None
        if usual is not None:
            tag, sentence, formatter = usual.groups()
            right, time_s, station, group = tag_block(tag)
            if right and formatter in wanted and not group:
                yield ReceivedSentence(number, sentence, time_s, clock, station)
                continue
        bare = line[0] in BARE
        ahead, rest, is_cut = (waiting, line, False) if bare else _prefix(line, waiting, f"{name}:{number}", tally)
        if rest[:1] == b"$" and rest[3:6].upper() not in wanted:
            waiting, clock, is_used = _other_line(rest, waiting, clock, f"{name}:{number}", tally)
            ledger.beside[OF_OTHERS] += is_used
            continue
        if not rest:
            waiting = ahead
            ledger.beside[OF_OTHERS] += not is_cut
            continue
        if rest[:1] == b"$":
            stamp_s = clock_s(rest)
            clock = stamp_s if not math.isnan(stamp_s) and checksum_is_right(rest) else clock
        elif rest[:1] != BANG or rest[3:6].upper() not in wanted:
            tally.add(OTHER_SENTENCE if rest[:1] == BANG else NOT_A_SENTENCE, f"{name}:{number}", raw)
            continue
        star = rest.find(b"*")
        if star < 0 or len(rest) < star + 3:
            is_whole = star < 0 and rest.count(b",") >= COMMAS.get(rest[3:6].upper(), math.inf)
            tally.add(NO_CHECKSUM if is_whole else HALF_A_LINE, f"{name}:{number}", raw)
            continue
        time_s = trailing_time_s(rest[star + 3 :]) if len(rest) > star + 3 else math.nan
        time_s = ahead.time_s if math.isnan(time_s) else time_s
        if ahead.group:
            time_s = groups.get(ahead.group, math.nan) if math.isnan(time_s) else time_s
            groups[ahead.group] = time_s
            if len(groups) > REMEMBERED_GROUPS:
                del groups[next(iter(groups))]
        waiting = NO_PREFIX
        yield ReceivedSentence(number, rest[: star + 3], time_s, clock, ahead.group or ahead.station)
    before.clock_s, before.prefix = clock, waiting


def _unwrapped(lines: Iterable[bytes]) -> Iterator[tuple[int, bytes]]:
    """The lines with their numbers. A line of JSON becomes the sentences in it, each behind its time of reception."""
    for number, raw in enumerate(lines, 1):
        if raw[:1] != b"{":
            yield number, raw
            continue
        for sentence in _of_json(raw) or [raw]:
            yield number, sentence


def _of_json(line: bytes) -> list[bytes]:
    """The sentences of a message as AIS-catcher writes it, each behind its time of reception; none if it is not of that form."""
    try:
        message = json.loads(line)
    except (ValueError, RecursionError):
        return []
    sentences = message.get("nmea") if isinstance(message, dict) else None
    if not isinstance(sentences, list) or len(sentences) > MOST_PARTS:
        return []
    time = next((message[key] for key in TIMES_OF_JSON if message.get(key) is not None), "")
    before = str(time)[:LONGEST_TIME]
    return [f"{before} {text}".encode(errors="replace") for text in sentences if isinstance(text, str)]


def _prefix(line: bytes, waiting: _Prefix, where: str, tally: Tally) -> tuple[_Prefix, bytes, bool]:
    """The prefix of a sentence on its line, the rest of the line, and whether its tag block has no end."""
    time_s, station, group = waiting
    starts = [at for at in (line.find(BACKSLASH), line.find(BANG), line.find(b"$")) if at >= 0]
    begin = min(starts, default=len(line))
    if begin and starts:
        prefix_s = leading_time_s(line[:begin])
        if math.isnan(prefix_s):
            tally.add(PREFIX, where, line, used=True)
        else:
            time_s = prefix_s
    rest = line[begin:] if starts else line
    while rest[:1] == BACKSLASH:
        end = rest.find(BACKSLASH, 1)
        if end < 0:
            tally.add(TAG_CUT, where, line)
            return _Prefix(time_s, station, group), b"", True
        right, tag_s, tag_station, tag_group = tag_block(rest[1:end])
        if not right:
            tally.add(TAG_CHECKSUM, where, line, used=True)
        time_s = time_s if math.isnan(tag_s) else tag_s
        station, group = tag_station or station, tag_group or group
        rest = rest[end + 1 :].lstrip()
    return _Prefix(time_s, station, group), rest, False


def _other_line(sentence: bytes, waiting: _Prefix, clock: float, where: str, tally: Tally) -> tuple[_Prefix, float, bool]:
    """The prefix for the next sentence, and the clock, after a sentence that starts with $, and whether it is of these two."""
    gateway = sentence.startswith(b"$PGHP")
    time_s = pghp_s(sentence) if gateway else clock_s(sentence)
    is_used = True
    if not math.isnan(time_s) and not checksum_is_right(sentence):
        tally.add(CHECKSUM, where, sentence)
        time_s, is_used = math.nan, False
    elif gateway and math.isnan(time_s):
        tally.add(PREFIX, where, sentence, used=True)
    elif math.isnan(time_s):
        tally.add(OTHER_SENTENCE, where, sentence)
        is_used = False
    if gateway:
        return _Prefix(time_s), clock, is_used
    return waiting, clock if math.isnan(time_s) else time_s, is_used
