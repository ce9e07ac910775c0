"""Lines of a recording to sentences, each with when and by whom it was heard."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from coastwatch.sensors.faults import SET_ASIDE, Tally
from coastwatch.sensors.wire_time import behind_s, clock_s, pghp_s, sound, tag_block, written_s

HALF_A_LINE = "half a line"
NOT_A_SENTENCE = "not a sentence"
CHECKSUM = "checksum"
TAG_CHECKSUM = "tag block checksum"
TAG_CUT = "tag block without end"
PREFIX = "unreadable prefix"
OTHER_SENTENCE = SET_ASIDE + "other sentence"

REMEMBERED_GROUPS = 4096
AIS_SENTENCES = (b"VDM", b"VDO")
BACKSLASH, BANG = b"\\", b"!"
BARE = b"!$"  # a line that begins so has nothing ahead of its sentence


class Heard(NamedTuple):
    """One AIS sentence."""

    line: int
    sentence: bytes  # from the ! to the checksum
    own_s: float  # the time that came with it; NaN: none
    clock_s: float  # of the last clock sentence before it; NaN: none
    station: bytes  # source of the tag block or number of its group; empty: none


class _Ahead(NamedTuple):
    """What was said ahead of a sentence."""

    time_s: float = math.nan
    station: bytes = b""
    group: bytes = b""


def heard(lines: Iterable[bytes], name: str, tally: Tally) -> Iterator[Heard]:
    """The AIS sentences among the lines, in their order. Whatever else is there is counted.

    A $PGHP line, or a tag block alone on its line, belongs to the sentence that follows. A sentence of a group without
    a time of its own has that of the group.
    """
    clock = math.nan
    waiting = _Ahead()
    groups: dict[bytes, float] = {}
    for number, raw in enumerate(lines, 1):
        line = raw.strip()
        if not line or line[:1] == b"#":
            continue
        bare = line[0] in BARE
        ahead, rest = (waiting, line) if bare else _ahead(line, waiting, f"{name}:{number}", tally)
        if rest[:1] == b"$":
            waiting, clock = _dollar(rest, waiting, clock, f"{name}:{number}", tally)
            continue
        if not rest:
            waiting = ahead
            continue
        if rest[:1] != BANG or rest[3:6].upper() not in AIS_SENTENCES:
            tally.add(OTHER_SENTENCE if rest[:1] == BANG else NOT_A_SENTENCE, f"{name}:{number}", raw)
            continue
        star = rest.find(b"*")
        if star < 0 or len(rest) < star + 3:
            tally.add(HALF_A_LINE, f"{name}:{number}", raw)
            continue
        time_s = behind_s(rest[star + 3 :]) if len(rest) > star + 3 else math.nan
        time_s = ahead.time_s if math.isnan(time_s) else time_s
        if ahead.group:
            time_s = groups.get(ahead.group, math.nan) if math.isnan(time_s) else time_s
            groups[ahead.group] = time_s
            if len(groups) > REMEMBERED_GROUPS:
                del groups[next(iter(groups))]
        waiting = _Ahead()
        yield Heard(number, rest[: star + 3], time_s, clock, ahead.group or ahead.station)


def _ahead(line: bytes, waiting: _Ahead, where: str, tally: Tally) -> tuple[_Ahead, bytes]:
    """What stands before the sentence on its line, and the line from there."""
    time_s, station, group = waiting
    starts = [at for at in (line.find(BACKSLASH), line.find(BANG), line.find(b"$")) if at >= 0]
    begin = min(starts, default=len(line))
    if begin and starts:
        prefix_s = written_s(line[:begin])
        if math.isnan(prefix_s):
            tally.add(PREFIX, where, line)
        else:
            time_s = prefix_s
    rest = line[begin:] if starts else line
    while rest[:1] == BACKSLASH:
        end = rest.find(BACKSLASH, 1)
        if end < 0:
            tally.add(TAG_CUT, where, line)
            return _Ahead(time_s, station, group), b""
        right, tag_s, tag_station, tag_group = tag_block(rest[1:end])
        if not right:
            tally.add(TAG_CHECKSUM, where, line)
        time_s = time_s if math.isnan(tag_s) else tag_s
        station, group = tag_station or station, tag_group or group
        rest = rest[end + 1 :].lstrip()
    return _Ahead(time_s, station, group), rest


def _dollar(sentence: bytes, waiting: _Ahead, clock: float, where: str, tally: Tally) -> tuple[_Ahead, float]:
    """What waits for the next sentence, and the clock, after a sentence that begins with $."""
    gateway = sentence.startswith(b"$PGHP")
    said = pghp_s(sentence) if gateway else clock_s(sentence)
    if not math.isnan(said) and not sound(sentence):
        tally.add(CHECKSUM, where, sentence)
        said = math.nan
    elif gateway and math.isnan(said):
        tally.add(PREFIX, where, sentence)
    elif math.isnan(said):
        tally.add(OTHER_SENTENCE, where, sentence)
    if gateway:
        return _Ahead(said), clock
    return waiting, clock if math.isnan(said) else said
