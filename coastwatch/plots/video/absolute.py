"""Plots where video is over a level that is set."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

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
    VideoRadar,
    extracted,
    with_summary,
)
from coastwatch.stage import Count, Method

WINDOW_RAD = np.radians(5.7)  # of spokes that are kept


class AbsoluteExtraction(Method):
    """Cells whose level is over one that is set are joined to echoes. There is no background: for radars that send cleaned video."""

    method: Literal["absolute"] = "absolute"
    least_level: Annotated[int, Field(ge=1, le=255)] = 1  # whole number of steps of the video, 1 to 255
    least_cells: Count = 4  # whole number of cells; an echo of fewer is no plot
    masks: Masks = Masks()  # where nothing is looked for

    def init(self) -> ExtractionMemory:
        """The memory before the first cycle."""
        return ExtractionMemory({})

    def step(self, memory: ExtractionMemory, given: ExtractionInput) -> tuple[ExtractionMemory, ExtractionOutput]:
        """The plots of the echoes that the video of this cycle completes."""
        after, plots = extracted(memory, given, self._detection)
        return after, with_summary(plots, given)

    def _detection(self, radar: VideoRadar, video: RadarVideo) -> Detection:
        background = kernels.video.background
        rules = background.Rules(
            window_rad=float(WINDOW_RAD),
            guard_rad=0.0,
            beam_rad=0.5 * radar.beam_rad,
            window_cells=0,
            guard_cells=0,
            pulse_cells=0,
            first_cell=max(int(np.ceil((radar.blind_m - video.first_m) / video.cell_m)), 0),
            block_cells=BLOCK_CELLS,
            threshold=self.least_level - 0.5,
            sigmas=0.0,
            clip=0.0,
            first_turn=0.0,
            db_per_level=radar.db_per_level,
            most_db=MOST_DB,
        )
        return Detection(background.over_level, rules, self.masks, self.least_cells)
