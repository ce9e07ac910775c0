"""The feed `nmea`: AIVDM and AIVDO sentences of files as one stream, in memory that does not grow with the files."""

from __future__ import annotations

import gzip
import math
import sys
import zlib
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache, partial
from itertools import islice
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import AwareDatetime, Field

from coastwatch.batches import AisReports, AisStatics, Fault, FileContent, Floats, Ints, Recording, Reports, Sensors
from coastwatch.errors import InputError
from coastwatch.formats.intake.ais_validation import Acceptance, AisIntake, AisRows, StaticRows, Timed
from coastwatch.formats.intake.faults import SET_ASIDE, Ledger, Tally
from coastwatch.formats.intake.reception_time import TIME_MISSING, backwards_note, reception_times
from coastwatch.formats.nmea.messages import Assembler, Messages
from coastwatch.formats.nmea.payload import decoded
from coastwatch.formats.nmea.sentences import FURTHER, ais_sentences
from coastwatch.sensors.recorded.files import CUT_FILE, GZIP_MAGIC, Fingerprint, fingerprint, has_sentences, opened
from coastwatch.sensors.recorded.merging import span_of
from coastwatch.stage import Method, NotNegative, Plan

TIME_OF_NEIGHBOUR = SET_ASIDE + "time missing, that of its neighbour taken"
OWN_SHIP = SET_ASIDE + "own ship"
NAMES, WAITING = "names and sizes", "not yet judged"
"""What is beside the positions of a file."""

BLOCK = 25_000  # sentences that are decoded at once
TAIL_BYTES = 1 << 20  # of a long file, read to find its last time


class Nmea(Method):
    """AIS from files of NMEA 0183 sentences."""

    method: Literal["nmea"] = "nmea"
    files: Annotated[tuple[Path, ...], Field(min_length=1)]  # each in order of arrival; compressed (gzip) or not
    assume_start_utc: AwareDatetime | None = None  # time of the first sentence, if no line has a time
    assume_interval_s: NotNegative = 0.1  # between messages, if no line has a time
    drop_own_ship: bool = False  # leave out VDO, and VDM of the same MMSI
    intake: AisIntake = AisIntake()  # which records are accepted

    def load(self, sensors: Sensors, seed: int, plan: Plan) -> Recording:
        """AIS reports and static data of all files as a stream in order of arrival.

        Raises: FileNotFoundError or InputError that names the file.
        """
        return Recording(self.stream(), feeds=tuple(path.name for path in self.files))

    def span(self, sensors: Callable[[], Sensors], after_s: float, to_the_end: bool) -> tuple[float, float]:
        """Whole seconds before the first and after the last time of reception. A long file is read at its start and end only.

        Raises: InputError if no record is usable.
        """
        ends = first_and_last(self, fingerprint(self.files))
        return span_of(ends.received_s, faults=ends.faults)

    def stream(self, first_feed: int = 0) -> NmeaStream:
        """The reports of all files, each a feed, numbered from `first_feed` on."""
        return NmeaStream(self, [path for path, _, _ in fingerprint(self.files)], first_feed)


class _Block(NamedTuple):
    """Decoded rows with finite stamps, and which of them are of the own ship."""

    rows: AisRows
    statics: AisStatics
    static_rows: StaticRows

    @property
    def stamp_s(self) -> Floats:
        """The stamps of all rows, in order of the file."""
        number = np.concatenate([self.rows.row, self.static_rows.row])
        return np.concatenate([self.rows.stamp_s, self.static_rows.stamp_s])[np.argsort(number, kind="stable")]


