"""Where the vessels of the current picture are, once more and in short: a box is found in an array, not in the rows of the picture.

A vessel is 16 bytes, in parts of 65,536 that are written with the picture and read as a whole: 1 ms for 100,000 vessels, where
SQLite looks at the rows of `vessel`, 200 bytes each, for 20 (`python -m scaling.load.queries --only "box now"`).
"""

from __future__ import annotations

import numpy as np
from sqlalchemy import Connection, delete, insert, select
from sqlalchemy.orm import Mapped

from coastwatch.batches import Floats, Ints
from coastwatch.store.box import Box
from coastwatch.store.declaring import IN_KEY_ORDER, Base, key

STEPS_A_DEG = 10_000_000  # 1 cm
REACH = 10
"""Steps that are looked for around a box: more than rounding takes."""

PART = 65_536
PLACE = np.dtype([("vessel", "<i8"), ("place", "<i4", 2)])
"""Number, latitude and longitude."""


class VesselPlace(Base):
    """The places of vessels of the current picture, written whenever table `vessel` is."""

    __tablename__ = "vessel_place"
    __table_args__ = IN_KEY_ORDER
    run_id: Mapped[int] = key()
    part: Mapped[int] = key()
    data: Mapped[bytes]  # PLACE after PLACE, in the order of vessels


def write_places(connection: Connection, run_id: int, vessel_id: Ints, position_deg: Floats) -> None:
    """Instead of those that are there. Args: (V,) sorted, (V, 2)."""
    connection.execute(delete(VesselPlace).where(VesselPlace.run_id == run_id))
    packed = np.empty(len(vessel_id), PLACE)
    packed["vessel"], packed["place"] = vessel_id, np.round(position_deg * STEPS_A_DEG)
    parts = [packed[low : low + PART].tobytes() for low in range(0, max(len(packed), 1), PART)]
    rows = [{"run_id": run_id, "part": part, "data": data} for part, data in enumerate(parts)]
    connection.execute(insert(VesselPlace), rows)


def vessels_near(connection: Connection, run_id: int, bbox: Box) -> Ints | None:
    """The vessels of the current picture in a box, and some within centimetres of it, sorted; None: it is not known."""
    query = select(VesselPlace.data).where(VesselPlace.run_id == run_id).order_by(VesselPlace.part)
    parts = [bytes(data) for data in connection.scalars(query)]
    if not parts:
        return None
    packed = np.frombuffer(b"".join(parts), PLACE)
    south, west, north, east = bbox
    latitude, longitude = packed["place"].T
    rows = np.flatnonzero((latitude >= south * STEPS_A_DEG - REACH) & (latitude <= north * STEPS_A_DEG + REACH))
    after, before = longitude[rows] >= west * STEPS_A_DEG - REACH, longitude[rows] <= east * STEPS_A_DEG + REACH
    found: Ints = packed["vessel"][rows[after & before if west <= east else after | before]].astype(np.int64)
    return found
