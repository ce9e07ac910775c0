"""Plots where video is over its local background: a constant rate of false alarms."""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from pydantic import model_validator

from coastwatch import kernels
from coastwatch.batches import RadarVideo
from coastwatch.plots.video.masks import Masks
from coastwatch.plots.video.spokes import (
    BLOCK_CELLS,
    MOST_DB,
    Detection,
    ExtractionInput,
    ExtractionMemory,
    ExtractionOutput,
    SpokeMemory,
    VideoRadar,
    extracted,
    pulse_cells,
    with_summary,
)
from coastwatch.stage import Count, Method, NotNegative, Positive

FIRST_TURN_DB = 12.0  # most that counts for the deviation while none is known
LEAST_GUARD = 1  # cells of the window beyond the guard, to each side


class CfarExtraction(Method):
    """Cells whose mean level over a beam and a pulse is over the mean of the window around, less a guard, are joined to echoes.

    Levels are clipped at the background of the turn before and a little more, so that a ship or a coast hides nothing beside it.
    The threshold follows the local deviation: spiky sea clutter makes no more false plots than noise.
    """

    method: Literal["cfar"] = "cfar"
    threshold_db: Positive = 9.0  # least excess over the background that is detected
    threshold_sigmas: NotNegative = 3.5  # the same, in local deviations; the larger one counts
    clip_db: Positive = 6.0  # over the background of the turn before; what is stronger counts as this in the background
    window_deg: Positive = 5.7  # half size of the window in azimuth
    window_m: Positive = 260.0  # half size in range
    guard_deg: Positive = 2.2  # half size of the guard in azimuth: what an echo may fill
    guard_m: Positive = 87.0  # half size in range
    least_cells: Count = 4  # whole number of cells; an echo of fewer is no plot
    masks: Masks = Masks()  # where nothing is looked for

    @model_validator(mode="after")
    def _window_is_wider_than_its_guard(self) -> Self:
        if self.guard_deg >= self.window_deg:
            raise ValueError(f"guard_deg: got {self.guard_deg}, needed less than window_deg ({self.window_deg})")
        return self

    def init(self) -> ExtractionMemory:
        """The memory before the first cycle."""
        return ExtractionMemory({})

    def step(self, memory: ExtractionMemory, given: ExtractionInput) -> tuple[ExtractionMemory, ExtractionOutput]:
        """The plots of the echoes that the video of this cycle completes."""
        after, plots = extracted(memory, given, self._detection)
        return after, with_summary(plots, given, lambda radar: self._threshold_db(after.radars[radar.number], radar))

    def _threshold_db(self, spokes: SpokeMemory, radar: VideoRadar) -> float:
        """The median of what is detected over the background."""
        square = spokes.square[np.isfinite(spokes.square)]
        if not len(square):
            return float("nan")
        deviation_db = radar.db_per_level * float(np.sqrt(np.maximum(np.median(square), 0.0)))
        return max(self.threshold_db, self.threshold_sigmas * deviation_db)

    def _detection(self, radar: VideoRadar, video: RadarVideo) -> Detection:
        background = kernels.video.background
        cells = video.level.shape[1]  # no window is larger
        pulse = min(pulse_cells(radar, video), cells)
        guard = min(max(round(self.guard_m / video.cell_m), pulse), cells)
        rules = background.Rules(
            window_rad=float(np.radians(self.window_deg)),
            guard_rad=float(np.radians(self.guard_deg)),
            beam_rad=0.5 * radar.beam_rad,
            window_cells=max(min(round(self.window_m / video.cell_m), cells), guard + LEAST_GUARD),
            guard_cells=guard,
            pulse_cells=pulse,
            first_cell=max(int(np.ceil((radar.blind_m - video.first_m) / video.cell_m)), 0),
            block_cells=BLOCK_CELLS,
            threshold=self.threshold_db / radar.db_per_level,
            sigmas=self.threshold_sigmas,
            clip=self.clip_db / radar.db_per_level,
            first_turn=FIRST_TURN_DB / radar.db_per_level,
            db_per_level=radar.db_per_level,
            most_db=MOST_DB,
        )
        return Detection(background.detected, rules, self.masks, self.least_cells)