class _FileStream:
    """The accepted reports of one file, block by block."""

    def __init__(self, settings: Nmea, path: Path, tally: Tally, feed: int = -1) -> None:
        self._settings, self._name, self._tally = settings, path.name, tally
        self._ledger = Ledger()
        self._sentences = ais_sentences(lines_of(path, tally), path.name, tally, self._ledger)
        self._assembler = Assembler(path.name, tally)
        self._acceptance = Acceptance(settings.intake, tally, lambda line: f"{path.name}:{line}", feed)
        self._size = sys.maxsize if settings.intake.order == "time" else BLOCK  # to sort by time takes all of the file
        self._stamp_s = math.nan  # of the newest message that has a time
        self._assumed = 0  # messages so far whose time is assumed
        self._own = np.zeros(0, np.int64)  # MMSI of the own ship
        self._decoded: deque[_Block] = deque()
        self._reports: list[AisReports] = []  # accepted, not yet asked for
        self._statics: list[AisStatics] = []
        self._at_end = False  # no sentence is left to decode
        self._handed_out = np.zeros(2, np.int64)  # reports and static data that no longer wait
        self._first_s, self._last_s = math.inf, -math.inf  # times of the fixes of the accepted reports
        self._corners = [[math.inf, math.inf], [-math.inf, -math.inf]]  # of their positions

    def content(self) -> FileContent:
        """What was taken so far."""
        past, waiting_names = self._handed_out.tolist(), sum(map(len, self._statics))
        count, names = past[0] + sum(map(len, self._reports)), past[1] + waiting_names
        first_s, last_s = (self._first_s, self._last_s) if count else (math.nan, math.nan)
        (south, west), (north, east) = self._corners
        box = (south, west, north, east) if count else None
        waiting = sum(len(block.rows) + len(block.static_rows) for block in self._decoded) + self._assembler.waiting
        beside = tuple((self._ledger.beside + Counter({NAMES: names, WAITING: waiting})).items())
        notes = backwards_note(self._acceptance.backwards)
        return FileContent(
            self._name, "AIS reports", count, first_s, last_s, notes=notes, box_deg=box, read=self._ledger.read, beside=beside
        )

    @property
    def newest_s(self) -> float:
        """The newest time of reception so far; no later record is older."""
        return self._acceptance.newest_s

    @property
    def is_exhausted(self) -> bool:
        """Whether nothing is left to decode or to accept. A block is decoded ahead of the one that is accepted."""
        return self._at_end and not self._decoded

    def between(self, after_s: float, until_s: float) -> tuple[AisReports, AisStatics]:
        """As `ReportStream.between`, of this file."""
        reports, statics = self._due(after_s, until_s)
        while self.newest_s <= until_s and (block := self.block()) is not None:
            self._reports.append(block[0])
            self._statics.append(block[1])
            due = self._due(after_s, until_s)
            reports, statics = [*reports, *due[0]], [*statics, *due[1]]
        return AisReports.join(reports), AisStatics.join(statics)

    def _due(self, after_s: float, until_s: float) -> tuple[list[AisReports], list[AisStatics]]:
        """The waiting reports of a time span. Those up to its end wait no longer."""
        reports, self._reports, older = _split(self._reports, after_s, until_s)
        statics, self._statics, older_statics = _split(self._statics, after_s, until_s)
        self._handed_out += [sum(map(len, reports)) + older, sum(map(len, statics)) + older_statics]
        return reports, statics

    def rest(self, after_s: float) -> int:
        """How many reports come after an instant. The file is read to its end, and nothing of it is kept."""
        count = 0
        waiting: tuple[list[AisReports], list[AisStatics]] | None = self._reports, self._statics
        self._reports, self._statics = [], []
        while waiting is not None:
            count += sum(int((part.received_s > after_s).sum()) for parts in waiting for part in parts)
            self._handed_out += [sum(map(len, parts)) for parts in waiting]
            block = self.block()
            waiting = None if block is None else ([block[0]], [block[1]])
        return count

    def head(self) -> tuple[AisReports, AisStatics]:
        """The first accepted reports and static data. They stay in the stream."""
        while not any(map(len, (*self._reports, *self._statics))) and (block := self.block()) is not None:
            self._reports.append(block[0])
            self._statics.append(block[1])
        return AisReports.join(self._reports), AisStatics.join(self._statics)

    def block(self) -> tuple[AisReports, AisStatics] | None:
        """The next accepted reports and static data, in order of arrival; None at the end of the file."""
        while len(self._decoded) < 2 and not self._at_end:
            self._decoded.append(self._decode())
        if not self._decoded:
            return None
        block = self._decoded.popleft()
        ahead_s = self._decoded[0].stamp_s if self._decoded else None
        rows, statics, static_rows = self._without_own(block) if self._settings.drop_own_ship else block
        reports, static = self._acceptance.block(rows, statics, static_rows, ahead_s)
        self._corners[0] = reports.position_deg.min(axis=0, initial=math.inf).clip(max=self._corners[0]).tolist()
        self._corners[1] = reports.position_deg.max(axis=0, initial=-math.inf).clip(min=self._corners[1]).tolist()
        self._first_s = min(self._first_s, float(reports.time_s.min(initial=math.inf)))
        self._last_s = max(self._last_s, float(reports.time_s.max(initial=-math.inf)))
        return reports, static

    def _decode(self) -> _Block:
        sentences = list(islice(self._sentences, self._size))
        self._at_end = len(sentences) < self._size
        messages = self._assembler.whole(sentences, self._at_end)
        messages = messages._replace(stamp_s=self._with_times(messages))
        rows, statics, static_rows = decoded(messages, self._name, self._tally)
        self._ledger.read += int(np.isin(static_rows.row, rows.row).sum())  # a message with a position and a name
        self._ledger.beside[FURTHER] += int(messages.sentences.sum()) - len(messages.line)
        for rows_of_kind in (rows, static_rows):
            self._tally.add_rows(
                TIME_MISSING, ~np.isfinite(rows_of_kind.stamp_s), partial(_where, self._name, rows_of_kind.row), lambda i: ""
            )
        if self._settings.drop_own_ship:
            own = messages.line[messages.own]
            of_statics = statics.mmsi[np.isin(static_rows.row, own)]
            self._own = np.unique(np.concatenate([self._own, rows.mmsi[np.isin(rows.row, own)], of_statics]))
        return _Block(rows.take(np.isfinite(rows.stamp_s)), statics, static_rows.take(np.isfinite(static_rows.stamp_s)))

    def _with_times(self, messages: Messages) -> Floats:
        """The stamps, with each missing one that of the message before; at the start the first known one, or the assumed ones."""
        stamp_s, settings = messages.stamp_s, self._settings
        stamped = np.flatnonzero(np.isfinite(stamp_s))
        assumed = settings.assume_start_utc is not None and not len(stamped) and math.isnan(self._stamp_s)
        if assumed and settings.assume_start_utc is not None:
            steps = np.arange(self._assumed, self._assumed + len(stamp_s), dtype=np.float64)
            self._assumed += len(stamp_s)
            return np.asarray(settings.assume_start_utc.timestamp() + settings.assume_interval_s * steps)
        first = stamp_s[stamped[0]] if math.isnan(self._stamp_s) and len(stamped) else self._stamp_s
        missing = np.isnan(stamp_s)
        if not math.isnan(first):
            where = partial(_where, self._name, messages.line)
            self._tally.add_rows(TIME_OF_NEIGHBOUR, missing, where, lambda i: "", used=True)
        if len(stamped):
            self._stamp_s = float(stamp_s[stamped[-1]])
        before = np.maximum.accumulate(np.where(missing, -1, np.arange(len(stamp_s))))
        return np.where(before < 0, first, stamp_s[np.maximum(before, 0)]) if len(stamp_s) else stamp_s

    def _without_own(self, block: _Block) -> _Block:
        """The rows that are not of the own ship: neither VDO nor of an MMSI in a VDO so far."""
        rows, statics, static_rows = block
        number = statics.mmsi[static_rows.static]
        own_rows, own_statics = np.isin(rows.mmsi, self._own), np.isin(number, self._own)
        name = self._name
        self._tally.add_rows(OWN_SHIP, own_rows, lambda i: f"{name}:{rows.row[i]}", lambda i: f"MMSI {rows.mmsi[i]}")
        self._tally.add_rows(
            OWN_SHIP, own_statics, lambda i: f"{name}:{static_rows.row[i]}", lambda i: f"static data of MMSI {number[i]}"
        )
        return _Block(rows.take(~own_rows), statics, static_rows.take(~own_statics))


