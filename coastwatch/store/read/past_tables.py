"""The tables of a run as they were after a past cycle: temporary tables and views of the same names hide every later row.

SQLite and PostgreSQL look for a name among temporary tables first. So the SQL that answers a question now also answers it then.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from sqlalchemy import Connection, text

from coastwatch.store.read.picture_queries import picture_of_cycle
from coastwatch.store.read.server_runs import HAS_PICTURE
from coastwatch.store.rows import Column, NullableId, insert
from coastwatch.store.runs import cycle_at
from coastwatch.store.schema.database import Store, refusals
from coastwatch.store.schema.tables import (
    ASSOCIATION,
    BEARING_ASSOCIATION,
    DECIDED_PATH,
    EVENT_GAP,
    HISTORY,
    SENSOR_REGISTRATION,
    SPOT,
    STAGE_TIMING,
    STAYS,
    VESSEL,
)

OF_CYCLE = (STAGE_TIMING, HISTORY, DECIDED_PATH, ASSOCIATION, BEARING_ASSOCIATION, SPOT, SENSOR_REGISTRATION, EVENT_GAP)
"""Tables whose rows belong to the cycle in their column `cycle`."""

OF_RUN = "run_id = {run}"

MEMBER_VIEW = """
SELECT run_id, vessel_id, source, track_id FROM {main}member_history
WHERE run_id = {run} AND from_cycle <= {cycle} AND (to_cycle IS NULL OR to_cycle >= {cycle})
"""

BEARING_TRACK_VIEW = """
SELECT b.run_id, b.source, b.bearing_track AS track_id, b.bearing_deg, CAST(NULL AS DOUBLE PRECISION) AS rate_deg_s, s.latitude_deg,
    s.longitude_deg, b.vessel_id, c.time_s AS updated_s
FROM {main}bearing_association b
    JOIN {main}source o ON o.run_id = b.run_id AND o.number = b.source
    JOIN {main}sensor s ON s.run_id = b.run_id AND s.kind = 'bearing' AND s.name = o.name
    JOIN {main}cycle c ON c.run_id = b.run_id AND c.number = b.cycle
WHERE b.run_id = {run} AND b.cycle = (
    SELECT max(number) FROM {main}cycle WHERE run_id = {run} AND number <= {cycle} AND associations_kept
)
"""
"""Of the bearing tracks of the past only those are stored that were given to a vessel, without their rates."""

EVENT_VIEW = """
SELECT e.run_id, e.vessel_id, e.kind, e.subject, e.from_cycle,
    CASE WHEN g.cycle IS NOT NULL THEN g.last_cycle WHEN e.to_cycle < {cycle} THEN e.to_cycle END AS to_cycle, e.start_s,
    CASE WHEN g.cycle IS NOT NULL THEN g.last_s WHEN e.to_cycle < {cycle} THEN e.end_s END AS end_s,
    e.latitude_deg, e.longitude_deg, e.sog_kn, e.mmsi, e.evidence
FROM {main}event e
    LEFT JOIN {main}event_gap g ON g.run_id = e.run_id AND g.vessel_id = e.vessel_id AND g.kind = e.kind
        AND g.subject = e.subject AND g.from_cycle = e.from_cycle AND g.last_cycle < {cycle} AND g.cycle > {cycle}
WHERE e.run_id = {run} AND e.from_cycle <= {cycle}
"""
"""An event in whose gap the cycle lies had ended then."""


@contextmanager
def as_of(store: Store, run_id: int, at_s: float) -> Iterator[Connection]:
    """A transaction that reads one run as it was in its newest kept cycle up to an instant. It changes nothing.

    Raises: StoreError where there is no such run, or nothing is stored so early.
    """
    options = {"isolation_level": "REPEATABLE READ"} if store.engine.dialect.name == "postgresql" else {}
    with refusals(store), store.engine.connect() as plain, plain.execution_options(**options).begin() as transaction:
        cycle = cycle_at(plain, store, run_id, at_s, HAS_PICTURE)
        _hide_later_rows(plain, run_id, cycle)
        try:
            yield plain
        finally:
            transaction.rollback()  # removes what is temporary


def _hide_later_rows(connection: Connection, run_id: int, cycle: int) -> None:
    """Temporary tables and views in the place of every table with rows of cycles."""
    main = "main." if connection.dialect.name == "sqlite" else ""  # a view of SQLite would name itself
    picture = picture_of_cycle(connection, run_id, cycle, None)
    connection.execute(text(f"CREATE TEMPORARY TABLE vessel AS SELECT * FROM {main}vessel WHERE run_id < 0"))
    values: dict[str, Column] = {name: picture.array(name) for name in picture.columns if name in VESSEL.c}
    values |= {name: NullableId(picture.array(name)) for name in ("mmsi", "nav_status")}
    values |= {"sources": [name or "" for name in picture.column("sources")]}
    insert(connection, VESSEL, [run_id if c.name == "run_id" else values.get(c.name) for c in VESSEL.columns])
    views = {
        "event": EVENT_VIEW,
        "member": MEMBER_VIEW,
        "bearing_track": BEARING_TRACK_VIEW,
    }  # they read the tables that follow
    views |= {table.name: f"SELECT * FROM {{main}}{table.name} WHERE {OF_RUN} AND cycle <= {{cycle}}" for table in OF_CYCLE}
    ended = "CASE WHEN to_cycle < {cycle} THEN to_cycle END AS to_cycle"  # a stay that had not ended is without an end
    for table in STAYS:
        columns = ", ".join(ended if name == "to_cycle" else name for name in table.c.keys())  # noqa: SIM118
        views[table.name] = f"SELECT {columns} FROM {{main}}{table.name} WHERE {OF_RUN} AND from_cycle <= {{cycle}}"
    views["cycle"] = f"SELECT * FROM {{main}}cycle WHERE {OF_RUN} AND number <= {{cycle}}"
    for name, sql in views.items():
        view = sql.format(main=main, run=int(run_id), cycle=int(cycle))
        connection.execute(text(f"CREATE TEMPORARY VIEW {name} AS {view}"))
