"""HDF5 files of HAXR, video of port radars that the radars have cleaned: the cells that are not 0, one after the other.

Source: DLR, HAXR, Zenodo 10.5281/zenodo.18759622; its companion library haxr. Sets `tod` s, `az1`, `az2` deg, `r1`, `r2` m, `amp`.
"""

from __future__ import annotations

import math
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

import numpy as np

from coastwatch.batches import Array, FileContent, Floats, Radars, RadarVideo
from coastwatch.errors import InputError
from coastwatch.formats.intake.faults import Tally
from coastwatch.formats.intake.timestamps import nearest_s
from coastwatch.sensors.recorded.files import existing_path
from coastwatch.sensors.recorded.video.pictures import radar_number
from coastwatch.stage import Settings

SETS = ("tod", "az1", "az2", "r1", "r2", "amp")
BLOCK = 1 << 18  # cells that are read at a time
MOST_SPOKES = 4_096  # that are made at a time
MOST_CELLS = 65_536  # of a spoke
CELL_M = 0.05, 1_000.0  # usual lengths of a cell that there may be
DAY_S = 86_401.0  # with a leap second
BAD_CELL, BEYOND = "cell without a range, an azimuth, a time of day or a level", "cell beyond the range of the radar"
TURN_DEG = 360.0


class HaxrFile(Settings):
    """A file of HAXR."""

    file: Path  # HDF5
    day: date  # of its first time of day, UTC
    radar: str = ""  # name of the radar in the scenario; not needed for a single radar