def _where(name: str, line: Ints, row: int) -> str:
    return f"{name}:{line[row]}"


def _split(parts: list[Timed], after_s: float, until_s: float) -> tuple[list[Timed], list[Timed], int]:
    """Of batches in order of arrival: the rows of a time span, the rows after it, and how many are before it."""
    due, later, older = [], [], 0
    for part in parts:
        low, high = np.searchsorted(part.received_s, [after_s, until_s], side="right").tolist()
        older += low
        due += [part.take(np.arange(low, high))] if low < high else []
        later += [part.take(np.arange(high, len(part)))] if high < len(part) else []
    return due, later, older


class NmeaStream:
    """The reports of several files as a `ReportStream`, merged by time of reception."""

    def __init__(self, settings: Nmea, paths: Sequence[Path], first_feed: int) -> None:
        self._tally = Tally()
        self._files = [_FileStream(settings, path, self._tally, feed) for feed, path in enumerate(paths, first_feed)]

    def between(self, after_s: float, until_s: float) -> Reports:
        parts = (file.between(after_s, until_s) for file in self._files)
        return Reports.merged([Reports(ais=reports, statics=statics) for reports, statics in parts])

    def rest(self, after_s: float) -> int:
        return sum(file.rest(after_s) for file in self._files)

    def faults(self) -> tuple[Fault, ...]:
        return self._tally.faults()

    def contents(self) -> tuple[FileContent, ...]:
        return tuple(file.content() for file in self._files)


