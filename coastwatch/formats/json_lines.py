"""Plots, bearings and tracks as JSON lines, one object a line: for sensors that speak nothing else, and for other systems."""

from __future__ import annotations

import json
import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from coastwatch.batches import BearingReports, Floats, RadarReports, Reports, Sensors, TrackReports
from coastwatch.batches.limits import CONTACTS
from coastwatch.formats.decoding import Counts, FeedSettings, Item, Stamps, Waiting, track_reports
from coastwatch.formats.format import Format
from coastwatch.formats.intake.faults import Tally
from coastwatch.geodesy import KNOT_M_S
from coastwatch.stage import Latitude, Longitude, NotNegative, Positive

NOT_READ = "not an object of the format"
UNKNOWN_FIELD = "field that the format does not have"
NO_SENSOR = "of no sensor of the scenario"


class _Line(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    time: AwareDatetime | float | None = None  # ISO 8601 or Unix seconds; none: that of arrival

    @property
    def time_s(self) -> float:
        return math.nan if self.time is None else self.time if isinstance(self.time, float) else self.time.timestamp()


class Plot(_Line):
    """A plot of a radar."""

    type: Literal["plot"]
    radar: str
    range_m: NotNegative
    azimuth_deg: Annotated[float, Field(ge=0.0, le=360.0)]  # true
    range_sigma_m: Positive | None = None
    azimuth_sigma_deg: Positive | None = None
    site_latitude_deg: Latitude | None = None  # where the sensor was, if it moves
    site_longitude_deg: Longitude | None = None


class Bearing(_Line):
    """A bearing of a sonar, camera or direction finder."""

    type: Literal["bearing"]
    sonar: str
    bearing_deg: Annotated[float, Field(ge=0.0, le=360.0)]  # true
    contact: Annotated[int, Field(ge=0, lt=CONTACTS)] = -1
    bearing_sigma_deg: Positive | None = None
    site_latitude_deg: Latitude | None = None  # where the sensor was, if it moves
    site_longitude_deg: Longitude | None = None


class Track(_Line):
    """The state of a track of another system."""

    type: Literal["track"]
    source: str
    number: Annotated[int, Field(ge=0, lt=2**62)]
    latitude_deg: Latitude
    longitude_deg: Longitude
    sog_kn: NotNegative | None = None
    cog_deg: Annotated[float, Field(ge=0.0, le=360.0)] | None = None


FIELDS = {"plot": tuple(Plot.model_fields), "bearing": tuple(Bearing.model_fields), "track": tuple(Track.model_fields)}
LINE: TypeAdapter[Plot | Bearing | Track] = TypeAdapter(Annotated[Plot | Bearing | Track, Field(discriminator="type")])


class JsonDecoder:
    """The lines of one feed."""

    has_dates = True

    def __init__(self, feed: FeedSettings, sensors: Sensors) -> None:
        self.tally, self.counts, self.checked = Tally(), Counts(), feed.checked
        self.stamps = Stamps(feed.name, feed.checked, self.tally)
        self._name, self._sensors, self._lines = feed.name, sensors, 0
        names = {"plot": sensors.radars.name, "bearing": sensors.sonars.name, "track": sensors.track_sources.name}
        self._numbers = {kind: {str(name): k for k, name in enumerate(own_names)} for kind, own_names in names.items()}
        self._waiting = Waiting(self.counts, self.tally, "radar", "bearing", "tracks")
        self.reports_between = self._waiting.reports_between

    @property
    def waiting(self) -> int:
        """As of `Decoder`."""
        return self._waiting.rows

    def decode(self, items: list[Item], reference_s: float | None) -> None:
        """As of `Decoder`."""
        lines_of: dict[str, list[tuple[float, int, Any]]] = {kind: [] for kind in self._numbers}
        for arrived_s, text, _ in items:
            self._lines += 1
            if not text.strip():
                continue
            self.counts.ledger.read += 1
            try:
                line = LINE.validate_json(text)
            except RecursionError:
                self.tally.add(NOT_READ, f"{self._name}:{self._lines}", text[:200])
                continue
            except ValidationError as error:
                kind, example = _refusal(error)
                self.tally.add(kind, f"{self._name}:{self._lines}", example or text[:200])
                continue
            named = line.radar if isinstance(line, Plot) else line.sonar if isinstance(line, Bearing) else line.source
            sensor = self._numbers[line.type].get(named)
            if sensor is None:
                self.tally.add(NO_SENSOR, f"{self._name}:{self._lines}", named)
                continue
            lines_of[line.type].append((arrived_s, sensor, line))
        kinds = ("plot", "radar", self._plots), ("bearing", "bearing", self._bearings), ("track", "tracks", self._tracks)
        for type_, kind, make in kinds:
            if lines_of[type_]:
                when, number, lines = (list(column) for column in zip(*lines_of[type_], strict=True))
                stamp = np.array([line.time_s for line in lines])
                time_s = self.stamps.times_s(stamp, np.array(when, np.float64))
                batch = make(time_s, np.array(number, np.int64), lines)
                self._waiting.add(kind, batch.take(np.isfinite(time_s)))

    def _plots(self, time_s: Any, number: Any, lines: Any) -> RadarReports:
        return RadarReports(
            sensor=number,
            time_s=time_s,
            received_s=time_s,
            range_m=_numbers(lines, "range_m"),
            azimuth_deg=_numbers(lines, "azimuth_deg"),
            site_deg=_sites(lines, self._sensors.radars.site_deg[number]),
            range_sigma_m=_numbers(lines, "range_sigma_m"),
            azimuth_sigma_deg=_numbers(lines, "azimuth_sigma_deg"),
        )

    def _bearings(self, time_s: Any, number: Any, lines: Any) -> BearingReports:
        return BearingReports(
            sensor=number,
            time_s=time_s,
            received_s=time_s,
            bearing_deg=_numbers(lines, "bearing_deg"),
            contact=np.array([line.contact for line in lines], np.int64),
            site_deg=_sites(lines, self._sensors.sonars.site_deg[number]),
            bearing_sigma_deg=_numbers(lines, "bearing_sigma_deg"),
        )

    def _tracks(self, time_s: Any, number: Any, lines: Any) -> TrackReports:
        speed, course = _numbers(lines, "sog_kn") * KNOT_M_S, np.radians(_numbers(lines, "cog_deg"))
        position = np.stack([_numbers(lines, "latitude_deg"), _numbers(lines, "longitude_deg")], 1)
        velocity = np.stack([speed * np.sin(course), speed * np.cos(course)], 1)
        return track_reports(number, [line.number for line in lines], time_s, position, velocity)


def _refusal(error: ValidationError) -> tuple[str, str]:
    """The kind of the fault of a line, and the value that is wrong; empty: it is no object with a known type.

    The kinds are bounded: the name of a field is one that the format has.
    """
    wrong = error.errors(include_url=False, include_context=False)[0]
    tag, *rest = wrong["loc"] or ("",)
    field = str(rest[0]) if rest else ""
    if field not in FIELDS.get(str(tag), ()):
        return (UNKNOWN_FIELD, field) if field else (NOT_READ, "")
    if wrong["type"] == "missing":
        return f"no {field}", ""
    return f"{field} wrong or out of range", f"{field} {wrong['input']!r}"


def _numbers(lines: Any, name: str) -> Any:
    return np.array([math.nan if (value := getattr(line, name)) is None else value for line in lines], np.float64)


def _sites(lines: Any, of_sensors: Floats) -> Floats:
    """Where the sensor of each line was: as the line says, else as the scenario has it. Args: (M, 2). Returns: (M, 2)."""
    said = np.stack([_numbers(lines, "site_latitude_deg"), _numbers(lines, "site_longitude_deg")], 1)
    return np.where(np.isfinite(said).all(axis=1, keepdims=True), said, of_sensors)


def encode(reports: Reports, sensors: Sensors) -> list[bytes]:
    """Lines of plots and bearings, with the place of the sensor and the standard deviations that are known."""
    radar, bearing = reports.radar, reports.bearing
    lines: list[dict[str, Any]] = []
    for k in range(len(radar)):
        line = {"type": "plot", "radar": str(sensors.radars.name[radar.sensor[k]]), "time": float(radar.time_s[k])}
        line |= {"range_m": float(radar.range_m[k]), "azimuth_deg": float(radar.azimuth_deg[k]) % 360.0}
        given = {"range_sigma_m": radar.range_sigma_m[k], "azimuth_sigma_deg": radar.azimuth_sigma_deg[k]}
        lines.append(line | _known(given, radar.site_deg[k]))
    for k in range(len(bearing)):
        line = {"type": "bearing", "sonar": str(sensors.sonars.name[bearing.sensor[k]]), "time": float(bearing.time_s[k])}
        line |= {"bearing_deg": float(bearing.bearing_deg[k]) % 360.0}
        if bearing.contact[k] >= 0:
            line["contact"] = int(bearing.contact[k])
        lines.append(line | _known({"bearing_sigma_deg": bearing.bearing_sigma_deg[k]}, bearing.site_deg[k]))
    return [json.dumps(line).encode() for line in lines]


def _known(given: dict[str, Any], site_deg: Floats) -> dict[str, float]:
    """The fields of numbers that are known, and of the place of the sensor. Args: site_deg: (2,)."""
    site = {"site_latitude_deg": site_deg[0], "site_longitude_deg": site_deg[1]}
    return {name: float(value) for name, value in (given | site).items() if math.isfinite(value)}


JSON = Format(
    "json",
    decoder=JsonDecoder,
    encode=encode,
    encodes=("radar", "bearing"),
)
