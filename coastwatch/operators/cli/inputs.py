"""What a run took from its files, and what looks wrong about it: in lines for a terminal, and for JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from coastwatch.batches import Fault, FileContent, RadarCorrections
from coastwatch.formats.intake.accounts import LOSSES, accounts
from coastwatch.formats.intake.faults import refused
from coastwatch.geodesy import from_plane
from coastwatch.operators.typed import Box
from coastwatch.scenario import Scenario
from coastwatch.scenario.sites import Radar, Station
from coastwatch.server.run import RunResult
from coastwatch.spelling import utc_text

FIRST_RECORDING_S = 315_532_800.0  # 1980
NEAR_DEG = 3.0
CUT_S = 3_600.0
"""Files of one kind that follow each other so soon are one recording, cut in parts."""

SURE_S, ALIKE_S, LATE_S = 1.0, 2.0, 3.0
"""Time lags of radars that are known so well, that differ by so little, and that are so large, are the lag of AIS."""

UNKNOWN_SENSORS = ("unknown radar", "unknown sonar", "unknown track source")


def contents_as_lines(contents: Sequence[FileContent]) -> Iterator[str]:
    """Each file: records, time span, columns read as ours=the file's, columns ignored."""
    if contents:
        yield "files"
    for file in contents:
        yield f"  {file.name}: {file.records:,} {file.kind}" + (f", {span_of(file)}" if file.records else "")
        if file.columns:
            yield "    columns read: " + ", ".join(our if our == theirs else f"{our}={theirs}" for our, theirs in file.columns)
        if file.ignored:
            yield "    columns ignored: " + ", ".join(file.ignored)
        yield from (f"    {note}" for note in file.notes)


def contents_as_objects(contents: Sequence[FileContent]) -> list[dict[str, object]]:
    """The same for JSON."""
    keys = ("name", "kind", "records", "read", "beside", "first_s", "last_s", "columns", "ignored", "notes")
    pairs = ("beside", "columns")
    return [{key: dict(getattr(file, key)) if key in pairs else getattr(file, key) for key in keys} for file in contents]


def accounts_as_lines(result: RunResult) -> Iterator[str]:
    """What became of the records that were read: in reports, beside them, refused, set aside."""
    if not result.contents:
        return
    counts = accounts(result.contents, result.faults_of_input)
    parts = [(counts.in_reports, "in reports"), *((count, what) for what, count in counts.beside)]
    parts += [(counts.refused, "refused"), (counts.set_aside, "set aside")]
    yield f"records: {counts.read:,} read = " + " + ".join(f"{count:,} {what}" for count, what in parts)


def accounts_as_object(result: RunResult) -> dict[str, object] | None:
    """The same for JSON; none without files."""
    if not result.contents:
        return None
    counts = accounts(result.contents, result.faults_of_input)
    return {**counts._asdict(), "beside": dict(counts.beside), "unaccounted": counts.unaccounted}


def warnings(scenario: Scenario, result: RunResult) -> list[str]:
    """What an operator should check: records that were lost, files of odd times or places, and why a picture is empty."""
    lost = [
        f"{fault.count:,} {fault.kind} ({fault.where}){f': {fault.example}' if fault.example else ''}"
        for fault in result.faults
        if fault.kind in LOSSES
    ]
    of_files = warnings_of_files(scenario, result.contents, result.faults)
    of_radars = *_alike_lags(result.corrections), *_wrong_sites(scenario, result.corrections)
    return [*lost, *of_files, *_nothing_taken(result), *_empty_picture(result), *of_radars]


def _alike_lags(corrections: RadarCorrections) -> Iterator[str]:
    """That all radars are late by the same time, against AIS: then it is AIS that is not of the time that it says."""
    lag_s = corrections.estimated_lag_s[corrections.lag_sigma_s <= SURE_S]
    if len(lag_s) > 1 and np.ptp(lag_s) <= ALIKE_S and abs(float(np.median(lag_s))) >= LATE_S:
        late_s = float(np.median(lag_s))
        sign = "late" if late_s < 0.0 else "ahead"
        yield (
            f"the {len(lag_s)} radars seem to be off by the same {late_s:.1f} s against AIS: more likely the times of AIS are "
            f"{abs(late_s):.1f} s {sign}"
        )


def _wrong_sites(scenario: Scenario, corrections: RadarCorrections) -> Iterator[str]:
    """The radars whose stated place seems to be wrong, and where they stand then."""
    for r in np.flatnonzero(np.isfinite(corrections.site_sigma_m).all(axis=1)).tolist():
        radar, off_m = scenario.radars[r], corrections.site_error_m[r]
        text = f"{abs(off_m[0]):.0f} m {'east' if off_m[0] > 0.0 else 'west'}"
        text += f" and {abs(off_m[1]):.0f} m {'north' if off_m[1] > 0.0 else 'south'}"
        said = f"radar {radar.name}: its stated site seems to be {text} of the antenna, against AIS; its plots were moved"
        if radar.latitude_deg is not None:
            there = from_plane(-off_m, np.array([radar.latitude_deg, radar.longitude_deg]))
            said += f". If that is so, state latitude_deg = {there[0]:.5f} and longitude_deg = {there[1]:.5f}"
        yield said


