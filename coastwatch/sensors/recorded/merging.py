"""Merges reports of several files and kinds into a Recording, in order of arrival."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np

from coastwatch.batches import (
    AisReports,
    AisStatics,
    BearingReports,
    Fault,
    FileContent,
    Floats,
    RadarReports,
    Recording,
    Reports,
    ReportStream,
    TrackReports,
    Trajectories,
)
from coastwatch.errors import InputError
from coastwatch.formats.intake.ais_validation import LATITUDE
from coastwatch.formats.intake.faults import refused
from coastwatch.formats.intake.reception_time import TIME_MISSING

REMEDY = "--set input.assume_start_utc=2026-07-01T12:00:00Z sets the time of the first sentence"
SWAPPED = "positions are decimal degrees; --columns latitude=THEIR-LONGITUDE,longitude=THEIR-LATITUDE mends swapped ones"

AnyReports = TypeVar("AnyReports", RadarReports, AisReports, AisStatics, BearingReports, TrackReports)


def by_arrival(parts: list[AnyReports]) -> AnyReports:
    """The rows of all parts in order of arrival; rows with equal times in order of the parts. Needs at least one part."""
    if len(parts) == 1:
        return parts[0]
    together: Any = type(parts[0]).join(parts)
    in_order: AnyReports = together.take(np.argsort(together.received_s, kind="stable"))
    return in_order


def span_of(*received_s: Floats, faults: tuple[Fault, ...] = ()) -> tuple[float, float]:
    """The whole seconds before the first and at or after the last arrival.

    Raises: InputError if nothing arrived; the message lists the refused records.
    """
    got = [r for r in received_s if len(r)]
    if not got:
        refusals = "; ".join(f"{f.count} {f.kind} (first at {f.where})" for f in refused(faults)) or "nothing was refused"
        remedy = f"; if no line has a time, {REMEDY}" if any(f.kind == TIME_MISSING for f in faults) else ""
        remedy += f"; {SWAPPED}" if any(f.kind == LATITUDE for f in faults) else ""
        raise InputError(f"recorded input: got no usable record, needed at least one: {refusals}{remedy}")
    first, last = min(float(r[0]) for r in got), max(float(r[-1]) for r in got)
    return float(np.ceil(first) - 1.0), float(np.ceil(last))


class MergedStream:
    """Reports in memory and streams as one stream."""

    def __init__(self, fixed: Reports, streams: Sequence[ReportStream]) -> None:
        self._parts: tuple[Reports | ReportStream, ...] = (fixed, *streams)
        self._fixed, self._streams = fixed, streams

    def between(self, after_s: float, until_s: float) -> Reports:
        """As `ReportStream.between`."""
        return Reports.merged([part.between(after_s, until_s) for part in self._parts])

    def rest(self, after_s: float) -> int:
        """As `ReportStream.rest`."""
        return len(self._fixed.between(after_s, np.inf)) + sum(part.rest(after_s) for part in self._streams)

    def faults(self) -> tuple[Fault, ...]:
        """As `ReportStream.faults`."""
        return tuple(fault for stream in self._streams for fault in stream.faults())

    def contents(self) -> tuple[FileContent, ...]:
        """As `ReportStream.contents`."""
        return tuple(content for stream in self._streams for content in stream.contents())


def recording(
    radar: RadarReports | None = None,
    ais: AisReports | None = None,
    statics: AisStatics | None = None,
    bearing: BearingReports | None = None,
    tracks: TrackReports | None = None,
    truth: Trajectories | None = None,
    faults: tuple[Fault, ...] = (),
    silenced: tuple[int, ...] = (),
) -> Recording:
    """A recording of these parts."""
    reports = Reports(
        RadarReports.empty() if radar is None else radar,
        AisReports.empty() if ais is None else ais,
        AisStatics.empty() if statics is None else statics,
        BearingReports.empty() if bearing is None else bearing,
        TrackReports.empty() if tracks is None else tracks,
    )
    return Recording(reports, truth, faults, silenced)


def ais_recording(reports: AisReports, statics: AisStatics, faults: tuple[Fault, ...]) -> Recording:
    """A recording of AIS alone."""
    return recording(ais=reports, statics=statics, faults=faults)
