"""Begin, finish, resume, delete and list runs; the times of their stages."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any

import numpy as np
from sqlalchemy import Connection, Executable, delete, func, insert, select, true, update

from coastwatch.batches import Fault, Radars, Sensors, Sonars, SourceKind, Stations, TrackSources
from coastwatch.store.journal import decompressed
from coastwatch.store.processes import Presence, presence, this_process
from coastwatch.store.rows import Rows, fetch_rows
from coastwatch.store.schema.database import NotThere, Store, StoreError, as_json, now_utc, reading, writing
from coastwatch.store.schema.tables import (
    AIS_FEED,
    CHECKPOINT,
    CYCLE,
    METADATA,
    OF_NO_RUN,
    RUN,
    SENSOR,
    SOURCE,
    STAGE_TIMING,
    TRACK_SOURCE,
)

if TYPE_CHECKING:  # to read a database needs no pydantic, which is slow to import
    from coastwatch.stage import Plan

_OF_PROCESS = (RUN.c.machine, RUN.c.process)

STATUSES = ("running", "finished", "interrupted", "failed")
LARGEST = 2**63

MOST_NAMED = 10
"""Runs that a refusal names."""

DEAD_S, DEAD_PERIODS = 60.0, 20.0
"""A run of a process that cannot be asked, of another machine, is no longer there when it has written no cycle for so long."""


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
    feeds: Sequence[str] = (),
) -> int:
    """The number of a new run, which is then `running`. The database's clock says when it began.

    Args: feeds: names of the feeds of AIS, by number.
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
    row["machine"], row["process"] = this_process()
    with writing(store) as connection:
        row["started_utc"] = row["written_utc"] = now_utc(connection)
        run_id = int(connection.execute(insert(RUN).values(row).returning(RUN.c.id)).scalar_one())
        of_feeds = [{"run_id": run_id, "number": number, "name": name} for number, name in enumerate(feeds)]
        made = (SENSOR, sensor_rows(run_id, sensors)), (SOURCE, source_rows(run_id, sensors)), (AIS_FEED, of_feeds)
        for table, rows in (*made, (TRACK_SOURCE, track_source_rows(run_id, sensors.track_sources))):
            if rows:
                connection.execute(insert(table), rows)
    return run_id


