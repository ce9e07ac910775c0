"""The feed of recorded radar video: captures and files of CAT 240, pictures, and HDF5."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal, Self

import numpy as np
from pydantic import model_validator

from coastwatch.batches import Fault, FileContent, Floats, Radars, Recording, Reports, Sensors, Videos
from coastwatch.errors import InputError
from coastwatch.formats.intake.faults import Tally
from coastwatch.sensors.recorded.merging import span_of
from coastwatch.sensors.recorded.video.haxr import HaxrFile, HaxrStream
from coastwatch.sensors.recorded.video.pictures import Pictures, PictureStream
from coastwatch.sensors.recorded.wire.stream import WireFile, WireStream, wire_file
from coastwatch.stage import Method, NotNegative, Plan

FORMAT = "video"
FORMATS = FORMAT, "heading"


class VideoFiles(Method):
    """Recorded radar video."""

    method: Literal["video_files"] = "video_files"
    files: tuple[
        str, ...
    ] = ()  # captures (PCAP, PCAPNG) and files of CAT 240: a path, or "video+file:PATH?25/1=north&port=8600"
    pictures: tuple[Pictures, ...] = ()  # pictures of a radar's screen
    haxr: tuple[HaxrFile, ...] = ()  # HDF5 files of HAXR; they need the extra `video`
    lateness_s: NotNegative = 2.0  # a spoke of a file may be this much older than the newest before it

    @model_validator(mode="after")
    def _has_files(self) -> Self:
        if not (self.files or self.pictures or self.haxr):
            raise InputError("files, pictures, haxr: got none, needed at least one")
        self._wire_files()
        return self

    def load(self, sensors: Sensors, seed: int, plan: Plan) -> Recording:
        """The video of all files as a stream. Raises: OSError, InputError that names the file."""
        return Recording(self._stream(sensors))

    def span(self, sensors: Callable[[], Sensors], after_s: float, to_the_end: bool) -> tuple[float, float]:
        """The whole seconds around the spokes. It reads the files once. Raises: OSError, InputError."""
        return self._stream(sensors()).span()

    def _stream(self, sensors: Sensors) -> VideoFileStream:
        if not len(sensors.radars):
            raise InputError("radars: got none, needed one where input.method is video_files")
        return VideoFileStream(
            WireStream(self._wire_files(), sensors, self.lateness_s), self.pictures, self.haxr, sensors.radars
        )

    def _wire_files(self) -> list[WireFile]:
        """Raises: InputError: an address of another format."""
        files = [wire_file(text, FORMAT) for text in self.files]
        for file in files:
            if file.format not in FORMATS:
                raise InputError(
                    f"files: got {file.text!r}, needed video+file:PATH, or heading+file:PATH; input.method = 'tables' reads other formats"
                )
        return files


class VideoFileStream:
    """The video of files of CAT 240 and of others as a `ReportStream`, by time."""

    def __init__(self, files: WireStream, pictures: Sequence[Pictures], haxr: Sequence[HaxrFile], radars: Radars) -> None:
        """Args: files: of CAT 240, and of any other wire format. Raises: OSError, InputError that names the file."""
        self._files, self._tally = files, Tally()
        self._others: list[PictureStream | HaxrStream] = [PictureStream(one, radars, self._tally) for one in pictures]
        self._others += [HaxrStream(one, radars, self._tally) for one in haxr]

    def between(self, after_s: float, until_s: float) -> Reports:
        turns = Videos(tuple(turn for one in self._others for turn in one.between(after_s, until_s)))
        return Reports.merged([self._files.between(after_s, until_s), Reports(video=turns)])

    def rest(self, after_s: float) -> int:
        return self._files.rest(after_s) + sum(one.after(after_s) for one in self._others)

    def spans(self) -> list[Floats]:
        """Times of the first and the last report of each part that has any. It reads the files to their ends."""
        spans = [self._files.span(), *(one.span_s() for one in self._others)]
        return [np.array(span) for span in spans if span[0] <= span[1]]

    def span(self) -> tuple[float, float]:
        """Of all spokes. It reads the files to their ends. Raises: InputError: there is no spoke."""
        found = self.spans()
        return span_of(*found, faults=self.faults())

    def faults(self) -> tuple[Fault, ...]:
        return (*self._files.faults(), *self._tally.faults())

    def contents(self) -> tuple[FileContent, ...]:
        return (*self._files.contents(), *(one.content() for one in self._others))
