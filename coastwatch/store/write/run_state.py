"""The newest stored cycle of a run, with which the next one is compared. It is kept in memory, and read after a restart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from sqlalchemy import Connection, and_, delete, false, func, insert, select, update

from coastwatch.batches import Ints, RegistrationState
from coastwatch.store.history_rule import Points, no_points, rate_deg_s
from coastwatch.store.rows import fetch_arrays
from coastwatch.store.runs import is_there, newest_cycle
from coastwatch.store.schema.database import NoSuchRunError
from coastwatch.store.schema.tables import (
    AIS_FEED,
    CYCLE,
    HISTORY,
    MEMBER,
    MEMBER_HISTORY,
    METADATA,
    PRESENCE,
    RUN,
    SENSOR,
    SENSOR_REGISTRATION,
    SOURCE,
    STAGE_TIMING,
    STAYS,
    VESSEL_STATIC,
)
from coastwatch.store.write.events import Timeline, truncate_events
from coastwatch.store.write.static_names import StoredNames
from coastwatch.store.write.to_rows import LastReport


@dataclass(frozen=True, eq=False)
class RunState:
    """The newest cycle of a run."""

    cycle: int  # -1 before the first
    time_s: float
    members: Ints  # (L, 3) vessel, source, track, sorted
    vessels: Ints  # (V, 1) sorted
    points: Points
    names: StoredNames
    last_report: LastReport
    radar_states: tuple[int, ...]  # as last written
    first_history: int  # first cycle whose history is kept
    first_details: int  # first cycle whose associations, spots, timings and registrations are kept
    timeline: Timeline
    stations: int
    feeds: int
    source_names: tuple[str, ...]
    source_kinds: tuple[str, ...]


def read_run_state(connection: Connection, run_id: int, where: str) -> RunState:
    """The stored state of a run, which is then marked as running.

    Raises: StoreError where there is no such run.
    """
    running = connection.execute(update(RUN).where(*is_there(run_id)).values(status="running", finished_utc=None))
    if running.rowcount == 0:
        raise no_such_run(run_id, where)
    number, time_s = newest_cycle(connection, run_id) or (-1, -np.inf)
    members = select(MEMBER.c.vessel_id, MEMBER.c.source, MEMBER.c.track_id).where(MEMBER.c.run_id == run_id)
    vessels = select(PRESENCE.c.vessel_id).where(PRESENCE.c.run_id == run_id, PRESENCE.c.to_cycle.is_(None))
    statics = select(VESSEL_STATIC.c.mmsi, VESSEL_STATIC.c.updated_s).where(VESSEL_STATIC.c.run_id == run_id)
    names = connection.execute(
        select(SOURCE.c.name, SOURCE.c.kind).where(SOURCE.c.run_id == run_id).order_by(SOURCE.c.number)
    ).all()
    stations = select(func.count()).where(SENSOR.c.run_id == run_id, SENSOR.c.kind == "ais")
    feeds = select(func.count()).where(AIS_FEED.c.run_id == run_id)
    last_report, states = _registration(connection, run_id)
    first_history = select(func.min(CYCLE.c.number)).where(CYCLE.c.run_id == run_id, CYCLE.c.history_from.is_not(None))
    first_details = select(func.min(STAGE_TIMING.c.cycle)).where(STAGE_TIMING.c.run_id == run_id)
    return RunState(
        cycle=number,
        time_s=time_s,
        members=np.stack(fetch_arrays(connection, members.order_by(MEMBER.c.vessel_id, MEMBER.c.source, MEMBER.c.track_id)), 1),
        vessels=np.stack(fetch_arrays(connection, vessels.order_by(PRESENCE.c.vessel_id)), 1),
        points=_points(connection, run_id, number),
        names=StoredNames(*fetch_arrays(connection, statics.order_by(VESSEL_STATIC.c.mmsi))),
        last_report=last_report,
        radar_states=states,
        first_history=connection.scalar(first_history) or 0,
        first_details=connection.scalar(first_details) or 0,
        timeline=Timeline(*connection.execute(select(RUN.c.start_s, RUN.c.period_s).where(RUN.c.id == run_id)).one()),
        stations=connection.scalar(stations) or 0,
        feeds=connection.scalar(feeds) or 0,
        source_names=tuple(row.name for row in names),
        source_kinds=tuple(row.kind for row in names),
    )


def truncate_run(connection: Connection, run_id: int, number: int) -> None:
    """Delete this cycle and all later ones; the stays of vessels and members are as they were after the one before it.

    The tables of the current picture are left to the cycle that is about to be written, in the same transaction.
    """
    truncate_events(connection, run_id, number)
    for table in METADATA.tables.values():
        if "cycle" in table.c:
            connection.execute(delete(table).where(table.c.run_id == run_id, table.c.cycle >= number))
    for stay in STAYS:
        of_run = stay.c.run_id == run_id
        connection.execute(delete(stay).where(of_run, stay.c.from_cycle >= number))
        connection.execute(update(stay).where(of_run, stay.c.to_cycle >= number - 1).values(to_cycle=None))
    connection.execute(delete(MEMBER).where(MEMBER.c.run_id == run_id))
    old = select(MEMBER_HISTORY.c.run_id, MEMBER_HISTORY.c.vessel_id, MEMBER_HISTORY.c.source, MEMBER_HISTORY.c.track_id)
    old = old.where(MEMBER_HISTORY.c.run_id == run_id, MEMBER_HISTORY.c.to_cycle.is_(None))
    connection.execute(insert(MEMBER).from_select(["run_id", "vessel_id", "source", "track_id"], old))
    connection.execute(delete(CYCLE).where(CYCLE.c.run_id == run_id, CYCLE.c.number >= number))


def no_such_run(run_id: int, where: str) -> NoSuchRunError:
    """The error for a run that does not exist."""
    return NoSuchRunError(f"{where}: there is no run {run_id}; another process may have restarted it")


def _registration(connection: Connection, run_id: int) -> tuple[LastReport, tuple[int, ...]]:
    """The newest report of each sensor, and the states of the radars."""
    t = SENSOR_REGISTRATION.c
    newest = select(t.kind, t.number, func.max(t.heard_s)).where(t.run_id == run_id).group_by(t.kind, t.number)
    last = select(func.max(t.cycle)).where(t.run_id == run_id).scalar_subquery()
    radars = select(t.state).where(t.run_id == run_id, t.cycle == last, t.kind == "radar").order_by(t.number)
    states = tuple(int(RegistrationState[str(row.state).upper()]) for row in connection.execute(radars))
    return {(row[0], row[1]): row[2] for row in connection.execute(newest) if row[2] is not None}, states


def _points(connection: Connection, run_id: int, number: int) -> Points:
    """The newest point of each vessel of a cycle."""
    first = connection.scalar(select(CYCLE.c.history_from).where(CYCLE.c.run_id == run_id, CYCLE.c.number == number))
    if first is None:
        return no_points()
    h = HISTORY.c
    here = select(h.vessel_id, func.max(h.cycle).label("cycle")).where(h.run_id == run_id, h.cycle.between(first, number))
    newest = here.group_by(h.vessel_id).subquery()
    is_newest = and_(h.run_id == run_id, h.cycle == newest.c.cycle, h.vessel_id == newest.c.vessel_id, h.closing == false())
    its_cycle = and_(CYCLE.c.run_id == run_id, CYCLE.c.number == h.cycle)
    query = select(h.vessel_id, h.cycle, h.mmsi, h.flags, h.previous_cycle, CYCLE.c.time_s, h.latitude_deg, h.longitude_deg)
    query = query.add_columns(h.sog_kn, h.cog_deg, h.major_m, h.minor_m, h.orientation_deg, h.updated_s, h.nav_status)
    query = query.select_from(newest).join(HISTORY, is_newest).join(CYCLE, its_cycle).order_by(h.vessel_id)
    vessel, cycle, mmsi, flags, previous, time_s, latitude, longitude, *moved, updated, status = fetch_arrays(connection, query)
    position = np.stack([latitude, longitude], 1)
    rate = rate_deg_s(position, moved[0], moved[1])
    return Points(vessel, cycle, mmsi, flags, previous < 0, time_s, position, np.stack(moved, 1), updated, rate, status)
