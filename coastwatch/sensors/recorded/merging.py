"""Merges reports of several files and kinds into a Recording, in order of arrival."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np

from coastwatch.batches import (
    AisReports,
    AisStatics,
    BearingReports,
    Fault,
    Floats,
    RadarReports,
    Recording,
    Reports,
    Trajectories,
)
from coastwatch.sensors.recorded.faults import refused

AnyReports = TypeVar("AnyReports", RadarReports, AisReports, AisStatics, BearingReports)


def by_arrival(parts: list[AnyReports]) -> AnyReports:
    """The rows of all parts in order of arrival; rows with equal times in order of the parts. Needs at least one part."""
    if len(parts) == 1:
        return parts[0]
    together: Any = type(parts[0]).join(parts)
    out: AnyReports = together.take(np.argsort(together.received_s, kind="stable"))
    return out


def span_of(*received_s: Floats, faults: tuple[Fault, ...] = ()) -> tuple[float, float]:
    """The whole seconds before the first and at or after the last arrival.

    Raises: ValueError if nothing arrived; the message lists the refused records.
    """
    got = [r for r in received_s if len(r)]
    if not got:
        refusals = "; ".join(f"{f.count} {f.kind} (first at {f.where})" for f in refused(faults)) or "nothing was refused"
        raise ValueError(f"recorded input: got no usable record, needed at least one: {refusals}")
    first, last = min(float(r[0]) for r in got), max(float(r[-1]) for r in got)
    return float(np.ceil(first) - 1.0), float(np.ceil(last))


def recording(
    radar: RadarReports | None = None,
    ais: AisReports | None = None,
    statics: AisStatics | None = None,
    bearing: BearingReports | None = None,
    truth: Trajectories | None = None,
    faults: tuple[Fault, ...] = (),
    silenced: tuple[int, ...] = (),
) -> Recording:
    """A recording of these parts. Without reports it starts and ends at 0."""
    reports = Reports(
        RadarReports.empty() if radar is None else radar,
        AisReports.empty() if ais is None else ais,
        AisStatics.empty() if statics is None else statics,
        BearingReports.empty() if bearing is None else bearing,
    )
    parts = (reports.radar, reports.ais, reports.statics, reports.bearing)
    start_s, stop_s = span_of(*(p.received_s for p in parts)) if len(reports) else (0.0, 0.0)
    return Recording(reports, start_s, stop_s, truth, faults, silenced)


def ais_recording(reports: AisReports, statics: AisStatics, faults: tuple[Fault, ...]) -> Recording:
    """A recording of AIS alone."""
    return recording(ais=reports, statics=statics, faults=faults)
