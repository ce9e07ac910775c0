"""Sentences of raw NMEA made for tests, and files of them read back."""

from __future__ import annotations

import math
from pathlib import Path

from pyais import encode_dict

from coastwatch.batches import AisReports, AisStatics, Fault
from coastwatch.sensors.recorded.nmea.feed import Nmea

T0 = 1_357_134_218.0  # 2013-01-02 13:43:38 UTC
ASSUMED = "2013-01-02T00:00:00Z"
SOUND = "!AIVDM,1,1,,B,14pWHb?P03rwO<F:RQOnROw<25bd,0*3E"


def wire(said: dict[str, object], seq_id: int = 1) -> list[str]:
    """The sentences of a message."""
    return encode_dict(said, talker_id="AI", sentence_type="VDM", seq_id=seq_id)


def sentence(**said: object) -> list[str]:
    message = {"msg_type": 1, "mmsi": 257000000, "lat": 59.5, "lon": 10.5, "speed": 12.3, "course": 45.6, "second": 60} | said
    return wire(message)


def checked(body: str) -> str:
    value = 0
    for c in body:
        value ^= ord(c)
    return f"{value:02X}"


def with_sum(body: str) -> bytes:
    """A sentence that begins with a dollar."""
    return f"${body}*{checked(body)}".encode()


def tagged(tag: str, line: str) -> str:
    return f"\\{tag}*{checked(tag)}\\{line}"


def write(path: Path, lines: list[str]) -> Path:
    file = path / "feed.nmea"
    file.write_bytes("\r\n".join(lines).encode("latin-1") + b"\r\n")
    return file


def read(path: Path, lines: list[str], **more: object) -> tuple[AisReports, dict[str, Fault]]:
    reports, _, faults = read_all(Nmea(files=(write(path, lines),), **more))
    return reports, {f.kind: f for f in faults}


def read_all(feed: Nmea) -> tuple[AisReports, AisStatics, tuple[Fault, ...]]:
    """The whole stream of a feed, and its faults."""
    stream = feed.stream()
    reports = stream.between(-math.inf, math.inf)
    return reports.ais, reports.statics, stream.faults()
