"""Columns and rows of tables: names of columns, what a table is by its columns, readable cells, sensor and arrival of a row."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from coastwatch.batches import Array, Bools, FileContent, Floats, Ints
from coastwatch.batches.limits import HIGHEST_LATITUDE_DEG
from coastwatch.errors import InputError
from coastwatch.formats.intake.ais_validation import (
    LATITUDE,
    LONGITUDE,
    NON_FINITE,
    NOT_AVAILABLE_LONGITUDE,
    AisIntake,
    of_table,
)
from coastwatch.formats.intake.faults import Tally
from coastwatch.formats.intake.reception_time import BACKWARDS, LATE, SORTED, backwards_note, reception_times
from coastwatch.sensors.recorded.tables.reader import LONGEST_COLUMN, Table, plain_name
from coastwatch.spelling import did_you_mean
from coastwatch.stage import Settings

EMPTY_CELL, BAD_CELL = "empty cell", "unparsable cell"
OUTLIERS_PERCENT = 2.0
SHOWN_NAMES = 5  # of unknown sensors
HIGHEST_MESSAGE_TYPE = 27  # of AIS
NAMES = "names and sizes"
NO_ZONE = "times have no zone: taken as UTC"
HEMISPHERES = {
    "north_south": (
        "ns",
        "n_s",
        "n/s",
        "north_south",
        "lat_ns",
        "lat_dir",
        "lat_hemi",
        "lat_hemisphere",
        "latitude_hemisphere",
    ),
    "east_west": ("ew", "e_w", "e/w", "east_west", "lon_ew", "lon_dir", "lon_hemi", "lon_hemisphere", "longitude_hemisphere"),
}
"""Columns of letters beside numbers without a sign."""
TEXTS = (
    "radar",
    "sonar",
    "source",
    "track",
    "contact",
    "name",
    "call_sign",
    "ais_class",
    "nav_status",
    "accuracy",
    "raim",
    *HEMISPHERES,
)
"""Keys of columns that hold texts."""
ANTENNA = ("to_bow", "to_stern", "to_port", "to_starboard")
"""Keys of the distances from the antenna of a ship to her ends and sides."""
MAY_BE_UNREADABLE = ("name", "call_sign", "ship_type", "length", "beam", "heading", *ANTENNA)
"""Keys whose unreadable cells do not make a row unusable."""
POSITION = ("latitude", "longitude")
LONGITUDES = ("longitude", "site_longitude")
LEAST_BEYOND_SHARE = 0.02  # of the longitudes of a column that counts to 360: fewer are wrong cells
POSITION_ENTRIES = ("covariance_east_east", "covariance_east_north", "covariance_north_north")
"""Columns of the covariance of a position, m2, as `coastwatch replay` writes them."""
AXES = ("east", "north", "east_rate", "north_rate")
STATE_ENTRIES = tuple(f"covariance_{a}_{b}" for i, a in enumerate(AXES) for b in AXES[i:])
"""Columns of the covariance of a state: m2, m2/s and m2/s2. They are the names that `coastwatch replay` writes."""
VELOCITY = (("east_m_s", "north_m_s"), ("sog", "cog"))

TIMES: dict[str, tuple[str, ...]] = {
    "time": ("time", "time_s", "timestamp", "time_utc", "timestamp_utc", "datetime", "t"),
    "received": ("received", "received_s", "receive_time", "received_utc"),
    "site_latitude": ("site_latitude", "site_latitude_deg", "site_lat", "own_latitude", "own_latitude_deg"),
    "site_longitude": ("site_longitude", "site_longitude_deg", "site_lon", "own_longitude", "own_longitude_deg"),
}
PLOTS: dict[str, tuple[str, ...]] = (
    TIMES
    | HEMISPHERES
    | {
        "radar": ("radar", "sensor", "radar_name", "sensor_name"),
        "range_m": ("range_m", "range"),
        "range_nm": ("range_nm",),
        "range_km": ("range_km",),
        "azimuth": ("azimuth_deg", "azimuth", "bearing_deg", "bearing"),
        "azimuth_rad": ("azimuth_rad", "bearing_rad"),
        "latitude": ("latitude", "lat", "latitude_deg"),
        "longitude": ("longitude", "lon", "longitude_deg"),
        "range_sigma_m": ("range_sigma_m", "range_sigma", "sigma_range_m", "range_std_m"),
        "azimuth_sigma": ("azimuth_sigma_deg", "azimuth_sigma", "sigma_azimuth_deg", "bearing_sigma_deg", "azimuth_std_deg"),
        "position_sigma_m": ("position_sigma_m", "sigma_m", "position_sigma"),
        **{name: (name,) for name in POSITION_ENTRIES},
    }
)
BEARINGS: dict[str, tuple[str, ...]] = TIMES | {
    "sonar": ("sonar", "sensor", "sonar_name", "sensor_name", "camera"),
    "bearing": ("bearing_deg", "bearing", "azimuth_deg", "azimuth"),
    "contact": ("contact", "track", "contact_id", "track_id"),
    "signature": ("signature", "signature_class", "vessel_class"),
    "bearing_sigma": ("bearing_sigma_deg", "bearing_sigma", "sigma_bearing_deg", "bearing_std_deg"),
}
AIS: dict[str, tuple[str, ...]] = HEMISPHERES | {
    "time": (
        "time",
        "time_s",
        "timestamp",
        "time_utc",
        "timestamp_utc",
        "timestampexternal",  # of Digitraffic, ms; its `timestamp` is the second of the minute
        "timestamp_external",
        "basedatetime",
        "base_date_time",
        "datetime",
        "date_time",
        "date_time_utc",
        "msgtime",
        "tstamp",
        "t",
    ),
    "received": ("received", "received_s", "receivetime", "receive_time", "received_utc"),
    "mmsi": ("mmsi", "sourcemmsi", "userid", "user_id"),
    "latitude": ("latitude", "lat", "latitude_deg", "latitude_degrees", "y"),
    "longitude": ("longitude", "lon", "lng", "long", "longitude_deg", "longitude_degrees", "x"),
    "sog": ("sog", "sog_kn", "sog_knots", "speed", "speed_over_ground", "speedoverground"),
    "cog": ("cog", "cog_deg", "cog_degrees", "course", "course_over_ground", "courseoverground"),
    "ais_class": ("class", "ais_class", "type_of_mobile", "transceiver", "transceiverclass", "transcieverclass"),
    "nav_status": (
        "nav_status",
        "navstatus",
        "navigational_status",
        "navigationalstatus",
        "navigation_status",
        "navstat",
        "status",
    ),
    "accuracy": ("position_accuracy", "positionaccuracy", "accuracy", "posacc"),
    "raim": ("raim", "raim_flag"),
    "position_sigma_m": ("position_sigma_m", "sigma_m", "position_sigma"),
    **{name: (name,) for name in POSITION_ENTRIES},
    "heading": ("heading", "true_heading", "trueheading", "heading_deg", "hdg"),
    "name": ("name", "shipname", "ship_name", "vesselname", "vessel_name"),
    "call_sign": ("call_sign", "callsign"),
    "ship_type": ("ship_type_code", "shiptype", "vesseltype", "vessel_type", "ship_type"),
    "length": ("length", "length_m"),
    "beam": ("beam", "beam_m", "width"),
    **{
        f"to_{end}": (
            f"to_{end}",
            f"to_{end}_m",
            f"dimension_to_{end}",
            f"dimensionto{end}",
            f"size_{letter}",
            f"dim_{letter}",
            letter,
        )
        for letter, end in zip("abcd", ("bow", "stern", "port", "starboard"), strict=True)
    },
}
TRACKS: dict[str, tuple[str, ...]] = HEMISPHERES | {
    "time": ("time", "time_s", "timestamp", "time_utc", "timestamp_utc", "datetime", "t"),
    "received": ("received", "received_s", "receive_time", "received_utc"),
    "source": ("source", "radar", "sensor", "tracker"),
    "track": ("track", "track_id", "track_number", "id", "target", "target_id", "target_number", "vessel_id", "number"),
    "latitude": ("latitude", "lat", "latitude_deg"),
    "longitude": ("longitude", "lon", "longitude_deg"),
    "east_m_s": ("east_m_s", "ve", "v_east", "velocity_east", "vx"),
    "north_m_s": ("north_m_s", "vn", "v_north", "velocity_north", "vy"),
    "sog": ("sog", "sog_kn", "speed", "speed_kn", "sog_knots"),
    "cog": ("cog", "cog_deg", "course", "course_deg"),
    "position_sigma_m": ("position_sigma_m", "sigma_m", "position_sigma"),
    "velocity_sigma_m_s": ("velocity_sigma_m_s", "velocity_sigma"),
    **{name: (name,) for name in STATE_ENTRIES},
}
RANGES, AZIMUTHS = ("range_m", "range_nm", "range_km"), ("azimuth", "azimuth_rad")
"""Keys of one quantity in several units: one column is read."""
RADAR_ALONE = ("radar", "radar_name")
"""Columns of the sensor that a table of bearings does not have."""
COLUMNS = {"ais": AIS, "plots": PLOTS, "bearings": BEARINGS, "tracks": TRACKS}
"""Of each kind of table our names of columns, and the names, in lower case, by which one is found if no setting names it."""
SETTING = {"ais": "ais_columns", "plots": "plot_columns", "bearings": "bearing_columns", "tracks": "track_columns"}
TABLE_OF = {"ais": "decoded AIS", "plots": "radar plots", "bearings": "bearings", "tracks": "finished tracks"}


def to_both_sides(longitude_deg: Floats) -> Floats:
    """The longitudes of a column from -180 to 180 degrees, where the whole column plainly counts from 0 to 360. (N,) -> (N,)

    181, which is "not available", stays as it is.
    """
    given = longitude_deg[np.isfinite(longitude_deg)]
    beyond = np.count_nonzero((given > 180.0) & (given != NOT_AVAILABLE_LONGITUDE))
    if beyond < max(LEAST_BEYOND_SHARE * len(given), 2) or given.min() < 0.0 or given.max() > 360.0:
        return longitude_deg
    return np.where((longitude_deg > 180.0) & (longitude_deg != NOT_AVAILABLE_LONGITUDE), longitude_deg - 360.0, longitude_deg)


def find_columns(table: Table, part: str, named: Settings) -> dict[str, str | None]:
    """The column of each of our names, None where the table has none.

    Args: part: a key of COLUMNS, what the table was given as; named: the settings of its columns.
    Raises: InputError: a named column is not there, or the columns are those of another kind of table.
    """
    column = {key: table.find(getattr(named, key, None), aliases) for key, aliases in COLUMNS[part].items()}
    for keys in (RANGES, AZIMUTHS) if part == "plots" else ():
        taken = next((key for key in keys if getattr(named, key)), next((key for key in keys if column[key]), None))
        column |= dict.fromkeys(key for key in keys if key != taken)
    if part == "ais" and getattr(named, "time", None) is None:
        column["time"] = _time_column(table, column["time"], COLUMNS[part])
    if part == "ais" and column["ship_type"] is None:
        column["ship_type"] = _type_column(table)
    if not named.model_fields_set - {"time", "received"}:
        parts = _parts(table)
        if parts and part not in parts:
            other, names = next(iter(parts.items()))
            raise InputError(
                f"{table.name}: given as {TABLE_OF[part]}, it is a table of {TABLE_OF[other]} (columns {', '.join(names)}): "
                f"use --{other} (in a scenario: input.{other})"
            )
    return column


def _time_column(table: Table, found: str | None, aliases: dict[str, tuple[str, ...]]) -> str | None:
    """The column of times: the one found, or another beside it, where that one holds seconds of the minute, as AIS messages do."""
    if found is None or not table.is_second_of_minute(found):
        return found
    others = tuple(name for name in (*aliases["time"], *aliases["received"]) if name != plain_name(found))
    return table.find(None, others) or found


def _type_column(table: Table) -> str | None:
    """The column `type`, where its numbers are types of ships: those of AIS messages end at 27."""
    found = table.find(None, ("type",))
    return found if (table.numbers(found)[0] > HIGHEST_MESSAGE_TYPE).any() else None


def need_columns(table: Table, part: str, column: dict[str, str | None], keys: Sequence[str]) -> None:
    """Refuses a table without these columns. Raises: InputError that names its columns, what was looked for, and the option."""
    free = [name for name in table.frame.columns if name not in column.values()]
    only = free[0] if len(free) == 1 and len(free[0]) <= LONGEST_COLUMN else None
    for key in keys:
        if column[key] is None:
            fits = only is not None and (key in TEXTS or table.may_hold(only, times=key == "time"))
            yours = only if fits else "NAME"
            raise table.lacks(
                f"one of {', '.join(COLUMNS[part][key])}: --columns {part}.{key}={yours} names yours (in a scenario: "
                f"input.{SETTING[part]}.{key})"
            )


def _parts(table: Table) -> dict[str, tuple[str, ...]]:
    """What a table may be, keys of COLUMNS, each with the columns that say so. Nothing where the names do not say."""
    parts: dict[str, tuple[str, ...]] = {}
    mmsi, latitude = table.find(None, AIS["mmsi"]), table.find(None, TRACKS["latitude"])
    if mmsi is not None:
        parts["ais"] = (mmsi,)
    reach, angle = (table.find(None, tuple(name for key in keys for name in PLOTS[key])) for keys in (RANGES, AZIMUTHS))
    if reach is not None and angle is not None:
        parts["plots"] = reach, angle
    radar = table.find(None, RADAR_ALONE)
    if reach is None and angle is not None and latitude is None and radar is None:
        parts["bearings"] = (angle,)
    track = table.find(None, TRACKS["track"])
    for keys in VELOCITY:
        first, second = (table.find(None, TRACKS[key]) for key in keys)
        if latitude is not None and track is not None and first is not None and second is not None:
            parts["tracks"] = track, first, second
            break
    return parts


def good_cells(
    table: Table,
    column: dict[str, str | None],
    required: tuple[str, ...],
    time_format: str,
    tally: Tally,
    without_position: Bools | None = None,
) -> tuple[Table, dict[str, Floats]]:
    """The rows whose required cells all have a number and whose other cells are readable, and their numbers by key.

    Keys "time" and "received" are times; those of TEXTS are not checked.
    Args: without_position: (M,) rows that need no latitude and longitude; None: all need them.
    """
    good = np.ones(len(table), np.bool_)
    values: dict[str, Floats] = {}
    for key, name in column.items():
        if key in TEXTS:
            continue
        numbers, bad = table.times(name, time_format) if key in ("time", "received") else table.numbers(name)
        if key == "mmsi":
            bad = bad | table.cut_digits(name)
        if key in LONGITUDES:
            numbers = to_both_sides(numbers)
        if key in MAY_BE_UNREADABLE:
            bad = np.zeros(len(table), np.bool_)  # an unreadable length does not invalidate the position
        empty = table.empty(name).to_numpy() if name is not None and key in required else np.zeros(len(table), np.bool_)
        infinite = np.isinf(numbers) | (np.isnan(numbers) & ~empty & ~bad if key in required else False)
        infinite = infinite & (key not in MAY_BE_UNREADABLE)
        if without_position is not None and key in POSITION:
            empty = empty & ~without_position
        for kind, mask in ((EMPTY_CELL, empty), (BAD_CELL, bad), (NON_FINITE, infinite)):
            tally.add_rows(kind, good & mask, partial(table.location, column=str(name)), table.example)
            good &= ~mask
        values[key] = numbers
    for key, letters, negative in (("latitude", "north_south", "S"), ("longitude", "east_west", "W")):
        if (name := column.get(letters)) is not None and key in values:
            values[key] = np.where(table.begins_with(name, negative), -np.abs(values[key]), values[key])
    return table.at(good), {key: numbers[good] for key, numbers in values.items()}


def content_of(
    table: Table,
    kind: str,
    column: dict[str, str | None],
    time_s: Floats,
    position_deg: Floats | None = None,
    doubts: tuple[str, ...] = (),
    names: tuple[int, int] = (0, 0),
    notes: tuple[str, ...] = (),
) -> FileContent:
    """What was taken from a table.

    Args: column: of the file, by our names; time_s: (M,) of the records taken; position_deg: (M, 2), None where they have none;
    doubts: as of FileContent; names: how many of the rows also hold a new name or size of a vessel, and how many of these are taken;
    notes: on the order of the rows.
    """
    read = tuple((key, name) for key, name in column.items() if name is not None)
    used = {name for _, name in read}
    first_s, last_s = (float(time_s.min()), float(time_s.max())) if len(time_s) else (math.nan, math.nan)
    ignored = tuple(name for name in table.frame.columns if name not in used)
    beside = ((NAMES, names[1]),) if names[1] else ()
    notes = ((NO_ZONE,) if table.without_zone(column["time"]) else ()) + notes
    box = None if position_deg is None or not len(time_s) else box_of(position_deg)
    return FileContent(
        table.name, kind, len(time_s), first_s, last_s, read, ignored, notes, box, doubts, table.read + names[0], beside
    )


def box_of(position_deg: Floats) -> tuple[float, float, float, float]:
    """South, west, north and east of positions (M, 2), M at least 1; a few wrong ones may lie outside."""
    (south, west), (north, east) = np.percentile(position_deg, [OUTLIERS_PERCENT, 100.0 - OUTLIERS_PERCENT], axis=0)
    return float(south), float(west), float(north), float(east)


def stamps_of(values: dict[str, Floats]) -> Floats:
    """When each row arrived, or else its time."""
    return np.where(np.isnan(values["received"]), values["time"], values["received"])


def order_notes(given: AisIntake, taken: AisIntake, backwards: int) -> tuple[str, ...]:
    """What to say of the order of a table. Args: given, taken: settings, and as of `of_table`; backwards: rows refused by it."""
    if taken.order == "time":
        return () if given.order == "time" else (SORTED,)
    return backwards_note(backwards)


def arrived(
    table: Table, good: Bools, values: dict[str, Floats], intake: AisIntake, tally: Tally
) -> tuple[Ints, Floats, tuple[str, ...]]:
    """The good rows whose time is accepted, in order of arrival, their reception times, and what to say of the order of the table.

    Args: good: (M,) of the table.
    """
    rows, stamp = np.flatnonzero(good), stamps_of(values)
    taken = of_table(intake, stamp[rows])
    if taken.order == "time":
        rows = rows[np.argsort(stamp[rows], kind="stable")]
    arrived = reception_times(stamp[rows], intake.lateness_s, intake.longest_silence_s)
    for kind, mask in arrived.faults.items():
        where, example = (lambda i: table.location(int(rows[i]))), (lambda i: table.example(int(rows[i])))
        tally.add_rows(kind, mask, where, example, used=kind == LATE)
    notes = order_notes(intake, taken, int(arrived.faults[BACKWARDS].sum()))
    return rows[arrived.accepted], arrived.received_s[arrived.accepted], notes


def off_earth(values: dict[str, Floats]) -> dict[str, Bools]:
    """Which positions are none, by the kind of the fault."""
    latitude, longitude = np.abs(values["latitude"]), np.abs(values["longitude"])
    return {LATITUDE: ~(latitude <= HIGHEST_LATITUDE_DEG), LONGITUDE: ~(longitude <= 180.0)}


def sensor_numbers(
    table: Table, column: str | None, names: Array, kind: str, tally: Tally, remedy: Callable[[list[str]], str] = lambda _: ""
) -> Ints:
    """The number of the sensor of each row, -1 for an unknown name. A single sensor needs no name.

    Args: kind: of the fault of an unknown name; remedy: how these names become known. Raises: InputError: no row has a known name.
    """
    if column is None and len(names) == 1:
        return np.zeros(len(table), np.int64)
    if column is None:
        tally.add_rows(EMPTY_CELL, np.ones(len(table), np.bool_), table.location, table.example)
        return np.full(len(table), -1, np.int64)
    names_found, number = np.unique(np.array(table.texts(column), "U"), return_inverse=True)
    number_of_name = {str(n): i for i, n in enumerate(names)}
    of_name = np.array([number_of_name.get(str(n), -1) for n in names_found], np.int64)
    if len(table) and (of_name < 0).all():
        got = ", ".join(repr(str(n)) for n in names_found[:SHOWN_NAMES]) + (", ..." if len(names_found) > SHOWN_NAMES else "")
        raise InputError(
            f"{table.location(0, column)}: got {kind} in every row, {got}, needed one of {', '.join(number_of_name)}"
            f"{did_you_mean(str(names_found[0]), list(number_of_name))}{remedy([str(n) for n in names_found if n])}"
        )
    sensor = of_name[number]
    tally.add_rows(
        kind,
        sensor < 0,
        lambda i: table.location(i, column),
        lambda i: f"{names_found[number[i]]!s}, known: {sorted(number_of_name)}",
    )
    return sensor


def numbers_of_names(table: Table, column: str) -> tuple[Ints, Bools]:
    """A number for each name in a column, in order of the names, and which rows have none. A whole number stays what it is."""
    texts = np.array(table.texts(column), "U")
    number, bad = table.numbers(column)
    empty = np.asarray(table.empty(column).to_numpy(), np.bool_) | (texts == "") | (np.isnan(number) & ~bad)  # a NaN is no name
    whole = ~bad & np.isfinite(number) & (number == np.floor(number)) & (np.abs(number) < 2**53)
    if whole[~empty].all():
        return np.where(whole, number, -1.0).astype(np.int64), empty
    _, index = np.unique(texts, return_inverse=True)
    return index.astype(np.int64), empty
