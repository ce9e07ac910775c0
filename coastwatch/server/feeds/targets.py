"""Sentences of tracked targets, TTM and TLL, of a live feed to reports of a track source."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from coastwatch.batches import Floats, Reports, TrackReports, TrackSources
from coastwatch.formats.intake.faults import Tally
from coastwatch.formats.nmea.sentences import wanted_sentences
from coastwatch.sensors.recorded.nmea.targets import OWN_SHIP, TARGETS, State, TargetSentences
from coastwatch.server.feeds.address import Address, AddressError
from coastwatch.server.feeds.decoding import Counts, Stamps, Waiting
from coastwatch.server.feeds.transport import Item

MOST_AHEAD = 16
"""Lines at the end of what came that may belong to the next sentence."""

AHEAD = b"$PGHP", b"\\"
"""Beginnings of lines that may belong to the next sentence."""


class TargetDecoder:
    """The sentences of one radar. Its position is that of the own ship's sentences, of `?site=LAT,LON` or of the track source."""

    def __init__(self, address: Address, sources: TrackSources, checked: bool = True) -> None:
        """Args: checked: stamps are judged by the clock of the machine. Raises: AddressError."""
        self.tally, self.counts = Tally(), Counts()
        self.checked = checked
        self.stamps = Stamps(address.name, checked, self.tally)
        self._name = address.name
        self._source = source_of(address, sources)
        site = site_of(address)
        of_source = sources.site_deg[self._source]
        heading = float(sources.heading_deg[self._source])
        self._targets = TargetSentences(of_source if site is None else site, heading, math.nan, self.tally)
        self._waiting = Waiting(self.counts, self.tally, TrackReports, ("sensor", "number", "position_deg"))
        self._before: list[Item] = []  # the last clock sentence, and lines that belong to the next sentence

    def take(self, items: list[Item], reference_s: float | None) -> None:
        """As of `Decoder`. A sentence without a time has that of its arrival."""
        items = [*self._before, *items]
        ahead = len(items)
        while (
            ahead
            and len(items) - ahead < MOST_AHEAD
            and items[ahead - 1][1].strip().startswith(AHEAD)
            and b"*" not in items[ahead - 1][1].rpartition(b"\\")[2]
        ):
            ahead -= 1
        items, waiting = items[:ahead], items[ahead:]
        self._before = [*[item for item in items if item[1][3:6] in (b"ZDA", b"RMC")][-1:], *waiting]
        lines = [line for _, line, _ in items]
        states: list[State] = []
        arrived: list[float] = []
        for found in wanted_sentences(lines, self._name, self.tally, TARGETS + OWN_SHIP):
            when = items[found.line - 1][0]
            stamps = (s for s in (found.own_s, found.clock_s, when) if not math.isnan(s))
            state = self._targets.state(found.sentence, next(stamps), self._name)
            if state is not None:
                states.append(state)
                arrived.append(when)
        if states:
            self._add(np.array(states, np.float64), np.array(arrived))

    def _add(self, table: Floats, arrived_s: Floats) -> None:
        """Keep states until their cycle. Args: table: (M, 7) of `State`."""
        time_s = self.stamps.times_s(table[:, 1], arrived_s)
        usable = np.isfinite(time_s)
        time_s, table = time_s[usable], table[usable]
        self._waiting.add(track_reports(self._source, table[:, 0].astype(np.int64), time_s, table[:, 3:5], table[:, 5:7]))

    def cut(self, after_s: float, until_s: float) -> Reports:
        """As `Cut`."""
        return replace(Reports.empty(), tracks=self._waiting.cut(after_s, until_s))


def source_of(address: Address, sources: TrackSources) -> int:
    """The number of the track source of a feed. Raises: AddressError."""
    names = [str(name) for name in sources.name]
    if address.source not in names:
        raise AddressError(
            f"feed: got {address.text!r}, needed ?source=NAME with a track source of {', '.join(names) or 'none'}"
        )
    return names.index(address.source)


def site_of(address: Address) -> Floats | None:
    """The position in `?site=LAT,LON`; None: there is none. Raises: AddressError."""
    text = address.options.get("site")
    if text is None:
        return None
    try:
        latitude, longitude = (float(part) for part in text.split(","))
    except ValueError:
        latitude = longitude = math.nan
    if not (abs(latitude) < 85.0 and abs(longitude) <= 180.0):
        raise AddressError(f"feed: got site={text} in {address.text!r}, needed LAT,LON in degrees, e.g. site=50.795,-1.105")
    return np.array([latitude, longitude])


def track_reports(
    source: int, number: object, time_s: Floats, position_deg: Floats, velocity_m_s: Floats, covariance: Floats | None = None
) -> TrackReports:
    """States of tracks of one source. Args: number: (M,) int64; covariance: (M, 4, 4); none: not given."""
    n = len(time_s)
    return TrackReports(
        sensor=np.full(n, source, np.int64),
        number=np.asarray(number, np.int64),
        time_s=time_s,
        received_s=time_s,
        position_deg=position_deg.copy(),
        velocity_m_s=velocity_m_s.copy(),
        covariance=np.full((n, 4, 4), np.nan) if covariance is None else covariance,
        origin=np.full(n, -1, np.int64),
    )
