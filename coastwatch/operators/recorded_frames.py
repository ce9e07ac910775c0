"""Recorded pictures as CSV and Parquet: the columns of a picture, unrounded, then members, velocity and covariance."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from contextlib import nullcontext
from itertools import chain
from typing import TYPE_CHECKING

import lazy_loader
import numpy as np

from coastwatch import store
from coastwatch.batches import Array, Floats, nav_status_text
from coastwatch.errors import InputError, StoreError
from coastwatch.operators.export import csv_cell, write_parquet
from coastwatch.operators.output_file import written
from coastwatch.operators.presentation import flag_words
from coastwatch.operators.typed import Box
from coastwatch.store import Recorded, Store
from coastwatch.store.rows import motion

if TYPE_CHECKING:
    import polars
else:
    polars = lazy_loader.load("polars")  # every command that reads imports this module, only `replay` needs polars

INSTANT = "%Y-%m-%dT%H:%M:%S%.6fZ"
AXES = ("east", "north", "east_rate", "north_rate")


def write(
    database: Store, run_id: int, from_s: float | None, to_s: float | None, bbox: Box | None, *, form: str, output: str | None
) -> None:
    """Writes the recorded cycles between two instants to a file, or to the terminal if `output` is None.

    Args: form: csv, written cycle by cycle, or parquet. Raises: InputError; StoreError if no cycle is recorded.
    """
    if form == "parquet" and output is None:
        raise InputError("Parquet is not text: got no --output, needed --output FILE")
    if from_s is not None and to_s is not None and from_s > to_s:
        raise InputError("--from: got an instant after --to, needed one before it")
    names = {number: csv_cell(name) for number, name, _ in store.sources(database, run_id).rows}
    frames = (_frame(cycle, names) for cycle in store.replay(database, run_id, from_s, to_s, bbox))
    first = next(frames, None)
    if first is None:
        raise StoreError(
            f"{database.where}: run {run_id} has no recorded cycle in that time span; the setting `store.recording` records a run"
        )
    if form == "parquet":
        write_parquet(polars.concat([first, *frames]), output)
        return
    with nullcontext() if output is None else written(output) as file:
        for number, frame in enumerate(chain([first], frames)):
            text = frame.with_columns(polars.col("flags").list.join(" "))
            lines = text.write_csv(include_header=number == 0, datetime_format=INSTANT)
            if file is None:
                sys.stdout.write(lines)
            else:
                file.write(lines.encode())


def _frame(recorded: Recorded, names: Mapping[int, str]) -> polars.DataFrame:
    """One row per vessel. Args: names: of the sources, by number."""
    p, members = recorded.picture, recorded.members
    sog_kn, cog_deg, major_m, minor_m, orientation_deg = motion(p.velocity_m_s, p.covariance).T
    sources = [names.get(number, str(number)) for number in members.source.tolist()]
    tracks = [f"{source}:{track}" for source, track in zip(sources, members.track_id.tolist(), strict=True)]
    first, last = (np.searchsorted(members.vessel_id, p.vessel_id, side).tolist() for side in ("left", "right"))
    statuses = {number: nav_status_text(number) for number in np.unique(p.nav_status[p.nav_status >= 0]).tolist()}
    flags = {number: flag_words(number).split() for number in np.unique(p.flags).tolist()}
    texts, instants = polars.String, polars.Datetime("us", "UTC")

    def utc(time_s: Floats) -> polars.Series:
        return polars.Series(np.round(time_s * 1e6).astype(np.int64)).cast(instants)

    columns: dict[str, Array | polars.Series] = {
        "cycle": np.full(len(p), recorded.cycle),
        "vessel_id": p.vessel_id,
        "latitude_deg": p.position_deg[:, 0],
        "longitude_deg": p.position_deg[:, 1],
        "sog_kn": sog_kn,
        "cog_deg": cog_deg,
        "mmsi": polars.Series([f"{mmsi:09d}" if mmsi >= 0 else None for mmsi in p.mmsi.tolist()], dtype=texts),
        "nav_status": polars.Series([statuses.get(number) for number in p.nav_status.tolist()], dtype=texts),
        "flags": polars.Series([flags[number] for number in p.flags.tolist()], dtype=polars.List(texts)),
        "time_utc": utc(p.time_s),
        "since_utc": utc(p.since_s),
        "updated_utc": utc(p.updated_s),
        "major_m": major_m,
        "minor_m": minor_m,
        "orientation_deg": orientation_deg,
        "echo_length_m": p.echo_length_m,
        "echo_width_m": p.echo_width_m,
        "echo_axis_deg": p.echo_axis_deg,
        "alternative_m": p.alternative_m,
        "members": polars.Series([" ".join(tracks[a:b]) for a, b in zip(first, last, strict=True)], dtype=texts),
        "origin": p.origin,
        "east_m_s": p.velocity_m_s[:, 0],
        "north_m_s": p.velocity_m_s[:, 1],
        **{f"covariance_{a}_{b}": p.covariance[:, i, j] for i, a in enumerate(AXES) for j, b in enumerate(AXES)},
    }
    plain = (np.ascontiguousarray(column) if isinstance(column, np.ndarray) else column for column in columns.values())
    return polars.DataFrame(dict(zip(columns, plain, strict=True)), nan_to_null=True)
