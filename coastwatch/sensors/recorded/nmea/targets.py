"""NMEA 0183 sentences of tracked targets, TTM and TLL, to track reports, with the position and heading of the radar's own ship."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pynmeagps import NMEAParseError, NMEAReader

from coastwatch.batches import FileContent, Floats, TrackReports, TrackSources
from coastwatch.formats.intake.ais_validation import HIGHEST_LATITUDE, LATITUDE, LONGITUDE, AisIntake
from coastwatch.formats.intake.faults import SET_ASIDE, Ledger, Tally
from coastwatch.formats.intake.reception_time import LATE, reception_times
from coastwatch.formats.nmea.messages import UNDECODABLE
from coastwatch.formats.nmea.sentences import CHECKSUM, wanted_sentences
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M, offset_deg
from coastwatch.sensors.recorded.merging import TIME_MISSING
from coastwatch.sensors.recorded.nmea.feed import lines_of

TARGETS = (b"TTM", b"TLL")
OWN_SHIP = (b"RMC", b"GGA", b"GLL", b"VTG", b"HDT", b"THS", b"OSD")
NO_OWN_SHIP = "no position or heading of own ship"
LOST = SET_ASIDE + "target lost"
ACQUIRED = SET_ASIDE + "target in acquisition"
NO_TARGET = "target without position"
OF_OWN_SHIP = "position, motion and heading of own ship"

METRES = {"N": NAUTICAL_MILE_M, "K": 1000.0, "S": 1609.344}
METRES_PER_SECOND = {"N": KNOT_M_S, "K": 1.0 / 3.6, "S": 1609.344 / 3600.0}
OLDEST_S = 30.0  # position or heading of own ship
DAY_S = 86_400.0

State = tuple[int, float, float, float, float, float, float]
"""Number, time of the state, of reception, latitude, longitude, velocity to the east and to the north."""


@dataclass
class _OwnShip:
    """The newest position, motion and heading of the radar, NaN where unknown; a fixed radar has them for all time."""

    latitude: float
    longitude: float
    heading_deg: float
    east_m_s: float = 0.0
    north_m_s: float = 0.0
    position_s: float = math.inf
    heading_s: float = math.inf

    def update(self, said: Any, kind: bytes, time_s: float) -> None:
        """Take what a sentence says of the own ship."""
        if kind in (b"RMC", b"GGA", b"GLL") and _known(said, "lat", "lon") and getattr(said, "status", "A") != "V":
            self.latitude, self.longitude, self.position_s = said.lat, said.lon, time_s
        if kind == b"RMC" and _known(said, "spd", "cog"):
            self._move(said.spd * KNOT_M_S, said.cog)
        if kind == b"VTG" and _known(said, "sogn", "cogt"):
            self._move(said.sogn * KNOT_M_S, said.cogt)
        name = {b"HDT": "headingT", b"THS": "headt", b"OSD": "hdg"}.get(kind, "")
        if name and _known(said, name):
            self.heading_deg, self.heading_s = getattr(said, name), time_s

    def _move(self, speed_m_s: float, course_deg: float) -> None:
        self.east_m_s, self.north_m_s = _vector(speed_m_s, course_deg)

    def at(self, time_s: float) -> tuple[float, float, float]:
        """Latitude, longitude and heading at a time, NaN where they are unknown or older than OLDEST_S."""
        place = (self.latitude, self.longitude) if time_s - self.position_s <= OLDEST_S else (math.nan, math.nan)
        return *place, self.heading_deg if time_s - self.heading_s <= OLDEST_S else math.nan


def target_reports(
    path: Path, source: int, sources: TrackSources, assumed_s: float, intake: AisIntake, tally: Tally
) -> TrackReports:
    """The states of all targets in a file of sentences, in order of arrival. Other sentences are counted in the tally.

    Args: source: index of the track source that the file is of; assumed_s: a time near the first sentence, for sentences with a
    time of day and no date; NaN: none.
    Raises: OSError that names the file.
    """
    targets = TargetSentences(sources.site_deg[source], float(sources.heading_deg[source]), assumed_s, tally)
    states: list[State] = []
    lines: list[int] = []
    ledger = Ledger()
    for received in wanted_sentences(lines_of(path, tally), path.name, tally, TARGETS + OWN_SHIP, ledger):
        clock_s = received.clock_s if math.isnan(received.own_s) else received.own_s
        state = targets.state(received.sentence, clock_s, f"{path.name}:{received.line}")
        if state is not None:
            states.append(state)
            lines.append(received.line)
    ledger.beside[OF_OWN_SHIP] += targets.of_own_ship
    return _in_order(states, lines, source, path.name, intake, tally, ledger)


class TargetSentences:
    """Sentences of one radar, one after the other, to states of its targets; what cannot be used is counted."""

    def __init__(self, site_deg: Floats, heading_deg: float, assumed_s: float, tally: Tally) -> None:
        """Args: site_deg: (2,) of a radar that does not move, NaN: unknown; heading_deg: its; assumed_s: as of `target_reports`."""
        fixed = bool(np.isfinite(site_deg).all())
        self._own = _OwnShip(float(site_deg[0]), float(site_deg[1]), heading_deg if fixed else math.nan)
        self._assumed_s, self._tally = assumed_s, tally
        self.of_own_ship = 0  # sentences so far

    def state(self, sentence: bytes, clock_s: float, where: str) -> State | None:
        """The state that a sentence of TARGETS holds; None: it has none, or is of the own ship.

        Args: clock_s: time of the sentence; NaN: unknown; where: of the sentence, for the tally.
        """
        try:
            return self._state(sentence, clock_s, where)
        except Exception:  # whatever an odd field leads to: a sentence must not stop the feed
            self._tally.add(UNDECODABLE, where, sentence)
            return None

    def _state(self, sentence: bytes, clock_s: float, where: str) -> State | None:
        kind = sentence[3:6].upper()
        said = self._parsed(sentence, where)
        if said is None:
            return None
        if math.isnan(clock_s) and not math.isnan(self._assumed_s):
            clock_s = self._assumed_s = _time_s(getattr(said, "time", None), self._assumed_s)
        if kind in OWN_SHIP:
            self._own.update(said, kind, clock_s)
            self.of_own_ship += 1
            return None
        if math.isnan(clock_s):
            self._tally.add(TIME_MISSING, where, sentence)
            return None
        state, refused = _state(said, kind, clock_s, self._own)
        if state is None:
            self._tally.add(refused, where, sentence)
        return state

    def _parsed(self, sentence: bytes, where: str) -> Any:
        """What pynmeagps makes of a sentence; None: nothing."""
        said: Any = None
        fault = UNDECODABLE
        try:
            said = NMEAReader.parse(sentence)
        except NMEAParseError as error:
            fault = CHECKSUM if "checksum" in str(error) else UNDECODABLE
        except Exception:  # a sentence that pynmeagps cannot parse must not stop the feed
            said = None
        if said is None:
            self._tally.add(fault, where, sentence)
        return said


def _state(said: Any, kind: bytes, clock_s: float, own: _OwnShip) -> tuple[State | None, str]:
    """The state of a target, or None and the kind of fault."""
    status = getattr(said, "targetstatus", None) if kind == b"TTM" else getattr(said, "status", None)
    if status in ("L", "Q"):
        return None, LOST if status == "L" else ACQUIRED
    needed = ("targetnum", "targetdist", "targetbearing") if kind == b"TTM" else ("targetnum", "targetlat", "targetlon")
    if not _known(said, *needed):
        return None, NO_TARGET
    time_s = _time_s(getattr(said, "time", None), clock_s)
    velocity = (math.nan, math.nan)
    if kind == b"TLL":
        latitude = _signed(said.targetlat, getattr(said, "targetlatNS", "N"), "S")  # pynmeagps gives both without a sign
        longitude = _signed(said.targetlon, getattr(said, "targetlonEW", "E"), "W")
    else:
        own_latitude, own_longitude, heading = own.at(clock_s)
        relative = getattr(said, "targetbearingu", "T") == "R"
        bearing = said.targetbearing + (heading if relative else 0.0)
        if math.isnan(own_latitude) or math.isnan(bearing):
            return None, NO_OWN_SHIP
        distance = said.targetdist * METRES.get(getattr(said, "speedu", "N"), NAUTICAL_MILE_M)
        place = offset_deg(np.array([own_latitude, own_longitude]), np.array(_vector(distance, bearing)))
        latitude, longitude = float(place[0]), float(place[1])
        velocity = _velocity(said, heading, own)
    if not abs(latitude) <= HIGHEST_LATITUDE:
        return None, LATITUDE
    if not abs(longitude) <= 180.0:
        return None, LONGITUDE
    return (int(said.targetnum), min(time_s, clock_s), clock_s, latitude, longitude, *velocity), ""


def _signed(degrees: float, side: str, negative: str) -> float:
    """Degrees with their sign. Args: negative: the side on which they are negative."""
    return -abs(degrees) if side == negative else degrees


def _velocity(said: Any, heading: float, own: _OwnShip) -> tuple[float, float]:
    """East and north of a TTM target. A relative one is against the own ship, and its course is from the bow."""
    if not _known(said, "targetspeed", "targetcourse"):
        return math.nan, math.nan
    speed = said.targetspeed * METRES_PER_SECOND.get(getattr(said, "speedu", "N"), KNOT_M_S)
    if getattr(said, "targetcourseu", "T") != "R":
        return _vector(speed, said.targetcourse)
    east, north = _vector(speed, said.targetcourse + heading)
    return east + own.east_m_s, north + own.north_m_s


def _vector(length: float, bearing_deg: float) -> tuple[float, float]:
    """East and north."""
    return length * math.sin(math.radians(bearing_deg)), length * math.cos(math.radians(bearing_deg))


def _known(said: Any, *names: str) -> bool:
    """Whether fields are there and finite numbers."""
    found = (getattr(said, name, None) for name in names)
    return all(isinstance(value, int | float) and math.isfinite(value) for value in found)


def _time_s(of_day: Any, clock_s: float) -> float:
    """The instant nearest to the clock that has this time of day; the clock without a time of day."""
    if not hasattr(of_day, "hour"):
        return clock_s
    second: float = 3600 * of_day.hour + 60 * of_day.minute + of_day.second + 1e-6 * of_day.microsecond
    return clock_s + (second - clock_s + 0.5 * DAY_S) % DAY_S - 0.5 * DAY_S


def _in_order(
    states: list[State], lines: list[int], source: int, name: str, intake: AisIntake, tally: Tally, ledger: Ledger
) -> TrackReports:
    table = np.array(states, np.float64).reshape(-1, 7)
    times = reception_times(table[:, 2], intake.lateness_s, intake.longest_silence_s)
    for kind, mask in times.faults.items():
        tally.add_rows(kind, mask, lambda i: f"{name}:{lines[i]}", lambda i: "", used=kind == LATE)
    table, received_s = table[times.accepted], times.received_s[times.accepted]
    span = (float(table[:, 1].min()), float(table[:, 1].max())) if len(table) else (math.nan, math.nan)
    beside = tuple(ledger.beside.items())
    tally.add_file(FileContent(name, "track states", len(table), *span, read=ledger.read, beside=beside))
    return TrackReports(
        sensor=np.full(len(table), source, np.int64),
        number=table[:, 0].astype(np.int64),
        time_s=table[:, 1].copy(),
        received_s=received_s,
        position_deg=table[:, 3:5].copy(),
        velocity_m_s=table[:, 5:7].copy(),
        covariance=np.full((len(table), 4, 4), np.nan),
        origin=np.full(len(table), -1, np.int64),
    )


def target_times(path: Path, assumed_s: float, intake: AisIntake, tally: Tally) -> Floats:
    """Reception times of the targets in a file."""
    stamps: list[float] = []
    for received in wanted_sentences(lines_of(path, Tally()), path.name, Tally(), TARGETS):
        clock_s = received.clock_s if math.isnan(received.own_s) else received.own_s
        if math.isnan(clock_s) and not math.isnan(assumed_s):
            with suppress(Exception):  # counted when the file is read
                clock_s = assumed_s = _time_s(getattr(NMEAReader.parse(received.sentence), "time", None), assumed_s)
        stamps.append(clock_s)
    found = np.array([s for s in stamps if not math.isnan(s)], np.float64)
    if len(found) < len(stamps):
        tally.add(TIME_MISSING, path.name, count=len(stamps) - len(found))
    return reception_times(found, intake.lateness_s, intake.longest_silence_s).received_s
