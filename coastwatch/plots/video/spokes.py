"""Spokes of a radar from cycle to cycle, and plots of the echoes that are complete: what all methods share.

Memory is as long as the window of azimuths, never a turn. The plots of a stream are the same wherever it is cut.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from coastwatch import kernels
from coastwatch.batches import (
    Array,
    Bools,
    Extractions,
    Floats,
    Ints,
    RadarExcess,
    RadarReports,
    RadarVideo,
    Rings,
    Sensors,
    Struct,
    Videos,
    column,
)
from coastwatch.geodesy import difference_m
from coastwatch.kernels.tables.row_numbers import require_rows
from coastwatch.plots.video.masks import Masks, MaskScale, mask_of

SECTORS = 128  # of a turn, on the coarse grid of what is learnt
BLOCK_CELLS = 12  # of a block on it
MOST_SPOKES = 2048  # at a time: bounds memory
LINEAR_DB = 0.5  # of the levels to which linear video is brought
REMASK_M = 50.0  # a mask is made again when the antenna has moved so far
MOST_DB = 60.0  # of the excess by which a cell is weighed
FWHM = 2.35  # standard deviations in a width at half power
PULSE_IN_MOMENT, BEAM_IN_MOMENT = 0.9, 0.72**2  # shares of the squares of pulse and beam that the moments of a point have
RANGE_M, BEAM_SHARE, GLINT = 5.0, 0.15, 0.1  # error of a plot: least in range; least in azimuth, in beams; share of its length
VESSEL_M = 120.0  # a plot that is nearer to a true vessel in range is of it
LEAST_HALF_DB, MOST_HALF_DB = -20, 60  # of what is given to trackers
TURN_RAD = 2.0 * np.pi


class ExtractionInput(NamedTuple):
    """What extraction is given in a cycle. Radars have their numbers within the region."""

    video: Videos
    sensors: Sensors


class ExtractionOutput(NamedTuple):
    """What extraction makes of the video of a cycle."""

    plots: RadarReports  # in order of arrival
    summary: Extractions


@dataclass(frozen=True, eq=False)
class SpokeMemory(Struct):
    """One radar at one range scale between two cycles."""

    first_m: float
    cell_m: float
    bits: int  # of a cell
    row: int  # the first spoke that is not looked at yet
    entered: int  # spokes whose clipped levels are written
    angle_before: Floats = column(np.float64, 3)  # as of `kernels.video.spokes.unwrapped`
    mask_deg: Floats = column(np.float64, 2)  # where the antenna was when the mask was made
    level: Array = column(np.uint8, "R", "C")  # of the spokes in the window; the following columns too
    clipped: Array = column(np.uint8, "R", "C")
    angle: Floats = column(np.float64, "R")
    step: Floats = column(np.float64, "R")
    azimuth: Floats = column(np.float64, "R")
    time_s: Floats = column(np.float64, "R")
    received_s: Floats = column(np.float64, "R")
    site_deg: Floats = column(np.float64, "R", 2)
    vessel_m: Floats = column(np.float64, "R", "V")
    background: Array = column(np.float32, "A", "B")  # this and the following as of `kernels.video.background.Learnt`
    square: Array = column(np.float32, "A", "B")
    level_sum: Array = column(np.float32, "C")
    square_sum: Array = column(np.float32, "C")
    cells: Array = column(np.int32, "C")
    sector: Ints = column(np.int64, 1, rows_of="A", least=-1)
    open_run: Ints = column(np.int64, "K", 3)  # of the last spoke: first cell, end, row of its echo
    open_echo: Floats = column(np.float64, "E", 13)  # as of `kernels.video.components.ECHO`

    def check_rows(self) -> None:
        """As `Struct.check_rows`."""
        super().check_rows()
        rows, cells = np.array([self.row, self.entered]), self.level.shape[1] + 1
        require_rows("SpokeMemory.row, entered", rows, len(self.level) + 1, 0)
        for name, numbers, size in zip(
            ("first", "end", "echo"), self.open_run.T, (cells, cells, len(self.open_echo)), strict=True
        ):
            require_rows(f"SpokeMemory.open_run: {name}", numbers, size, 0)


BY_SPOKE = ("level", "clipped", "angle", "step", "azimuth", "time_s", "received_s", "site_deg", "vessel_m")
LEARNT = ("background", "square", "level_sum", "square_sum", "cells", "sector")


@dataclass(frozen=True, eq=False)
class PictureMemory(Struct):
    """The picture of the turn of one radar that is under way, at one range scale. Columns by azimuth are even parts of the turn."""

    first_m: float
    cell_m: float
    bits: int  # of a cell
    cells: int  # of a spoke
    turn: int  # whole turns before
    lit_to: float  # angle up to which the picture is painted, as of `kernels.video.spokes.unwrapped`; NaN: nothing is
    angle_before: Floats = column(np.float64, 3)  # as of `kernels.video.spokes.unwrapped`
    mask_deg: Floats = column(np.float64, 2)  # where the antenna was when the mask was made
    picture: Array = column(np.uint8, "P", "P")  # north up, the antenna in the middle; 0 where nothing is painted
    time_s: Floats = column(np.float64, "A")  # of the beam; NaN: no spoke came
    site_deg: Floats = column(np.float64, "A", 2)
    vessel_m: Floats = column(np.float64, "A", "V")


@dataclass(frozen=True)
class ExtractionMemory:
    """What is kept of each radar that sends video, by its number: spokes or a picture, as the method looks at them."""

    radars: dict[int, SpokeMemory]
    pictures: dict[int, PictureMemory] = field(default_factory=dict)


class VideoRadar(NamedTuple):
    """A radar as its video is to be read."""

    number: int
    name: str
    beam_rad: float
    pulse_m: float
    blind_m: float
    db_per_level: float  # after linear video is brought to levels of half a decibel
    is_linear: bool
    land_deg: Rings  # in which nothing is looked for, beside that of the masks

    @classmethod
    def of(cls, sensors: Sensors, radar: int) -> VideoRadar:
        """This radar by its specification."""
        r = sensors.radars
        beam, pulse, blind, step = (float(column[radar]) for column in (r.beam_rad, r.pulse_m, r.blind_m, r.db_per_level))
        return cls(radar, str(r.name[radar]), beam, pulse, blind, step or LINEAR_DB, step == 0.0, sensors.land_deg)


def pulse_cells(radar: VideoRadar, video: RadarVideo) -> int:
    """Cells to each side over which a level is averaged."""
    return max(1, round(0.5 * radar.pulse_m / video.cell_m - 0.5))


class Detection(NamedTuple):
    """How a method looks at the video of a radar."""

    detector: Callable[[Any, Any, Any, Any, Any, Any], tuple[int, int]]
    """(spokes, rules, learnt, begun, runs, excess) -> how many runs, and the first spoke that may be needed again."""
    rules: Any  # kernels.video.background.Rules
    masks: Masks
    least_cells: int  # an echo of fewer is none


def extracted(
    memory: ExtractionMemory, given: ExtractionInput, detection_of: Callable[[VideoRadar, RadarVideo], Detection]
) -> tuple[ExtractionMemory, RadarReports]:
    """The plots of the echoes that these spokes complete, in order of arrival. A new range scale begins again."""
    if not given.video.parts:
        return memory, RadarReports.empty()
    radars, plots = dict(memory.radars), []
    for video in given.video.parts:
        radar = VideoRadar.of(given.sensors, video.sensor)
        detection = detection_of(radar, video)
        spokes = radars.get(video.sensor)
        if spokes is None or scale_of(spokes) != scale_of(video):
            spokes = _no_spokes(video)
        for first in range(0, len(video), MOST_SPOKES):
            some = video.take(slice(first, first + MOST_SPOKES))
            appended = _appended(spokes, some, radar, detection)
            spokes, found = _advanced(appended, radar, detection)
            plots.append(found)
        radars[video.sensor] = spokes
    together = RadarReports.join(plots)
    return ExtractionMemory(radars), together.take(np.argsort(together.received_s, kind="stable"))


def with_summary(
    plots: RadarReports, given: ExtractionInput, threshold_db: Callable[[VideoRadar], float] = lambda radar: float("nan")
) -> ExtractionOutput:
    """These plots, and how many are of each radar that sent video.

    Args: threshold_db: of a radar; NaN: not in decibels, or not known.
    """
    radar = sorted({video.sensor for video in given.video.parts})
    summary = Extractions(
        radar=np.array(radar, np.int64),
        plots=np.array([(plots.sensor == number).sum() for number in radar], np.int64),
        threshold_db=np.array([threshold_db(VideoRadar.of(given.sensors, number)) for number in radar], np.float64),
    )
    return ExtractionOutput(plots, summary)


def scale_of(of: SpokeMemory | PictureMemory | RadarVideo) -> tuple[float, ...]:
    """What stays the same while the memory of a radar is of use."""
    cells = of.cells if isinstance(of, PictureMemory) else of.level.shape[1]
    return of.first_m, of.cell_m, of.bits, cells, of.vessel_m.shape[1]


def _no_spokes(video: RadarVideo) -> SpokeMemory:
    """The memory before the first spoke of a radar, or of a range scale."""
    cells = video.level.shape[1]
    grid = np.full((SECTORS, -(-cells // BLOCK_CELLS)), np.nan, np.float32)
    none, levels, sums = np.zeros(0), np.zeros((0, cells), np.uint8), np.zeros(cells, np.float32)
    return SpokeMemory(
        first_m=video.first_m,
        cell_m=video.cell_m,
        bits=video.bits,
        row=0,
        entered=0,
        angle_before=np.full(3, np.nan),
        mask_deg=np.full(2, np.nan),
        level=levels,
        clipped=levels,
        **dict.fromkeys(("angle", "step", "azimuth", "time_s", "received_s"), none),
        site_deg=np.zeros((0, 2)),
        vessel_m=np.zeros((0, video.vessel_m.shape[1])),
        background=grid,
        square=grid.copy(),
        level_sum=sums,
        square_sum=sums.copy(),
        cells=np.zeros(cells, np.int32),
        sector=np.full(1, -1),
        open_run=np.zeros((0, 3), np.int64),
        open_echo=np.zeros((0, len(kernels.video.components.ECHO))),
    )


def _appended(m: SpokeMemory, video: RadarVideo, radar: VideoRadar, detection: Detection) -> SpokeMemory:
    """The memory with more spokes, masked but not looked at."""
    before = m.angle_before.copy()
    angle, step, kept = kernels.video.spokes.unwrapped(video.azimuth_rad, before, radar.beam_rad)
    if not kept.all():
        video, angle, step = video.take(kept), angle[kept], step[kept]
    level = in_decibels(video.level, radar)
    mask_deg, clipped = masked(m.mask_deg, video, radar, detection.masks)
    new = {
        "level": level,
        "clipped": clipped,
        "angle": angle,
        "step": step,
        "azimuth": video.azimuth_rad,
        "time_s": video.time_s,
        "received_s": video.received_s,
        "site_deg": video.site_deg,
        "vessel_m": video.vessel_m,
    }
    rows: dict[str, Any] = {name: np.concatenate([getattr(m, name), values]) for name, values in new.items()}
    return replace(m, angle_before=before, mask_deg=mask_deg, **rows)


def in_decibels(level: Array, radar: VideoRadar) -> Array:
    """Levels in steps of decibels, also of linear video. (S, C)"""
    if not radar.is_linear:
        return level
    decibels = 20.0 * np.log10(np.maximum(np.arange(256), 1.0))
    return np.asarray(np.round(decibels / LINEAR_DB).astype(np.uint8)[level])


def over_background(memory: ExtractionMemory, given: ExtractionInput) -> tuple[RadarExcess, ...]:
    """The video of a cycle as levels over the background, which extraction has just learnt; 0 without one, and where none came.

    Args: memory: after the step with this video.
    """
    out = []
    for video in given.video.parts:
        known, radar = memory.radars.get(video.sensor), VideoRadar.of(given.sensors, video.sensor)
        if known is None:  # a method that learns none
            known = _no_spokes(video)
        sectors, cells = len(known.background), video.level.shape[1]
        if cells != known.level.shape[1]:  # of a range scale that has changed since
            continue
        sector = (video.azimuth_rad % TURN_RAD / TURN_RAD * sectors).astype(np.int64) % sectors
        half_db = np.empty(video.level.shape, np.int8)
        for first in range(0, len(video), MOST_SPOKES // 8):  # some at a time: it bounds memory
            some = slice(first, first + MOST_SPOKES // 8)
            background = np.repeat(known.background[sector[some]], BLOCK_CELLS, axis=1)[:, :cells]
            over = (in_decibels(video.level[some], radar) - background) * np.float32(2.0 * radar.db_per_level)
            over[_missing(video.take(some))] = 0.0
            half_db[some] = np.clip(np.nan_to_num(over), LEAST_HALF_DB, MOST_HALF_DB)
        out.append(
            RadarExcess(
                video.sensor, video.first_m, video.cell_m, video.time_s, video.azimuth_rad % TURN_RAD, video.site_deg, half_db
            )
        )
    return tuple(out)


def masked(mask_deg: Floats, video: RadarVideo, radar: VideoRadar, masks: Masks) -> tuple[Floats, Array]:
    """Where the antenna was when the mask was made, and the mask of each spoke, with what did not come. (2,), (S, C)"""
    clipped, sectors = np.zeros(video.level.shape, np.uint8), masks.of(radar.name)
    land_deg = (*radar.land_deg, *masks.land_deg)
    scale, at = MaskScale(video.first_m, video.cell_m, video.level.shape[1], radar.beam_rad, radar.pulse_m), 0
    while (sectors or land_deg) and at < len(video):
        off_m = np.hypot(*difference_m(video.site_deg[at:], mask_deg).T)
        moved = ~(off_m <= REMASK_M)
        if moved[0]:
            mask_deg = video.site_deg[at].copy()
            moved = np.hypot(*difference_m(video.site_deg[at:], mask_deg).T) > REMASK_M
        end = at + int(moved.argmax()) if moved.any() else len(video)
        mask = mask_of(sectors, land_deg, (float(mask_deg[0]), float(mask_deg[1])), scale)
        clipped[at:end] = mask[(video.azimuth_rad[at:end] % TURN_RAD / TURN_RAD * len(mask)).astype(np.int64) % len(mask)]
        at = end
    clipped[_missing(video)] = kernels.video.background.MASKED
    return mask_deg, clipped


def _missing(video: RadarVideo) -> Bools:
    """Which cells of each spoke did not come. (S, C)"""
    out, some = np.zeros(video.level.shape, np.bool_), np.flatnonzero(video.missing[:, 1] > video.missing[:, 0])
    cell, (begin, end) = np.arange(video.level.shape[1]), video.missing[some].T[:, :, None]
    out[some] = (cell >= begin) & (cell < end)
    return out


def _advanced(m: SpokeMemory, radar: VideoRadar, detection: Detection) -> tuple[SpokeMemory, RadarReports]:
    """The memory after all spokes that can be looked at, and the plots of the echoes that are complete. It writes into the memory."""
    video, (count, cells) = kernels.video, m.level.shape
    learnt = video.background.Learnt(*(getattr(m, name) for name in LEARNT))
    released = np.full(count, count)
    begun, most = np.array([m.row, m.entered]), max(count - m.row, 0)
    runs, excess = np.empty((most * (cells // 2 + 1), 3), np.int32), np.empty(most * cells, np.float32)
    spokes = video.background.Spokes(m.level, m.clipped, m.angle, released)
    found, first = detection.detector(spokes, detection.rules, learnt, begun, runs, excess)
    echo = video.components.ECHO
    complete, open_run, open_echo = video.components.joined(
        runs[:found],
        excess,
        (m.angle, m.azimuth, m.time_s),
        (m.row, int(begun[0])),
        radar.beam_rad,
        (m.open_run, m.open_echo.view(echo)[:, 0]),
    )
    complete = complete[complete["cells"] >= detection.least_cells]
    plots = _plots(complete, released, m, radar, detection.rules.window_rad)
    rows: dict[str, Any] = {name: getattr(m, name)[first:].copy() for name in BY_SPOKE}
    open_: dict[str, Any] = {"open_run": open_run, "open_echo": open_echo.view(np.float64).reshape(-1, len(echo))}
    return replace(m, row=int(begun[0]) - first, entered=int(begun[1]) - first, **rows, **open_), plots


def _plots(echo: Array, released: Ints, m: SpokeMemory, radar: VideoRadar, window_rad: float) -> RadarReports:
    """Plots of complete echoes. Args: echo: (F,) `kernels.video.components.ECHO`; released: (R,) row that let each spoke be looked at."""
    weight, end = echo["weight"], echo["row"].astype(np.int64)
    cell, turned = echo["cell"] / weight, echo["azimuth"] / weight
    range_m = m.first_m + (echo["first_cell"] + cell + 0.5) * m.cell_m
    time_s = echo["first_time"] + echo["time"] / weight
    var_r = np.maximum(echo["cell2"] / weight - cell**2, 0.0) * m.cell_m**2
    var_a = np.maximum(echo["azimuth2"] / weight - turned**2, 0.0)
    both = (echo["both"] / weight - cell * turned) * m.cell_m
    ship_r = var_r - PULSE_IN_MOMENT * (radar.pulse_m / FWHM) ** 2
    ship_a = var_a - BEAM_IN_MOMENT * (radar.beam_rad / FWHM) ** 2
    long_m2 = np.maximum(var_r - (radar.pulse_m / FWHM) ** 2, 0.0)
    wide_rad2 = np.maximum(var_a - (radar.beam_rad / FWHM) ** 2, 0.0)
    sigma_m = np.sqrt(RANGE_M**2 + m.cell_m**2 / 12.0 + GLINT * long_m2)
    sigma_rad = np.sqrt((BEAM_SHARE * radar.beam_rad) ** 2 + m.step[end] ** 2 / 12.0 + GLINT * wide_rad2)
    # Spokes before the window may have left the memory already, so none of them is asked.
    row = np.maximum(np.searchsorted(m.time_s, time_s), np.searchsorted(m.angle, m.angle[end] - window_rad))
    row = np.minimum(row, end)
    return RadarReports(
        sensor=np.full(len(echo), radar.number, np.int64),
        time_s=time_s,
        received_s=m.received_s[released[end]],
        range_m=range_m,
        azimuth_deg=np.degrees((echo["first_azimuth"] + turned) % TURN_RAD),
        site_deg=m.site_deg[row],
        origin=origin_of(range_m, m.vessel_m[row]),
        range_sigma_m=sigma_m,
        azimuth_sigma_deg=np.degrees(sigma_rad),
        extent=np.column_stack([ship_r, range_m * both, range_m**2 * ship_a]),
        weight=weight,
    )


def origin_of(range_m: Floats, vessel_m: Floats) -> Ints:
    """The true vessel of each plot, -1: none. (F,) Args: vessel_m: (F, V) ranges of true vessels there, NaN: not there."""
    if not vessel_m.shape[1]:
        return np.full(len(range_m), -1)
    off_m = np.nan_to_num(np.abs(vessel_m - range_m[:, None]), nan=np.inf)
    nearest = off_m.argmin(axis=1)
    return np.where(off_m[np.arange(len(range_m)), nearest] <= VESSEL_M, nearest, -1)
