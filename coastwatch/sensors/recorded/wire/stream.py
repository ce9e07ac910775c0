"""Files of wire formats as a stream of reports: a file, and the format that decodes it, in memory that does not grow with the file."""

from __future__ import annotations

import gzip
import math
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from urllib.parse import parse_qsl, unquote, urlsplit

from coastwatch.batches import Fault, FileContent, Reports, Sensors
from coastwatch.errors import InputError
from coastwatch.formats.decoding import DROPPED, LATE, LONGEST_NAME, Decoder, FeedSettings, Item, decode
from coastwatch.formats.format import Format
from coastwatch.formats.intake.faults import SET_ASIDE, Tally
from coastwatch.formats.registry import DECODED, FORMATS, check_options, decoders_of
from coastwatch.sensors.recorded.files import CUT_FILE, existing_path, opened
from coastwatch.sensors.recorded.wire.captures import Bytes, datagrams, is_capture

BLOCK_BYTES = 1 << 18
"""Bytes of a file that are read at a time."""

LONGEST = 65_536
"""Bytes of a message, as of a live feed."""

BATCH, VIDEO_BATCH = 1_000, 100
"""Messages that are decoded at a time: what comes out does not depend on how the file was read. Those of video hold many cells."""

REPEATED, WAITING = SET_ASIDE + "the same report again", "waiting for a cycle or for more of a message"
DAMAGED_FILE = "file damaged, not read any further"
TOO_LONG = "message too long"


@dataclass(frozen=True)
class WireFile:
    """A file of a wire format. `text` is how it was given."""

    text: str
    format: str  # of DECODED
    path: Path
    options: dict[str, str] = field(default_factory=dict)
    port: int | None = None  # of a capture: to which its datagrams were sent; None: all of them

    @property
    def source(self) -> str | None:
        """The track source that its tracks are of; None: its format or its content says."""
        own = self.path.name if FORMATS[self.format].own_source else None
        return self.options.get("source", own and own[:LONGEST_NAME])

    def settings(self) -> FeedSettings:
        """What its format is told of it."""
        return FeedSettings(self.path.name, self.text, self.options, self.source or "", checked=False)


def wire_file(text: str, of_path: str = "") -> WireFile:
    """The file of an address such as asterix+file:plots.pcap?port=8600. Args: of_path: format of a path alone. Raises: InputError."""
    text = text if not of_path or "+file:" in text else f"{of_path}+file:{text}"
    parts = urlsplit(text, allow_fragments=False)
    format_, _, transport = parts.scheme.partition("+")
    path, options = unquote(parts.netloc + parts.path), dict(parse_qsl(parts.query, keep_blank_values=True))
    port = options.pop("port", None)
    if format_ not in DECODED or transport != "file" or not path or (port is not None and not port.isdecimal()):
        raise InputError(
            f"feed: got {text!r}, needed FORMAT+file:PATH with FORMAT one of {', '.join(DECODED)}, e.g. "
            "asterix+file:plots.pcap?port=8600, json+file:bearings.jsonl"
        )
    check_options(format_, text, options, ("port",) if FORMATS[format_].numbered else ("port", "source"))
    return WireFile(text, format_, Path(path), options, None if port is None else int(port))


def items_of(file: WireFile, tally: Tally) -> Iterator[Item]:
    """The messages of a file in their order: of a capture with their times of arrival, else with NaN.

    A file that is cut short or damaged is counted, and used as far as it goes. Raises: OSError, InputError that names file and byte.
    """
    path, format_ = existing_path(file.path), FORMATS[file.format]
    used = False
    with opened(path) as opened_file:
        stream = Bytes(opened_file)
        try:
            if is_capture(path):
                for when_s, payload, sender in datagrams(stream, path.name, file.port, tally):
                    for message in [payload] if format_.in_datagrams else payload.splitlines():
                        used = True
                        yield when_s, message, sender
            else:
                for message in _messages(stream, format_, path.name, tally):
                    used = True
                    yield math.nan, message, 0
        except (EOFError, ValueError, zlib.error, gzip.BadGzipFile) as error:
            if not used:
                raise InputError(f"{path}: byte {stream.at}: got {error}, needed {file.format} or a capture of it") from error
            kind = CUT_FILE if isinstance(error, EOFError) else DAMAGED_FILE
            tally.add(kind, f"{path.name}: byte {stream.at}", str(error), used=True)


