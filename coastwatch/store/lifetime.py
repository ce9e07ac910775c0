"""Runs: begun, finished, found again, discarded."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from sqlalchemy import delete, insert, select, update

from coastwatch.batches import Fault, Sensors
from coastwatch.store.opening import Store, StoreError, as_json, reading, writing
from coastwatch.store.specifications import sensor_rows, source_rows
from coastwatch.store.tables import Base, Checkpoint, Run
from coastwatch.store.utc import utc

if TYPE_CHECKING:  # to read a database needs no pydantic, which is slow to import
    from coastwatch.stage import Plan

STATUSES = ("running", "finished", "interrupted", "failed")
LARGEST = 2**63


def begin_run(
    store: Store,
    *,
    scenario: str,
    title: str,
    seed: int,
    version: str,
    settings: Mapping[str, Any],
    sensors: Sensors,
    plan: Plan,
    warmup_cycles: int = 0,
    workers: int = 1,
    command: str = "",
    faults: Sequence[Fault] = (),
) -> int:
    """The number of a new run, which is then `running`. The database's clock says when it began.

    Raises: StoreError.
    """
    if not 0 <= seed < LARGEST:
        raise StoreError(f"{store.where}: seed: got {seed}, needed 0 to {LARGEST - 1}, the largest number a database can hold")
    row = {
        "scenario": scenario,
        "title": title,
        "seed": seed,
        "version": version,
        "settings": dict(settings),
        "command": command,
        "status": "running",
        "period_s": plan.period_s,
        "cycles": plan.cycles,
        "warmup_cycles": warmup_cycles,
        "start_s": plan.start_s,
        "workers": workers,
        "faults": [asdict(fault) for fault in faults],
    }
    with writing(store) as connection:
        row["started_utc"] = utc(connection)
        run_id = int(connection.execute(insert(Run).values(row).returning(Run.id)).scalar_one())
        for name, rows in (("sensor", sensor_rows(run_id, sensors)), ("source", source_rows(run_id, sensors))):
            if rows:
                connection.execute(insert(Base.metadata.tables[name]), rows)
    return run_id


def finish_run(
    store: Store, run_id: int, status: str, scores: Mapping[str, Any] | None = None, faults: Sequence[Fault] = ()
) -> None:
    """Note how a run ended: finished, interrupted or failed. The cycles it stored stay.

    Raises: StoreError; ValueError for another status.
    """
    if status not in STATUSES:
        raise ValueError(f"status: got {status!r}, needed one of {', '.join(STATUSES)}")
    with writing(store) as connection:
        connection.execute(
            update(Run)
            .where(Run.id == run_id)
            .values(
                status=status,
                finished_utc=utc(connection),
                scores=dict(scores) if scores else None,
                faults=[asdict(fault) for fault in faults],
            )
        )


def resume_point(
    store: Store, scenario: str, seed: int, version: str, settings: Mapping[str, Any] | None = None
) -> tuple[int, int, bytes] | None:
    """Run, cycle and memory of the newest checkpoint of an unfinished run of this scenario, seed and version; None without one.

    Args: settings: where given, a run under other settings does not count.
    Raises: StoreError.
    """
    of_run = (Run.scenario == scenario, Run.seed == seed, Run.version == version, Run.status != "finished")
    query = select(Run.id, Run.settings, Checkpoint.cycle).join(Checkpoint, Checkpoint.run_id == Run.id)
    with reading(store) as connection:
        for run_id, stored, cycle in connection.execute(query.where(*of_run, Checkpoint.piece == 0).order_by(Run.id.desc())):
            if settings is None or stored == json.loads(as_json(settings)):
                pieces = select(Checkpoint.memory).where(Checkpoint.run_id == run_id).order_by(Checkpoint.piece)
                return run_id, cycle, b"".join(connection.scalars(pieces))
    return None


def discard_runs(store: Store, scenario: str, seed: int | None = None) -> list[int]:
    """Delete all runs of a scenario (of one seed, where given) with everything they stored; returns their numbers.

    Raises: StoreError.
    """
    with writing(store) as connection:
        which = select(Run.id).where(Run.scenario == scenario)
        found = list(connection.scalars(which if seed is None else which.where(Run.seed == seed)))
        for run_id in found:
            for table in reversed(Base.metadata.sorted_tables):
                column = table.c.id if table.name == "run" else table.c.run_id
                connection.execute(delete(table).where(column == run_id))
    for run_id in found:
        store.newest.pop(run_id, None)
    return found
