"""The picture of every cycle in metres from an origin, as CSV for scoring programs."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from coastwatch.geodesy import to_plane, turn

if TYPE_CHECKING:
    from coastwatch.centre import Cycle

COLUMNS = ("time", "track_id", "north", "east", "vn", "ve", "latitude_deg", "longitude_deg")


@contextmanager
def written(path: str, origin_deg: tuple[float, float]) -> Iterator[Callable[[Cycle], None]]:
    """A function that adds the picture of a cycle to the file.

    Args: path: of the CSV. origin_deg: latitude, longitude of the point where north and east are 0.
    """
    origin = np.array(origin_deg)
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)

        def add(cycle: Cycle) -> None:
            picture = cycle.picture
            position_m = to_plane(picture.position_deg, origin)
            velocity = np.einsum("vij,vj->vi", turn(picture.position_deg, origin), picture.velocity_m_s)
            motion = (position_m[:, 1], position_m[:, 0], velocity[:, 1], velocity[:, 0])
            columns = (picture.time_s, picture.vessel_id, *motion, *picture.position_deg.T)
            writer.writerows(zip(*(column.tolist() for column in columns), strict=True))

        yield add
