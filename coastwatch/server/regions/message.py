"""One cycle of a region's tracks as bytes, `coastwatch.tracks.v2`, and back: an npz archive of arrays without objects.

Version 1 has no echoes, and older regions of version 2 no `alternative_m`. A centre leaves the arrays that it does not know, so
all have the same bytes.
"""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from coastwatch.batches import Batch, Bools, Floats, Ints, TrackReports, Tracks, column, optional_column

PROTOCOL = "coastwatch.tracks.v2"
PROTOCOLS = PROTOCOL, "coastwatch.tracks.v1"
"""That are spoken, the newest first."""

OPTIONAL = "echo_length_m", "echo_width_m", "echo_axis_deg", "alternative_m"
"""Columns that an older region does not send."""
RUN_BITS, TRACK_BITS = 14, 48
HEAD = "run", "seq", "time_s"
LARGEST_MESSAGE = 1 << 27
"""Bytes of a message, 640,000 tracks, and of its arrays together: one with compressed arrays could be any size in memory."""


LARGEST_SEQ = 1 << 32
"""Of a cycle in a run: 136 years of one a second. Counts of cycles are stored, and sums of them are to fit in 64 bits too."""

LONGEST_RUN = 64
"""Characters of the name of a run, as its column in the database."""


class MessageError(ValueError):
    """Bytes that are no cycle of tracks, with the reason."""


@dataclass(frozen=True, eq=False)
class RegionTracks(Batch):
    """The tracks of a region after a cycle, all at its time."""

    track_id: Ints = column(np.int64, "N")  # never used again in a run
    updated_s: Floats = column(np.float64, "N")  # of the newest plot in the track
    position_deg: Floats = column(np.float64, "N", 2)
    velocity_m_s: Floats = column(np.float64, "N", 2)
    covariance: Floats = column(np.float64, "N", 4, 4)  # of east, north, east rate, north rate
    echo_length_m: Floats = optional_column("N")  # NaN: not known, or of an older region, here and below
    echo_width_m: Floats = optional_column("N")
    echo_axis_deg: Floats = optional_column("N")
    alternative_m: Floats = optional_column("N")  # as of `Tracks`


@dataclass(frozen=True, eq=False)
class RegionCycle:
    """One cycle of a region."""

    run: str  # number of the run in the region's database, and when it began: `7@2026-07-01T12:00:00Z`
    seq: int  # of the cycle in this run, from 1 on
    time_s: float
    tracks: RegionTracks
    merged: int = 0  # cycles before it that are computed in it, because the region was behind

    def reports(self, source: int) -> TrackReports:
        """The tracks as states of a track source. Their numbers differ between the runs of a region.

        Args: source: number of the track source.
        """
        tracks, n = self.tracks, len(self.tracks)
        when = np.full(n, self.time_s)
        return TrackReports(
            sensor=np.full(n, source, np.int64),
            number=(run_number(self.run) % 2**RUN_BITS << TRACK_BITS) + tracks.track_id % 2**TRACK_BITS,
            time_s=when,
            received_s=when,
            position_deg=tracks.position_deg,
            velocity_m_s=tracks.velocity_m_s,
            covariance=tracks.covariance,
            echo_length_m=tracks.echo_length_m,
            echo_width_m=tracks.echo_width_m,
            echo_axis_deg=tracks.echo_axis_deg,
            alternative_m=tracks.alternative_m,
        )


def run_number(run: str) -> int:
    """The number of a run in its database. Raises: MessageError."""
    number = run.partition("@")[0]
    if not (number.isascii() and number.isdecimal() and len(number) <= 18):
        raise MessageError(f"run: got {run[:40]!r}, needed NUMBER@TIME")
    return int(number)


def radar_tracks(tracks: Tracks, of_regions: Bools) -> RegionTracks:
    """What a region sends of its tracks. Args: of_regions: (N,) whether radars of this centre made the track."""
    return RegionTracks(**{f.name: getattr(tracks, f.name)[of_regions] for f in fields(RegionTracks)})


def encode(cycle: RegionCycle) -> bytes:
    """The bytes of a cycle."""
    file = io.BytesIO()
    head: dict[str, Any] = {"run": np.array(cycle.run), "seq": np.int64(cycle.seq), "time_s": np.float64(cycle.time_s)}
    head["merged"] = np.int64(cycle.merged)
    np.savez(file, **head, **{f.name: getattr(cycle.tracks, f.name) for f in fields(RegionTracks)})
    return file.getvalue()


def decode(data: bytes) -> RegionCycle:
    """The cycle that `encode` was given. Raises: MessageError."""
    wanted = (*HEAD, "merged", *(f.name for f in fields(RegionTracks)))
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > LARGEST_MESSAGE:
            raise MessageError(f"got {size} bytes of arrays, needed at most {LARGEST_MESSAGE}")
        with np.load(io.BytesIO(data)) as file:  # numpy refuses arrays of objects by default
            arrays = {name: file[name] for name in wanted if name in file.files}
        run, time_s = str(arrays["run"][()]), float(arrays["time_s"])
        seq = _count(arrays, "seq")
        merged = _count(arrays, "merged") if "merged" in arrays else 0  # a region of an older version merges none
        names = [f.name for f in fields(RegionTracks) if f.name not in OPTIONAL or f.name in arrays]
        tracks = RegionTracks(**{name: arrays[name] for name in names})
    except Exception as error:  # whatever zipfile and numpy raise on damaged bytes
        raise MessageError(f"damaged cycle of tracks: {type(error).__name__}: {error}") from error
    run_number(run)
    if len(run) > LONGEST_RUN or not (run.isascii() and run.isprintable()):  # what the database would refuse
        raise MessageError(f"run: got {run[:40]!r}, {len(run)} characters, needed printable ASCII, at most {LONGEST_RUN}")
    if not 1 <= seq <= LARGEST_SEQ or not 0 <= merged < seq or not np.isfinite(time_s):
        refusal = f"got seq {seq}, {merged} merged and time {time_s}, needed 1 or more, at most {LARGEST_SEQ}, fewer and a finite time"
        raise MessageError(f"cycle of tracks: {refusal}")
    return RegionCycle(run, seq, time_s, tracks, merged)


def _count(arrays: dict[str, Any], name: str) -> int:
    """The whole number of this name. Raises: MessageError: it is another kind of value."""
    array = arrays[name]
    if array.shape or array.dtype.kind not in "iu":
        raise MessageError(f"{name}: got an array {array.shape} of {array.dtype}, needed a whole number")
    return int(array)
