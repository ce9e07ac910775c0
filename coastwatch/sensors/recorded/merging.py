"""Reports of several files and kinds as one, in order of arrival."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

from coastwatch.batches import (
    AisReports,
    AisStatics,
    BearingReports,
    Fault,
    FileContent,
    Floats,
    RadarReports,
    Reports,
    ReportStream,
    TrackReports,
)
from coastwatch.errors import InputError
from coastwatch.formats.intake.ais_validation import LATITUDE
from coastwatch.formats.intake.faults import refused
from coastwatch.formats.intake.reception_time import TIME_MISSING
from coastwatch.spelling import utc_text

REMEDY = "--set input.assume_start_utc=2026-07-01T12:00:00Z sets the time of the first sentence"
SWAPPED = "positions are decimal degrees; --columns latitude=THEIR-LONGITUDE,longitude=THEIR-LATITUDE mends swapped ones"

DAY_S = 86_400.0
LONGEST_SPARSE_S, MOST_EMPTY = 31.0 * DAY_S, 0.5
"""A longer run is refused where gaps of more than a day are more than this share of it."""

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

    Raises: InputError if nothing arrived; the message lists the refused records, or those set aside where none was refused.
    """
    got = [r for r in received_s if len(r)]
    if not got:
        refusals = (
            "; ".join(f"{f.count} {f.kind} (first at {f.first})" for f in refused(faults) or faults) or "nothing was refused"
        )
        remedy = f"; if no line has a time, {REMEDY}" if any(f.kind == TIME_MISSING for f in faults) else ""
        remedy += f"; {SWAPPED}" if any(f.kind == LATITUDE for f in faults) else ""
        raise InputError(f"recorded input: got no usable record, needed at least one: {refusals}{remedy}")
    first, last = min(float(r[0]) for r in got), max(float(r[-1]) for r in got)
    return float(np.ceil(first) - 1.0), float(np.ceil(last))


class FileTimes(NamedTuple):
    """When the reports of a file arrived."""

    name: str
    received_s: Floats  # in any order; of a stream its first and last alone
    is_stream: bool = False  # it counts as without a gap


def check_gaps(files: Sequence[FileTimes], after_s: float) -> None:
    """Refuses files that are so far apart that a run over all of them would be long and mostly empty.

    Args: after_s: where the run begins. Raises: InputError that names the files with their times, and how to go on.
    """
    begins = np.concatenate([file.received_s[:1] if file.is_stream else np.sort(file.received_s) for file in files])
    ends = np.concatenate([file.received_s[-1:] if file.is_stream else np.sort(file.received_s) for file in files])
    order = np.argsort(begins[ends > after_s], kind="stable")
    begins, ends = begins[ends > after_s][order], np.maximum.accumulate(ends[ends > after_s][order])
    gaps_s = np.maximum(begins[1:] - ends[:-1], 0.0)
    empty_s, whole_s = float(gaps_s[gaps_s > DAY_S].sum()), float(ends[-1] - begins[0]) if len(ends) else 0.0
    if whole_s <= LONGEST_SPARSE_S or empty_s <= MOST_EMPTY * whole_s:
        return
    named = [f"{file.name} ({_utc(file.received_s.min())} to {_utc(file.received_s.max())})" for file in files]
    last = int(np.argmax(gaps_s))
    raise InputError(
        f"recorded input: got {', '.join(named)}, with no report between {_utc(ends[last])} and {_utc(begins[last + 1])}, needed less "
        f"than {LONGEST_SPARSE_S / DAY_S:.0f} days, or reports on half of them: leave out the file or the rows of a wrong time, or name "
        f"the time of the run, --set start_utc={_utc(begins[0])} --set cycles=1200"
    )


def _utc(time_s: float) -> str:
    return utc_text(time_s, "seconds")


class MergedStream:
    """Reports in memory and streams as one `ReportStream`."""

    def __init__(self, fixed: Reports, streams: Sequence[ReportStream]) -> None:
        self._parts: tuple[Reports | ReportStream, ...] = (fixed, *streams)
        self._fixed, self._streams = fixed, streams

    def between(self, after_s: float, until_s: float) -> Reports:
        return Reports.merged([part.between(after_s, until_s) for part in self._parts])

    def rest(self, after_s: float) -> int:
        return len(self._fixed.between(after_s, np.inf)) + sum(part.rest(after_s) for part in self._streams)

    def faults(self) -> tuple[Fault, ...]:
        return tuple(fault for stream in self._streams for fault in stream.faults())

    def contents(self) -> tuple[FileContent, ...]:
        return tuple(content for stream in self._streams for content in stream.contents())
