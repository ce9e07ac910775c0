"""The feed `nmea`: AIVDM and AIVDO sentences with or without tag blocks, reception times and clock sentences."""

from __future__ import annotations

import gzip
import math
import zlib
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import AwareDatetime, Field

from coastwatch.batches import AisReports, AisStatics, Fault, Floats, Recording, Sensors
from coastwatch.sensors.recorded.ais_messages import PositionRow, StaticRow, rows_of, whole
from coastwatch.sensors.recorded.ais_validation import AisIntake, AisRows, StaticRows, accept
from coastwatch.sensors.recorded.faults import SET_ASIDE, Tally
from coastwatch.sensors.recorded.file_locations import Fingerprint, fingerprint
from coastwatch.sensors.recorded.merging import ais_recording, by_arrival, span_of
from coastwatch.sensors.recorded.nmea_sentences import ais_sentences
from coastwatch.stage import Method, Plan

TIME_MISSING = "time missing"
TIME_OF_NEIGHBOUR = SET_ASIDE + "time missing, that of its neighbour taken"
OWN_SHIP = SET_ASIDE + "own ship"
CUT_FILE = "file cut short"

REMEDY = "--set input.assume_start_utc=2026-07-01T12:00:00Z sets the time of the first sentence"

GZIP_MAGIC = b"\x1f\x8b"


class Nmea(Method):
    """AIS from files of NMEA 0183 sentences. Settings: coastwatch/sensors/recorded/README.md."""

    method: Literal["nmea"] = "nmea"
    files: Annotated[tuple[Path, ...], Field(min_length=1)]  # each in order of arrival; compressed (gzip) or not
    assume_start_utc: AwareDatetime | None = None  # time of the first sentence, if no line has a time
    assume_interval_s: Annotated[float, Field(ge=0.0)] = 0.1  # between messages, if no line has a time
    drop_own_ship: bool = False  # leave out VDO, and VDM of the same MMSI
    intake: AisIntake = AisIntake()  # which records are accepted

    def load(self, sensors: Sensors, seed: int, plan: Plan) -> Recording:
        """AIS reports and static data of all files in order of arrival, and the faults.

        Raises: FileNotFoundError or OSError that names the file.
        """
        return ais_recording(*self.read())

    def span(self) -> tuple[float, float]:
        """Whole seconds before the first and after the last time of reception.

        Raises: ValueError if no record is usable.
        """
        reports, statics, faults = self.read()
        return span_of_nmea(reports.received_s, statics.received_s, faults=faults)

    def read(self) -> tuple[AisReports, AisStatics, tuple[Fault, ...]]:
        """Reports and static data of all files in order of arrival, and the faults."""
        return _read(self, fingerprint(self.files))


def span_of_nmea(*received_s: Floats, faults: tuple[Fault, ...]) -> tuple[float, float]:
    """As `span_of`. Raises: ValueError; if the sentences have no time, the message says how to set one."""
    try:
        return span_of(*received_s, faults=faults)
    except ValueError as error:
        if not any(f.kind == TIME_MISSING for f in faults):
            raise
        raise ValueError(f"{error}; if no line has a time, {REMEDY}") from error


class _Raw(NamedTuple):
    positions: list[PositionRow]
    statics: list[StaticRow]
    own: set[int]  # lines of VDO
    stamp_s: Floats  # of each message; NaN: not known


@lru_cache(maxsize=1)
def _read(settings: Nmea, files: Fingerprint) -> tuple[AisReports, AisStatics, tuple[Fault, ...]]:
    tally = Tally()
    parts = [_one_file(settings, path, tally) for path, _, _ in files]
    reports, statics = by_arrival([p[0] for p in parts]), by_arrival([p[1] for p in parts])
    return reports, statics, tally.faults()


def _one_file(settings: Nmea, path: Path, tally: Tally) -> tuple[AisReports, AisStatics]:
    name = path.name
    raw = _messages(settings, path, tally)
    rows = _position_rows(raw)
    statics, static_rows = _static_rows(raw)
    rows, static_rows = rows.take(np.isfinite(rows.stamp_s)), static_rows.take(np.isfinite(static_rows.stamp_s))
    if settings.drop_own_ship:
        rows, static_rows = _without_own(rows, static_rows, statics, raw.own, name, tally)
    return accept(rows, statics, static_rows, settings.intake, tally, lambda line: f"{name}:{line}")