class HaxrStream:
    """The video of one file, a block of cells at a time."""

    def __init__(self, settings: HaxrFile, radars: Radars, tally: Tally) -> None:
        """Raises: OSError, InputError that names the file."""
        path = existing_path(settings.file)
        self._radar, self._name, self._tally = radar_number(path, radars, settings.radar, "its radar"), path.name, tally
        self._sets, self._count = _sets_of(path)
        self._site_deg, self._range_m = radars.site_deg[self._radar], float(radars.range_m[self._radar])
        self._day_s = datetime.combine(settings.day, datetime.min.time(), UTC).timestamp()
        self._at, self._newest_s, self._first_s = 0, math.nan, math.nan
        self._videos: list[RadarVideo] = []  # read, and after what was asked for
        self._taken = 0
        self.cell_m = self._cell_m()
        self._cells = min(math.ceil(self._range_m / self.cell_m), MOST_CELLS)

    def between(self, after_s: float, until_s: float) -> list[RadarVideo]:
        """The spokes with after_s < time <= until_s. Older ones are left out."""
        while self._at < self._count and not self._newest_s > until_s:
            self._read_block()
            self._videos = [video for video in self._videos if video.time_s[-1] > after_s]
        found, rest = [], []
        for video in self._videos:
            first, end = np.searchsorted(video.time_s, [after_s, until_s], side="right").tolist()
            found += [video.take(slice(first, end))] if first < end else []
            rest += [video.take(slice(end, None))] if end < len(video) else []
        self._videos = rest
        self._taken += sum(map(len, found))
        return found

    def after(self, after_s: float) -> int:
        """How many spokes come after an instant. It reads the file to its end."""
        count = 0
        while self._videos or self._at < self._count:
            count += sum(int((video.time_s > after_s).sum()) for video in self._videos)
            self._videos.clear()
            if self._at < self._count:
                self._read_block()
        self._taken += count
        return count

    def span_s(self) -> tuple[float, float]:
        """Times of the first and the last spoke; inf and -inf: there is none. It reads the file to its end."""
        self.after(-math.inf)
        return (self._first_s, self._newest_s) if math.isfinite(self._newest_s) else (math.inf, -math.inf)

    def content(self) -> FileContent:
        """What was taken so far."""
        span = (self._first_s, self._newest_s) if self._taken else (math.nan, math.nan)
        return FileContent(self._name, "spokes of video", self._taken, *span, read=self._taken)

    def _cell_m(self) -> float:
        """The usual length of a cell. Raises: InputError: there is none."""
        head = slice(0, min(BLOCK, self._count))
        with np.errstate(over="ignore", invalid="ignore"):
            length = np.asarray(self._sets["r2"][head], np.float64) - np.asarray(self._sets["r1"][head], np.float64)
        good = length[np.isfinite(length) & (length > 0.0)]
        if not len(good):
            raise InputError(f"{self._name}: got no cell with r2 after r1, needed cells with near and far edge in metres")
        usual_m = float(np.median(good))
        if not CELL_M[0] <= usual_m <= CELL_M[1]:
            raise InputError(f"{self._name}: got cells of {usual_m:.3g} m, needed {CELL_M[0]:g} to {CELL_M[1]:g} m")
        return usual_m

    def _read_block(self) -> None:
        """Read the next cells, up to the end of a spoke."""
        block = slice(self._at, min(self._at + BLOCK, self._count))
        tod, az1, az2, r1, r2, amp = (np.asarray(self._sets[name][block]) for name in SETS)
        begins = np.append(True, np.logical_or.reduce([column[1:] != column[:-1] for column in (az1, az2, tod)]))
        rows = np.flatnonzero(begins)
        if block.stop < self._count or len(rows) > MOST_SPOKES:
            last = int(rows[min(len(rows) - 1, MOST_SPOKES)])
            end = last if last else len(tod)  # a spoke of more than a block is cut
            tod, az1, az2, r1, r2, amp, begins = (column[:end] for column in (tod, az1, az2, r1, r2, amp, begins))
        begun = self._at
        self._at += len(tod)
        edges = np.stack([tod, az1, az2, r1, r2, amp]).astype(np.float64)
        good = np.isfinite(edges).all(axis=0) & (edges[3] >= 0.0) & (edges[4] > edges[3])
        good &= (edges[0] >= 0.0) & (edges[0] < DAY_S)
        with np.errstate(over="ignore"):
            middle = np.floor(0.5 * np.where(good, edges[3:5], 0.0).sum(axis=0) / self.cell_m)
        beyond = good & (middle >= self._cells)
        for kind, refused in ((BAD_CELL, ~good), (BEYOND, beyond)):
            self._tally.add_rows(kind, refused, lambda i: f"{self._name}: cell {begun + i}", lambda i: f"{edges[:, i]}")
        good &= ~beyond
        cell = np.where(good, middle, 0.0).astype(np.int64)
        spoke = np.cumsum(begins) - 1
        level = np.zeros((int(begins.sum()), self._cells), np.uint8)
        np.maximum.at(level, (spoke[good], cell[good]), np.clip(amp[good], 0, 255).astype(np.uint8))
        kept = np.bincount(spoke[good], minlength=len(level)) > 0
        first = np.flatnonzero(begins)
        if kept.any():
            self._videos.append(self._video(edges[:3, first[kept]], level[kept]))

    def _video(self, head: Floats, level: Array) -> RadarVideo:
        """Spokes as a batch. Args: head: (3, S), time of day and both edges in azimuth."""
        time_s = np.empty(len(level))
        for row, of_day_s in enumerate(head[0].tolist()):
            at_s = self._day_s + of_day_s if math.isnan(self._newest_s) else nearest_s(of_day_s, self._newest_s)
            self._newest_s = at_s if math.isnan(self._newest_s) else max(at_s, self._newest_s)
            time_s[row] = self._newest_s
        self._first_s = float(time_s[0]) if math.isnan(self._first_s) else self._first_s
        width = (head[2] - head[1]) % TURN_DEG
        return RadarVideo(
            sensor=self._radar,
            first_m=0.0,
            cell_m=self.cell_m,
            time_s=time_s,
            received_s=time_s.copy(),
            azimuth_rad=np.radians((head[1] + 0.5 * width) % TURN_DEG),
            site_deg=np.tile(self._site_deg, (len(level), 1)),
            level=level,
        )


def _sets_of(path: Path) -> tuple[dict[str, Any], int]:
    """The sets of a file, and how many cells it has. Links and data in other files are refused. Raises: InputError, OSError."""
    try:
        import h5py
    except ImportError as error:
        raise InputError(f"{path}: got HDF5, needed the package h5py: pip install 'coastwatch[video]'") from error
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise InputError(f"{path}: got {error}, needed an HDF5 file of HAXR") from error
    sets = {}
    for name in SETS:
        link = file.get(name, getlink=True)
        if link is None:
            raise InputError(f"{path}: got sets {', '.join(sorted(file))}, needed {', '.join(SETS)}")
        if not isinstance(link, h5py.HardLink):
            raise InputError(f"{path}: got a link as {name}, which may point to another file, needed a set of its own")
        found = file[name]
        if not isinstance(found, h5py.Dataset) or found.ndim != 1 or found.dtype.kind not in "fiu":
            raise InputError(f"{path}: got {found!r} as {name}, needed one row of numbers")
        if found.is_virtual or found.external:
            raise InputError(f"{path}: got {name} with data in another file, needed a set of its own")
        sets[name] = found
    sizes = {len(found) for found in sets.values()}
    if len(sizes) != 1:
        raise InputError(f"{path}: got {', '.join(f'{len(sets[name])} {name}' for name in SETS)}, needed as many of each")
    return sets, sizes.pop()
