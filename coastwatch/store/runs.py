"""Begin, finish, resume and list runs; their cycles by time. `deletion` deletes them."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from datetime import timedelta
from typing import TYPE_CHECKING, Any, NamedTuple, TypedDict, cast

import numpy as np
from sqlalchemy import ColumnElement, Connection, Executable, RowMapping, Table, func, insert, select, update
from sqlalchemy.exc import DBAPIError

from coastwatch.batches import Fault, Floats, Radars, Sensors, Sonars, SourceKind, Stations
from coastwatch.errors import InputError, StoreError
from coastwatch.spelling import utc_text
from coastwatch.store.journal import decompressed
from coastwatch.store.processes import Presence, presence, this_process
from coastwatch.store.rows import Rows, fetch_rows
from coastwatch.store.schema.database import NotThere, Store, now_utc, reading, refusals, writing
from coastwatch.store.schema.tables import (
    AIS_FEED,
    CHECKPOINT,
    CYCLE,
    DELETING,
    RUN,
    SENSOR,
    SOURCE,
    TRACK_SOURCE,
)

if TYPE_CHECKING:  # to read a database needs no pydantic, which is slow to import
    from coastwatch.stage import Plan

ENDLESS = 100_000_000
"""Planned cycles of a live run: ten years of cycles of 3 s."""

STATUSES = ("running", "finished", "interrupted", "failed")
LARGEST = 2**63

MOST_NAMED = 10
"""Runs that a refusal names."""

DEAD_S, DEAD_PERIODS = 60.0, 20.0
"""A run of a process that cannot be asked, of another machine, is no longer there when it has written nothing for so long."""


SERVER = "serve"
"""The command of runs that a server writes; that of others is empty."""

SERVES = 0x73657276
"""First key of the advisory lock of PostgreSQL that a server holds, the bytes of "serv"; the second one is of the schema."""

SERVER_KEEPALIVES = {"tcp_keepalives_idle": 15, "tcp_keepalives_interval": 5, "tcp_keepalives_count": 3}
"""Of PostgreSQL for that connection, in s: the lock of a machine that is gone is free after half a minute."""

FREED_S = 40.0
"""So long a server waits for that lock: it may have been started anew on another machine."""


def begin_run(
    store: Store,
    *,
    scenario: str,
    title: str,
    seed: int,
    version: str,
    settings: Mapping[str, object],
    sensors: Sensors,
    plan: Plan,
    warmup_cycles: int = 0,
    workers: int = 1,
    feeds: Sequence[str] = (),
    by_server: bool = False,
) -> int:
    """The number of a new run, which is then `running`. The database's clock says when it began.

    Args: feeds: names of the feeds of AIS, by number; by_server: as of `resume_run`.
    Raises: StoreError; InputError, as of `refuse_second_writer`.
    """
    if not 0 <= seed < LARGEST:
        raise StoreError(f"{store.where}: seed: got {seed}, needed 0 to {LARGEST - 1}, the largest number a database can hold")
    machine, process = this_process()
    row = {
        "scenario": scenario,
        "title": title,
        "seed": seed,
        "version": version,
        "settings": dict(settings),
        "command": SERVER if by_server else "",
        "status": "running",
        "period_s": plan.period_s,
        "cycles": plan.cycles,
        "warmup_cycles": warmup_cycles,
        "start_s": plan.start_s,
        "workers": workers,
        "faults": [],
        "machine": machine,
        "process": process,
    }
    with writing(store) as connection:
        if by_server:
            _refuse_second_writer(connection, store)
        row["started_utc"] = row["written_utc"] = now_utc(connection)
        run_id = int(connection.execute(insert(RUN).values(row).returning(RUN.c.id)).scalar_one())
        names = [{"number": number, "name": name} for number, name in enumerate(feeds)]
        for table, rows in ((AIS_FEED, names), *_sensor_rows(sensors)):
            if rows:
                connection.execute(insert(table).values(run_id=run_id), rows)
    return run_id


def resume_run(
    store: Store,
    run_id: int,
    *,
    title: str,
    version: str,
    settings: Mapping[str, object],
    workers: int = 1,
    by_server: bool = False,
) -> None:
    """Note that this process goes on with a run, which is then `running` again.

    Args: title, version, settings, workers: from now on; by_server: a server writes it, and is refused where another one writes a run.
    Raises: StoreError; InputError, as of `refuse_second_writer`.
    """
    machine, process = this_process()
    with writing(store) as connection:
        if by_server:
            _refuse_second_writer(connection, store)
        again = {"status": "running", "machine": machine, "process": process, "written_utc": now_utc(connection)}
        again |= {"title": title, "version": version, "settings": dict(settings), "workers": workers}
        again |= {"command": SERVER} if by_server else {}
        if connection.execute(update(RUN).where(*is_there(run_id)).values(finished_utc=None, **again)).rowcount == 0:
            raise no_run(connection, store, run_id)


def finish_run(
    store: Store, run_id: int, status: str, scores: Mapping[str, object] | None = None, faults: Sequence[Fault] = ()
) -> None:
    """Note how a run ended: finished, interrupted or failed. The cycles it stored stay.

    Raises: StoreError; ValueError for another status.
    """
    if status not in STATUSES:
        raise ValueError(f"status: got {status!r}, needed one of {', '.join(STATUSES)}")
    ended: dict[str, object] = {"scores": dict(scores) if scores else None, "faults": [asdict(fault) for fault in faults]}
    with writing(store) as connection:
        ended |= {"status": status, "finished_utc": now_utc(connection)}
        connection.execute(update(RUN).where(*is_there(run_id)).values(ended))


def refuse_second_writer(store: Store) -> None:
    """Refuse a database into which another server of this machine writes a run. `sole_server` asks other machines too.

    Runs that are no servers', as of scheduled jobs, may be written beside.

    Raises: StoreError; InputError: there is such a process.
    """
    with reading(store) as connection:
        _refuse_second_writer(connection, store)


@contextmanager
def sole_server(store: Store) -> Iterator[None]:
    """Hold a database for this server: another one is refused, in PostgreSQL also one of another machine.

    PostgreSQL frees the lock when the connection ends, or half a minute after the machine of its server is gone. A restart of
    the database frees it too.
    Raises: StoreError; InputError, as of `refuse_second_writer`.
    """
    refuse_second_writer(store)
    if store.engine.dialect.name != "postgresql":
        yield
        return
    with refusals(store):
        held = store.engine.connect().execution_options(isolation_level="AUTOCOMMIT")
    try:
        with refusals(store):
            held.detach()  # closed at the end: a connection that goes back to its pool keeps the lock
            for name, value in SERVER_KEEPALIVES.items():
                held.execute(select(func.set_config(name, str(value), False)))
            lock, until_s = func.pg_try_advisory_lock(SERVES, func.hashtext(func.current_schema())), time.monotonic() + FREED_S
            while not (is_free := held.scalar(select(lock))) and time.monotonic() < until_s:
                time.sleep(0.2)
        if not is_free:
            raise InputError(f"--db: got {store.where}, where another server is writing, needed another database, or its end")
        yield
    finally:
        with suppress(DBAPIError):  # the database ended it
            held.close()


def _refuse_second_writer(connection: Connection, store: Store) -> None:
    r = RUN.c
    of_servers = select(r.id, r.machine, r.process).where(r.status == "running", r.command == SERVER)
    running = connection.execute(of_servers.order_by(r.id.desc())).all()
    mine = this_process()
    for run_id, machine, process in running:
        if (machine, process) != mine and presence(machine, process) is Presence.HERE:
            raise InputError(
                f"--db: got {store.where}, where a server, process {process}, is writing run {run_id}, needed another database, "
                "or the end of that process"
            )


class Unfinished(NamedTuple):
    """A run that has not finished, with its newest checkpoint."""

    run_id: int
    version: str
    settings: Mapping[str, object]  # the scenario as a document
    cycle: int  # of the checkpoint


def unfinished_runs(store: Store, scenario: str, seed: int) -> list[Unfinished]:
    """The runs of a scenario and seed that have a checkpoint and have not finished, newest first. Raises: StoreError."""
    r, of_run = RUN.c, CHECKPOINT.join(RUN, RUN.c.id == CHECKPOINT.c.run_id)
    query = select(r.id, r.version, r.settings, CHECKPOINT.c.cycle).select_from(of_run).where(CHECKPOINT.c.piece == 0)
    query = query.where(r.scenario == scenario, r.seed == seed, r.status != "finished", *is_there()).order_by(r.id.desc())
    with reading(store) as connection:
        return [Unfinished(*row) for row in connection.execute(query)]


def read_checkpoint(store: Store, run_id: int) -> bytes:
    """The memory of the newest checkpoint of a run. Raises: StoreError."""
    pieces = select(CHECKPOINT.c.memory).where(CHECKPOINT.c.run_id == run_id).order_by(CHECKPOINT.c.piece)
    with reading(store) as connection:
        return decompressed(b"".join(connection.scalars(pieces)))


class Run(TypedDict):
    """A row of `run`, as far as it is read by name, and its number of stored cycles."""

    id: int
    scenario: str
    title: str
    seed: int
    status: str
    start_s: float
    period_s: float
    cycles: int  # ENDLESS or more: of a live run
    cycles_stored: int
    settings: dict[str, Any]  # the scenario as a document, maybe of another version


def runs(store: Store) -> Rows:
    """Every run, newest first, without its settings. Status `died`: it was not ended, and its process is no longer there.

    `deleting`: it is in no answer but this one.
    """
    stored = select(CYCLE.c.run_id, func.count().label("done")).group_by(CYCLE.c.run_id).subquery()
    r, done = RUN.c, func.coalesce(stored.c.done, 0).label("cycles_stored")
    shown = [r.id, r.scenario, r.title, r.seed, r.version, r.status, r.started_utc, r.finished_utc, r.workers, done, r.cycles]
    shown += [r.period_s, r.start_s, r.written_utc, r.scores, r.faults, r.verdict]
    names = tuple(column.name for column in shown)
    query = select(*shown, r.machine, r.process).outerjoin(stored, stored.c.run_id == r.id).order_by(r.id.desc())
    with reading(store) as connection:
        rows = [dict(row) | {"status": status_of(connection, row)} for row in connection.execute(query).mappings()]
    return Rows(names, [tuple(row[name] for name in names) for row in rows])


def run(store: Store, run_id: int) -> Run:
    """One run with settings, scores and faults. Raises: StoreError where there is none."""
    stored = select(func.count()).where(CYCLE.c.run_id == run_id).scalar_subquery().label("cycles_stored")
    with reading(store) as connection:
        row = connection.execute(select(*RUN.c, stored).where(*is_there(run_id))).mappings().first()
        if row is None:
            raise no_run(connection, store, run_id)
        return cast(Run, dict(row) | {"status": status_of(connection, row)})


def run_status(store: Store, run_id: int) -> str:
    """The status of a run, as in `runs`. Raises: StoreError where there is none."""
    with reading(store) as connection:
        row = connection.execute(select(RUN).where(RUN.c.id == run_id)).mappings().first()
        if row is None:
            raise no_run(connection, store, run_id)
        return status_of(connection, row)


def status_of(connection: Connection, row: RowMapping) -> str:
    """The status of a row of `run`; `died` where it is `running` and its process is gone.

    A process of this machine is asked: a live run may wait for its feeds for hours. One of another machine is taken to be gone once
    it has written nothing for DEAD_S, or DEAD_PERIODS if longer. A live run that waits for input notes that it is there.
    """
    if row["status"] == "running":
        there = presence(row["machine"], row["process"])
        silent = timedelta(seconds=max(DEAD_S, DEAD_PERIODS * row["period_s"]))
        is_silent = (row["written_utc"] or row["started_utc"]) < now_utc(connection, -silent)
        if there is Presence.GONE or (there is Presence.UNKNOWN and is_silent):
            return "died"
    return str(row["status"])


def has_run(store: Store, run_id: int) -> bool:
    """Whether there is a run of this number, which is not being deleted."""
    with reading(store) as connection:
        return connection.scalar(select(RUN.c.id).where(*is_there(run_id))) is not None


def set_verdict(store: Store, run_id: int, sentences: Sequence[str]) -> None:
    """Store which figures of a run fell, one sentence each; none: all are as required. Raises: StoreError."""
    with writing(store) as connection:
        connection.execute(update(RUN).where(RUN.c.id == run_id).values(verdict=list(sentences)))


def last_good_run(store: Store, scenario: str, seed: int, before: int) -> tuple[int, dict[str, Any]] | None:
    """Number and scores of the newest run before another one that finished with scores of which none fell; None without one."""
    r = RUN.c
    query = select(r.id, r.scores, r.verdict).where(r.scenario == scenario, r.seed == seed, r.id < before)
    finished = _fetch(store, query.where(r.status == "finished").order_by(r.id.desc()))
    return next(((number, scores) for number, scores, verdict in finished.rows if scores and not verdict), None)


def latest_run(store: Store, scenario: str | None = None) -> int:
    """The number of the newest run (of a scenario). Raises: StoreError where there is none."""
    query = select(func.max(RUN.c.id)).where(*is_there())
    number = _fetch(store, query if scenario is None else query.where(RUN.c.scenario == scenario)).rows[0][0]
    if number is None:
        raise StoreError(f"{store.where}: holds no run" + (f" of {scenario}" if scenario else ""))
    return int(number)


def newest_picture(store: Store, run_id: int | None = None) -> tuple[int, int, float] | None:
    """Run, cycle and time of the newest stored picture (of a run); None where there is none."""
    with reading(store) as connection:
        number = connection.scalar(select(func.max(RUN.c.id)).where(*is_there(run_id)))
        cycle = None if number is None else newest_cycle(connection, number, CYCLE.c.picture_kept)
    return None if number is None or cycle is None else (number, *cycle)


def last_instant(store: Store, run_id: int) -> float | None:
    """Time of the newest stored cycle of a run; None where there is none."""
    with reading(store) as connection:
        cycle = newest_cycle(connection, run_id)
    return None if cycle is None else cycle[1]


def newest_cycle(connection: Connection, run_id: int, *where: ColumnElement[bool]) -> tuple[int, float] | None:
    """Number and time of the newest stored cycle of a run (of those that meet conditions); None where there is none."""
    query = select(CYCLE.c.number, CYCLE.c.time_s).where(CYCLE.c.run_id == run_id, *where)
    row = connection.execute(query.order_by(CYCLE.c.number.desc()).limit(1)).first()
    return None if row is None else (int(row.number), float(row.time_s))


def between(from_s: float | None, to_s: float | None) -> list[ColumnElement[bool]]:
    """That a cycle is between two instants, both included. None: without that end."""
    return [*([] if from_s is None else [CYCLE.c.time_s >= from_s]), *([] if to_s is None else [CYCLE.c.time_s <= to_s])]


def cycle_at(connection: Connection, store: Store, run_id: int, at_s: float | None, *kept: ColumnElement[bool]) -> int:
    """The newest cycle (of those that are kept) up to an instant; -1 where no instant is asked and there is none.

    Raises: StoreError where there is no such run, or nothing is stored so early.
    """
    run_exists(connection, store, run_id)
    upto = select(CYCLE.c.number).where(CYCLE.c.run_id == run_id, *kept, *between(None, at_s))
    cycle = connection.scalar(upto.order_by(CYCLE.c.time_s.desc()).limit(1))
    if cycle is None and at_s is not None:
        first_s = connection.scalar(select(func.min(CYCLE.c.time_s)).where(CYCLE.c.run_id == run_id, *kept))
        has = "it has no cycle yet" if first_s is None else f"its first kept cycle is at {utc_text(first_s, 'auto')}"
        raise NotThere(f"{store.where}: run {run_id} holds nothing up to {utc_text(at_s, 'auto')}, {has}")
    return -1 if cycle is None else int(cycle)


def is_there(run_id: int | None = None) -> list[ColumnElement[bool]]:
    """That a run (with this number) is not being deleted."""
    return [RUN.c.status != DELETING, *([] if run_id is None else [RUN.c.id == run_id])]


def run_exists(connection: Connection, store: Store, run_id: int) -> None:
    """Raises: StoreError where there is no such run."""
    if connection.scalar(select(RUN.c.id).where(*is_there(run_id))) is None:
        raise no_run(connection, store, run_id)


def no_run(connection: Connection, store: Store, run_id: int) -> StoreError:
    """The refusal of a run that is not there, with the runs that are."""
    numbers = sorted(connection.scalars(select(RUN.c.id).where(*is_there()).order_by(RUN.c.id.desc()).limit(MOST_NAMED)))
    needed = f"needed one of {', '.join(map(str, numbers))}" if numbers else "the database holds none"
    return StoreError(f"{store.where}: there is no run {run_id}, {needed}; `coastwatch runs` lists all")


def _fetch(store: Store, query: Executable) -> Rows:
    with reading(store) as connection:
        return fetch_rows(connection, query)


def _sensor_rows(sensors: Sensors) -> list[tuple[Table, list[dict[str, object]]]]:
    """The rows of sensors and sources, a table each, without their run. `number` is the index that reports or tracks carry."""
    radars, sonars = sensors.radars, sensors.sonars
    of_radars = {
        "period_s": radars.period_s,
        "range_sigma_m": radars.range_sigma_m,
        "azimuth_sigma_deg": np.degrees(radars.azimuth_sigma_rad),
    }
    of_sonars = {
        "bearing_sigma_deg": np.degrees(sonars.bearing_sigma_rad),
        "interval_s": sonars.interval_s,
        "arc_from_deg": sonars.arc_from_deg,
        "arc_to_deg": sonars.arc_to_deg,
    }
    described = _described("radar", radars, of_radars, [sensors.region_names[region] for region in radars.region])
    described += _described("ais", sensors.stations, {}) + _described("bearing", sonars, of_sonars)
    kinds = [SourceKind(kind).name.lower() for kind in sensors.source_kinds.tolist()]
    named = enumerate(zip(sensors.source_names, kinds, strict=True))
    tracks = sensors.track_sources
    sites = [[value if np.isfinite(value) else None for value in site] for site in tracks.site_deg.tolist()]
    return [
        (SENSOR, described),
        (SOURCE, [{"number": k, "name": name, "kind": kind} for k, (name, kind) in named]),
        (
            TRACK_SOURCE,
            [
                {"number": k, "name": str(name), "latitude_deg": latitude, "longitude_deg": longitude}
                for k, (name, (latitude, longitude)) in enumerate(zip(tracks.name, sites, strict=True))
            ],
        ),
    ]


def _described(
    kind: str, sensors: Radars | Stations | Sonars, spec: Mapping[str, Floats], regions: Sequence[str] | None = None
) -> list[dict[str, object]]:
    """Rows of table `sensor`. Args: spec: values of each sensor by name; regions: of each."""
    return [
        {
            "kind": kind,
            "number": k,
            "name": str(sensors.name[k]),
            "latitude_deg": float(sensors.site_deg[k, 0]),
            "longitude_deg": float(sensors.site_deg[k, 1]),
            "range_m": float(sensors.range_m[k]),
            "region": None if regions is None else regions[k],
            "spec": {name: float(values[k]) for name, values in spec.items()},
        }
        for k in range(len(sensors))
    ]
