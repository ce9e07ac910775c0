"""What a run took from its files, and what looks wrong about it: in lines for a terminal, and for JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from typing import Any

FIRST_RECORDING_S = 315_532_800.0  # 1980
NEAR_DEG = 3.0
UNKNOWN_SENSORS = ("unknown radar", "unknown sonar", "unknown track source")


def contents_as_lines(contents: Sequence[Any]) -> Iterator[str]:
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


def accounts_as_lines(result: Any) -> Iterator[str]:
    """What became of the records that were read: in reports, beside them, refused, set aside."""
    if not result.contents:
        return
    found = _accounts(result)
    parts = [(found.in_reports, "in reports"), *((count, what) for what, count in found.beside)]
    parts += [(found.refused, "refused"), (found.set_aside, "set aside")]
    yield f"records: {found.read:,} read = " + " + ".join(f"{count:,} {what}" for count, what in parts)


def accounts_as_object(result: Any) -> dict[str, Any] | None:
    """The same for JSON; none without files."""
    if not result.contents:
        return None
    found = _accounts(result)
    return {**found._asdict(), "beside": dict(found.beside), "unaccounted": found.unaccounted}


def _accounts(result: Any) -> Any:
    from coastwatch.formats.intake.accounts import accounts  # commands that read a database do not load the feeds

    return accounts(result.contents, result.faults_of_input)


def _lost_records(result: Any) -> Iterator[str]:
    """Each loss of records, which is an error of the program or of a clock in the file."""
    from coastwatch.formats.intake.accounts import LOSSES

    for fault in result.faults:
        if fault.kind in LOSSES:
            yield f"{fault.count:,} {fault.kind} ({fault.where}){f': {fault.example}' if fault.example else ''}"


def contents_as_objects(contents: Sequence[Any]) -> list[dict[str, Any]]:
    """The same for JSON."""
    return [
        {
            "name": file.name,
            "kind": file.kind,
            "records": file.records,
            "read": file.read,
            "beside": dict(file.beside),
            "first_s": file.first_s,
            "last_s": file.last_s,
            "columns": dict(file.columns),
            "ignored": list(file.ignored),
            "notes": list(file.notes),
        }
        for file in contents
    ]


def warnings(scenario: Any, result: Any) -> list[str]:
    """What an operator should check: files of odd times, files that do not overlap in time or in place, and why a picture is empty."""
    of_files = warnings_of_files(scenario, result.contents, result.faults)
    return [*_lost_records(result), *of_files, *_nothing_taken(result), *_empty_picture(result)]


def warnings_of_files(scenario: Any, contents: Sequence[Any], faults: Sequence[Any]) -> list[str]:
    """The warnings that need no result: files of odd times, files that do not overlap in time or in place, unknown sensors, odd speeds."""
    return [
        *_before_1980(contents),
        *_without_overlap(contents),
        *_elsewhere(scenario, contents),
        *_unknown_sensors(contents, faults),
        *(f"{file.name}: {doubt}" for file in contents for doubt in file.doubts),
    ]


def span_of(file: Any) -> str:
    """From when to when, UTC."""
    return f"{_utc(file.first_s)} to {_utc(file.last_s)}"


def _without_overlap(contents: Sequence[Any]) -> Iterator[str]:
    """Each file that overlaps no other in time, with the one nearest to it; every pair once."""
    files = [file for file in contents if file.records]
    said: set[frozenset[int]] = set()
    for k, file in enumerate(files):
        gaps = {i: _gap_s(file, other) for i, other in enumerate(files) if i != k}
        nearest = min(gaps, key=lambda i: gaps[i], default=k)
        if gaps and gaps[nearest] > 0.0 and {k, nearest} not in said:
            said.add(frozenset((k, nearest)))
            yield (
                f"{file.name} and {files[nearest].name} do not overlap in time: {span_of(file)}, and {span_of(files[nearest])}, "
                f"{gaps[nearest] / 3600.0:.2f} h apart; is the time zone of one of them wrong?"
            )


def _nothing_taken(result: Any) -> Iterator[str]:
    """Each file of which no record was taken, beside files that have some, and the faults of the file."""
    taken = any(file.records for file in result.contents)
    for file in result.contents:
        if taken and not file.records:
            faults = [f for f in result.faults if f.where.startswith(file.name)]
            refusals = ", ".join(f"{f.count:,} {f.kind} (first at {f.where}: {f.example})" for f in faults) or "it has none"
            yield f"{file.name}: no record was taken: {refusals}"


def _unknown_sensors(contents: Sequence[Any], faults: Sequence[Any]) -> Iterator[str]:
    """The rows of files with other rows that name a sensor which the scenario does not have."""
    taken = [file.name for file in contents if file.records]
    for fault in faults:
        if fault.kind in UNKNOWN_SENSORS and any(map(fault.where.startswith, taken)):
            yield f"{fault.count:,} rows are left out: {fault.kind} (first at {fault.where}: {fault.example})"


def _before_1980(contents: Sequence[Any]) -> Iterator[str]:
    """Each file whose times are before 1980, which no recording is."""
    for file in contents:
        if file.records and file.last_s < FIRST_RECORDING_S:
            yield (
                f"{file.name}: its times are {span_of(file)}: are they seconds from a start, or days of a spreadsheet? "
                f"Numbers count as Unix time; with --columns time=NAME another column has the time"
            )


def _elsewhere(scenario: Any, contents: Sequence[Any]) -> Iterator[str]:
    """Each file whose positions are far from every sensor that has a range, or without any, from every other file."""
    sites = (*scenario.radars, *scenario.stations)
    discs = [_box(s.latitude_deg, s.longitude_deg, s.range_nm / 60.0) for s in sites if s.latitude_deg is not None]
    files = [file for file in contents if file.box_deg is not None]
    for k, file in enumerate(files):
        south, west, north, east = file.box_deg
        others = discs or [other.box_deg for i, other in enumerate(files) if i != k]
        if others and not any(_near(file.box_deg, other) for other in others):
            swapped = any(_near((west, south, east, north), other) for other in others)
            ask = "are latitude and longitude swapped?" if swapped else "is one of the positions wrong?"
            what = "sensor" if discs else "other file"
            yield (
                f"{file.name} lies far from every {what}, at latitude {south:.2f} to {north:.2f}, longitude {west:.2f} to {east:.2f}: "
                f"{ask}"
            )


def _box(latitude: float, longitude: float, reach_deg: float) -> tuple[float, float, float, float]:
    wide = reach_deg / max(math.cos(math.radians(latitude)), 0.1)
    return latitude - reach_deg, longitude - wide, latitude + reach_deg, longitude + wide


def _near(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> bool:
    """Whether two boxes lie within NEAR_DEG of each other. One over the antimeridian may count as near."""
    apart = (b[1] + b[3] - a[1] - a[3]) / 2.0
    apart = abs((apart + 180.0) % 360.0 - 180.0) - (a[3] - a[1] + b[3] - b[1]) / 2.0
    return a[0] - NEAR_DEG < b[2] and b[0] - NEAR_DEG < a[2] and apart < NEAR_DEG


def _gap_s(a: Any, b: Any) -> float:
    gap: float = max(a.first_s - b.last_s, b.first_s - a.last_s, 0.0)
    return gap


def _empty_picture(result: Any) -> Iterator[str]:
    """Why the last picture has no vessel. A run of simulated sensors has no files."""
    if result.vessels or not result.contents:
        return
    taken = [file for file in result.contents if file.records]
    records = ", ".join(f"{file.records:,} {file.kind}" for file in taken) or "0 records"
    yield f"0 vessels from {records}: {_why_empty(result, taken)}"


def _why_empty(result: Any, taken: Sequence[Any]) -> str:
    if not taken:
        from coastwatch.formats.intake.faults import refused  # commands that read a database do not load the feeds

        refusals = ", ".join(f"{f.count:,} {f.kind} (first at {f.where})" for f in refused(result.faults))
        return f"every record was refused: {refusals}" if refusals else "the files hold none"
    newest_s = max(file.last_s for file in taken)
    if result.most_vessels:
        return (
            f"there were up to {result.most_vessels:,} at {_utc(result.most_vessels_s)}; the newest record is of "
            f"{_utc(newest_s)}, the last cycle of {_utc(result.stop_s)}"
        )
    kinds = {file.kind for file in taken}
    if kinds == {"bearings"}:
        return "bearings alone place no vessel, they need radar, AIS or tracks"
    if kinds == {"radar plots"}:
        return "no plots of a radar followed one another as those of a vessel do: check its position, rpm, range and noise"
    return "no track was confirmed: check units and times of the columns above, and --period"


def _utc(time_s: float) -> str:
    if not math.isfinite(time_s):
        return "-"
    return datetime.fromtimestamp(time_s, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
