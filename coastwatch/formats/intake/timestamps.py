"""Time stamps in recordings of NMEA 0183: before a sentence, after it, in tag blocks and in clock sentences."""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime
from functools import lru_cache, reduce
from operator import xor

MILLISECONDS_FROM, MICROSECONDS_FROM, NANOSECONDS_FROM = 1e11, 1e14, 1e17
"""A Unix time this large is in a smaller unit: in seconds it would be after the year 5000."""

LEAST_UNIX_S = 1e8
"""Of a time before a sentence: a smaller number, as of a line, is no Unix time. It is of 1973."""

NUMBER = re.compile(rb"\+?\d+(?:\.\d*)?(?:[eE]\+?\d+)?(?=[\s,;:|\])]|$)")
COMPACT = re.compile(rb"(?:19|20|21)\d{12}")
BEHIND = re.compile(rb"(?:^|[,;\s])(\d{9,10}(?:\.\d+)?|\d{13}|" + COMPACT.pattern + rb")\s*$")
WRITTEN = re.compile(
    rb"(\d{4}[-/]\d\d[-/]\d\d|\d{8})(?:[Tt_-]|[\s,;]+)"
    rb"(\d\d:\d\d(?::\d\d(?:\.\d+|,\d{3}(?!\d))?)?|\d{6})(?![\d.]|:\d)"
    rb"([+-]\d\d(?!\d)| ?(?:Z|[+-]\d\d:?\d\d|UTC|GMT|[AP]M|[A-Z]{1,4}T))?(?![A-Za-z\d])"
)
"""A date, a time of day, and a zone if there is one: an offset, or a name."""

WRITTEN_BEHIND = re.compile(rb"(?:^|[,;\s])" + WRITTEN.pattern + rb"\s*$")
UTC_NAMES = ("Z", "UTC", "GMT")
GROUP = re.compile(rb"(\d+)G(\d+):(\d+)")
LONGEST_TAG = 256
"""Characters of a tag block. NMEA 0183 says 80, and some loggers write a little more. What it says is remembered."""

USUAL_TAG = re.compile(rb"(?:g:\d+-\d+-(\d+),)?s:([^,:*]*),c:(\d{9,10})\*([0-9A-Fa-f]{2})")


DAY_S = 86_400.0


def nearest_s(of_day_s: float, about_s: float) -> float:
    """The instant nearest to another one at this time of day, UTC. Its last bits do not depend on the other one."""
    return round((about_s - of_day_s) / DAY_S) * DAY_S + of_day_s


def unix_s(number: float) -> float:
    """Seconds, from a Unix time in seconds, milliseconds, microseconds or nanoseconds."""
    for limit, divisor in ((NANOSECONDS_FROM, 1e9), (MICROSECONDS_FROM, 1e6), (MILLISECONDS_FROM, 1e3)):
        if abs(number) >= limit:
            return number / divisor
    return number


def _date_s(*fields: int) -> float:
    try:
        return datetime(*fields, tzinfo=UTC).timestamp()  # type: ignore[misc,arg-type]
    except (ValueError, OverflowError):
        return math.nan


def leading_time_s(text: bytes) -> float:
    """The time at the start of a text: a Unix time, 20260714033320, or a date and a time. UTC if it has no zone; NaN: there is none."""
    begin = text.lstrip(b" \t,;[](){}")
    if written := WRITTEN.match(begin):
        return _written_s(written)
    if (number := NUMBER.match(begin)) is None:
        return math.nan
    time_s = _compact_s(number[0]) if COMPACT.fullmatch(number[0]) else unix_s(float(number[0]))
    return time_s if time_s >= LEAST_UNIX_S else math.nan


def trailing_time_s(text: bytes) -> float:
    """The time at the end of the text after a checksum, as of `leading_time_s`; NaN if there is none."""
    if written := WRITTEN_BEHIND.search(text):
        return _written_s(written)
    if (match := BEHIND.search(text)) is None:
        return math.nan
    return _compact_s(match[1]) if COMPACT.fullmatch(match[1]) else unix_s(float(match[1]))


def _compact_s(digits: bytes) -> float:
    """The time of 20260714033320, UTC; NaN of other digits."""
    text = digits.decode("ascii")
    return _date_s(int(text[:4]), *(int(text[k : k + 2]) for k in range(4, 14, 2)))


def _written_s(match: re.Match[bytes]) -> float:
    """The time of a match of WRITTEN; NaN if there is no such day, or behind it is AM, PM or a zone by name."""
    date, clock, zone = (part.decode("ascii").strip() for part in match.groups(b""))
    if zone.isalpha():
        if zone not in UTC_NAMES:
            return math.nan
        zone = "+00:00"
    try:
        return datetime.fromisoformat(f"{date.replace('/', '-')}T{clock.replace(',', '.')}{zone or '+00:00'}").timestamp()
    except ValueError:
        return math.nan


def pghp_s(sentence: bytes) -> float:
    """The time of a `$PGHP,1,year,month,day,hour,minute,second,millisecond,...` sentence; NaN if it has none."""
    fields = sentence.split(b",")
    try:
        numbers = [int(f) for f in fields[2:9]]
    except ValueError:
        return math.nan
    return _date_s(*numbers[:6], numbers[6] * 1000) if len(numbers) == 7 else math.nan


def clock_s(sentence: bytes) -> float:
    """The time of a ZDA or a valid RMC sentence of any talker; NaN for other sentences."""
    fields = sentence.split(b"*")[0].split(b",")
    kind = fields[0][3:]
    try:
        if kind == b"ZDA":
            day, month, year = (int(f) for f in fields[2:5])
        elif kind == b"RMC" and fields[2] == b"A":
            day, month, year = (int(fields[9][k : k + 2]) for k in (0, 2, 4))
        else:
            return math.nan
        second = float(fields[1][4:])
        whole = _date_s(year + 2000 if year < 100 else year, month, day, int(fields[1][:2]), int(fields[1][2:4]))
    except (ValueError, IndexError):
        return math.nan
    return whole + second


def tag_block(text: bytes) -> tuple[bool, float, bytes, bytes]:
    """Whether the checksum of a tag block is correct, its time (NaN: none), its station and its group (empty: none).

    One that is too long is as one with a wrong checksum: nothing of it is used.
    """
    return _tag_block(text) if len(text) <= LONGEST_TAG else (False, math.nan, b"", b"")


@lru_cache(maxsize=4096)
def _tag_block(text: bytes) -> tuple[bool, float, bytes, bytes]:
    usual = USUAL_TAG.fullmatch(text)
    if usual is not None and checksum(text[:-3]) == int(usual[4], 16):
        return True, float(usual[3]), usual[2], usual[1] or b""
    body, star, digits = text.rpartition(b"*")
    right = bool(star) and digits.strip().upper() == f"{checksum(body):02X}".encode()
    time_s, station, group = math.nan, b"", b""
    for item in body.split(b",") if right else ():
        key, _, value = item.partition(b":")
        old = GROUP.fullmatch(item)
        if old is not None:
            group = old[3]
        elif key == b"g":
            group = value.rpartition(b"-")[2]
        elif key == b"s":
            station = value
        elif key == b"c":
            try:
                time_s = unix_s(float(value))
            except ValueError:
                time_s = math.nan
    return right, time_s, station, group


def checksum_is_right(sentence: bytes) -> bool:
    """Whether the checksum of a sentence is correct or absent."""
    body, star, digits = sentence.partition(b"*")
    return not star or digits[:2].upper() == f"{checksum(body[1:]):02X}".encode()


def checksum(body: bytes) -> int:
    """The exclusive or of all bytes."""
    return reduce(xor, body, 0)
