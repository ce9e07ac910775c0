"""The cycles of a run into the database: one transaction a cycle, so that what stands there is always whole cycles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from sqlalchemy import Connection, delete, func, insert, select, update

from coastwatch.batches import Floats, Ints, Reports
from coastwatch.store import columns, registrations, statics
from coastwatch.store.bulk import amend, append, erase
from coastwatch.store.cells import Column, Named, Texts
from coastwatch.store.opening import Store, StoreError, writing
from coastwatch.store.rewind import rewind
from coastwatch.store.tables import Base, Checkpoint, Member, Presence, Run, Source
from coastwatch.store.tables import Cycle as CycleRow

if TYPE_CHECKING:  # to read a database needs no stage of the pipeline, which are slow to import
    from coastwatch.pipeline import Cycle
    from coastwatch.scenario import StoreSettings

TABLES = Base.metadata.tables


@dataclass(frozen=True, eq=False)
class Newest:
    """What the database holds of a run's newest cycle: against it the next one is compared."""

    cycle: int  # -1 before the first
    members: Ints  # (L, 3) vessel, source, track, sorted
    vessels: Ints  # (V, 1) sorted
    source_names: tuple[str, ...]
    source_kinds: tuple[str, ...]
    statics: Ints  # MMSI, sorted
    heard: registrations.Heard


def write_cycle(
    store: Store,
    run_id: int,
    number: int,
    cycle: Cycle,
    reports: Reports,
    seconds: Mapping[str, float],
    keep: StoreSettings,
    checkpoint: bytes | None = None,
) -> None:
    """Write all that one cycle yielded, in one transaction: after a SIGKILL the cycle is there as a whole or not at all.

    The cycle becomes the newest of its run: where the database already holds it or later ones (a run that goes on from an older
    checkpoint), those are replaced in the same transaction.

    Args: number: of the cycle, from 0; seconds: of each stage, in order; keep: how often the large tables get their rows;
    checkpoint: the memory after this cycle, where one is to be kept.
    Raises: StoreError where the run is absent, a cycle is left out, the database is locked or the disk is full.
    """
    picture = cycle.picture
    if (np.diff(picture.vessel_id) <= 0).any():
        picture = picture.take(np.argsort(picture.vessel_id, kind="stable"))
    members, moving = columns.memberships(cycle), columns.motion(picture)
    keeps = number % keep.history_every == 0, number % keep.associations_every == 0
    with writing(store) as connection:
        before = store.newest.get(run_id) or _newest(connection, run_id, store.where)
        if number > before.cycle + 1:
            raise StoreError(f"{store.where}: run {run_id}: got cycle {number}, needed {before.cycle + 1}")
        if number <= before.cycle:
            rewind(connection, run_id, number)
            before = _newest(connection, run_id, store.where)
        _cycle_row(connection, run_id, number, cycle, reports, keeps)
        _timings(connection, run_id, number, seconds, _rows_by_stage(cycle, reports, before.source_kinds))
        texts = columns.sources(picture.vessel_id, members, before.source_names)
        _replace(connection, "vessel", run_id, columns.vessels(run_id, picture, texts, moving))
        now = columns.bearing_tracks(run_id, cycle.bearing_tracks, cycle.bearing_associations, cycle.picture)
        _replace(connection, "bearing_track", run_id, now)
        _stays(connection, run_id, number, before, members, picture.vessel_id[:, None], picture.since_s)
        if keeps[0]:
            append(connection, TABLES["history"], columns.history(run_id, number, picture, moving))
            append(connection, TABLES["spot"], columns.spots(run_id, number, cycle.spots))
        if keeps[1]:
            _associations(connection, run_id, number, cycle, members)
        known = statics.merge(connection, run_id, before.statics, reports.statics)
        heard = registrations.merge(connection, run_id, number, before.heard, cycle, reports, keep.registration_every)
        if checkpoint is not None:
            connection.execute(delete(Checkpoint).where(Checkpoint.run_id == run_id))
            connection.execute(insert(Checkpoint).values(run_id=run_id, cycle=number, memory=checkpoint))
    vessels = picture.vessel_id[:, None]
    store.newest[run_id] = Newest(number, members, vessels, before.source_names, before.source_kinds, known, heard)


def _newest(connection: Connection, run_id: int, where: str) -> Newest:
    """What the database holds of the newest cycle; the run is marked as running."""
    running = connection.execute(update(Run).where(Run.id == run_id).values(status="running", finished_utc=None))
    if running.rowcount == 0:
        raise StoreError(f"{where}: there is no run {run_id}; another process may have restarted it")
    cycle = connection.scalar(select(func.max(CycleRow.number)).where(CycleRow.run_id == run_id))
    members = select(Member.vessel_id, Member.source, Member.track_id).where(Member.run_id == run_id)
    vessels = select(Presence.vessel_id).where(Presence.run_id == run_id, Presence.to_cycle.is_(None))
    names = connection.execute(select(Source.name, Source.kind).where(Source.run_id == run_id).order_by(Source.number)).all()
    return Newest(
        cycle=-1 if cycle is None else cycle,
        members=_array(connection, members.order_by(Member.vessel_id, Member.source, Member.track_id), 3),
        vessels=_array(connection, vessels.order_by(Presence.vessel_id), 1),
        source_names=tuple(row.name for row in names),
        source_kinds=tuple(row.kind for row in names),
        statics=statics.known(connection, run_id),
        heard=registrations.known(connection, run_id),
    )