def _messages(stream: Bytes, format_: Format, name: str, tally: Tally) -> Iterator[bytes]:
    """The messages of a file; lines without their ends.

    Raises: EOFError: the last one is cut short; ValueError: the bytes are none.
    """
    rest, rest_at, too_long, length = b"", 0, False, format_.length
    line_end = b"" if format_.in_datagrams else b"\r\n"
    while block := stream.read(BLOCK_BYTES):
        rest += block
        begin = 0
        while begin < (end := begin + length(rest, begin)) <= len(rest):
            if end - begin > LONGEST or too_long:
                tally.add(TOO_LONG, f"{name}: byte {rest_at + begin}", count=int(not too_long))
            else:
                yield rest[begin:end].rstrip(line_end)
            begin, too_long = end, False
        rest, rest_at = rest[begin:], rest_at + begin
        if len(rest) > LONGEST:
            tally.add(TOO_LONG, f"{name}: byte {rest_at}", count=int(not too_long))
            rest, rest_at, too_long = b"", rest_at + len(rest), True
    if rest and not too_long:
        if b"\n" not in rest and length(rest + b"\n", 0) == len(rest) + 1:  # the last line, without its end
            yield rest.rstrip(b"\r")
        else:
            raise EOFError(f"{len(rest)} bytes of a message without its end")


class _File:
    """One file as it is decoded."""

    def __init__(self, file: WireFile, decoder: Decoder) -> None:
        self.name, self.format, self.decoder = file.path.name, file.format, decoder
        self.is_read = False
        self._uncut = Tally()  # what is refused before it comes to the decoder
        self._items = items_of(file, self._uncut)
        self._batch = VIDEO_BATCH if file.format == "video" else BATCH

    def read_beyond(self, time_s: float) -> None:
        """Decode until a report is newer than an instant, or to the end."""
        while not self.is_read and not self.decoder.stamps.newest_s > time_s:
            items = list(islice(self._items, self._batch))
            self.is_read = len(items) < self._batch
            newest_s = self.decoder.stamps.newest_s
            raw = bool(items) and math.isnan(items[0][0])
            decode(self.decoder, self.name, items, newest_s if raw and math.isfinite(newest_s) else None)

    def faults(self) -> list[Fault]:
        """What was refused or set aside so far, with what came too late."""
        counts = self.decoder.counts
        counted = (LATE, counts.late), (DROPPED, counts.dropped), (REPEATED, counts.repeated)
        late = [Fault(kind, count, self.name, "") for kind, count in counted if count]
        return [*self._uncut.faults(), *self.decoder.tally.faults(), *late]

    def content(self) -> FileContent:
        """What was taken so far."""
        stamps, counts = self.decoder.stamps, self.decoder.counts
        records = counts.records + counts.before_run
        span = (stamps.first_s, stamps.newest_s) if records else (math.nan, math.nan)
        read = counts.ledger.read + sum(fault.count for fault in self._uncut.faults() if not fault.used)
        beside = tuple((counts.ledger.beside + Counter({WAITING: self.decoder.waiting})).items())
        return FileContent(self.name, f"{self.format} reports", records, *span, read=read, beside=beside)


class WireStream:
    """The reports of some files as a `ReportStream`, by the time they were made."""

    def __init__(self, files: Sequence[WireFile], sensors: Sensors, lateness_s: float, first_feed: int = 0) -> None:
        """Args: lateness_s: a report may be this much older than the newest before it; first_feed: number of the first one.

        Raises: InputError, OSError.
        """
        self._lateness_s = lateness_s
        decoders, self._report_sources = decoders_of([(file.format, file.settings()) for file in files], sensors, first_feed)
        for file, decoder in zip(files, decoders, strict=True):
            if not decoder.has_dates and not is_capture(existing_path(file.path)):
                raise InputError(
                    f"{file.path}: got times of day without a date, needed the day of its first report behind '?': "
                    f"{file.format}+file:{file.path}?date=YYYY-MM-DD; or a capture, whose packets have times"
                )
        self._files = [_File(file, decoder) for file, decoder in zip(files, decoders, strict=True)]

    def between(self, after_s: float, until_s: float) -> Reports:
        for file in self._files:
            file.read_beyond(until_s + self._lateness_s)
        return Reports.merged([source(after_s, until_s) for source in self._report_sources])

    def first(self) -> Reports:
        """The reports of the first batch of each file. They do not stay in the stream."""
        for file in self._files:
            file.read_beyond(-math.inf)
        return Reports.merged([source(-math.inf, math.inf) for source in self._report_sources])

    def rest(self, after_s: float) -> int:
        count, until_s = 0, after_s
        while not all(file.is_read for file in self._files):
            part = self.between(after_s, until_s)
            count, after_s = count + len(part), until_s
            newest_s = (file.decoder.stamps.newest_s for file in self._files if not file.is_read)
            until_s = max(until_s, min(newest_s, default=until_s))
        return count + len(self.between(after_s, math.inf))

    def span(self) -> tuple[float, float]:
        """The times of the first and the last report. It reads all files to their ends."""
        self.rest(-math.inf)
        stamps = [file.decoder.stamps for file in self._files]
        first_s, newest_s = (one.first_s for one in stamps), (one.newest_s for one in stamps)
        return min(first_s, default=math.inf), max(newest_s, default=-math.inf)

    def faults(self) -> tuple[Fault, ...]:
        return tuple(fault for file in self._files for fault in file.faults())

    def contents(self) -> tuple[FileContent, ...]:
        return tuple(file.content() for file in self._files)
