"""Sentences of tracked targets, TTM and TLL, to track reports, with the position and heading of the radar's own ship."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from coastwatch.batches import Floats, Sensors, TrackSources
from coastwatch.batches.limits import HIGHEST_LATITUDE_DEG
from coastwatch.errors import AddressError
from coastwatch.formats.decoding import Counts, FeedSettings, Item, Stamps, Waiting, track_reports
from coastwatch.formats.format import Format, OutSettings, Vessels, parsed_site, rounded_deg
from coastwatch.formats.intake.ais_validation import LATITUDE, LONGITUDE
from coastwatch.formats.intake.faults import SET_ASIDE, Tally
from coastwatch.formats.intake.reception_time import TIME_MISSING
from coastwatch.formats.intake.timestamps import nearest_s
from coastwatch.formats.nmea.messages import UNDECODABLE
from coastwatch.formats.nmea.sentence_feed import SentenceFeed, has_numbers, made_sentence, parsed_sentence
from coastwatch.formats.nmea.sentences import OF_OWN_SHIP
from coastwatch.formats.target_numbers import TargetNumbers
from coastwatch.geodesy import KNOT_M_S, NAUTICAL_MILE_M, difference_m, offset_deg

TARGETS = (b"TTM", b"TLL")
OWN_SHIP = (b"RMC", b"GGA", b"GLL", b"VTG", b"HDT", b"THS", b"OSD")
NO_OWN_SHIP = "no position or heading of own ship"
LOST = SET_ASIDE + "target lost"
ACQUIRED = SET_ASIDE + "target in acquisition"
NO_TARGET = "target without position"

METRES = {"N": NAUTICAL_MILE_M, "K": 1000.0, "S": 1609.344}
METRES_PER_SECOND = {"N": KNOT_M_S, "K": 1.0 / 3.6, "S": 1609.344 / 3600.0}
NUMBERS = 1000  # of targets that are sent
OLDEST_S = 30.0  # position or heading of own ship

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

    def update(self, message: Any, kind: bytes, time_s: float) -> None:
        """Take what a sentence says of the own ship."""
        if kind in (b"RMC", b"GGA", b"GLL") and has_numbers(message, "lat", "lon") and getattr(message, "status", "A") != "V":
            self.latitude, self.longitude, self.position_s = message.lat, message.lon, time_s
        if kind == b"RMC" and has_numbers(message, "spd", "cog"):
            self._move(message.spd * KNOT_M_S, message.cog)
        if kind == b"VTG" and has_numbers(message, "sogn", "cogt"):
            self._move(message.sogn * KNOT_M_S, message.cogt)
        name = {b"HDT": "headingT", b"THS": "headt", b"OSD": "hdg"}.get(kind, "")
        if name and has_numbers(message, name):
            self.heading_deg, self.heading_s = getattr(message, name), time_s

    def _move(self, speed_m_s: float, course_deg: float) -> None:
        self.east_m_s, self.north_m_s = _vector(speed_m_s, course_deg)

    def at(self, time_s: float) -> tuple[float, float, float]:
        """Latitude, longitude and heading at a time, NaN where they are unknown or older than OLDEST_S."""
        place = (self.latitude, self.longitude) if time_s - self.position_s <= OLDEST_S else (math.nan, math.nan)
        return *place, self.heading_deg if time_s - self.heading_s <= OLDEST_S else math.nan


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
        message = parsed_sentence(sentence, where, self._tally)
        if message is None:
            return None
        if math.isnan(clock_s) and not math.isnan(self._assumed_s):
            clock_s = self._assumed_s = time_of_day_s(getattr(message, "time", None), self._assumed_s)
        if kind in OWN_SHIP:
            self._own.update(message, kind, clock_s)
            self.of_own_ship += 1
            return None
        if math.isnan(clock_s):
            self._tally.add(TIME_MISSING, where, sentence)
            return None
        state, refused = _state(message, kind, clock_s, self._own)
        if state is None:
            self._tally.add(refused, where, sentence)
        return state


def _state(message: Any, kind: bytes, clock_s: float, own: _OwnShip) -> tuple[State | None, str]:
    """The state of a target, or None and the kind of fault."""
    status = getattr(message, "targetstatus", None) if kind == b"TTM" else getattr(message, "status", None)
    if status in ("L", "Q"):
        return None, LOST if status == "L" else ACQUIRED
    needed = ("targetnum", "targetdist", "targetbearing") if kind == b"TTM" else ("targetnum", "targetlat", "targetlon")
    if not has_numbers(message, *needed):
        return None, NO_TARGET
    time_s = time_of_day_s(getattr(message, "time", None), clock_s)
    velocity = (math.nan, math.nan)
    if kind == b"TLL":
        latitude = _signed(message.targetlat, getattr(message, "targetlatNS", "N"), "S")  # pynmeagps gives both without a sign
        longitude = _signed(message.targetlon, getattr(message, "targetlonEW", "E"), "W")
    else:
        own_latitude, own_longitude, heading = own.at(clock_s)
        relative = getattr(message, "targetbearingu", "T") == "R"
        bearing = message.targetbearing + (heading if relative else 0.0)
        if math.isnan(own_latitude) or math.isnan(bearing):
            return None, NO_OWN_SHIP
        distance = message.targetdist * METRES.get(getattr(message, "speedu", "N"), NAUTICAL_MILE_M)
        place = offset_deg(np.array([own_latitude, own_longitude]), np.array(_vector(distance, bearing)))
        latitude, longitude = float(place[0]), float(place[1])
        velocity = _velocity(message, heading, own)
    if not abs(latitude) <= HIGHEST_LATITUDE_DEG:
        return None, LATITUDE
    if not abs(longitude) <= 180.0:
        return None, LONGITUDE
    return (int(message.targetnum), min(time_s, clock_s), clock_s, latitude, longitude, *velocity), ""


def _signed(degrees: float, side: str, negative: str) -> float:
    """Degrees with their sign. Args: negative: the side on which they are negative."""
    return -abs(degrees) if side == negative else degrees


def _velocity(message: Any, heading: float, own: _OwnShip) -> tuple[float, float]:
    """East and north of a TTM target. A relative one is against the own ship, and its course is from the bow."""
    if not has_numbers(message, "targetspeed", "targetcourse"):
        return math.nan, math.nan
    speed = message.targetspeed * METRES_PER_SECOND.get(getattr(message, "speedu", "N"), KNOT_M_S)
    if getattr(message, "targetcourseu", "T") != "R":
        return _vector(speed, message.targetcourse)
    east, north = _vector(speed, message.targetcourse + heading)
    return east + own.east_m_s, north + own.north_m_s


def _vector(length: float, bearing_deg: float) -> tuple[float, float]:
    """East and north."""
    return length * math.sin(math.radians(bearing_deg)), length * math.cos(math.radians(bearing_deg))


def time_of_day_s(of_day: Any, clock_s: float) -> float:
    """The instant nearest to the clock that has this time of day; the clock without a time of day."""
    if not hasattr(of_day, "hour"):
        return clock_s
    second: float = 3600 * of_day.hour + 60 * of_day.minute + of_day.second + 1e-6 * of_day.microsecond
    return nearest_s(second, clock_s)


class TargetDecoder:
    """The sentences of one radar. Its position is that of the own ship's sentences, of `?site=LAT,LON` or of the track source."""

    has_dates = True

    def __init__(self, feed: FeedSettings, sensors: Sensors) -> None:
        """Raises: AddressError."""
        self.tally, self.counts, self.checked = Tally(), Counts(), feed.checked
        self.stamps = Stamps(feed.name, feed.checked, self.tally)
        sources, site_deg = sensors.track_sources, site_of(feed)
        self._source = source = source_of(feed, sources)
        site_deg = sources.site_deg[source] if site_deg is None else site_deg
        self._targets = TargetSentences(site_deg, float(sources.heading_deg[source]), math.nan, self.tally)
        self._waiting = Waiting(self.counts, self.tally, "tracks")
        self.reports_between = self._waiting.reports_between
        self._cut = SentenceFeed(feed.name, TARGETS + OWN_SHIP, self.tally, self.counts.ledger)

    @property
    def waiting(self) -> int:
        """As of `Decoder`."""
        return self._waiting.rows

    def decode(self, items: list[Item], reference_s: float | None) -> None:
        """As of `Decoder`. A sentence without a time has that of its arrival."""
        own_ship = self._targets.of_own_ship
        states: list[State] = []
        arrived: list[float] = []
        for fed in self._cut.sentences(items):
            state = self._targets.state(fed.sentence, fed.time_s, fed.where)
            if state is not None:
                states.append(state)
                arrived.append(fed.arrived_s)
        self.counts.ledger.beside[OF_OWN_SHIP] += self._targets.of_own_ship - own_ship
        if states:
            table = np.array(states, np.float64)
            time_s = self.stamps.times_s(table[:, 1], np.array(arrived))
            usable = np.isfinite(time_s)
            time_s, table = time_s[usable], table[usable]
            reports = track_reports(self._source, table[:, 0].astype(np.int64), time_s, table[:, 3:5], table[:, 5:7])
            self._waiting.add("tracks", reports)


