"""Rows as they are read, and the columns that every picture has, of now or of the past."""

from __future__ import annotations

from typing import Any, NamedTuple

from sqlalchemy import Connection, Executable, and_

from coastwatch.store.tables import VesselStatic

Box = tuple[float, float, float, float]
"""South, west, north, east in degrees; west > east crosses the antimeridian."""

STATIC = (VesselStatic.name, VesselStatic.call_sign, VesselStatic.ship_type, VesselStatic.length_m, VesselStatic.beam_m)


class Rows(NamedTuple):
    """Named columns and rows of plain values."""

    columns: tuple[str, ...]
    rows: list[tuple[Any, ...]]

    def column(self, name: str) -> list[Any]:
        """The values of one column."""
        at = self.columns.index(name)
        return [row[at] for row in self.rows]


def fetched(connection: Connection, query: Executable) -> Rows:
    """The answer of the database."""
    result = connection.execute(query)
    return Rows(tuple(result.keys()), [tuple(row) for row in result])


def picture_columns(table: Any) -> tuple[Any, ...]:
    """What a picture begins with. Args: table: Vessel or History."""
    place = (table.vessel_id, table.latitude_deg, table.longitude_deg, table.sog_kn, table.cog_deg, table.mmsi)
    return (*place, *STATIC, table.flags)


def same_mmsi(table: Any) -> Any:
    """What joins the static data of its vessel to a row."""
    return and_(VesselStatic.run_id == table.run_id, VesselStatic.mmsi == table.mmsi)
