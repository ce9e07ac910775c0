"""Recorded pictures as CSV and Parquet: the columns of a picture, unrounded, then members, velocity and covariance."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from itertools import chain
from typing import Any

import lazy_loader
import numpy as np

from coastwatch import store
from coastwatch.batches import Array, Floats, Ints, Members, Picture, nav_status_text
from coastwatch.errors import InputError, StoreError
from coastwatch.operators.export import csv_cell, write_parquet
from coastwatch.operators.presentation import flag_words
from coastwatch.store import Recorded, Store
from coastwatch.store.rows import motion

polars = lazy_loader.load("polars")  # every command that reads imports this module, only `replay` needs polars

Box = tuple[float, float, float, float]
INSTANT = "%Y-%m-%dT%H:%M:%S%.6fZ"
AXES = ("east", "north", "east_rate", "north_rate")


def write(
    found: Store, run_id: int, from_s: float | None, to_s: float | None, bbox: Box | None, *, form: str, output: str | None
) -> None:
    """Writes the recorded cycles between two instants to a file, or to the terminal if `output` is None.

    Args: form: csv, written cycle by cycle, or parquet. Raises: InputError; StoreError if no cycle is recorded.
    """
    if form == "parquet" and output is None:
        raise InputError("Parquet is not text: got no --output, needed --output FILE")
    if from_s is not None and to_s is not None and from_s > to_s:
        raise InputError("--from: got an instant after --to, needed one before it")
    names = {number: csv_cell(name) for number, name, _ in store.sources(found, run_id).rows}
    frames = (_frame(cycle, names) for cycle in store.replay(found, run_id, from_s, to_s, bbox))
    first = next(frames, None)
    if first is None:
        raise StoreError(
            f"{found.where}: run {run_id} has no recorded cycle in that time span; the setting `store.recording` records a run"
        )
    if form == "csv":
        _write_csv(chain([first], frames), output)
        return
    write_parquet(polars.concat([first, *frames]), output)


def _write_csv(frames: Iterator[Any], output: str | None) -> None:
    with nullcontext(sys.stdout) if output is None else open(output, "w", encoding="utf-8", newline="") as file:
        for number, frame in enumerate(frames):
            text = frame.with_columns(polars.col("flags").list.join(" "))
            file.write(text.write_csv(include_header=number == 0, datetime_format=INSTANT))


def _frame(recorded: Recorded, names: Mapping[int, str]) -> Any:
    """One row per vessel. Args: names: of the sources, by number."""
    p = recorded.picture
    sog_kn, cog_deg, major_m, minor_m, orientation_deg = motion(p.velocity_m_s, p.covariance).T
    columns: dict[str, Any] = {
        "cycle": np.full(len(p), recorded.cycle),
        "vessel_id": p.vessel_id,
        "latitude_deg": p.position_deg[:, 0],
        "longitude_deg": p.position_deg[:, 1],
        "sog_kn": sog_kn,
        "cog_deg": cog_deg,
        "mmsi": _mmsi(p.mmsi),
        "nav_status": _nav_status(p.nav_status),
        "flags": _flags(p.flags),
        "time_utc": _utc(p.time_s),
        "since_utc": _utc(p.since_s),
        "updated_utc": _utc(p.updated_s),
        "major_m": major_m,
        "minor_m": minor_m,
        "orientation_deg": orientation_deg,
        "members": _members(p, recorded.members, names),
        "origin": p.origin,
        "east_m_s": p.velocity_m_s[:, 0],
        "north_m_s": p.velocity_m_s[:, 1],
        **{f"covariance_{a}_{b}": p.covariance[:, i, j] for i, a in enumerate(AXES) for j, b in enumerate(AXES)},
    }
    plain = (np.ascontiguousarray(column) if isinstance(column, np.ndarray) else column for column in columns.values())
    return polars.DataFrame(dict(zip(columns, plain, strict=True)))


def _utc(time_s: Floats) -> Any:
    return polars.Series(np.round(time_s * 1e6).astype(np.int64)).cast(polars.Datetime("us", "UTC"))


def _mmsi(mmsi: Ints) -> Any:
    """Nine digits, or nothing for -1."""
    return polars.Series([f"{number:09d}" if number >= 0 else None for number in mmsi.tolist()], dtype=polars.String)


def _nav_status(status: Ints) -> Any:
    """In words, or nothing for -1."""
    words = {number: nav_status_text(number) for number in np.unique(status[status >= 0]).tolist()}
    return polars.Series([words.get(number) for number in status.tolist()], dtype=polars.String)


def _flags(flags: Array) -> Any:
    words = {number: flag_words(number).split() for number in np.unique(flags).tolist()}
    return polars.Series([words[number] for number in flags.tolist()], dtype=polars.List(polars.String))


def _members(picture: Picture, members: Members, names: Mapping[int, str]) -> Any:
    """The tracks of each vessel, "guanabara:17 ais:5000000003"."""
    source = [names.get(number, str(number)) for number in members.source.tolist()]
    tracks = [f"{name}:{track}" for name, track in zip(source, members.track_id.tolist(), strict=True)]
    first = np.searchsorted(members.vessel_id, picture.vessel_id).tolist()
    last = np.searchsorted(members.vessel_id, picture.vessel_id, "right").tolist()
    texts = [" ".join(tracks[a:b]) for a, b in zip(first, last, strict=True)]
    return polars.Series(texts, dtype=polars.String)
