"""Plots where a picture of a whole turn has blobs: the way of Heymann et al., for comparison and for pictures of a screen.

Source: F. Heymann, J. Hoth, P. Banys, G. Siegert, Validation of Radar Image Tracking Algorithms with Simulated Data, section 3.2.2;
OpenCV, SimpleBlobDetector.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Annotated, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from coastwatch import kernels
from coastwatch.batches import Array, Floats, Ints, RadarReports, RadarVideo
from coastwatch.errors import InputError
from coastwatch.plots.video.masks import Masks
from coastwatch.plots.video.spokes import (
    BEAM_SHARE,
    RANGE_M,
    TURN_RAD,
    ExtractionInput,
    ExtractionMemory,
    ExtractionOutput,
    PictureMemory,
    VideoRadar,
    in_decibels,
    masked,
    origin_of,
    scale_of,
    with_summary,
)
from coastwatch.stage import Count, Method, NotNegative, Positive, Share

AZIMUTHS = 1024  # parts of a turn whose time of the beam is kept
MOST_SPOKES = 256  # that are painted at a time: bounds memory
LEAST = 1e-3  # of OpenCV, which refuses 0
WHITE = 255  # of a picture of two colours
COMPLETE = 0.25  # of a spoke that may lack of a turn: angles are rounded

Level = Annotated[int, Field(ge=1, le=255)]


class BlobExtraction(Method):
    """A picture of each turn is thresholded at several levels; regions of the right size and shape at some of them are plots.

    It is for comparison with a paper, and needs the extra `blobs` (OpenCV). Plots come when the turn is complete, at north: up to
    a turn after the beam. A vessel far away has few pixels and is often missed.
    """

    method: Literal["blobs"] = "blobs"
    pixels: Annotated[int, Field(ge=32, le=2048)] = 1024  # whole number; width and height of the picture, over twice the range
    least_level: Level = 40  # whole number of steps of the video, 1 to 255: the lowest threshold
    most_level: Level = 125  # whole number of such steps: thresholds are lower
    level_step: Level = 5  # whole number of such steps from one threshold to the next
    least_thresholds: Count = 3  # whole number of thresholds at which a blob is found, one at least
    least_apart_pixels: Positive = 3.0  # number of pixels; blobs whose middles are nearer are one
    least_pixels: NotNegative = 2.0  # number of pixels of a blob at each threshold
    most_pixels: Positive = 400.0  # number of pixels of a blob: larger ones are land or sea clutter
    least_convexity: Share = 0.6  # area as a share of that of the convex hull
    least_circularity: Share = 0.1  # ratio: 4 pi area over squared perimeter, 1 of a disc
    least_inertia: Share = 0.02  # ratio of the smaller to the larger second moment: 1 of a disc, 0 of a line
    masks: Masks = Masks()  # where nothing is looked for

    @model_validator(mode="after")
    def _has_thresholds(self) -> Self:
        if self.most_level <= self.least_level:
            raise InputError(f"most_level: got {self.most_level}, needed more than least_level, {self.least_level}")
        return self

    def init(self) -> ExtractionMemory:
        """The memory before the first cycle. Raises: InputError: OpenCV is not installed."""
        require_opencv()
        return ExtractionMemory({})

    def step(self, memory: ExtractionMemory, given: ExtractionInput) -> tuple[ExtractionMemory, ExtractionOutput]:
        """The plots of the turns that the video of this cycle completes. A new range scale begins again. Raises: InputError."""
        if not given.video.parts:
            return memory, with_summary(RadarReports.empty(), given)
        pictures, plots = dict(memory.pictures), []
        for video in given.video.parts:
            radar = VideoRadar.of(given.sensors, video.sensor)
            before = pictures.get(video.sensor)
            if before is None or scale_of(before) != scale_of(video) or len(before.picture) != self.pixels:
                before = _dark(video, self.pixels)
            pictures[video.sensor], found = self._painted(before, video, radar)
            plots += found
        together = RadarReports.join([RadarReports.empty(), *plots])
        in_order = together.take(np.argsort(together.received_s, kind="stable"))
        return replace(memory, pictures=pictures), with_summary(in_order, given)

    def _painted(self, m: PictureMemory, video: RadarVideo, radar: VideoRadar) -> tuple[PictureMemory, list[RadarReports]]:
        """The memory with more spokes in its picture, and the plots of each turn that they complete."""
        angle_before = m.angle_before.copy()
        angle, step, kept = kernels.video.spokes.unwrapped(video.azimuth_rad, angle_before, radar.beam_rad)
        if not kept.all():
            video, angle, step = video.take(kept), angle[kept], step[kept]
        if not len(video):
            return replace(m, angle_before=angle_before), []
        mask_deg, mask = masked(m.mask_deg, video, radar, self.masks)
        level = np.where(mask == kernels.video.background.MASKED, np.uint8(0), in_decibels(video.level, radar))
        # A spoke lights from the end of the one before, at most half a beam, to half a step beyond itself.
        ends = np.maximum.accumulate(np.append(angle[0] if np.isnan(m.lit_to) else m.lit_to, angle + 0.5 * step))
        begin, end = np.maximum(ends[:-1], angle - 0.5 * np.maximum(radar.beam_rad, step)), ends[1:]
        layout = layout_of(PictureScale(video.first_m, video.cell_m, video.level.shape[1], radar.blind_m), self.pixels)
        picture, time_s = m.picture.copy(), m.time_s.copy()
        site_deg, vessel_m, turn, at, plots = m.site_deg.copy(), m.vessel_m.copy(), m.turn, 0, []
        while True:
            complete = np.flatnonzero(end[at:] > TURN_RAD * (turn + 1) - COMPLETE * step[at:])
            last = at + int(complete[0]) + 1 if len(complete) else len(angle)
            for first in range(at, last, MOST_SPOKES):
                rows = slice(first, min(first + MOST_SPOKES, last))
                lit_from, lit_to = begin[rows] - TURN_RAD * turn, end[rows] - TURN_RAD * turn
                pixel, spoke = _lit(lit_from, lit_to, layout.azimuth)
                picture.reshape(-1)[layout.pixel[pixel]] = _means(level[rows], layout.averaged)[spoke, layout.cell[pixel]]
                part, spoke = _lit(lit_from, lit_to, MIDDLES)
                time_s[part], site_deg[part] = video.time_s[rows][spoke], video.site_deg[rows][spoke]
                vessel_m[part] = video.vessel_m[rows][spoke]
            if not len(complete):
                break
            whole = replace(m, picture=picture, time_s=time_s, site_deg=site_deg, vessel_m=vessel_m)
            plots.append(self._plots(whole, layout, radar, float(video.received_s[last - 1])))
            picture[:] = 0
            time_s[:] = site_deg[:] = vessel_m[:] = np.nan
            turn, at = turn + 1, last - 1
        after = replace(m, picture=picture, time_s=time_s, site_deg=site_deg, vessel_m=vessel_m)
        return replace(after, turn=turn, lit_to=float(end[-1]), angle_before=angle_before, mask_deg=mask_deg), plots

    def _plots(self, m: PictureMemory, layout: Layout, radar: VideoRadar, received_s: float) -> RadarReports:
        """The plots of a complete picture, in order of the beam."""
        known = np.flatnonzero(np.isfinite(m.time_s))
        if not len(known) or int(m.picture.max()) <= self.least_level:
            return RadarReports.empty()
        middle = 0.5 * (self.pixels - 1)
        found = self._blobs(m.picture)
        east_m, north_m = (found[:, 0] - middle) * layout.pixel_m, (middle - found[:, 1]) * layout.pixel_m
        range_m, azimuth = np.hypot(east_m, north_m), np.arctan2(east_m, north_m) % TURN_RAD
        order = np.lexsort((range_m, azimuth))
        range_m, azimuth = range_m[order], azimuth[order]
        part = np.minimum((azimuth / TURN_RAD * AZIMUTHS).astype(np.int64), AZIMUTHS - 1)
        part = known[np.minimum(np.searchsorted(known, part), len(known) - 1)]  # of a blob over a gap, what comes after it
        pixel_m2 = layout.pixel_m**2 / 12.0
        sigma_m = np.full(len(found), np.sqrt(RANGE_M**2 + m.cell_m**2 / 12.0 + pixel_m2))
        sigma_rad = np.sqrt((BEAM_SHARE * radar.beam_rad) ** 2 + pixel_m2 / np.maximum(range_m, layout.pixel_m) ** 2)
        return RadarReports(
            sensor=np.full(len(found), radar.number, np.int64),
            time_s=m.time_s[part],
            received_s=np.full(len(found), received_s),
            range_m=range_m,
            azimuth_deg=np.degrees(azimuth),
            site_deg=m.site_deg[part],
            origin=origin_of(range_m, m.vessel_m[part]),
            range_sigma_m=sigma_m,
            azimuth_sigma_deg=np.degrees(sigma_rad),
        )

    def _blobs(self, picture: Array) -> Floats:
        """Column and row of the middle of each blob, as of OpenCV. (F, 2) Raises: InputError."""
        require_opencv()
        import cv2

        wanted = cv2.SimpleBlobDetector.Params()
        wanted.minThreshold, wanted.maxThreshold, wanted.thresholdStep = self.least_level, self.most_level, self.level_step
        wanted.minRepeatability, wanted.minDistBetweenBlobs = self.least_thresholds, self.least_apart_pixels
        wanted.filterByColor, wanted.blobColor = True, WHITE
        wanted.filterByArea, wanted.minArea, wanted.maxArea = True, max(self.least_pixels, LEAST), self.most_pixels
        wanted.filterByConvexity, wanted.minConvexity = True, max(self.least_convexity, LEAST)
        wanted.filterByCircularity, wanted.minCircularity = True, max(self.least_circularity, LEAST)
        wanted.filterByInertia, wanted.minInertiaRatio = True, max(self.least_inertia, LEAST)
        found = cv2.SimpleBlobDetector.create(wanted).detect(picture)
        return np.array([point.pt for point in found], np.float64).reshape(-1, 2)


class PictureScale(NamedTuple):
    """The cells of a spoke, and the range within which nothing is looked for."""

    first_m: float
    cell_m: float
    cells: int
    blind_m: float


class Layout(NamedTuple):
    """The pixels of a picture that lie in the range of the radar, in order of azimuth."""

    azimuth: Floats  # (Q,) rad
    pixel: Ints  # (Q,) of the flat picture
    cell: Ints  # (Q,) of a spoke: the first of those of the pixel
    averaged: int  # cells of a pixel
    pixel_m: float


MIDDLES = (np.arange(AZIMUTHS) + 0.5) * TURN_RAD / AZIMUTHS


@lru_cache(maxsize=4)
def layout_of(scale: PictureScale, pixels: int) -> Layout:
    """Where each pixel lies: 16 octets a pixel. The picture reaches as far as the spokes."""
    outer_m = scale.first_m + scale.cells * scale.cell_m
    pixel_m = 2.0 * outer_m / pixels
    averaged = min(max(1, round(pixel_m / scale.cell_m)), scale.cells)
    off_m = (np.arange(pixels) - 0.5 * (pixels - 1)) * pixel_m
    range_m, azimuth = np.hypot(off_m, -off_m[:, None]).ravel(), (np.arctan2(off_m, -off_m[:, None]) % TURN_RAD).ravel()
    pixel = np.flatnonzero((range_m >= max(scale.blind_m, scale.first_m)) & (range_m < outer_m))
    pixel = pixel[np.argsort(azimuth[pixel], kind="stable")]
    cell = np.round((range_m[pixel] - scale.first_m) / scale.cell_m - 0.5 * averaged).astype(np.int32)
    made = Layout(azimuth[pixel], pixel.astype(np.int32), np.clip(cell, 0, scale.cells - averaged), averaged, pixel_m)
    for column in (made.azimuth, made.pixel, made.cell):
        column.flags.writeable = False
    return made


def _lit(begin: Floats, end: Floats, azimuth: Floats) -> tuple[Ints, Ints]:
    """Which of some azimuths spokes light, and which spoke each of them. Args: begin, end: (S,); azimuth: sorted; all rad."""
    first, last = np.searchsorted(azimuth, [begin[0], end[-1]]).tolist()
    spoke = np.searchsorted(begin, azimuth[first:last], side="right") - 1
    lit = np.flatnonzero(azimuth[first:last] < end[spoke])
    return lit + first, spoke[lit]


def _means(level: Array, averaged: int) -> Array:
    """The mean of each cell and those behind it. (S, C - averaged + 1) uint8. Args: averaged: cells."""
    if averaged == 1:
        return level
    sums = np.cumsum(np.pad(level, ((0, 0), (1, 0))), axis=1, dtype=np.int32)
    return ((sums[:, averaged:] - sums[:, :-averaged] + averaged // 2) // averaged).astype(np.uint8)


def _dark(video: RadarVideo, pixels: int) -> PictureMemory:
    """The memory before the first spoke of a radar, or of a range scale."""
    return PictureMemory(
        first_m=video.first_m,
        cell_m=video.cell_m,
        bits=video.bits,
        cells=video.level.shape[1],
        turn=0,
        lit_to=float("nan"),
        angle_before=np.full(3, np.nan),
        mask_deg=np.full(2, np.nan),
        picture=np.zeros((pixels, pixels), np.uint8),
        time_s=np.full(AZIMUTHS, np.nan),
        site_deg=np.full((AZIMUTHS, 2), np.nan),
        vessel_m=np.full((AZIMUTHS, video.vessel_m.shape[1]), np.nan),
    )


def require_opencv() -> None:
    """Raises: InputError: OpenCV is not installed."""
    try:
        import cv2  # noqa: F401
    except ImportError as error:
        raise InputError(
            "extraction.method: got 'blobs', needed the package opencv-python-headless: pip install 'coastwatch[blobs]'"
        ) from error