def warnings_of_files(scenario: Scenario, contents: Sequence[FileContent], faults: Sequence[Fault]) -> list[str]:
    """The warnings that need no result: files of odd times, files that do not overlap in time or in place, unknown sensors, odd speeds."""
    read = [file for file in contents if file.records]
    return [
        *(
            f"{file.name}: its times are {span_of(file)}: are they seconds from a start, or days of a spreadsheet? "
            f"Numbers count as Unix time; with --columns time=NAME another column has the time"
            for file in read
            if file.last_s < FIRST_RECORDING_S  # no recording is so old
        ),
        *_without_overlap(read),
        *_elsewhere(scenario, contents),
        *(
            f"{fault.count:,} rows are left out: {fault.kind} (first at {fault.first})"
            for fault in faults
            if fault.kind in UNKNOWN_SENSORS and any(fault.where.startswith(file.name) for file in read)
        ),
        *(f"{file.name}: {doubt}" for file in contents for doubt in file.doubts),
    ]


def span_of(file: FileContent) -> str:
    """From when to when, UTC."""
    return f"{_utc(file.first_s)} to {_utc(file.last_s)}"


def _without_overlap(files: Sequence[FileContent]) -> Iterator[str]:
    """Each file that overlaps no other in time, with the one nearest to it; every pair once. One that follows another of its kind within
    CUT_S is a part of the same recording.
    """
    named: set[frozenset[int]] = set()
    for k, file in enumerate(files):
        gaps = {
            i: max(file.first_s - other.last_s, other.first_s - file.last_s, 0.0) for i, other in enumerate(files) if i != k
        }
        nearest = min(gaps, key=lambda i: gaps[i], default=k)
        allowed_s = CUT_S if file.kind == files[nearest].kind else 0.0
        if gaps and gaps[nearest] > allowed_s and {k, nearest} not in named:
            named.add(frozenset((k, nearest)))
            yield (
                f"{file.name} and {files[nearest].name} do not overlap in time: {span_of(file)}, and {span_of(files[nearest])}, "
                f"{gaps[nearest] / 3600.0:.2f} h apart; is the time zone of one of them wrong?"
            )


def _nothing_taken(result: RunResult) -> Iterator[str]:
    """Each file of which no record was taken, beside files that have some, and the faults of the file."""
    if not any(file.records for file in result.contents):
        return
    for file in result.contents:
        if not file.records:
            faults = [f for f in result.faults if f.where.startswith(file.name)]
            refusals = ", ".join(f"{f.count:,} {f.kind} (first at {f.first})" for f in faults) or "it has none"
            yield f"{file.name}: no record was taken: {refusals}"


def _elsewhere(scenario: Scenario, contents: Sequence[FileContent]) -> Iterator[str]:
    """Each file whose positions are far from every sensor that has a range, or without any, from every other file."""
    discs: list[Box] = []
    sites: list[Radar | Station] = [*scenario.radars, *scenario.stations]
    for s in sites:
        if s.latitude_deg is not None and s.longitude_deg is not None:
            reach = s.range_nm / 60.0
            wide = reach / max(math.cos(math.radians(s.latitude_deg)), 0.1)
            discs.append((s.latitude_deg - reach, s.longitude_deg - wide, s.latitude_deg + reach, s.longitude_deg + wide))
    boxes = [(file.name, file.box_deg) for file in contents if file.box_deg is not None]
    for k, (name, (south, west, north, east)) in enumerate(boxes):
        others = discs or [box for i, (_, box) in enumerate(boxes) if i != k]
        if others and not any(_near((south, west, north, east), other) for other in others):
            swapped = any(_near((west, south, east, north), other) for other in others)
            ask = "are latitude and longitude swapped?" if swapped else "is one of the positions wrong?"
            what = "sensor" if discs else "other file"
            yield (
                f"{name} lies far from every {what}, at latitude {south:.2f} to {north:.2f}, longitude {west:.2f} to {east:.2f}: "
                f"{ask}"
            )


def _near(a: Box, b: Box) -> bool:
    """Whether two boxes lie within NEAR_DEG of each other. One over the antimeridian may count as near."""
    gap_deg = (b[1] + b[3] - a[1] - a[3]) / 2.0
    gap_deg = abs((gap_deg + 180.0) % 360.0 - 180.0) - (a[3] - a[1] + b[3] - b[1]) / 2.0
    return a[0] - NEAR_DEG < b[2] and b[0] - NEAR_DEG < a[2] and gap_deg < NEAR_DEG


def _empty_picture(result: RunResult) -> Iterator[str]:
    """Why the last picture has no vessel. A run of simulated sensors has no files."""
    if result.vessels or not result.contents:
        return
    read = [file for file in result.contents if file.records]
    kinds = {file.kind for file in read}
    if not read:
        refusals = ", ".join(f"{f.count:,} {f.kind} (first at {f.where})" for f in refused(result.faults))
        why = f"every record was refused: {refusals}" if refusals else "the files hold none"
    elif result.most_vessels:
        why = (
            f"there were up to {result.most_vessels:,} at {_utc(result.most_vessels_s)}; the newest record is of "
            f"{_utc(max(file.last_s for file in read))}, the last cycle of {_utc(result.stop_s)}"
        )
    elif kinds == {"bearings"}:
        why = "bearings alone place no vessel, they need radar, AIS or tracks"
    elif kinds == {"radar plots"}:
        why = "no plots of a radar followed one another as those of a vessel do: check its position, rpm, range and noise"
    else:
        why = "no track was confirmed: check units and times of the columns above, and --period"
    yield f"0 vessels from {', '.join(f'{file.records:,} {file.kind}' for file in read) or '0 records'}: {why}"


def _utc(time_s: float) -> str:
    return utc_text(time_s, "seconds") if math.isfinite(time_s) else "-"
