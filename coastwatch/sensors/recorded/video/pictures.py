"""Pictures of a radar's screen to radar video.

Source: F. Heymann et al., Validation of Radar Image Tracking Algorithms with Simulated Data, section 3.2.2, steps 1 and 2.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from coastwatch.batches import Array, AzimuthReference, FileContent, Radars, RadarVideo
from coastwatch.errors import InputError
from coastwatch.formats.intake.faults import Tally
from coastwatch.sensors.recorded.files import existing_path
from coastwatch.sensors.recorded.tables.reader import read_table
from coastwatch.stage import NotNegative, Positive, Settings

GREY = np.array([0.299, 0.587, 0.114])  # weights of red, green and blue
PNG = b"\x89PNG\r\n\x1a\n"
MOST_PIXELS = 16_000_000
NO_HEADING, NO_TIME = "picture without heading", "picture without time"
NO_PICTURE, OTHER_SIZE, TOO_LARGE = "no picture in PNG", "picture of another size", "picture too large"
COLUMNS = {
    "file": ("file", "picture", "image", "name"),
    "time": ("time", "time_utc", "timestamp", "utc"),
    "heading": ("heading", "heading_deg", "hdg"),
    "latitude": ("latitude", "latitude_deg", "lat", "site_latitude"),
    "longitude": ("longitude", "longitude_deg", "lon", "site_longitude"),
}
Octet = Annotated[int, Field(ge=0, le=255)]
Pixel = Annotated[int, Field(ge=0)]


class Pictures(Settings):
    """Pictures of the screen of one radar, a turn each, which a table names."""

    table: Path  # CSV with columns file and time, and heading where ahead is up; the pictures (PNG) lie beside it
    radar: str = ""  # name of the radar in the scenario; not needed for a single radar
    pixel_m: Positive  # range of a pixel
    head_up: bool = False  # ahead is up, so that each picture needs its heading; else north is up
    centre: tuple[float, float] | None = None  # number of pixels to the antenna, positive to right and down; none: the middle
    radius_pixels: Annotated[int, Field(ge=8, le=65_536)] = 512  # whole number of cells
    rectangles: tuple[tuple[Pixel, Pixel, Pixel, Pixel], ...] = ()  # whole number of pixels: left, top, right, bottom of tables
    disc_pixels: NotNegative = 0.0  # number of pixels around the antenna that are masked
    colours: tuple[tuple[Octet, Octet, Octet], ...] = ()  # whole number each: red, green, blue of what is masked
    colour_tolerance: Octet = 30  # whole number by which each part of a colour may differ
    spokes: Annotated[int, Field(ge=8, le=16_384)] = 1024  # whole number in a turn


def radar_number(path: Path, radars: Radars, name: str, what: str) -> int:
    """The number of the radar that a file is of. A single radar needs no name. Raises: InputError that names the file."""
    names = [str(known) for known in radars.name]
    if name not in names and (name or len(names) != 1):
        raise InputError(f"{path}: got radar {name!r}, needed one of {', '.join(names) or 'none'} as {what}")
    return names.index(name) if name else 0


class PictureStream:
    """The video of the pictures of one table, one picture at a time."""

    def __init__(self, settings: Pictures, radars: Radars, tally: Tally) -> None:
        """Raises: InputError that names the table."""
        self._settings, self._tally = settings, tally
        path = existing_path(settings.table)
        self._radar = radar_number(path, radars, settings.radar, "radar of input.pictures")
        if radars.azimuth_reference[self._radar] == AzimuthReference.HEADING:
            raise InputError(
                f"{path}: got a radar of azimuth_reference 'heading', needed another one: pictures have a heading each, with head_up"
            )
        self._table, self._folder = read_table(path, "auto", tally), path.parent
        column = {name: self._table.find(None, aliases) for name, aliases in COLUMNS.items()}
        if column["file"] is None or column["time"] is None:
            raise self._table.lacks("file and time")
        self._files, (time_s, _) = self._table.texts(column["file"]), self._table.times(column["time"], "auto")
        self._heading_rad = np.radians(self._table.numbers(column["heading"])[0])
        site_deg = np.stack([self._table.numbers(column[name])[0] for name in ("latitude", "longitude")], axis=-1)
        self._site_deg = np.where(np.isfinite(site_deg), site_deg, radars.site_deg[self._radar])
        no_time = np.isnan(time_s)
        tally.add_rows(NO_TIME, no_time, self._table.location, self._table.example)
        no_heading = ~no_time & np.isnan(self._heading_rad) & settings.head_up
        tally.add_rows(NO_HEADING, no_heading, self._table.location, self._table.example)
        rows = np.flatnonzero(~no_time & ~no_heading)
        self._rows = rows[np.argsort(time_s[rows], kind="stable")]
        self._time_s = time_s
        self._size: tuple[int, int] | None = None  # of the first picture, width and height
        self._taken: list[float] = []  # times of the first and the newest picture that was taken
        self._count = 0

    def span_s(self) -> tuple[float, float]:
        """Times of the first and the last picture; inf and -inf: there is none."""
        times = self._time_s[self._rows]
        return (float(times[0]), float(times[-1])) if len(times) else (math.inf, -math.inf)

    def between(self, after_s: float, until_s: float) -> list[RadarVideo]:
        """The turns of the pictures with after_s < time <= until_s."""
        time_s = self._time_s[self._rows]
        found = (self._turn(int(row)) for row in self._rows[(time_s > after_s) & (time_s <= until_s)])
        return [turn for turn in found if turn is not None]

    def after(self, after_s: float) -> int:
        """How many spokes come after an instant, if each picture is good."""
        return int((self._time_s[self._rows] > after_s).sum()) * self._settings.spokes

    def content(self) -> FileContent:
        """What was taken so far."""
        span = (self._taken[0], self._taken[-1]) if self._taken else (math.nan, math.nan)
        return FileContent(self._table.name, "pictures of a radar", self._count, *span, read=len(self._table))

    def _turn(self, row: int) -> RadarVideo | None:
        """The spokes of a picture; None: it cannot be used, which is counted."""
        s, where = self._settings, self._table.location(row)
        colours = self._picture(self._folder / self._files[row], where)
        if colours is None:
            return None
        height, width = colours.shape[:2]
        x, y = ((width - 1) / 2.0, (height - 1) / 2.0) if s.centre is None else s.centre
        azimuth = (np.arange(s.spokes) + 0.5) * (2.0 * np.pi / s.spokes)
        turned = azimuth - (self._heading_rad[row] if s.head_up else 0.0)
        reach = np.arange(s.radius_pixels) + 0.5
        columns = np.rint(x + np.sin(turned)[:, None] * reach).astype(np.int64)
        rows = np.rint(y - np.cos(turned)[:, None] * reach).astype(np.int64)
        inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width) & (reach >= s.disc_pixels)
        seen = colours[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)]
        for left, top, right, bottom in s.rectangles:
            inside &= (columns < left) | (columns >= right) | (rows < top) | (rows >= bottom)
        for colour in s.colours:
            inside &= (np.abs(seen - np.array(colour, np.int16)) > s.colour_tolerance).any(axis=2)
        level = _filled(np.rint(seen @ GREY).astype(np.uint8), inside)
        time_s = np.full(s.spokes, self._time_s[row])
        self._taken, self._count = [*self._taken[:1], float(time_s[0])], self._count + 1
        return RadarVideo(
            sensor=self._radar,
            first_m=0.0,
            cell_m=s.pixel_m,
            time_s=time_s,
            received_s=time_s,
            azimuth_rad=np.asarray(azimuth, np.float64),
            site_deg=np.tile(self._site_deg[row], (s.spokes, 1)),
            level=level,
        )

    def _picture(self, path: Path, where: str) -> Array | None:
        """The colours of a picture, 0 to 255; None: it cannot be used. (height, width, 3) uint8"""
        try:
            with path.open("rb") as file:
                begin = file.read(24)
        except OSError as error:
            self._tally.add(NO_PICTURE, where, f"{path}: {error.strerror or error}")
            return None
        width, height = (int.from_bytes(begin[at : at + 4], "big") for at in (16, 20))
        if not begin.startswith(PNG) or not width or not height:
            self._tally.add(NO_PICTURE, where, str(path))
            return None
        if width * height > MOST_PIXELS:  # nothing of it is unpacked
            self._tally.add(TOO_LARGE, where, f"{path}: got {width} x {height} pixels, needed at most {MOST_PIXELS}")
            return None
        if self._size is not None and self._size != (width, height):
            self._tally.add(
                OTHER_SIZE, where, f"{path}: got {width} x {height} pixels, needed {self._size[0]} x {self._size[1]}"
            )
            return None
        from PIL import Image  # it takes a while, and only pictures need it

        try:
            with Image.open(path, formats=["PNG"]) as picture:
                if picture.mode.startswith("I"):  # grey of 16 bits
                    found = np.repeat((np.asarray(picture)[..., None] // 257).astype(np.uint8), 3, axis=2)
                else:
                    found = np.asarray(picture.convert("RGBA"))[..., :3]
        except Exception as error:  # whatever the library raises on damaged bytes
            self._tally.add(NO_PICTURE, where, f"{path}: {error}")
            return None
        self._size = width, height
        return found


def _filled(level: Array, good: Array) -> Array:
    """The levels, with the median of their range in place of those that are not good; 0: there is none. (S, C) uint8 each"""
    if good.all():
        return level
    seen, usual = good.any(axis=0), np.zeros(level.shape[1], np.uint8)
    usual[seen] = np.rint(np.nanmedian(np.where(good, level, np.nan)[:, seen], axis=0)).astype(np.uint8)
    return np.where(good, level, usual)