def _array(connection: Connection, query: Any, width: int) -> Ints:
    return np.array([tuple(row) for row in connection.execute(query)], np.int64).reshape(-1, width)


def _cycle_row(
    connection: Connection, run_id: int, number: int, cycle: Cycle, reports: Reports, keeps: tuple[bool, bool]
) -> None:
    row = {
        "run_id": run_id,
        "number": number,
        "time_s": cycle.time_s,
        "vessels": len(cycle.picture),
        "tracks": len(cycle.tracks) + len(cycle.bearing_tracks),
        "pairs": len(cycle.associations.first),
        "bearing_pairs": len(cycle.bearing_associations.bearing_row),
        "reports": len(reports),
        "picture_kept": True,
        "history_from": number if keeps[0] else None,
        "history_points": len(cycle.picture) if keeps[0] else 0,
        "associations_kept": keeps[1],
    }
    connection.execute(insert(CycleRow), [row])


def _rows_by_stage(cycle: Cycle, reports: Reports, kinds: Sequence[str]) -> dict[str, int]:
    """How many rows each stage yielded; `store` and other stages that yield none are absent."""
    ais = int((np.array([kind == "ais" for kind in kinds], bool)[cycle.tracks.source]).sum())
    return {
        "plots": len(reports.radar),
        "tracks": len(cycle.tracks) - ais,
        "ais_tracks": ais,
        "bearing_tracks": len(cycle.bearing_tracks),
        "spots": len(cycle.spots.centre_m),
        "associations": len(cycle.associations.first),
        "fused_tracks": len(cycle.fused),
        "picture": len(cycle.picture),
        "octants": len(cycle.octants.bearing_row),
        "bearing_associations": len(cycle.bearing_associations.bearing_row),
        "registration": len(cycle.corrections),
    }


def _timings(connection: Connection, run_id: int, number: int, seconds: Mapping[str, float], rows: Mapping[str, int]) -> None:
    stages = list(seconds)
    counts = np.array([rows.get(stage, -1) for stage in stages], np.int64)
    places = np.arange(len(stages))
    took = np.array([float(s) for s in seconds.values()])
    append(connection, TABLES["stage_timing"], [run_id, number, places, Texts(places, stages), took, Named(counts)])


def _replace(connection: Connection, name: str, run_id: int, rows: Sequence[Column]) -> None:
    connection.execute(delete(TABLES[name]).where(TABLES[name].c.run_id == run_id))
    append(connection, TABLES[name], rows)


def _associations(connection: Connection, run_id: int, number: int, cycle: Cycle, members: Ints) -> None:
    append(connection, TABLES["association"], columns.associations(run_id, number, cycle, members))
    found = columns.bearing_associations(run_id, number, cycle.bearing_tracks, cycle.bearing_associations, cycle.picture)
    append(connection, TABLES["bearing_association"], found)


def _stays(
    connection: Connection, run_id: int, number: int, before: Newest, members: Ints, vessels: Ints, since_s: Floats
) -> None:
    """Open and close what came and went since the last cycle; what stayed costs nothing."""
    gone, come = _changed(before.members, members)
    left = dict(zip(("vessel_id", "source", "track_id"), gone.T, strict=True))
    amend(connection, TABLES["member_history"], left, {"run_id": run_id, "to_cycle": None}, {"to_cycle": number - 1})
    erase(connection, TABLES["member"], left, {"run_id": run_id})
    append(connection, TABLES["member"], [run_id, *come.T])
    append(connection, TABLES["member_history"], [run_id, *come.T, number, None])
    gone, come = _changed(before.vessels, vessels)
    left = {"vessel_id": gone[:, 0]}
    amend(connection, TABLES["presence"], left, {"run_id": run_id, "to_cycle": None}, {"to_cycle": number - 1})
    since = since_s[np.searchsorted(vessels[:, 0], come[:, 0])]
    append(connection, TABLES["presence"], [run_id, come[:, 0], number, None, since])


def _changed(before: Ints, now: Ints) -> tuple[Ints, Ints]:
    """Rows that are only in the first and rows that are only in the second of two sorted tables without repetition."""
    from coastwatch.kernels.sorted_rows import differences

    gone, come = np.zeros(len(before), np.bool_), np.zeros(len(now), np.bool_)
    differences(before, now, gone, come)
    return before[gone], now[come]
