"""Tables of finished tracks: number, time, position, velocity and covariance of each state."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np

from coastwatch.batches import Bools, Floats, TrackReports, TrackSources
from coastwatch.batches.limits import MOST_SPEED_M_S
from coastwatch.formats.intake.ais_validation import COG_RANGE, FIRST_WRONG_COG_DEG, AisIntake
from coastwatch.formats.intake.faults import SET_ASIDE, Tally
from coastwatch.geodesy import KNOT_M_S
from coastwatch.sensors.recorded.tables.reader import Table, read_table
from coastwatch.sensors.recorded.tables.rows import (
    AXES,
    EMPTY_CELL,
    arrived,
    content_of,
    find_columns,
    good_cells,
    need_columns,
    numbers_of_names,
    off_earth,
    sensor_numbers,
)
from coastwatch.sensors.recorded.tables.stated_motion import SPEED_KN, SpeedUnit, doubts
from coastwatch.sensors.recorded.tables.stated_units import angle_doubts, speed_doubts
from coastwatch.stage import Settings

UNKNOWN_SOURCE = "unknown track source"
MOST_SOURCES = 20  # that an error proposes
COVARIANCE = "covariance that is none"
FASTEST_KN = MOST_SPEED_M_S / KNOT_M_S
TOO_FAST = SET_ASIDE + f"SOG beyond {FASTEST_KN:.0f} kn, taken as not available"


class TrackColumns(Settings):
    """Names of the columns of a table of tracks; a column without a setting is found by its usual names."""

    time: str | None = None  # of the state
    received: str | None = None  # time of arrival; none: as `time`
    source: str | None = None  # name of the track source in the scenario; not needed for a file of one source
    track: str | None = None  # number or text that the source gives to the track
    latitude: str | None = None  # deg, north positive
    longitude: str | None = None  # deg, east positive
    east_m_s: str | None = None  # velocity to the east
    north_m_s: str | None = None  # velocity to the north
    sog: str | None = None  # instead of these two: speed in the unit of `speed_unit`
    cog: str | None = None  # and course, deg true
    position_sigma_m: str | None = None  # standard deviation per axis; instead of a covariance
    velocity_sigma_m_s: str | None = None  # standard deviation per axis; instead of a covariance


def track_reports(
    path: Path,
    sources: TrackSources,
    only: int | None,
    columns: TrackColumns,
    time_format: str,
    separator: str,
    speed_unit: SpeedUnit,
    *,
    intake: AisIntake,
    tally: Tally,
) -> TrackReports:
    """The states in a table, in order of arrival. Other rows are counted in the tally.

    Args: only: the source of a table without a column of sources; speed_unit: of SOG.
    Raises: InputError that names the file.
    """
    table = read_table(path, separator, tally)
    column = find_columns(table, "tracks", columns)
    need_columns(table, "tracks", column, ("time", "track", "latitude", "longitude"))
    table, values = good_cells(table, column, ("time", "latitude", "longitude"), time_format, tally)
    if column["source"] is None and only is not None:
        sensor = np.full(len(table), only, np.int64)
    else:
        sensor = sensor_numbers(
            table, column["source"], sources.name, UNKNOWN_SOURCE, tally, partial(_option_for_sources, sources.name.tolist())
        )
    good = sensor >= 0
    covariance = _covariance(values)
    number, empty = numbers_of_names(table, str(column["track"]))
    for kind, mask in {EMPTY_CELL: empty, **off_earth(values), COVARIANCE: _is_wrong(covariance)}.items():
        tally.add_rows(kind, good & mask, table.location, table.example)
        good &= ~mask
    rows, received, notes = arrived(table, good, values, intake, tally)
    position = np.stack([values["latitude"], values["longitude"]], axis=-1)[rows]
    velocity = _velocity(_speeds_and_courses_in_range(values, SPEED_KN[speed_unit], table, good, tally))[rows]
    _, track = np.unique(np.stack([sensor, number], axis=-1)[rows], axis=0, return_inverse=True)
    source = "SOG" if column["east_m_s"] is None or column["north_m_s"] is None else "the velocity"
    doubtful = doubts(track, values["time"][rows], position, velocity, speed_unit if source == "SOG" else "m/s", source)
    if not doubtful and column["sog"] is not None:
        doubtful = speed_doubts(values["sog"] * SPEED_KN[speed_unit], FASTEST_KN, speed_unit, column["sog"])
    if column["cog"] is not None:
        doubtful += angle_doubts(values["cog"], column["cog"], "course")
    tally.add_file(content_of(table, "track states", column, values["time"][rows], position, doubtful, notes=notes))
    return TrackReports(
        sensor=sensor[rows],
        number=number[rows],
        time_s=values["time"][rows],
        received_s=received,
        position_deg=position,
        velocity_m_s=velocity,
        covariance=covariance[rows],
    )


def _option_for_sources(known: list[str], names: list[str]) -> str:
    """How to make the names of a column sources, in the words of an error. The source that a single file was given is not kept."""
    if not names or len(names) > MOST_SOURCES or any(re.search(r"['\"\\]", name) for name in names):
        return ""
    every = names if len(known) == 1 else known + names
    written = ", ".join(f'{{name="{name}"}}' for name in every)
    return f": --set 'track_sources=[{written}]' makes them known (in a scenario: [[track_sources]])"


def _speeds_and_courses_in_range(
    values: dict[str, Floats], speed_kn: float, table: Table, good: Bools, tally: Tally
) -> dict[str, Floats]:
    """The values with SOG in knots; SOG of no vessel and aircraft on the sea, and COG that is none, are counted, and not available.

    Args: speed_kn: of the unit of SOG; good: (M,) rows that are used.
    """
    sog_kn, cog_deg = values["sog"] * speed_kn, values["cog"]
    too_fast, no_course = (sog_kn < 0.0) | (sog_kn > FASTEST_KN), np.abs(cog_deg) >= FIRST_WRONG_COG_DEG
    for kind, mask in ((TOO_FAST, too_fast), (COG_RANGE, no_course)):
        tally.add_rows(kind, good & mask, table.location, table.example, used=True)
    return values | {"sog": np.where(too_fast, np.nan, sog_kn), "cog": np.where(no_course, np.nan, cog_deg)}


def _velocity(values: dict[str, Floats]) -> Floats:
    """East and north, NaN where a row has neither form. Args: values: SOG in knots. (M, 2)"""
    stated = np.stack([values["east_m_s"], values["north_m_s"]], axis=-1)
    course, speed = np.radians(values["cog"]), values["sog"] * KNOT_M_S
    along = np.stack([speed * np.sin(course), speed * np.cos(course)], axis=-1)
    return np.where(np.isfinite(stated).all(axis=1, keepdims=True), stated, along)


def _covariance(values: dict[str, Floats]) -> Floats:
    """The covariance of each row: its entries, or those of its standard deviations; NaN where it has none. (M, 4, 4)"""
    n = len(values["time"])
    covariance = np.full((n, 4, 4), np.nan)
    for i, a in enumerate(AXES):
        for j, b in enumerate(AXES[i:], i):
            covariance[:, i, j] = covariance[:, j, i] = values[f"covariance_{a}_{b}"]
    for at, key in ((0, "position_sigma_m"), (2, "velocity_sigma_m_s")):
        block = covariance[:, at : at + 2, at : at + 2]
        missing = ~np.isfinite(block).all(axis=(1, 2)) & np.isfinite(values[key])
        block[missing] = (values[key][missing] ** 2)[:, None, None] * np.eye(2)
    is_stated = np.isfinite(covariance[:, :2, :2]).all(axis=(1, 2)) & np.isfinite(covariance[:, 2:, 2:]).all(axis=(1, 2))
    cross = covariance[:, :2, 2:]
    absent = is_stated & ~np.isfinite(cross).all(axis=(1, 2))
    cross[absent] = 0.0
    covariance[:, 2:, :2] = cross.swapaxes(1, 2)
    return covariance


def _is_wrong(covariance: Floats) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Which covariances are given and not positive definite. (M,)"""
    is_wrong = np.zeros(len(covariance), np.bool_)
    for part in (covariance, covariance[:, :2, :2]):
        stated = np.flatnonzero(np.isfinite(part).all(axis=(1, 2)))
        is_wrong[stated] |= np.linalg.eigvalsh(part[stated])[:, 0] <= 0.0
    return is_wrong
