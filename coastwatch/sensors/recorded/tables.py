"""The feed `tables`: radar plots and bearings in tables, with AIS tables and NMEA files, merged in order of arrival."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import AwareDatetime, Field, model_validator

from coastwatch.batches import (
    CLASSES,
    Array,
    BearingReports,
    Bools,
    Floats,
    Ints,
    RadarReports,
    Radars,
    Recording,
    Sensors,
    Sonars,
)
from coastwatch.geodesy import NAUTICAL_MILE_M, to_plane
from coastwatch.sensors.recorded.ais_table import EMPTY_CELL, AisColumns, AisTable, good_cells
from coastwatch.sensors.recorded.ais_validation import HIGHEST_LATITUDE, LATITUDE, LONGITUDE, AisIntake
from coastwatch.sensors.recorded.faults import Tally
from coastwatch.sensors.recorded.file_locations import fingerprint
from coastwatch.sensors.recorded.merging import by_arrival, recording
from coastwatch.sensors.recorded.nmea import Nmea, span_of_nmea
from coastwatch.sensors.recorded.reception_time import reception_times
from coastwatch.sensors.recorded.table_reader import Table, read_table
from coastwatch.stage import Method, Plan, Settings

UNKNOWN_RADAR, UNKNOWN_SONAR = "unknown radar", "unknown sonar"
RANGE = "range out of range"
AZIMUTH = "angle out of range"

TIMES: dict[str, tuple[str, ...]] = {
    "time": ("time", "time_s", "timestamp", "time_utc", "timestamp_utc", "datetime", "t"),
    "received": ("received", "received_s", "receive_time", "received_utc"),
    "site_latitude": ("site_latitude", "site_latitude_deg", "site_lat", "own_latitude", "own_latitude_deg"),
    "site_longitude": ("site_longitude", "site_longitude_deg", "site_lon", "own_longitude", "own_longitude_deg"),
}
PLOTS: dict[str, tuple[str, ...]] = TIMES | {
    "radar": ("radar", "sensor", "radar_name", "sensor_name"),
    "range_m": ("range_m", "range"),
    "range_nm": ("range_nm",),
    "azimuth": ("azimuth_deg", "azimuth", "bearing_deg", "bearing"),
    "latitude": ("latitude", "lat", "latitude_deg"),
    "longitude": ("longitude", "lon", "longitude_deg"),
}
BEARINGS: dict[str, tuple[str, ...]] = TIMES | {
    "sonar": ("sonar", "sensor", "sonar_name", "sensor_name", "camera"),
    "bearing": ("bearing_deg", "bearing", "azimuth_deg", "azimuth"),
    "contact": ("contact", "track", "contact_id", "track_id"),
    "signature": ("signature", "signature_class", "vessel_class"),
}


class PlotColumns(Settings):
    """Names of the columns of a table of plots; a column without a setting is found by its usual names."""

    time: str | None = None  # of the beam
    received: str | None = None  # time of arrival; none: as `time`
    radar: str | None = None  # name of the radar in the scenario; not needed for a single radar
    range_m: str | None = None  # m
    range_nm: str | None = None  # instead of `range_m`
    azimuth: str | None = None  # deg true
    latitude: str | None = None  # deg, of the plot, instead of range and azimuth
    longitude: str | None = None  # deg, of the plot, instead of range and azimuth
    site_latitude: str | None = None  # deg, of the antenna, if it moves
    site_longitude: str | None = None  # deg, of the antenna, if it moves


class BearingColumns(Settings):
    """Names of the columns of a table of bearings; a column without a setting is found by its usual names."""

    time: str | None = None  # of the bearing
    received: str | None = None  # time of arrival; none: as `time`
    sonar: str | None = None  # name of the sonar in the scenario; not needed for a single sonar
    bearing: str | None = None  # deg true
    contact: str | None = None  # the sensor's own track number
    signature: str | None = (
        None  # number of the VesselClass by its sound, coastwatch/batches/classes.py; other values count as none
    )
    site_latitude: str | None = None  # deg, of the sensor, if it moves
    site_longitude: str | None = None  # deg, of the sensor, if it moves


class Tables(Method):
    """Recorded files of any sensors. Settings: coastwatch/sensors/recorded/README.md."""

    method: Literal["tables"] = "tables"
    plots: tuple[Path, ...] = ()  # tables of radar plots, CSV or Parquet
    bearings: tuple[Path, ...] = ()  # tables of bearings
    ais: tuple[Path, ...] = ()  # tables of decoded AIS
    nmea: tuple[Path, ...] = ()  # files of NMEA 0183
    plot_columns: PlotColumns = PlotColumns()  # names of the columns
    bearing_columns: BearingColumns = BearingColumns()  # names of the columns
    ais_columns: AisColumns = AisColumns()  # names of the columns
    time_format: str = "auto"  # Unix time in s, ms, us or ns, or a written date; else a pattern of strptime; UTC without a zone
    separator: Annotated[str, Field(min_length=1, max_length=1)] = ","  # between the cells of a CSV file
    speed_unit: Literal["kn", "m/s", "km/h"] = "kn"  # of the column of SOG
    assume_start_utc: AwareDatetime | None = None  # time of the first sentence of NMEA files without any time
    assume_interval_s: Annotated[float, Field(ge=0.0)] = 0.1  # between their messages
    drop_own_ship: bool = False  # of NMEA files: leave out VDO, and VDM of the same MMSI
    intake: AisIntake = AisIntake()  # which records are accepted

    @model_validator(mode="after")
    def _has_files(self) -> Self:
        if not (self.plots or self.bearings or self.ais or self.nmea):
            raise ValueError("plots, bearings, ais, nmea: got no file, needed at least one")
        return self

    def load(self, sensors: Sensors, seed: int, plan: Plan) -> Recording:
        """The reports of all files, each kind in order of arrival, and the faults.

        Raises: FileNotFoundError, OSError or ValueError that names the file.
        """
        tally = Tally()
        radar = by_arrival(
            [RadarReports.empty(), *(_plots(self, p, sensors.radars, tally) for p, _, _ in fingerprint(self.plots))]
        )
        bearing = by_arrival(
            [BearingReports.empty(), *(_bearings(self, p, sensors.sonars, tally) for p, _, _ in fingerprint(self.bearings))]
        )
        parts = [feed.read() for feed in self._ais_feeds()]
        faults = tuple(f for _, _, some in parts for f in some) + tally.faults()
        if not parts:
            return recording(radar=radar, bearing=bearing, faults=faults)
        ais, statics = by_arrival([h[0] for h in parts]), by_arrival([h[1] for h in parts])
        return recording(radar, ais, statics, bearing, faults=faults)

    def span(self) -> tuple[float, float]:
        """Whole seconds before the first and after the last time of reception.

        Raises: ValueError if no record is usable.
        """
        tally = Tally()
        received: list[Floats] = []
        for files, times in ((self.plots, self.plot_columns), (self.bearings, self.bearing_columns)):
            for path, _, _ in fingerprint(files):
                received.append(_received(self, read_table(path, self.separator, Tally()), times, tally))
        parts = [feed.read() for feed in self._ais_feeds()]
        faults = tuple(f for _, _, some in parts for f in some) + tally.faults()
        return span_of_nmea(*received, *(part.received_s for h in parts for part in h[:2]), faults=faults)

    def _ais_feeds(self) -> list[AisTable | Nmea]:
        feeds: list[AisTable | Nmea] = []
        if self.ais:
            feeds.append(
                AisTable(
                    files=self.ais,
                    columns=self.ais_columns,
                    time_format=self.time_format,
                    separator=self.separator,
                    speed_unit=self.speed_unit,
                    intake=self.intake,
                )
            )
        if self.nmea:
            feeds.append(
                Nmea(
                    files=self.nmea,
                    assume_start_utc=self.assume_start_utc,
                    assume_interval_s=self.assume_interval_s,
                    drop_own_ship=self.drop_own_ship,
                    intake=self.intake,
                )
            )
        return feeds


def _received(settings: Tables, table: Table, columns: PlotColumns | BearingColumns, tally: Tally) -> Floats:
    """Reception times of the rows of a table that have a time."""
    time, _ = table.times(table.need(columns.time, TIMES["time"]), settings.time_format)
    received, _ = table.times(table.find(columns.received, TIMES["received"]), settings.time_format)
    stamp = np.where(np.isnan(received), time, received)
    return _arrived(table.at(np.isfinite(stamp)), stamp[np.isfinite(stamp)], settings.intake, tally)[1]


def _arrived(table: Table, stamp: Floats, intake: AisIntake, tally: Tally) -> tuple[Array, Floats]:
    """The rows whose time is accepted, in order of arrival, and their reception times."""
    order = np.argsort(stamp, kind="stable") if intake.order == "time" else np.arange(len(stamp))
    arrived = reception_times(stamp[order], intake.lateness_s, intake.longest_silence_s)
    for kind, mask in arrived.faults.items():
        tally.add_rows(kind, mask, lambda i: table.location(int(order[i])), lambda i: table.example(int(order[i])))
    return order[arrived.accepted], arrived.received_s[arrived.accepted]


def _plots(settings: Tables, path: Path, radars: Radars, tally: Tally) -> RadarReports:
    table = read_table(path, settings.separator, tally)
    column = {key: table.find(getattr(settings.plot_columns, key), names) for key, names in PLOTS.items()}
    polar = (column["range_m"] or column["range_nm"]) is not None and column["azimuth"] is not None
    place = ("azimuth", "range_m" if column["range_m"] else "range_nm") if polar else ("latitude", "longitude")
    for key in ("time", *place):
        table.need(column[key], PLOTS[key])
    table, values = good_cells(table, column, ("time", *place), settings.time_format, tally)
    sensor = _sensors(table, column["radar"], radars.name, UNKNOWN_RADAR, tally)
    site = _sites(values, radars.site_deg, sensor)
    range_m, azimuth_deg = _polar(values, site, polar)
    good = sensor >= 0
    for kind, mask in _plot_faults(values, range_m, azimuth_deg, polar).items():
        tally.add_rows(kind, good & mask, table.location, table.example)
        good &= ~mask
    stamp = np.where(np.isnan(values["received"]), values["time"], values["received"])[good]
    kept = np.flatnonzero(good)
    rows, received = _arrived(table.at(good), stamp, settings.intake, tally)
    rows = kept[rows]
    return RadarReports(
        sensor=sensor[rows],
        time_s=values["time"][rows],
        received_s=received,
        range_m=range_m[rows],
        azimuth_deg=azimuth_deg[rows] % 360.0,
        site_deg=site[rows],
        origin=np.full(len(rows), -1, np.int64),
    )


def _polar(values: dict[str, Floats], site: Floats, polar: bool) -> tuple[Floats, Floats]:
    if polar:
        metres = values["range_m"]
        return np.where(np.isnan(metres), values["range_nm"] * NAUTICAL_MILE_M, metres), values["azimuth"]
    flat = to_plane(np.stack([values["latitude"], values["longitude"]], axis=-1), site)
    return np.hypot(flat[:, 0], flat[:, 1]), np.degrees(np.arctan2(flat[:, 0], flat[:, 1]))


def _plot_faults(values: dict[str, Floats], range_m: Floats, azimuth_deg: Floats, polar: bool) -> dict[str, Bools]:
    shape = {RANGE: ~(range_m > 0.0), AZIMUTH: ~(np.abs(azimuth_deg) <= 360.0)}
    if polar:
        return shape
    far = {LATITUDE: ~(np.abs(values["latitude"]) <= HIGHEST_LATITUDE), LONGITUDE: ~(np.abs(values["longitude"]) <= 180.0)}
    return far | shape


def _bearings(settings: Tables, path: Path, sonars: Sonars, tally: Tally) -> BearingReports:
    table = read_table(path, settings.separator, tally)
    column = {key: table.find(getattr(settings.bearing_columns, key), names) for key, names in BEARINGS.items()}
    for key in ("time", "bearing"):
        table.need(column[key], BEARINGS[key])
    table, values = good_cells(table, column, ("time", "bearing"), settings.time_format, tally)
    sensor = _sensors(table, column["sonar"], sonars.name, UNKNOWN_SONAR, tally)
    wrong = np.abs(values["bearing"]) > 360.0
    good = (sensor >= 0) & ~wrong
    tally.add_rows(AZIMUTH, (sensor >= 0) & wrong, table.location, table.example)
    stamp = np.where(np.isnan(values["received"]), values["time"], values["received"])[good]
    kept = np.flatnonzero(good)
    rows, received = _arrived(table.at(good), stamp, settings.intake, tally)
    rows = kept[rows]
    return BearingReports(
        sensor=sensor[rows],
        time_s=values["time"][rows],
        received_s=received,
        bearing_deg=values["bearing"][rows] % 360.0,
        contact=np.nan_to_num(values["contact"], nan=-1.0).astype(np.int64)[rows],
        site_deg=_sites(values, sonars.site_deg, sensor)[rows],
        signature=_signatures(values["signature"][rows]),
        origin=np.full(len(rows), -1, np.int64),
    )


def _signatures(cells: Floats) -> Ints:
    """The class in each cell, -1 for none."""
    whole = np.isin(cells, np.arange(CLASSES))
    return np.where(whole, np.where(whole, cells, -1.0), -1.0).astype(np.int64)


def _sensors(table: Table, column: str | None, names: Array, kind: str, tally: Tally) -> Ints:
    """The number of the sensor of each row, -1 for an unknown name. A single sensor needs no name."""
    if column is None and len(names) == 1:
        return np.zeros(len(table), np.int64)
    if column is None:
        tally.add_rows(EMPTY_CELL, np.ones(len(table), np.bool_), table.location, table.example)
        return np.full(len(table), -1, np.int64)
    names_found, number = np.unique(np.array(table.texts(column), "U"), return_inverse=True)
    known = {str(n): i for i, n in enumerate(names)}
    out = np.array([known.get(str(n), -1) for n in names_found], np.int64)[number]
    tally.add_rows(
        kind, out < 0, lambda i: table.location(i, column), lambda i: f"{names_found[number[i]]!s}, known: {sorted(known)}"
    )
    return out


def _sites(values: dict[str, Floats], of_sensor: Floats, sensor: Ints) -> Floats:
    """Position of the sensor of each row: from the row, else from the scenario."""
    if not len(of_sensor):
        return np.full((len(sensor), 2), np.nan)
    in_row = np.stack([values["site_latitude"], values["site_longitude"]], axis=-1)
    return np.where(np.isfinite(in_row).all(axis=1, keepdims=True), in_row, of_sensor[np.maximum(sensor, 0)])