def _position_rows(raw: _Raw) -> AisRows:
    table = list(zip(*raw.positions, strict=True)) or [()] * 10
    return AisRows(
        row=np.array(table[0], np.int64),
        stamp_s=raw.stamp_s[np.array(table[1], np.int64)],
        fix_s=np.full(len(table[0]), np.nan),
        second=np.array(table[2], np.int64),
        mmsi=np.array(table[3], np.int64),
        position_deg=np.stack([np.array(table[4], np.float64), np.array(table[5], np.float64)], axis=-1),
        sog_kn=np.array(table[6], np.float64),
        cog_deg=np.array(table[7], np.float64),
        class_b=np.array(table[8], np.bool_),
        digest=np.array(table[9], np.int64),
    )


def _messages(settings: Nmea, path: Path, tally: Tally) -> _Raw:
    """The rows of a file, and the reception time of each message, NaN if unknown."""
    name = path.name
    positions: list[PositionRow] = []
    statics: list[StaticRow] = []
    own: set[int] = set()
    stamps: list[float] = []
    lines: list[int] = []
    for message in whole(ais_sentences(_lines(path, tally), name, tally), name, tally):
        position, static = rows_of(message, len(stamps), name, tally)
        stamps.append(message.clock_s if math.isnan(message.own_s) else message.own_s)
        lines.append(message.line)
        if message.sentence.type == "VDO":
            own.add(message.line)
        if position is not None:
            positions.append(position)
        if static is not None:
            statics.append(static)
    stamp_s = np.array(stamps, np.float64)
    missing = np.isnan(stamp_s)
    kind = TIME_MISSING if missing.all() and settings.assume_start_utc is None else TIME_OF_NEIGHBOUR
    if not missing.all() or settings.assume_start_utc is None:
        tally.add_rows(kind, missing, lambda i: f"{name}:{lines[i]}", lambda i: "")
    return _Raw(positions, statics, own, _filled(stamp_s, settings))


def _filled(stamp_s: Floats, settings: Nmea) -> Floats:
    """Stamps with the missing ones taken from the message before, at the start from the first known; or assumed, if all are missing."""
    known = np.flatnonzero(np.isfinite(stamp_s))
    if len(known):
        before = np.maximum.accumulate(np.where(np.isfinite(stamp_s), np.arange(len(stamp_s)), known[0]))
        return np.asarray(stamp_s[before])
    if settings.assume_start_utc is None:
        return stamp_s
    steps = np.arange(len(stamp_s), dtype=np.float64)
    return np.asarray(settings.assume_start_utc.timestamp() + settings.assume_interval_s * steps)


def _static_rows(raw: _Raw) -> tuple[AisStatics, StaticRows]:
    table = list(zip(*raw.statics, strict=True)) or [()] * 9
    received = raw.stamp_s[np.array(table[1], np.int64)]
    statics = AisStatics(
        received_s=received,
        mmsi=np.array(table[3], np.int64),
        name=np.array(table[4], "U20"),
        call_sign=np.array(table[5], "U7"),
        ship_type=np.array(table[6], np.int64),
        length_m=np.array(table[7], np.float64),
        beam_m=np.array(table[8], np.float64),
    )
    static_rows = StaticRows(
        row=np.array(table[0], np.int64),
        stamp_s=received,
        digest=np.array(table[2], np.int64),
        static=np.arange(len(raw.statics), dtype=np.int64),
    )
    return statics, static_rows


def _without_own(
    rows: AisRows, static_rows: StaticRows, statics: AisStatics, own: set[int], name: str, tally: Tally
) -> tuple[AisRows, StaticRows]:
    """The rows that are not of the own ship: neither VDO nor of an MMSI in a VDO."""
    lines = np.array(sorted(own), np.int64)
    number = statics.mmsi[static_rows.static]
    mine = np.concatenate([rows.mmsi[np.isin(rows.row, lines)], number[np.isin(static_rows.row, lines)]])
    own_rows, own_statics = np.isin(rows.mmsi, mine), np.isin(number, mine)
    tally.add_rows(OWN_SHIP, own_rows, lambda i: f"{name}:{rows.row[i]}", lambda i: f"MMSI {rows.mmsi[i]}")
    tally.add_rows(
        OWN_SHIP, own_statics, lambda i: f"{name}:{static_rows.row[i]}", lambda i: f"static data of MMSI {number[i]}"
    )
    return rows.take(~own_rows), static_rows.take(~own_statics)


def _lines(path: Path, tally: Tally) -> Iterator[bytes]:
    """The lines of a file, decompressed if needed. A truncated file is counted and used as far as it goes."""
    read = 0
    with path.open("rb") as plain:
        packed = plain.read(2) == GZIP_MAGIC
    with gzip.open(path, "rb") if packed else path.open("rb") as stream:
        try:
            for line in stream:
                read += 1
                yield line
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            if not read:
                raise OSError(f"{path}: got {error}, needed text or gzip") from error
            tally.add(CUT_FILE, f"{path.name}:{read}", str(error))
