"""The wire formats by name. A new one is a module and a name in this table."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

from coastwatch.batches import Sensors
from coastwatch.errors import AddressError
from coastwatch.formats.asterix.decoder import ASTERIX
from coastwatch.formats.asterix.video_feed import VIDEO
from coastwatch.formats.cot import COT
from coastwatch.formats.decoding import Decoder, FeedSettings, ReportsBetween
from coastwatch.formats.format import NAMED_BY_CODES, Format
from coastwatch.formats.json_lines import JSON
from coastwatch.formats.nmea.ais import AIS
from coastwatch.formats.nmea.headings import HEADING
from coastwatch.formats.nmea.targets import TLL, TTM
from coastwatch.spelling import did_you_mean

FORMATS: dict[str, Format] = {one.name: one for one in (AIS, ASTERIX, TTM, JSON, COT, TLL, VIDEO, HEADING)}
CODES = re.compile(r"\d+/\d+")
DECODED = tuple(name for name, one in FORMATS.items() if one.decoder is not None)
ENCODED = tuple(name for name, one in FORMATS.items() if one.encode is not None)
PICTURES = tuple(name for name, one in FORMATS.items() if one.pictures is not None)


def check_options(format_: str, text: str, options: Mapping[str, str], more: Sequence[str] = ()) -> None:
    """Refuses an option behind '?' of an address that its format does not take.

    Args: text: the address, as it was given; more: what its transport takes. Raises: AddressError that names those that are known.
    """
    known = ("name", *FORMATS[format_].options, *more)
    for key in options:
        if key not in known and not (NAMED_BY_CODES in known and CODES.fullmatch(key)):
            raise AddressError(
                f"feed: got the option {key} in {text!r}, needed one of {', '.join(known)}{did_you_mean(key, known)}"
            )


def decoders_of(
    feeds: Sequence[tuple[str, FeedSettings]], sensors: Sensors, first: int = 0
) -> tuple[list[Decoder], list[ReportsBetween]]:
    """A decoder of each feed, and what gives the reports of all of them, in order of the feeds.

    Args: feeds: the format of each, and what it is told; first: number of the first feed of each format. Raises: AddressError.
    """
    decoders: list[Decoder] = []
    rows: dict[str, list[int]] = {}
    for row, (name, settings) in enumerate(feeds):
        own, make = rows.setdefault(name, []), FORMATS[name].decoder
        if make is None:
            raise AddressError(f"feed: got {settings.text!r}, needed a format of {', '.join(DECODED)}")
        decoders.append(make(replace(settings, number=first + len(own)), sensors))
        own.append(row)
    sources: list[tuple[int, ReportsBetween]] = []
    for name, own in rows.items():
        of_format = FORMATS[name].report_sources([decoders[row] for row in own])
        sources += zip(own, of_format, strict=False)  # AIS has one source of all its feeds
    return decoders, [source for _, source in sorted(sources, key=lambda pair: pair[0])]
