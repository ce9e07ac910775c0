"""Headings of ships and platforms with a radar that counts azimuths from the bow: HDT and THS."""

from __future__ import annotations

import math

import numpy as np

from coastwatch.batches import AzimuthReference, HeadingReports, Ints, Radars, Reports, Sensors
from coastwatch.errors import AddressError
from coastwatch.formats.decoding import Counts, FeedSettings, Item, Stamps, Waiting
from coastwatch.formats.format import Format, rounded_deg
from coastwatch.formats.intake.faults import Tally
from coastwatch.formats.nmea.sentence_feed import SentenceFeed, has_numbers, made_sentence, parsed_sentence

FIELDS = {b"HDT": "headingT", b"THS": "headt"}
"""The field of the heading, by formatter."""

NOT_VALID = "heading that is not valid"
VALID_MODES = "A", "E"
"""Of THS: autonomous, estimated. Not manual, simulated or invalid."""


class HeadingDecoder:
    """The sentences of one compass, to the headings of radars."""

    has_dates = True

    def __init__(self, feed: FeedSettings, sensors: Sensors) -> None:
        """Raises: AddressError."""
        self.tally, self.counts, self.checked = Tally(), Counts(), feed.checked
        self.stamps = Stamps(feed.name, feed.checked, self.tally)
        self._radars = _radars_of(feed, sensors.radars)
        self._cut = SentenceFeed(feed.name, tuple(FIELDS), self.tally, self.counts.ledger)
        self._waiting = Waiting(self.counts, self.tally, "headings")
        self.reports_between = self._waiting.reports_between

    @property
    def waiting(self) -> int:
        """As of `Decoder`."""
        return self._waiting.rows // len(self._radars)

    def decode(self, items: list[Item], reference_s: float | None) -> None:
        """As of `Decoder`. A sentence without a time has that of its arrival."""
        found: list[tuple[float, float, float]] = []
        for fed in self._cut.sentences(items):
            message = parsed_sentence(fed.sentence, fed.where, self.tally)
            if message is None:
                continue
            name = FIELDS[fed.sentence[3:6].upper()]
            if not has_numbers(message, name) or getattr(message, "mi", "A") not in VALID_MODES:
                self.tally.add(NOT_VALID, fed.where, fed.sentence)
                continue
            found.append((fed.time_s, fed.arrived_s, getattr(message, name)))
        if not found:
            return
        table = np.array(found)
        time_s = self.stamps.times_s(table[:, 0], table[:, 1])
        usable, count = np.isfinite(time_s), len(self._radars)
        time_s = np.repeat(time_s[usable], count)
        sensor = np.tile(self._radars, int(usable.sum()))
        self._waiting.add("headings", HeadingReports(sensor, time_s, time_s, np.repeat(table[usable, 2], count)))


def _radars_of(feed: FeedSettings, radars: Radars) -> Ints:
    """The radars in `?radar=NAME,NAME`; without it all that count azimuths from the bow. Raises: AddressError: there is none."""
    by_heading = np.flatnonzero(radars.azimuth_reference == AzimuthReference.HEADING)
    known = {str(radars.name[k]): k for k in by_heading.tolist()}
    named = feed.options["radar"].split(",") if "radar" in feed.options else list(known)
    if not named or not set(named) <= known.keys():
        raise AddressError(
            f"feed: got {feed.text!r}, needed ?radar=NAME with radars of azimuth_reference = 'heading', of "
            f"{', '.join(known) or 'none'}"
        )
    return np.array(sorted({known[name] for name in named}), np.int64)


def encode(reports: Reports, sensors: Sensors) -> list[bytes]:
    """HDT sentences, each after a tag block with its time, and the radar as its source."""
    headings, radar = reports.headings, sensors.radars.name
    lines = []
    for k, time_s, heading in zip(
        headings.sensor.tolist(), headings.time_s.tolist(), headings.heading_deg.tolist(), strict=True
    ):
        source = "".join(c for c in str(radar[k]) if c.isalnum())[:15]
        tag = made_sentence(f"s:{source},c:{math.floor(1000.0 * time_s + 0.5)}", "\\")
        lines.append(f"{tag}\\{made_sentence(f'HEHDT,{rounded_deg(heading, 2):.2f},T')}".encode())
    return lines


HEADING = Format(
    "heading",
    decoder=HeadingDecoder,
    encode=encode,
    encodes=("headings",),
    options=("radar",),
)
