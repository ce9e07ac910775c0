"""The feed `tables`: radar plots and bearings in tables, with AIS tables and NMEA files, merged in order of arrival."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import AwareDatetime, model_validator

from coastwatch.batches import (
    CLASSES,
    AisReports,
    AisStatics,
    BearingReports,
    Floats,
    Ints,
    RadarReports,
    Radars,
    Recording,
    Reports,
    ReportStream,
    Sensors,
    Sonars,
    Stations,
    TrackReports,
    TrackSources,
)
from coastwatch.errors import InputError
from coastwatch.formats.intake.ais_validation import AisIntake
from coastwatch.formats.intake.faults import SET_ASIDE, Tally
from coastwatch.formats.registry import FORMATS
from coastwatch.geodesy import NAUTICAL_MILE_M, to_plane
from coastwatch.sensors.recorded.files import fingerprint
from coastwatch.sensors.recorded.merging import FileTimes, MergedStream, by_arrival, check_gaps, span_of
from coastwatch.sensors.recorded.nmea.feed import Nmea, first_and_last
from coastwatch.sensors.recorded.nmea.targets import target_reports, target_times
from coastwatch.sensors.recorded.tables.ais import AisColumns, AisTable
from coastwatch.sensors.recorded.tables.reader import Separator, Table, plain_name, read_table
from coastwatch.sensors.recorded.tables.rows import (
    AZIMUTHS,
    PLOTS,
    POSITION_ENTRIES,
    RANGES,
    arrived,
    content_of,
    find_columns,
    good_cells,
    need_columns,
    numbers_of_names,
    off_earth,
    sensor_numbers,
    stamps_of,
    to_both_sides,
)
from coastwatch.sensors.recorded.tables.stated_motion import SpeedUnit
from coastwatch.sensors.recorded.tables.stated_units import angle_doubts, range_doubts
from coastwatch.sensors.recorded.tables.tracks import TrackColumns, track_reports
from coastwatch.sensors.recorded.video.feed import FORMAT as VIDEO, VideoFileStream
from coastwatch.sensors.recorded.video.haxr import HaxrFile
from coastwatch.sensors.recorded.video.pictures import Pictures
from coastwatch.sensors.recorded.wire.stream import WireFile, WireStream, wire_file
from coastwatch.stage import Method, NotNegative, Plan, Settings

UNKNOWN_RADAR, UNKNOWN_SONAR = "unknown radar", "unknown sonar"
RANGE = "range out of range"
AZIMUTH = "angle out of range"
NO_SIGMA = SET_ASIDE + "standard deviation of 0 or less, that of the sensor taken: "

RANGE_M = {"range_m": 1.0, "range_nm": NAUTICAL_MILE_M, "range_km": 1000.0}
"""Metres of the unit of each column of ranges."""

PARTS = ("plots", "bearings", "ais", "nmea", "tracks", "track_sentences", "feeds", "pictures", "haxr")
"""Settings that hold files."""

NO_SENSORS = Sensors(Radars.empty(), Stations.empty(), Sonars.empty(), (), np.zeros((0, 2)))


class PlotColumns(Settings):
    """Names of the columns of a table of plots; a column without a setting is found by its usual names."""

    time: str | None = None  # of the beam
    received: str | None = None  # time of arrival; none: as `time`
    radar: str | None = None  # name of the radar in the scenario; not needed for a single radar
    range_m: str | None = None  # m
    range_nm: str | None = None  # instead of `range_m`
    range_km: str | None = None  # instead of `range_m`
    azimuth: str | None = None  # deg true
    azimuth_rad: str | None = None  # instead of `azimuth`: radians from true north
    latitude: str | None = None  # deg, of the plot, instead of range and azimuth
    longitude: str | None = None  # deg, of the plot, instead of range and azimuth
    site_latitude: str | None = None  # deg, of the antenna, if it moves
    site_longitude: str | None = None  # deg, of the antenna, if it moves
    range_sigma_m: str | None = None  # m, standard deviation of this plot, instead of the radar's `range_noise_m`
    azimuth_sigma: str | None = None  # deg, the same for `azimuth_noise_deg`
    position_sigma_m: str | None = None  # m per axis, of a plot with latitude and longitude


class BearingColumns(Settings):
    """Names of the columns of a table of bearings; a column without a setting is found by its usual names."""

    time: str | None = None  # of the bearing
    received: str | None = None  # time of arrival; none: as `time`
    sonar: str | None = None  # name of the sonar in the scenario; not needed for a single sonar
    bearing: str | None = None  # deg true
    contact: str | None = None  # the sensor's own track: a number or a text
    signature: str | None = (
        None  # number of the VesselClass by its sound, coastwatch/batches/ais_codes.py; other values count as none
    )
    site_latitude: str | None = None  # deg, of the sensor, if it moves
    site_longitude: str | None = None  # deg, of the sensor, if it moves
    bearing_sigma: str | None = None  # deg, standard deviation of this bearing, instead of the sensor's `bearing_noise_deg`


class Tables(Method):
    """Recorded files of any sensors."""

    method: Literal["tables"] = "tables"
    plots: tuple[Path, ...] = ()  # tables of radar plots, CSV or Parquet
    bearings: tuple[Path, ...] = ()  # tables of bearings
    ais: tuple[Path, ...] = ()  # tables of decoded AIS
    nmea: tuple[Path, ...] = ()  # files of NMEA 0183 with AIS
    tracks: tuple[Path, ...] = ()  # tables of finished tracks
    track_sentences: tuple[Path, ...] = ()  # files of NMEA 0183 with TTM or TLL
    feeds: tuple[str, ...] = ()  # files of what live feeds carry, and captures: "asterix+file:plots.pcap?port=8600"
    pictures: tuple[Pictures, ...] = ()  # pictures of a radar's screen, as of input.method video_files
    haxr: tuple[HaxrFile, ...] = ()  # HDF5 files of HAXR; they need the extra `video`
    plot_columns: PlotColumns = PlotColumns()  # names of the columns
    bearing_columns: BearingColumns = BearingColumns()  # names of the columns
    ais_columns: AisColumns = AisColumns()  # names of the columns
    track_columns: TrackColumns = TrackColumns()  # names of the columns
    time_format: str = "auto"
    """Of times. "auto": Unix time in s, ms, us or ns, or a written date; a date with points is day first. Else a pattern of strptime,
    e.g. "%d/%m/%Y %H:%M:%S" for 31/12/2025 23:59:59. A time without a zone is UTC; with "%z" the zone is read, e.g.
    "%Y-%m-%d %H:%M:%S%z" for 2025-12-31 23:59:59+0100."""
    separator: Separator = "auto"  # one character between the cells of a CSV file, e.g. ";"; "auto": by the header
    speed_unit: SpeedUnit = "kn"  # of the column of SOG, e.g. "m/s" for 5.14, "0.1 kn" for 100, where a ship makes 10 kn
    assume_start_utc: AwareDatetime | None = None  # time of the first sentence of NMEA files without any time
    assume_interval_s: NotNegative = 0.1  # between their messages
    drop_own_ship: bool = False  # of NMEA files: leave out VDO, and VDM of the same MMSI
    intake: AisIntake = AisIntake()  # which records are accepted

    @model_validator(mode="after")
    def _has_files(self) -> Self:
        if not any(getattr(self, part) for part in PARTS):
            raise InputError(f"{', '.join(PARTS)}: got no file, needed at least one")
        self._wire_files()
        return self

    def load(self, sensors: Sensors, seed: int, plan: Plan) -> Recording:
        """The reports of all files, each kind in order of arrival, and the faults.

        Raises: FileNotFoundError, InputError that names the file.
        """
        tally = Tally()
        radar = by_arrival(
            [RadarReports.empty(), *(_plots(self, p, sensors.radars, tally) for p, _, _ in fingerprint(self.plots))]
        )
        bearing = by_arrival(
            [BearingReports.empty(), *(_bearings(self, p, sensors.sonars, tally) for p, _, _ in fingerprint(self.bearings))]
        )
        tracks = self._tracks(sensors.track_sources, tally)
        ais, statics, faults = AisReports.empty(), AisStatics.empty(), tally.faults()
        if self.ais:
            ais, statics, of_tables = self._ais_table().read()
            faults = of_tables + faults
        contents = (self._ais_table().contents() if self.ais else ()) + tally.contents()
        reports = Reports(radar, ais, statics, bearing, tracks)
        numbered = [file.path for file in self._wire_files() if FORMATS[file.format].numbered]
        feeds = tuple(path.name for path in (*self.ais, *self.nmea, *numbered))
        streams: list[ReportStream] = [self._nmea().stream(len(self.ais))] if self.nmea else []
        streams += [self._video_stream(sensors)] if self.names_sensors() else []
        return Recording(MergedStream(reports, streams) if streams else reports, faults=faults, contents=contents, feeds=feeds)

    def span(self, sensors: Callable[[], Sensors], after_s: float, to_the_end: bool) -> tuple[float, float]:
        """Whole seconds before the first and after the last time of reception.

        Args: sensors: asked if files name some; after_s: where the run begins, if that is set; to_the_end: it goes to the last report.
        Raises: InputError if no record is usable, or files are so far apart that a run to the end would be long and mostly empty.
        """
        tally = Tally()
        received, of_names = list[FileTimes](), np.zeros(0)
        for part, files, columns in (
            ("plots", self.plots, self.plot_columns),
            ("bearings", self.bearings, self.bearing_columns),
            ("tracks", self.tracks, self.track_columns),
        ):
            for path, _, _ in fingerprint(files):
                table = read_table(path, self.separator, tally)
                received.append(FileTimes(path.name, _received(self, table, part, columns, tally)))
        for path, _, _ in fingerprint(self.track_sentences):
            received.append(FileTimes(path.name, target_times(path, self._assumed_s(), self.intake, tally)))
        faults = tally.faults()
        if self.ais:
            ais, statics, of_tables = self._ais_table().read()
            of_reports = [ais.received_s[ais.feed == number] for number in range(len(self.ais))]
            received += [FileTimes(path.name, times) for path, times in zip(self.ais, of_reports, strict=True)]
            of_names = statics.received_s
            faults = of_tables + faults
        if self.nmea:
            ends = first_and_last(self._nmea(), fingerprint(self.nmea))
            of_files = zip(self.nmea, ends.of_files_s, strict=True)
            received += [FileTimes(path.name, times, is_stream=True) for path, times in of_files]
            faults = ends.faults + faults
        if self.names_sensors():
            stream = self._video_stream(sensors())
            names = ", ".join(content.name for content in stream.contents())
            received += [FileTimes(names, times, is_stream=True) for times in stream.spans()]
            faults = stream.faults() + faults
        found = [file for file in received if len(file.received_s)]
        with_names = [of_names] if found else []  # names alone place no vessel
        span = span_of(*(file.received_s for file in found), *with_names, faults=faults)
        if to_the_end:
            check_gaps(found, after_s)
        return span

    def first_positions(self) -> Floats:
        """Positions of AIS: of the whole tables, and of the starts of files of NMEA and of wire formats. (M, 2) deg"""
        parts = [self._ais_table().read()[0].position_deg] if self.ais else []
        parts += [first_and_last(self._nmea(), fingerprint(self.nmea)).first_deg] if self.nmea else []
        numbered = [file for file in self._wire_files() if FORMATS[file.format].numbered]
        parts += [WireStream(numbered, NO_SENSORS, self.intake.lateness_s).first().ais.position_deg] if numbered else []
        return np.concatenate([np.zeros((0, 2)), *parts])

    def first_sites(self) -> dict[str, tuple[float, float]]:
        """Latitude and longitude of the antenna in the first plot of each radar, by its name; "" where the table names none."""
        site_of_radar: dict[str, tuple[float, float]] = {}
        for path, _, _ in fingerprint(self.plots):
            table = read_table(path, self.separator, Tally())
            latitude, longitude, name = (
                table.find(getattr(self.plot_columns, key), PLOTS[key]) for key in ("site_latitude", "site_longitude", "radar")
            )
            site = np.stack([table.numbers(latitude)[0], to_both_sides(table.numbers(longitude)[0])], axis=-1)
            stated = np.flatnonzero(np.isfinite(site).all(axis=1))
            names, first = np.unique(np.array(table.texts(name), "U")[stated], return_index=True)
            for radar, row in zip(names.tolist(), stated[first], strict=True):
                site_of_radar.setdefault(radar, (float(site[row, 0]), float(site[row, 1])))
        return site_of_radar

    def _tracks(self, sources: TrackSources, tally: Tally) -> TrackReports:
        """The states in all files of tracks, in order of arrival. The k-th file without a column of sources is of the k-th source."""
        files = [*self.tracks, *self.track_sentences]
        parts = [TrackReports.empty()]
        for number, (path, _, _) in enumerate(fingerprint(tuple(files))):
            of_files = len(sources) == len(files) or (
                len(sources) > len(files) and bool(self.feeds)
            )  # those of feeds come last
            only = 0 if len(sources) == 1 else number if of_files else None
            if number >= len(self.tracks):
                if only is None:
                    raise InputError(f"{path.name}: got {len(sources)} track_sources for {len(files)} files, needed as many")
                parts.append(target_reports(path, only, sources, self._assumed_s(), self.intake, tally))
            else:
                form = self.time_format, self.separator, self.speed_unit
                parts.append(track_reports(path, sources, only, self.track_columns, *form, intake=self.intake, tally=tally))
        return by_arrival(parts)

    def _wire_files(self) -> list[WireFile]:
        """Raises: InputError."""
        return [wire_file(text) for text in self.feeds]

    def has_video(self) -> bool:
        """Whether a file may have radar video."""
        return bool(self.pictures or self.haxr) or any(file.format == VIDEO for file in self._wire_files())

    def names_sensors(self) -> bool:
        """Whether a file cannot be read without the sensors of the scenario."""
        return bool(self.feeds or self.pictures or self.haxr)

    def _video_stream(self, sensors: Sensors) -> VideoFileStream:
        """The files of wire formats, pictures and HDF5. Raises: InputError, OSError."""
        files = WireStream(self._wire_files(), sensors, self.intake.lateness_s, len(self.ais) + len(self.nmea))
        return VideoFileStream(files, self.pictures, self.haxr, sensors.radars)

    def _assumed_s(self) -> float:
        return math.nan if self.assume_start_utc is None else self.assume_start_utc.timestamp()

    def _ais_table(self) -> AisTable:
        return AisTable(
            files=self.ais,
            columns=self.ais_columns,
            time_format=self.time_format,
            separator=self.separator,
            speed_unit=self.speed_unit,
            intake=self.intake,
        )

    def _nmea(self) -> Nmea:
        return Nmea(
            files=self.nmea,
            assume_start_utc=self.assume_start_utc,
            assume_interval_s=self.assume_interval_s,
            drop_own_ship=self.drop_own_ship,
            intake=self.intake,
        )


def _received(settings: Tables, table: Table, part: str, columns: Settings, tally: Tally) -> Floats:
    """Reception times of the rows of a table that have a time."""
    column = find_columns(table, part, columns)
    need_columns(table, part, column, ("time",))
    values = {key: table.times(column[key], settings.time_format)[0] for key in ("time", "received")}
    return arrived(table, np.isfinite(stamps_of(values)), values, settings.intake, tally)[1]


def _plots(settings: Tables, path: Path, radars: Radars, tally: Tally) -> RadarReports:
    table = read_table(path, settings.separator, tally)
    column = find_columns(table, "plots", settings.plot_columns)
    placed = column["latitude"] is not None or column["longitude"] is not None
    reach, angle = (next((key for key in keys if column[key]), None) for keys in (RANGES, AZIMUTHS))
    polar = not placed or (reach is not None and angle is not None)
    place = (reach or "range_m", angle or "azimuth") if polar else ("latitude", "longitude")
    need_columns(table, "plots", column, ("time", *place))
    table, values = good_cells(table, column, ("time", *place), settings.time_format, tally)
    sensor = sensor_numbers(table, column["radar"], radars.name, UNKNOWN_RADAR, tally)
    site = _sites(values, radars.site_deg, sensor)
    range_m, azimuth_deg = _polar(values, site, place)
    good = sensor >= 0
    shape = {RANGE: ~(range_m > 0.0), AZIMUTH: ~(np.abs(azimuth_deg) <= 360.0)}
    for kind, mask in (shape if polar else off_earth(values) | shape).items():
        tally.add_rows(kind, good & mask, table.location, table.example)
        good &= ~mask
    rows, received, notes = arrived(table, good, values, settings.intake, tally)
    range_sigma, azimuth_sigma = _plot_sigmas(values, range_m, azimuth_deg, polar)
    for name, sigma in (("range", range_sigma), ("azimuth", azimuth_sigma)):
        tally.add_rows(f"{NO_SIGMA}{name}", good & (sigma <= 0.0), table.location, table.example, used=True)
    position = None if polar else np.stack([values["latitude"], values["longitude"]], axis=-1)[rows]
    doubts = _polar_doubts(column, settings.plot_columns, sensor, range_m, azimuth_deg, radars) if polar else ()
    tally.add_file(content_of(table, "radar plots", column, values["time"][rows], position, doubts, notes=notes))
    return RadarReports(
        sensor=sensor[rows],
        time_s=values["time"][rows],
        received_s=received,
        range_m=range_m[rows],
        azimuth_deg=azimuth_deg[rows] % 360.0,
        site_deg=site[rows],
        range_sigma_m=_or_unknown(range_sigma[rows]),
        azimuth_sigma_deg=_or_unknown(azimuth_sigma[rows]),
    )


def _or_unknown(sigma: Floats) -> Floats:
    """Standard deviations, NaN for one of 0 or less: that of the sensor is taken."""
    return np.where(sigma > 0.0, sigma, np.nan)


def _plot_sigmas(values: dict[str, Floats], range_m: Floats, azimuth_deg: Floats, polar: bool) -> tuple[Floats, Floats]:
    """Standard deviations of range (m) and azimuth (deg) of each plot, NaN where the row has none.

    A covariance of position is taken along and across the beam. What both share is not used.
    """
    if polar:
        return values["range_sigma_m"], values["azimuth_sigma"]
    ee, en, nn = (values[name] for name in POSITION_ENTRIES)
    square = values["position_sigma_m"] ** 2
    ee, en, nn = np.where(np.isnan(ee), square, ee), np.where(np.isnan(ee), 0.0, en), np.where(np.isnan(nn), square, nn)
    sine, cosine = np.sin(np.radians(azimuth_deg)), np.cos(np.radians(azimuth_deg))
    along = sine**2 * ee + 2.0 * sine * cosine * en + cosine**2 * nn
    across = cosine**2 * ee - 2.0 * sine * cosine * en + sine**2 * nn
    sigmas = [np.sign(v) * np.sqrt(np.abs(v)) for v in (along, across)]
    return sigmas[0], np.degrees(np.arctan2(sigmas[1], np.maximum(range_m, 1.0)))


def _polar(values: dict[str, Floats], site: Floats, place: tuple[str, str]) -> tuple[Floats, Floats]:
    """Range in m and azimuth in deg. Args: place: keys of the columns that say where the plots are."""
    reach, angle = place
    if reach in RANGE_M:
        return values[reach] * RANGE_M[reach], np.degrees(values[angle]) if angle == "azimuth_rad" else values[angle]
    flat = to_plane(np.stack([values["latitude"], values["longitude"]], axis=-1), site)
    return np.hypot(flat[:, 0], flat[:, 1]), np.degrees(np.arctan2(flat[:, 0], flat[:, 1]))


def _polar_doubts(
    column: dict[str, str | None], named: PlotColumns, sensor: Ints, range_m: Floats, azimuth_deg: Floats, radars: Radars
) -> tuple[str, ...]:
    """What looks wrong about the units of ranges and azimuths that no column and no setting states."""
    known, reach, angle = sensor >= 0, column["range_m"], column["azimuth"]
    doubts: tuple[str, ...] = ()
    if reach is not None and named.range_m is None and not plain_name(reach).endswith("_m"):
        doubts += range_doubts(sensor[known], range_m[known], radars, reach)
    return doubts if angle is None else doubts + angle_doubts(azimuth_deg[known], angle, "azimuth")


def _bearings(settings: Tables, path: Path, sonars: Sonars, tally: Tally) -> BearingReports:
    table = read_table(path, settings.separator, tally)
    column = find_columns(table, "bearings", settings.bearing_columns)
    need_columns(table, "bearings", column, ("time", "bearing"))
    table, values = good_cells(table, column, ("time", "bearing"), settings.time_format, tally)
    sensor = sensor_numbers(table, column["sonar"], sonars.name, UNKNOWN_SONAR, tally)
    wrong = np.abs(values["bearing"]) > 360.0
    good = (sensor >= 0) & ~wrong
    tally.add_rows(AZIMUTH, (sensor >= 0) & wrong, table.location, table.example)
    rows, received, notes = arrived(table, good, values, settings.intake, tally)
    is_class = np.isin(values["signature"], np.arange(CLASSES))
    no_sigma = good & (values["bearing_sigma"] <= 0.0)
    tally.add_rows(f"{NO_SIGMA}bearing", no_sigma, table.location, table.example, used=True)
    doubts = angle_doubts(values["bearing"][sensor >= 0], str(column["bearing"]), "bearing")
    tally.add_file(content_of(table, "bearings", column, values["time"][rows], doubts=doubts, notes=notes))
    return BearingReports(
        sensor=sensor[rows],
        time_s=values["time"][rows],
        received_s=received,
        bearing_deg=values["bearing"][rows] % 360.0,
        contact=_contacts(table, column["contact"])[rows],
        site_deg=_sites(values, sonars.site_deg, sensor)[rows],
        signature=np.where(is_class, values["signature"], -1.0).astype(np.int64)[rows],
        bearing_sigma_deg=_or_unknown(values["bearing_sigma"][rows]),
    )


def _contacts(table: Table, column: str | None) -> Ints:
    """The number of the contact of each row, -1 where it has none."""
    if column is None:
        return np.full(len(table), -1, np.int64)
    number, empty = numbers_of_names(table, column)
    return np.where(empty, -1, number)


def _sites(values: dict[str, Floats], of_sensor: Floats, sensor: Ints) -> Floats:
    """Position of the sensor of each row: from the row, else from the scenario."""
    if not len(of_sensor):
        return np.full((len(sensor), 2), np.nan)
    in_row = np.stack([values["site_latitude"], values["site_longitude"]], axis=-1)
    return np.where(np.isfinite(in_row).all(axis=1, keepdims=True), in_row, of_sensor[np.maximum(sensor, 0)])