def source_of(feed: FeedSettings, sources: TrackSources) -> int:
    """The number of the track source of a feed. Raises: AddressError."""
    names = [str(name) for name in sources.name]
    if feed.source not in names:
        raise AddressError(f"feed: got {feed.text!r}, needed ?source=NAME with a track source of {', '.join(names) or 'none'}")
    return names.index(feed.source)


def site_of(feed: FeedSettings) -> Floats | None:
    """The position in `?site=LAT,LON`; None: there is none. Raises: AddressError."""
    text = feed.options.get("site")
    if text is None:
        return None
    if (site := parsed_site(text)) is None:
        raise AddressError(f"feed: got site={text} in {feed.text!r}, needed LAT,LON in degrees, e.g. site=50.795,-1.105")
    return np.array(site)


class TargetEncoder:
    """TTM or TLL sentences. A vessel keeps its target number, 0 to 999, while it is in the picture."""

    def __init__(self, site_deg: tuple[float, float] | None) -> None:
        """Args: site_deg: of TTM; None: TLL."""
        self._site = site_deg
        self._numbers = TargetNumbers(range(NUMBERS))

    def messages(self, vessels: Vessels) -> Iterator[bytes]:
        """As of `Encoder`. Vessels beyond the last number are left out."""
        self._numbers.keep(vessels.every_id.tolist())
        columns = vessels.vessel_id, vessels.sog_kn, vessels.cog_deg
        clock = datetime.fromtimestamp(vessels.time_s, UTC).strftime("%H%M%S.%f")[:9]
        for place, vessel, sog, cog, name in zip(
            vessels.position_deg, *(column.tolist() for column in columns), vessels.name, strict=True
        ):
            number = self._numbers.get(vessel)
            if number is not None:
                yield self._sentence(
                    number, place, (sog, cog), "".join(c for c in name or "" if c.isalnum() or c == " "), clock
                )

    def _sentence(self, number: int, place: Floats, motion: tuple[float, float], name: str, clock: str) -> bytes:
        if self._site is None:
            return _line(
                f"CWTLL,{number:02d},{_angle(place[0], 'N', 'S', 2)},{_angle(place[1], 'E', 'W', 3)},{name},{clock},T,"
            )
        east, north = difference_m(place, np.array(self._site)).tolist()
        miles, bearing = math.hypot(east, north) / NAUTICAL_MILE_M, rounded_deg(math.degrees(math.atan2(east, north)), 2)
        motion_fields = f"{motion[0]:.1f},{rounded_deg(motion[1], 1):.1f},T" if math.isfinite(motion[0] + motion[1]) else ",,"
        return _line(f"CWTTM,{number:02d},{miles:.3f},{bearing:.2f},T,{motion_fields},,,N,{name},T,,{clock},A")


def _line(body: str) -> bytes:
    return f"{made_sentence(body)}\r\n".encode()


def _angle(degrees: float, positive: str, negative: str, width: int) -> str:
    """Degrees and minutes as NMEA has them: 5047.7000,N."""
    minutes = round(abs(float(degrees)) * 60.0, 4)
    whole = int(minutes // 60)
    return f"{whole:0{width}d}{minutes - 60 * whole:07.4f},{positive if degrees >= 0 else negative}"


def _pictures(to: OutSettings) -> TargetEncoder:
    return TargetEncoder(to.site_deg)


TTM = Format(
    "ttm",
    decoder=TargetDecoder,
    pictures=_pictures,
    options=("source", "site"),
    needs_site=True,
    own_source=True,
)
TLL = Format("tll", pictures=_pictures)
