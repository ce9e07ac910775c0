"""Recorded pictures as CSV and Parquet: every column as it was computed, in SI units."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import nullcontext
from itertools import chain
from typing import Any

import lazy_loader
import numpy as np

from coastwatch import store
from coastwatch.batches import Members, Picture
from coastwatch.operators.bad_input import BadInput
from coastwatch.store import Recorded, Store, StoreError

polars = lazy_loader.load("polars")  # every command that reads imports this module, only `replay` needs polars

Box = tuple[float, float, float, float]
AXES = ("east", "north", "east_rate", "north_rate")


def write(
    found: Store, run_id: int, from_s: float | None, to_s: float | None, bbox: Box | None, *, form: str, output: str | None
) -> None:
    """Writes the recorded cycles between two instants to a file, or to the terminal if `output` is None.

    Args: form: csv, written cycle by cycle, or parquet. Raises: BadInput; StoreError if no cycle is recorded.
    """
    if form == "parquet" and output is None:
        raise BadInput("Parquet is not text: got no --output, needed --output FILE")
    if from_s is not None and to_s is not None and from_s > to_s:
        raise BadInput("--from: got an instant after --to, needed one before it")
    frames = (_frame(cycle) for cycle in store.replay(found, run_id, from_s, to_s, bbox))
    first = next(frames, None)
    if first is None:
        raise StoreError(
            f"{found.where}: run {run_id} has no recorded cycle in that time span; the setting `store.recording` records a run"
        )
    if form == "csv":
        _write_csv(chain([first], frames), output)
        return
    polars.concat([first, *frames]).write_parquet(str(output))


def _write_csv(frames: Iterator[Any], output: str | None) -> None:
    with nullcontext(sys.stdout) if output is None else open(output, "w", encoding="utf-8", newline="") as file:
        for number, frame in enumerate(frames):
            file.write(frame.write_csv(include_header=number == 0))


def _frame(recorded: Recorded) -> Any:
    """One row per vessel."""
    p = recorded.picture
    matrix = {f"covariance_{a}_{b}": p.covariance[:, i, j] for i, a in enumerate(AXES) for j, b in enumerate(AXES)}
    columns = {
        "cycle": np.full(len(p), recorded.cycle),
        "vessel_id": p.vessel_id,
        "time_s": p.time_s,
        "latitude_deg": p.position_deg[:, 0],
        "longitude_deg": p.position_deg[:, 1],
        "east_m_s": p.velocity_m_s[:, 0],
        "north_m_s": p.velocity_m_s[:, 1],
        "since_s": p.since_s,
        "updated_s": p.updated_s,
        "mmsi": p.mmsi,
        "flags": p.flags,
        "origin": p.origin,
        **matrix,
    }
    frame = polars.DataFrame({name: np.ascontiguousarray(column) for name, column in columns.items()})
    return frame.with_columns(polars.Series("members", _members(p, recorded.members), dtype=polars.String))


def _members(picture: Picture, members: Members) -> list[str]:
    """The tracks of each vessel, "0:17 2:5000000003"."""
    words = [f"{source}:{track}" for source, track in zip(members.source.tolist(), members.track_id.tolist(), strict=True)]
    first = np.searchsorted(members.vessel_id, picture.vessel_id).tolist()
    last = np.searchsorted(members.vessel_id, picture.vessel_id, "right").tolist()
    return [" ".join(words[a:b]) for a, b in zip(first, last, strict=True)]
