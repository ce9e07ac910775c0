"""Which vessel had which MMSI, and when: by it the history of an MMSI is found, whose points stand in the order of cycles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from sqlalchemy import Connection, Index, func, or_, select
from sqlalchemy.orm import Mapped

from coastwatch.store.bulk import amend, append
from coastwatch.store.declaring import IN_KEY_ORDER, Base, key, of_run
from coastwatch.store.history_rule import Added
from coastwatch.store.past import points_of
from coastwatch.store.rows import Rows, Table
from coastwatch.store.tables import ENDED, Cycle

COLUMNS = ("time_s", "vessel_id", "latitude_deg", "longitude_deg", "sog_kn", "cog_deg", "major_m", "mmsi", "flags")
"""Of the history of an MMSI."""


class Identity(Base):
    """One row a stay of an MMSI with a vessel. to_cycle is the last cycle of it, null while it lasts."""

    __tablename__ = "identity"
    __table_args__ = (
        Index("identity_to", "run_id", "to_cycle", sqlite_where=ENDED, postgresql_where=ENDED),
        IN_KEY_ORDER,
    )
    run_id: Mapped[int] = of_run()
    mmsi: Mapped[int] = key()
    vessel_id: Mapped[int] = key()
    from_cycle: Mapped[int] = key()
    to_cycle: Mapped[int | None]


def write_identities(connection: Connection, run_id: int, number: int, added: Added) -> int:
    """Open and close what came and went in a cycle: nearly always nothing. Returns: rows that were added."""
    table = Base.metadata.tables["identity"]
    left = dict(zip(("mmsi", "vessel_id"), added.unnamed.T, strict=True))
    amend(connection, table, left, {"run_id": run_id, "to_cycle": None}, {"to_cycle": number - 1})
    return append(connection, table, [run_id, *added.named.T, number, None])


def history_of_mmsi(connection: Connection, values: Mapping[str, Any]) -> Rows:
    """The answer to question `history_of_mmsi`. Args: values: its parameters, `run` too."""
    run_id, mmsi, i = values["run"], int(values["mmsi"]), Identity
    latest = connection.scalar(select(func.max(Cycle.time_s)).where(Cycle.run_id == run_id))
    from_s = 0.0 if latest is None else latest - values["minutes"] * 60.0
    first = connection.scalar(select(func.min(Cycle.number)).where(Cycle.run_id == run_id, Cycle.time_s >= from_s))
    if first is None:
        return Rows(COLUMNS, [])
    since = or_(i.to_cycle.is_(None), i.to_cycle >= first)
    vessels = connection.scalars(select(i.vessel_id).where(i.run_id == run_id, i.mmsi == mmsi, since).distinct())
    found = [points_of(connection, run_id, vessel, first) for vessel in sorted(vessels)]
    if not found:
        return Rows(COLUMNS, [])
    columns = {name: np.concatenate([points.array(name) for points in found]) for name in COLUMNS}
    rows = np.flatnonzero((columns["mmsi"] == mmsi) & (columns["time_s"] >= from_s))
    rows = rows[np.lexsort((columns["vessel_id"][rows], columns["time_s"][rows]))]
    return Rows(COLUMNS, Table(COLUMNS, tuple(columns[name][rows] for name in COLUMNS)).rows)