def resume_run(store: Store, run_id: int) -> None:
    """Note that this process goes on with a run, which is then `running` again. Raises: StoreError."""
    machine, process = this_process()
    with writing(store) as connection:
        again = {"status": "running", "machine": machine, "process": process, "written_utc": now_utc(connection)}
        connection.execute(update(RUN).where(RUN.c.id == run_id).values(finished_utc=None, **again))


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
            update(RUN)
            .where(RUN.c.id == run_id)
            .values(
                status=status,
                finished_utc=now_utc(connection),
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
    of_run = (RUN.c.scenario == scenario, RUN.c.seed == seed, RUN.c.version == version, RUN.c.status != "finished")
    query = select(RUN.c.id, RUN.c.settings, CHECKPOINT.c.cycle).join(CHECKPOINT, CHECKPOINT.c.run_id == RUN.c.id)
    with reading(store) as connection:
        for run_id, stored, cycle in connection.execute(
            query.where(*of_run, CHECKPOINT.c.piece == 0).order_by(RUN.c.id.desc())
        ):
            if settings is None or stored == json.loads(as_json(settings)):
                pieces = select(CHECKPOINT.c.memory).where(CHECKPOINT.c.run_id == run_id).order_by(CHECKPOINT.c.piece)
                return run_id, cycle, decompressed(b"".join(connection.scalars(pieces)))
    return None


def discard_runs(store: Store, scenario: str, seed: int | None = None) -> list[int]:
    """Delete all runs of a scenario (of one seed, where given) with everything they stored; returns their numbers.

    A run that another process of this machine writes stays. Raises: StoreError.
    """
    r = RUN.c
    which = select(r.id, r.machine, r.process).where(r.scenario == scenario, true() if seed is None else r.seed == seed)
    with reading(store) as connection:
        found = connection.execute(which.where(r.status == "running")).all()
    mine = this_process()
    live = [
        row.id for row in found if (row.machine, row.process) != mine and presence(row.machine, row.process) is Presence.HERE
    ]
    return _delete(store, which.with_only_columns(r.id).where(r.id.not_in(live)))


def delete_run(store: Store, run_id: int) -> None:
    """Delete one run with everything it stored. Raises: StoreError where there is none, or it is being written."""
    if run(store, run_id)["status"] == "running":
        raise StoreError(f"{store.where}: run {run_id} is being written: got delete, needed a run that has ended")
    _delete(store, select(RUN.c.id).where(RUN.c.id == run_id))


def keep_runs(store: Store, count: int, scenario: str | None = None) -> list[int]:
    """Delete all but the newest runs; one that is being written stays. Returns: the deleted ones.

    Args: count: how many stay; scenario: delete only runs of this scenario, and never its last good run.
    Raises: StoreError.
    """
    listed = runs(store)
    about = zip(*(listed.column(name) for name in ("id", "scenario", "status", "scores", "verdict")), strict=True)
    of_scenario = [row for row in about if scenario in (None, row[1])]
    good = [number for number, _, status, scores, verdict in of_scenario if status == "finished" and scores and not verdict]
    stay = set() if scenario is None else set(good[:1])
    old = [number for number, _, status, *_ in of_scenario[count:] if status != "running" and number not in stay]
    return _delete(store, select(RUN.c.id).where(RUN.c.id.in_(old)))


def _delete(store: Store, which: Executable) -> list[int]:
    with writing(store) as connection:
        found = list(connection.scalars(which))
        for run_id in found:
            for table in (t for t in reversed(METADATA.sorted_tables) if t not in OF_NO_RUN):
                column = table.c.id if table.name == "run" else table.c.run_id
                connection.execute(delete(table).where(column == run_id))
    for run_id in found:
        store.run_states.pop(run_id, None)
    return found


def runs(store: Store) -> Rows:
    """Every run, newest first, without its settings. Status `died`: it was not ended, and its process is no longer there."""
    stored = select(CYCLE.c.run_id, func.count().label("done")).group_by(CYCLE.c.run_id).subquery()
    r, done = RUN.c, func.coalesce(stored.c.done, 0).label("cycles_stored")
    about = (r.id, r.scenario, r.title, r.seed, r.version, r.status, r.started_utc, r.finished_utc, r.workers)
    plan = r.cycles, r.period_s, r.start_s, r.written_utc
    query = select(*about, done, *plan, r.scores, r.faults, r.verdict, *_OF_PROCESS)
    with reading(store) as connection:
        found = fetch_rows(connection, query.outerjoin(stored, stored.c.run_id == r.id).order_by(r.id.desc()))
        shown = slice(-len(_OF_PROCESS))
        return Rows(found.columns[shown], [_with_death(connection, found.columns, row)[shown] for row in found.rows])


def run(store: Store, run_id: int) -> dict[str, Any]:
    """One run with settings, scores and faults. Raises: StoreError where there is none."""
    stored = select(func.count()).where(CYCLE.c.run_id == run_id).scalar_subquery().label("cycles_stored")
    with reading(store) as connection:
        found = fetch_rows(connection, select(*RUN.c, stored).where(RUN.c.id == run_id))
        if not found.rows:
            raise no_run(connection, store, run_id)
        return dict(zip(found.columns, _with_death(connection, found.columns, found.rows[0]), strict=True))


def run_status(store: Store, run_id: int) -> str:
    """The status of a run, as in `runs`. Raises: StoreError where there is none."""
    r = RUN.c
    query = select(r.status, r.period_s, r.started_utc, r.written_utc, *_OF_PROCESS).where(r.id == run_id)
    with reading(store) as connection:
        found = fetch_rows(connection, query)
        if not found.rows:
            raise no_run(connection, store, run_id)
        return str(_with_death(connection, found.columns, found.rows[0])[0])


def _with_death(connection: Connection, columns: Sequence[str], row: tuple[Any, ...]) -> tuple[Any, ...]:
    """A row of `run`, with status `died` where it is `running` and its process is gone.

    A process of this machine is asked: a live run may wait for its feeds for hours. One of another machine is taken to be gone once
    it has written nothing for DEAD_S, or DEAD_PERIODS if longer.
    """
    of = dict(zip(columns, row, strict=True))
    if of["status"] == "running":
        there = presence(of["machine"], of["process"])
        silent = timedelta(seconds=max(DEAD_S, DEAD_PERIODS * of["period_s"]))
        is_silent = (of["written_utc"] or of["started_utc"]) < now_utc(connection, -silent)
        if there is Presence.GONE or (there is Presence.UNKNOWN and is_silent):
            of["status"] = "died"
    return tuple(of.values())


def set_verdict(store: Store, run_id: int, sentences: Sequence[str]) -> None:
    """Store which figures of a run fell, one sentence each; none: all are as required. Raises: StoreError."""
    with writing(store) as connection:
        connection.execute(update(RUN).where(RUN.c.id == run_id).values(verdict=list(sentences)))


def last_good_run(store: Store, scenario: str, seed: int, before: int) -> tuple[int, dict[str, Any]] | None:
    """Number and scores of the newest run before another one that finished with scores of which none fell; None without one."""
    r = RUN.c
    query = select(r.id, r.scores, r.verdict).where(r.scenario == scenario, r.seed == seed, r.id < before)
    found = _fetch(store, query.where(r.status == "finished").order_by(r.id.desc()))
    return next(((number, scores) for number, scores, verdict in found.rows if scores and not verdict), None)


def latest_run(store: Store, scenario: str | None = None) -> int:
    """The number of the newest run (of a scenario). Raises: StoreError where there is none."""
    query = select(func.max(RUN.c.id))
    found = _fetch(store, query if scenario is None else query.where(RUN.c.scenario == scenario)).rows[0][0]
    if found is None:
        raise StoreError(f"{store.where}: holds no run" + (f" of {scenario}" if scenario else ""))
    return int(found)


def newest_picture(store: Store, run_id: int | None = None) -> tuple[int, int, float] | None:
    """Run, cycle and time of the newest stored picture (of a run); None where there is none."""
    c = CYCLE.c
    which = func.coalesce(run_id, select(func.max(RUN.c.id)).scalar_subquery())
    query = select(c.run_id, c.number, c.time_s).where(c.run_id == which, c.picture_kept).order_by(c.number.desc()).limit(1)
    found = _fetch(store, query).rows
    return (int(found[0][0]), int(found[0][1]), float(found[0][2])) if found else None


def last_instant(store: Store, run_id: int) -> float | None:
    """Time of the newest stored cycle of a run; None where there is none."""
    newest = select(CYCLE.c.time_s).where(CYCLE.c.run_id == run_id).order_by(CYCLE.c.number.desc()).limit(1)
    with reading(store) as connection:
        found = connection.scalar(newest)
    return None if found is None else float(found)


def timings(store: Store, run_id: int) -> Rows:
    """For each stage, in the order in which they ran: cycles, milliseconds (median, p99, longest, total), share and rows a cycle."""
    t = STAGE_TIMING.c
    query = select(t.stage, t.number, t.seconds, t.rows).where(t.run_id == run_id).order_by(t.cycle, t.number)
    stored = _fetch(store, query).rows
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
    before = true() if at_s is None else CYCLE.c.time_s <= at_s
    upto = select(CYCLE.c.number).where(CYCLE.c.run_id == run_id, kept, before)
    cycle = connection.scalar(upto.order_by(CYCLE.c.time_s.desc()).limit(1))
    if cycle is None and at_s is not None:
        first_s = connection.scalar(select(func.min(CYCLE.c.time_s)).where(CYCLE.c.run_id == run_id, kept))
        has = "it has no cycle yet" if first_s is None else f"its first kept cycle is at {_text_utc(first_s)}"
        raise NotThere(f"{store.where}: run {run_id} holds nothing up to {_text_utc(at_s)}, {has}")
    return -1 if cycle is None else int(cycle)


def _text_utc(time_s: float) -> str:
    return datetime.fromtimestamp(time_s, UTC).isoformat().replace("+00:00", "Z")


def run_exists(connection: Connection, store: Store, run_id: int) -> None:
    """Raises: StoreError where there is no such run."""
    if connection.scalar(select(RUN.c.id).where(RUN.c.id == run_id)) is None:
        raise no_run(connection, store, run_id)


def no_run(connection: Connection, store: Store, run_id: int) -> StoreError:
    """The refusal of a run that is not there, with the runs that are."""
    known = sorted(connection.scalars(select(RUN.c.id).order_by(RUN.c.id.desc()).limit(MOST_NAMED)))
    needed = f"needed one of {', '.join(map(str, known))}" if known else "the database holds none"
    return StoreError(f"{store.where}: there is no run {run_id}, {needed}; `coastwatch runs` lists all")


def _fetch(store: Store, query: Executable) -> Rows:
    with reading(store) as connection:
        return fetch_rows(connection, query)


def sensor_rows(run_id: int, sensors: Sensors) -> list[dict[str, Any]]:
    """One row a radar, AIS receiver and sonar. `number` is the index that its reports carry."""
    return [
        {"run_id": run_id, "kind": kind, "number": k, **row}
        for kind, rows in (
            ("radar", _radars(sensors.radars, sensors.region_names)),
            ("ais", [_common(sensors.stations, k) for k in range(len(sensors.stations))]),
            ("bearing", _sonars(sensors.sonars)),
        )
        for k, row in enumerate(rows)
    ]


def track_source_rows(run_id: int, sources: TrackSources) -> list[dict[str, Any]]:
    """One row a track source. `number` is the index that its reports carry."""
    sites = [[value if np.isfinite(value) else None for value in site] for site in sources.site_deg.tolist()]
    return [
        {"run_id": run_id, "number": k, "name": str(name), "latitude_deg": latitude, "longitude_deg": longitude}
        for k, (name, (latitude, longitude)) in enumerate(zip(sources.name, sites, strict=True))
    ]


def source_rows(run_id: int, sensors: Sensors) -> list[dict[str, Any]]:
    """One row for each source of tracks. `number` is the source that tracks carry."""
    kinds = [SourceKind(kind).name.lower() for kind in sensors.source_kinds.tolist()]
    named = enumerate(zip(sensors.source_names, kinds, strict=True))
    return [{"run_id": run_id, "number": k, "name": name, "kind": kind} for k, (name, kind) in named]


def _common(of: Radars | Stations | Sonars, k: int) -> dict[str, Any]:
    return {
        "name": str(of.name[k]),
        "latitude_deg": float(of.site_deg[k, 0]),
        "longitude_deg": float(of.site_deg[k, 1]),
        "range_m": float(of.range_m[k]),
        "region": None,
        "spec": {},
    }


def _radars(radars: Radars, regions: tuple[str, ...]) -> list[dict[str, Any]]:
    return [
        {
            **_common(radars, k),
            "region": regions[radars.region[k]],
            "spec": {
                "period_s": float(radars.period_s[k]),
                "range_sigma_m": float(radars.range_sigma_m[k]),
                "azimuth_sigma_deg": float(np.degrees(radars.azimuth_sigma_rad[k])),
            },
        }
        for k in range(len(radars))
    ]


def _sonars(sonars: Sonars) -> list[dict[str, Any]]:
    return [
        {
            **_common(sonars, k),
            "spec": {
                "bearing_sigma_deg": float(np.degrees(sonars.bearing_sigma_rad[k])),
                "interval_s": float(sonars.interval_s[k]),
                "arc_from_deg": float(sonars.arc_from_deg[k]),
                "arc_to_deg": float(sonars.arc_to_deg[k]),
            },
        }
        for k in range(len(sonars))
    ]
