"""The newest turn of each radar's video for those who look, as a polar picture in sectors. Where nobody looks, nothing is done."""

from __future__ import annotations

import logging
import math
import secrets
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from coastwatch.batches import Array, AzimuthReference, Floats, HeadingReports, Ints, Radars, RadarVideo, Videos
from coastwatch.plots import true_video
from coastwatch.server.listeners import Listeners

LOG = logging.getLogger("coastwatch.serve")

AZIMUTHS, RANGES, SECTORS = 1024, 512, 16
ROWS = AZIMUTHS // SECTORS
LOOKED_S = 60.0
"""For so long after somebody asked for a radar its picture is kept up to date: a viewer that comes back resumes."""

SILENT_S = 15.0
"""A radar that has sent nothing for so long has no picture: an old one would look like one of now."""

FIRST_DB, STEP_DB = 10.0, 5.0
"""Over the noise: from where a cell is shown, and how much stronger that of the next level is."""

SHADES = 15  # levels beside 0
COARSE_BITS = 4  # of a cell; such levels are shown as they are
BACK = AZIMUTHS / 36.0  # a spoke that is less than this behind the one before stepped back
MOST_STEP = AZIMUTHS / 18.0  # between spokes; a longer one is a gap
SMOOTH_DB = 2.0  # over which the histogram of levels is averaged
SAMPLED = 64  # cells of a spoke in the histogram, about
KEPT = 0.98  # weight of the histogram after a sector: about three turns