class Ends(NamedTuple):
    """What the starts and ends of some files say."""

    received_s: Floats  # first and last time of reception; empty if there is none
    of_files_s: tuple[Floats, ...]  # the same of each file
    first_deg: Floats  # (M, 2) positions of the first accepted reports of each file
    faults: tuple[Fault, ...]  # found on the way


@lru_cache(maxsize=1)
def first_and_last(settings: Nmea, files: Fingerprint) -> Ends:
    """What the files hold first and last. A long file is read at its start and at its end only."""
    positions, of_files, tally = [np.zeros((0, 2))], list[Floats](), Tally()
    for path, _, _ in files:
        if not has_sentences(path, "ais"):
            raise InputError(
                f"{path}: got no sentence of NMEA 0183, needed VDM or VDO; a table of AIS goes to --ais or input.ais"
            )
        file = _FileStream(settings, path, tally)
        head = file.head()
        positions.append(head[0].position_deg)
        received = np.concatenate([part.received_s for part in head])
        first_s, last_s = float(received.min(initial=math.inf)), float(received.max(initial=-math.inf))
        if not file.is_exhausted:
            end_s = _last_s(settings, path)
            if math.isnan(end_s):  # no time at its end: of all of its blocks
                whole = _FileStream(settings, path, Tally())
                while whole.block() is not None:
                    pass
                end_s = whole.newest_s
            last_s = max(last_s, end_s)
        of_files.append(_ends(first_s, last_s))
    every = np.concatenate([np.zeros(0), *of_files])
    ends = _ends(float(every.min(initial=math.inf)), float(every.max(initial=-math.inf)))
    return Ends(ends, tuple(of_files), np.concatenate(positions), tally.faults())


def _ends(first_s: float, last_s: float) -> Floats:
    return np.array([first_s, last_s] if first_s <= last_s else [], np.float64)


def _last_s(settings: Nmea, path: Path) -> float:
    """The newest time of reception at the end of a file; NaN if its sentences have no time there."""
    lines = _tail(path)
    sentences = list(ais_sentences(lines, path.name, Tally()))
    stamps = np.array([s.clock_s if math.isnan(s.own_s) else s.own_s for s in sentences], np.float64)
    stamps = stamps[np.isfinite(stamps)]
    times = reception_times(stamps, settings.intake.lateness_s, settings.intake.longest_silence_s)
    return float(times.received_s[-1]) if times.accepted.any() else math.nan


def _tail(path: Path) -> list[bytes]:
    """The last lines of a file, decompressed if needed."""
    with path.open("rb") as stream:
        if stream.read(2) != GZIP_MAGIC:
            stream.seek(max(path.stat().st_size - TAIL_BYTES, 0))
            return stream.read().split(b"\n")[1:]
    kept = b""
    with gzip.open(path, "rb") as packed:
        try:
            while piece := packed.read(TAIL_BYTES):
                kept = (kept + piece)[-TAIL_BYTES:]
        except (EOFError, zlib.error, gzip.BadGzipFile):
            pass  # the reader of the stream counts it
    return kept.split(b"\n")[1:]


def lines_of(path: Path, tally: Tally) -> Iterator[bytes]:
    """The lines of a file, decompressed if needed. A truncated file is counted and used as far as it goes."""
    read = 0
    with opened(path) as stream:
        try:
            for line in stream:
                read += 1
                yield line
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            if not read:
                raise InputError(f"{path}: got {error}, needed text or gzip") from error
            tally.add(CUT_FILE, f"{path.name}:{read}", str(error), used=True)
