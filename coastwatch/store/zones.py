"""Zones that were drawn or sent, with who changed what and when. A change is a new row; no row is changed."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

from sqlalchemy import Connection, and_, func, insert, select, text

from coastwatch.errors import StoreError
from coastwatch.store.rows import Rows, fetch_rows
from coastwatch.store.schema.database import Store, reading, writing
from coastwatch.store.schema.tables import ZONE

FIRST_NUMBER = 1001
"""Numbers below are for zones of scenario files."""

Z = ZONE.c


class StoredZone(NamedTuple):
    """The newest version of a zone."""

    number: int
    version: int
    definition: Mapping[str, Any]  # as in a scenario file


def zones(store: Store, scenario: str) -> tuple[StoredZone, ...]:
    """The zones of a scenario that are not deleted, by number. Raises: StoreError."""
    with reading(store) as connection:
        return _zones(connection, scenario)


def zone_version(store: Store, scenario: str) -> int:
    """How often zones of a scenario were changed: it grows with every change, whatever old versions are deleted."""
    last = select(func.max(Z.version).label("version")).where(Z.scenario == scenario).group_by(Z.number).subquery()
    with reading(store) as connection:
        return int(connection.scalar(select(func.sum(last.c.version))) or 0)


def add_zone(store: Store, scenario: str, definition: Mapping[str, object], *, at_s: float, who: str) -> StoredZone | None:
    """Store a new zone. Returns: it; None where another one has its name. Raises: StoreError."""
    with writing(store) as connection:
        _wait_for_others(connection)
        if _named(connection, scenario, definition["name"]) is not None:
            return None
        newest = connection.scalar(select(func.max(Z.number)))
        number = FIRST_NUMBER if newest is None else int(newest) + 1
        _write(connection, scenario, number, 1, definition, at_s, who)
    return StoredZone(number, 1, definition)


class ZoneChangedError(StoreError):
    """A zone has another version than the caller knows."""


def change_zone(
    store: Store,
    scenario: str,
    number: int,
    definition: Mapping[str, object] | None,
    *,
    at_s: float,
    who: str,
    versions: Collection[int] | None = None,
) -> StoredZone | str | None:
    """Replace a zone, or delete it. Returns: it as it is or was; the name where another one has it; None where there is no such zone.

    Args: definition: none: delete it; versions: it must have one of them; none: any.
    Raises: ZoneChangedError: somebody changed it since; StoreError.
    """
    with writing(store) as connection:
        _wait_for_others(connection)
        before = next((zone for zone in _zones(connection, scenario) if zone.number == number), None)
        if before is None:
            return None
        if versions is not None and before.version not in versions:
            needed = f"needed version {before.version}, the newest: look at it again, then change it"
            raise ZoneChangedError(f"zone {before.definition['name']!r}: somebody has changed it meanwhile, {needed}")
        if definition is not None and _named(connection, scenario, definition["name"]) not in (None, number):
            return str(definition["name"])
        _write(connection, scenario, number, before.version + 1, definition, at_s, who)
    return before if definition is None else StoredZone(number, before.version + 1, definition)


def zone_changes(store: Store, scenario: str, number: int | None = None) -> Rows:
    """Every change, newest first: number, version, definition or null if deleted, changed_s, changed_by."""
    query = select(Z.number, Z.version, Z.definition, Z.changed_s, Z.changed_by).where(Z.scenario == scenario)
    if number is not None:
        query = query.where(Z.number == number)
    with reading(store) as connection:
        return fetch_rows(connection, query.order_by(Z.changed_s.desc(), Z.version.desc(), Z.number))


def _wait_for_others(connection: Connection) -> None:
    """Let one transaction at a time change zones, so that numbers, versions and names are of one zone. SQLite does so by itself."""
    if connection.dialect.name == "postgresql":
        connection.execute(text("LOCK TABLE zone IN SHARE ROW EXCLUSIVE MODE"))


def _zones(connection: Connection, scenario: str) -> tuple[StoredZone, ...]:
    last = select(Z.number, func.max(Z.version).label("version")).where(Z.scenario == scenario).group_by(Z.number).subquery()
    same = and_(Z.number == last.c.number, Z.version == last.c.version)
    rows = connection.execute(select(Z.number, Z.version, Z.definition).join(last, same).order_by(Z.number)).all()
    return tuple(StoredZone(row.number, row.version, row.definition) for row in rows if row.definition is not None)


def _named(connection: Connection, scenario: str, name: object) -> int | None:
    """The number of the zone with a name."""
    return next((zone.number for zone in _zones(connection, scenario) if zone.definition["name"] == name), None)


def _write(
    connection: Connection,
    scenario: str,
    number: int,
    version: int,
    definition: Mapping[str, object] | None,
    at_s: float,
    who: str,
) -> None:
    row = {"number": number, "version": version, "scenario": scenario, "changed_s": at_s, "changed_by": who}
    connection.execute(insert(ZONE).values({**row, "definition": None if definition is None else dict(definition)}))
