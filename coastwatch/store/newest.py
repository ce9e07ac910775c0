"""What the database holds of a run's newest cycle: against it the next is compared. In hand between cycles, read after a restart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from sqlalchemy import Connection, and_, select, update

from coastwatch.batches import Ints
from coastwatch.store import history_rule, registrations, retention, statics
from coastwatch.store.blocks import Tail
from coastwatch.store.opening import StoreError
from coastwatch.store.past import newest_points, of_newest
from coastwatch.store.tables import Cycle, History, Member, Presence, Run, Source

if TYPE_CHECKING:  # with kernels, which are slow to import
    from coastwatch.store.chunks import Key


@dataclass(frozen=True, eq=False)
class Newest:
    """The newest cycle of a run."""

    cycle: int  # -1 before the first
    time_s: float
    members: Ints  # (L, 3) vessel, source, track, sorted
    vessels: Ints  # (V, 1) sorted
    points: history_rule.Points
    source_names: tuple[str, ...]
    source_kinds: tuple[str, ...]
    statics: Ints  # MMSI, sorted
    heard: registrations.Heard
    forgotten: retention.Forgotten
    period_s: float
    tail: Tail | None = None  # of the history by place; None: the database knows
    key: Key | None = None  # of the full recording; None: the database knows


def read(connection: Connection, run_id: int, where: str) -> Newest:
    """What is stored; the run is marked as running. Raises: StoreError where there is no such run."""
    running = connection.execute(update(Run).where(Run.id == run_id).values(status="running", finished_utc=None))
    if running.rowcount == 0:
        raise _missing(run_id, where)
    last = select(Cycle.number, Cycle.time_s).where(Cycle.run_id == run_id).order_by(Cycle.number.desc()).limit(1)
    found = connection.execute(last).first()
    number, time_s = (-1, -np.inf) if found is None else (found.number, found.time_s)
    members = select(Member.vessel_id, Member.source, Member.track_id).where(Member.run_id == run_id)
    vessels = select(Presence.vessel_id).where(Presence.run_id == run_id, Presence.to_cycle.is_(None))
    names = connection.execute(select(Source.name, Source.kind).where(Source.run_id == run_id).order_by(Source.number)).all()
    return Newest(
        cycle=number,
        time_s=time_s,
        members=_array(connection, members.order_by(Member.vessel_id, Member.source, Member.track_id), 3),
        vessels=_array(connection, vessels.order_by(Presence.vessel_id), 1),
        points=_points(connection, run_id, number),
        source_names=tuple(row.name for row in names),
        source_kinds=tuple(row.kind for row in names),
        statics=statics.known(connection, run_id),
        heard=registrations.known(connection, run_id),
        forgotten=retention.known(connection, run_id),
        period_s=connection.scalars(select(Run.period_s).where(Run.id == run_id)).one(),
    )


def look(connection: Connection, run_id: int, where: str) -> None:
    """See that a run is still there whose rows are about to be written. Raises: StoreError."""
    if connection.scalar(select(Run.id).where(Run.id == run_id)) is None:
        raise _missing(run_id, where)


def _missing(run_id: int, where: str) -> StoreError:
    return StoreError(f"{where}: there is no run {run_id}; another process may have restarted it")


def _array(connection: Connection, query: Any, width: int) -> Ints:
    return np.array([tuple(row) for row in connection.execute(query)], np.int64).reshape(-1, width)


def _points(connection: Connection, run_id: int, number: int) -> history_rule.Points:
    """The newest point of each vessel of a cycle."""
    first = connection.scalar(select(Cycle.history_from).where(Cycle.run_id == run_id, Cycle.number == number))
    if first is None:
        return history_rule.none()
    newest, h = newest_points(run_id, first, number), History
    then = and_(Cycle.run_id == run_id, Cycle.number == h.cycle)
    ellipse = (h.major_m, h.minor_m, h.orientation_deg)
    whole = (h.vessel_id, h.cycle, h.mmsi, h.flags, h.previous_cycle)
    real = (Cycle.time_s, h.latitude_deg, h.longitude_deg, h.sog_kn, h.cog_deg, *ellipse, h.updated_s)
    query = select(*whole, *real).select_from(newest).join(h, of_newest(run_id, newest)).join(Cycle, then)
    rows = connection.execute(query.order_by(h.vessel_id)).all()
    numbers = [(row[0], row[1], -1 if row[2] is None else row[2], row[3], int(row[4] is None)) for row in rows]
    reals = np.array([tuple(row[5:]) for row in rows], float).reshape(-1, 9)  # None is NaN
    return history_rule.points(np.array(numbers, np.int64).reshape(-1, 5), reals)
