"""What is kept of radar video for drawing: one turn as a square picture, and particles while filters search and when they have vessels."""

from __future__ import annotations

import base64

import numpy as np

from coastwatch.batches import Floats, RadarExcess
from coastwatch.tracks import ParticlesMemory

SIDE = 240  # cells of a picture to each side
TURN_RAD = 2.0 * np.pi
EVERY = 5  # particles, of which one is drawn

Picture = dict[str, "float | str | list[list[float]]"]


def points(position_m: Floats) -> list[list[float]]:
    """East and north of each point, to a metre."""
    rounded: list[list[float]] = np.round(position_m).tolist()
    return rounded


def scan(video: RadarExcess, plots_m: Floats) -> Picture:
    """A turn as the level over the background in squares around the antenna, the strongest cell of each, and the plots in it.

    Returns: `reach_m`: half a side; `half_db`: base64 of uint8 rows from south, 0: nothing over the background; `candidates`.
    """
    cells = video.half_db.shape[1]
    reach_m = video.first_m + cells * video.cell_m
    range_m = video.first_m + (np.arange(cells) + 0.5) * video.cell_m
    east, north = (range_m * turn(video.azimuth_rad)[:, None] for turn in (np.sin, np.cos))
    column, row = (np.clip((at / reach_m + 1.0) * 0.5 * SIDE, 0, SIDE - 1).astype(np.int64) for at in (east, north))
    picture = np.zeros((SIDE, SIDE), np.uint8)
    np.maximum.at(picture, (row, column), np.maximum(video.half_db, 0).astype(np.uint8))
    text = base64.b64encode(picture.tobytes()).decode()
    return {"reach_m": reach_m, "half_db": text, "candidates": points(plots_m)}


def picture_of(kept: Picture) -> Floats:
    """The picture of `scan`. (SIDE, SIDE)"""
    levels = np.frombuffer(base64.b64decode(str(kept["half_db"])), np.uint8)
    return levels.reshape(SIDE, SIDE).astype(float)


def clouds(memory: ParticlesMemory) -> dict[str, list[list[float]]]:
    """Some particles of the filters that have vessels (`acquired`) and of those that look for one (`searching`)."""
    f = memory.filters
    return {
        name: points(f.particle[rows][:, ::EVERY, :2].reshape(-1, 2))
        for name, rows in (("acquired", f.acquired), ("searching", ~f.acquired))
    }