class Sector(NamedTuple):
    """A sixteenth of the newest turn of a radar."""

    radar: int  # index into the scenario's radars
    number: int  # grows with each sector of any radar
    begun: int  # the same as long as the range scale is: a sector of another one belongs to another picture
    place: int  # clockwise from north, 0 to SECTORS - 1
    time_s: float  # of its newest spoke
    site_deg: tuple[float, float]
    range_m: float  # of the far edge of the picture
    cells: bytes  # ROWS azimuths of RANGES cells, two levels an octet, the nearer one in the upper half

    def levels(self) -> Array:
        """The levels over the noise, 0 to 15. (ROWS, RANGES) uint8"""
        octets = np.frombuffer(self.cells, np.uint8).reshape(ROWS, RANGES // 2)
        return np.stack([octets >> 4, octets & 15], axis=-1).reshape(ROWS, RANGES)


@dataclass
class _Turn:
    """The picture of one radar. A row is an azimuth; angles are in rows and grow from turn to turn."""

    scale: tuple[float, float, int, int]  # as of `RadarVideo`
    begun: int
    cells: Ints  # (K, RANGES) cells of the video in each cell of the picture, some of them repeated
    is_blind: Array  # (RANGES,) bool: before the first cell
    range_m: float
    level: Array = field(default_factory=lambda: np.zeros((AZIMUTHS, RANGES), np.uint8))  # of the video, by maximum
    # Of the open sector; 1: of a spoke beside it, 2: on it
    swept: Array = field(default_factory=lambda: np.zeros(ROWS, np.uint8))
    levels: Floats = field(default_factory=lambda: np.zeros(256))  # how often each level came
    azimuth: float = math.nan  # of the newest spoke
    angle: float = 0.0
    step: float = 1.0  # between spokes
    open: int = -1  # number of the sector that the beam is in
    time_s: float = 0.0
    site_deg: tuple[float, float] = (0.0, 0.0)


class LiveVideo:
    """The video of the radars of a run. `take...` are called in the thread of the run, all else in any thread."""

    def __init__(self, radars: Radars) -> None:
        self.run = secrets.randbelow(2**32 - 1) + 1  # numbers of sectors are of it
        self.names = [str(name) for name in radars.name]
        self._radars, self._db_per_level = radars, radars.db_per_level.tolist()
        self._number = 0
        self._asked_s: dict[int, float] = {}  # monotonic time at which somebody asked for a radar last
        self._heard_s: dict[int, float] = {}  # monotonic time of its newest video
        self._turns: dict[int, _Turn] = {}
        self._sectors: dict[int, list[Sector | None]] = {k: [None] * SECTORS for k in range(len(radars))}
        self._listeners = Listeners()
        self.listen = self._listeners.listen
        """As of `Listeners`: a function is called after new sectors."""

    def ask(self, radars: Iterable[int]) -> None:
        """Somebody looks at these radars."""
        now_s = time.monotonic()
        self._asked_s.update(dict.fromkeys(radars, now_s))

    def since(self, seen: dict[int, int]) -> list[Sector]:
        """The newest sectors, oldest first, of these radars. Args: seen: by radar, the number of the last one that is known."""
        found = [one for radar, number in seen.items() for one in self._now(radar) if one.number > number]
        return sorted(found, key=lambda sector: sector.number)

    def turn(self, radar: int) -> Sequence[Sector] | None:
        """The newest turn of a radar by azimuth; None: it is not whole yet, nobody has asked for it, or the radar is silent."""
        sectors = self._now(radar)
        return sectors if len(sectors) == SECTORS else None

    def _now(self, radar: int) -> list[Sector]:
        """The sectors of a radar by azimuth; none of one that is silent."""
        if time.monotonic() - self._heard_s.get(radar, -math.inf) > SILENT_S:
            return []
        return [sector for sector in self._sectors[radar] if sector is not None]

    def take_all(self, videos: Videos) -> None:
        """Take the spokes of a cycle, with true azimuths."""
        for video in videos.parts:
            self._take(video)

    def take_as_sent(self, video: RadarVideo) -> None:
        """Take the next spokes of a radar before their cycle, with azimuths as it counts them. Those from a bow wait for their cycle."""
        if not self._is_by_heading(video):
            for part in true_video(self._radars, HeadingReports.empty(), Videos((video,))).parts:
                self._take(part)

    def take_by_heading(self, videos: Videos) -> None:
        """Take the spokes of a cycle that `take_as_sent` left, with true azimuths."""
        self.take_all(Videos(tuple(video for video in videos.parts if self._is_by_heading(video))))

    def _is_by_heading(self, video: RadarVideo) -> bool:
        return bool(self._radars.azimuth_reference[video.sensor] == AzimuthReference.HEADING)

    def _take(self, video: RadarVideo) -> None:
        """A fault in it is logged, and costs nobody but its viewers."""
        radar, before = video.sensor, self._number
        self._heard_s[radar] = time.monotonic()
        try:
            if time.monotonic() - self._asked_s.get(radar, -math.inf) <= LOOKED_S:
                self._add(video)
            elif self._turns.pop(radar, None) is not None:
                self._sectors[radar] = [None] * SECTORS
        except Exception:
            LOG.exception("the picture of radar video is begun again")
            self._turns.pop(radar, None)
        if self._number > before:
            self._listeners.tell()

    def _add(self, video: RadarVideo) -> None:
        if not len(video):
            return
        cells, turn = video.level.shape[1], self._turns.get(video.sensor)
        if turn is None or turn.scale != video.scale:
            range_m = video.first_m + cells * video.cell_m
            edge = (np.arange(RANGES + 1) * (range_m / RANGES) - video.first_m) / video.cell_m
            low, high = np.floor(edge[:-1] + 1e-6).astype(np.int64), np.ceil(edge[1:] - 1e-6).astype(np.int64)
            found = np.clip(np.minimum(low + np.arange((high - low).max())[:, None], high - 1), 0, cells - 1)
            turn = _Turn(video.scale, self._number, found, high <= 0, range_m)
            self._turns[video.sensor], self._sectors[video.sensor] = turn, [None] * SECTORS
        azimuth = video.azimuth_rad * (AZIMUTHS / (2.0 * np.pi))
        if turn.azimuth != turn.azimuth:
            turn.azimuth = turn.angle = float(azimuth[0])
        forward = np.diff(azimuth, prepend=turn.azimuth) % AZIMUTHS
        forward[forward > AZIMUTHS - BACK] -= AZIMUTHS
        steps = forward[(forward > 0.0) & (forward < MOST_STEP)]
        turn.step = float(np.median(steps)) if len(steps) else turn.step
        angle = np.maximum.accumulate(turn.angle + np.cumsum(forward))
        turn.azimuth, turn.angle = float(azimuth[-1]), float(angle[-1])
        sector = (angle // ROWS).astype(np.int64)
        first = 0
        for end in [*(np.flatnonzero(np.diff(sector)) + 1).tolist(), len(sector)]:
            number, some = int(sector[first]), slice(first, end)
            if number != turn.open:
                if turn.open >= 0:
                    self._close(video.sensor, turn, number)
                turn.open = number
            _sweep(turn, angle[some], video.level[some])
            turn.time_s = float(video.time_s[end - 1])
            turn.site_deg = float(video.site_deg[end - 1, 0]), float(video.site_deg[end - 1, 1])
            first = end

    def _close(self, radar: int, turn: _Turn, following: int) -> None:
        """Give out the sector that the beam has left, and those without spokes before the following one."""
        shades = shades_of(turn.levels, self._db_per_level[radar], turn.scale[2])
        for number in range(turn.open, min(following, turn.open + SECTORS)):
            place = number % SECTORS
            level = turn.level[place * ROWS : (place + 1) * ROWS]
            level[turn.swept == 0] = 0
            turn.swept[:] = 0
            levels = shades[level]
            self._number += 1
            cells = ((levels[:, 0::2] << 4) | levels[:, 1::2]).tobytes()
            self._sectors[radar][place] = Sector(
                radar, self._number, turn.begun, place, turn.time_s, turn.site_deg, turn.range_m, cells
            )
        turn.levels *= KEPT


def _sweep(turn: _Turn, angle: Floats, level: Array) -> None:
    """Bring the spokes of one sector to the rows that they are on, and to rows between them where spokes are rare.

    Args: angle: (S,), not falling; level: (S, C).
    """
    base, half = turn.open * ROWS, 0.5 * turn.step
    low, high = max(int(angle[0] - half), base), min(int(angle[-1] + half), base + ROWS - 1)
    rows = np.arange(low, high + 1)
    start, end = np.searchsorted(angle, rows), np.searchsorted(angle, rows + 1)
    after, before = np.minimum(start, len(angle) - 1), np.maximum(start - 1, 0)
    middle = rows + 0.5
    nearest = np.where(np.abs(angle[before] - middle) < np.abs(angle[after] - middle), before, after)
    hit, swept = start < end, turn.swept[rows - base]
    first, last = np.where(hit, start, nearest), np.where(hit, end - 1, nearest)
    by_azimuth = level[first]
    for k in range(1, int((last - first).max()) + 1):
        np.maximum(by_azimuth, level[np.minimum(first + k, last)], out=by_azimuth)
    found = by_azimuth.take(turn.cells[0], axis=1)
    for cells in turn.cells[1:]:
        np.maximum(found, by_azimuth.take(cells, axis=1), out=found)
    found[:, turn.is_blind] = 0
    shown = hit | ((swept == 0) & (np.abs(angle[nearest] - middle) <= half + 1e-6))
    here = rows[shown] % AZIMUTHS
    turn.level[here] = np.where(swept[shown, None] == 2, np.maximum(turn.level[here], found[shown]), found[shown])
    turn.swept[rows[shown] - base] = 1 + hit[shown]
    stride = max(level.shape[1] // SAMPLED, 1)
    turn.levels += np.bincount(level[:: max(len(level) // ROWS, 1), ::stride].ravel(), minlength=256)


def shades_of(levels: Floats, db_per_level: float, bits: int) -> Array:
    """The level over the noise, 0 to 15, of each level of the video. (256,) uint8

    The noise is the most frequent level up to the median: in decibels, noise of a receiver is most frequent at its mean. Land,
    clutter and what a radar blanks do not move it. Of video that is 0 in most cells the radar has taken the noise.
    Args: levels: (256,) how often each came; db_per_level: 0: linear in amplitude; bits: of a cell.
    """
    level = np.arange(256)
    if bits <= COARSE_BITS:
        return np.asarray(np.minimum(level * SHADES // (2**bits - 1), SHADES), np.uint8)
    decibels = level * db_per_level if db_per_level else 20.0 * np.log10(np.maximum(level, 1))
    counts, total = levels.copy(), float(levels.sum())
    if counts[0] > 0.5 * total:
        return np.asarray(np.where(level > 0, np.clip(1 + (decibels - decibels[1]) // STEP_DB, 1, SHADES), 0), np.uint8)
    counts[0] = 0.0
    width = max(round(SMOOTH_DB / db_per_level) if db_per_level else 1, 1)
    smooth = np.convolve(counts, np.ones(width), "same")
    median = int(np.searchsorted(np.cumsum(counts), 0.5 * counts.sum()))
    noise = int(smooth[: median + 1].argmax())
    return np.asarray(np.clip(1 + (decibels - decibels[noise] - FIRST_DB) // STEP_DB, 0, SHADES), np.uint8)
