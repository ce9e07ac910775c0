"""Runs as they are read: which there are, where they stand, what their stages took."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import numpy as np
from sqlalchemy import Connection, Executable, func, select, true

from coastwatch.store.opening import Store, StoreError, reading
from coastwatch.store.rows import Rows, fetched
from coastwatch.store.tables import Cycle, Run, StageTiming


def runs(store: Store) -> Rows:
    """Every run, newest first, without its settings and scores."""
    stored = select(Cycle.run_id, func.count().label("done")).group_by(Cycle.run_id).subquery()
    columns = (
        Run.id,
        Run.scenario,
        Run.title,
        Run.seed,
        Run.version,
        Run.status,
        Run.started_utc,
        Run.finished_utc,
        Run.workers,
    )
    query = select(*columns, func.coalesce(stored.c.done, 0).label("cycles_stored"), Run.cycles, Run.period_s, Run.start_s)
    return _ask(store, query.outerjoin(stored, stored.c.run_id == Run.id).order_by(Run.id.desc()))


def run(store: Store, run_id: int) -> dict[str, Any]:
    """One run with settings, scores and faults. Raises: StoreError where there is none."""
    found = _ask(store, select(*Run.__table__.columns).where(Run.id == run_id))
    if not found.rows:
        raise StoreError(f"{store.where}: there is no run {run_id}")
    return dict(zip(found.columns, found.rows[0], strict=True))


def latest_run(store: Store, scenario: str | None = None) -> int:
    """The number of the newest run (of a scenario). Raises: StoreError where there is none."""
    query = select(func.max(Run.id))
    found = _ask(store, query if scenario is None else query.where(Run.scenario == scenario)).rows[0][0]
    if found is None:
        raise StoreError(f"{store.where}: holds no run" + (f" of {scenario}" if scenario else ""))
    return int(found)


def timings(store: Store, run_id: int) -> Rows:
    """For each stage, in the order in which they ran: cycles, milliseconds (median, p99, longest, total), share and rows a cycle."""
    query = select(StageTiming.stage, StageTiming.number, StageTiming.seconds, StageTiming.rows)
    stored = _ask(store, query.where(StageTiming.run_id == run_id).order_by(StageTiming.cycle, StageTiming.number)).rows
    by_stage: dict[str, list[tuple[Any, ...]]] = {}
    for row in stored:
        by_stage.setdefault(row[0], []).append(row)
    everything = sum(row[2] for row in stored) or 1.0
    out = []
    for stage, rows in sorted(by_stage.items(), key=lambda item: max(row[1] for row in item[1])):
        ms = np.array([row[2] for row in rows]) * 1e3
        yielded = [row[3] for row in rows if row[3] is not None]
        figures = (np.median(ms), np.percentile(ms, 99), ms.max(), ms.sum(), ms.sum() / 1e3 / everything)
        out.append((stage, len(rows), *(float(x) for x in figures), sum(yielded) / len(yielded) if yielded else None))
    return Rows(("stage", "cycles", "median_ms", "p99_ms", "longest_ms", "total_ms", "share", "rows"), out)


def cycle_at(connection: Connection, store: Store, run_id: int, at_s: float | None, kept: Any = true()) -> int:  # noqa: B008
    """The newest cycle (of those that are kept) up to an instant; -1 where no instant is asked and there is none.

    Raises: StoreError where there is no such run, or nothing is stored so early.
    """
    run_exists(connection, store, run_id)
    before = true() if at_s is None else Cycle.time_s <= at_s
    upto = select(Cycle.number).where(Cycle.run_id == run_id, kept, before)
    cycle = connection.scalar(upto.order_by(Cycle.time_s.desc()).limit(1))
    if cycle is None and at_s is not None:
        first_s = connection.scalar(select(func.min(Cycle.time_s)).where(Cycle.run_id == run_id, kept))
        has = "it has no cycle yet" if first_s is None else f"its first kept cycle is at {_utc(first_s)}"
        raise StoreError(f"{store.where}: run {run_id} holds nothing up to {_utc(at_s)}, {has}")
    return -1 if cycle is None else int(cycle)


def _utc(time_s: float) -> str:
    return datetime.fromtimestamp(time_s, UTC).isoformat().replace("+00:00", "Z")


def run_exists(connection: Connection, store: Store, run_id: int) -> None:
    """Raises: StoreError where there is no such run."""
    if connection.scalar(select(Run.id).where(Run.id == run_id)) is None:
        raise StoreError(f"{store.where}: there is no run {run_id}")


def _ask(store: Store, query: Executable) -> Rows:
    with reading(store) as connection:
        return fetched(connection, query)
