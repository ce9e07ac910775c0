"""The cycles of a run into the database: one transaction a cycle, so that what stands there is always whole cycles."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from sqlalchemy import Connection, delete, insert, select

from coastwatch.batches import Floats, Ints, Members, Picture, Reports
from coastwatch.store import blocks, columns, history_rule, newest, registrations, retention, statics, write_ahead
from coastwatch.store.bulk import amend, append, erase
from coastwatch.store.cells import Column, Named, Texts
from coastwatch.store.identities import write_identities
from coastwatch.store.newest import Newest
from coastwatch.store.opening import Store, StoreError, writing
from coastwatch.store.places import write_places
from coastwatch.store.rehearsal import rehearse
from coastwatch.store.rewind import rewind
from coastwatch.store.tables import Base, Checkpoint
from coastwatch.store.tables import Cycle as CycleRow

if TYPE_CHECKING:  # to read a database needs no stage of the pipeline, which are slow to import
    from coastwatch.pipeline import Cycle
    from coastwatch.scenario import StoreSettings
    from coastwatch.store.chunks import Key

TABLES = Base.metadata.tables
PIECE_BYTES = 1 << 26


class Written(NamedTuple):
    """What there is to say of a cycle that was written."""

    rows: int  # that came into the tables of the picture, its history, stays and associations
    complaint: str | None  # what an operator should see to


def write_cycle(
    store: Store,
    run_id: int,
    number: int,
    cycle: Cycle,
    reports: Reports,
    seconds: Mapping[str, float],
    keep: StoreSettings,
    checkpoint: bytes | None = None,
    *,
    last: bool = False,
) -> Written:
    """Write all that one cycle yielded, in one transaction: after a SIGKILL the cycle is there as a whole or not at all.

    The cycle becomes the newest of its run: where the database already holds it or later ones (a run that goes on from an older
    checkpoint), those are replaced in the same transaction.

    Args: number: of the cycle, from 0; seconds: of each stage, in order; keep: how often the large tables get their rows;
    checkpoint: the memory after this cycle, where one is to be kept; last: the run ends here, and its last picture is to be seen.
    Returns: what there is to say of it.
    Raises: StoreError where the run is absent, a cycle is left out, the database is locked or the disk is full.
    """
    rehearse(write_cycle, store, run_id, cycle, reports, seconds, keep)
    picture, members = _in_order(cycle.picture), columns.memberships(cycle)
    with writing(store, parents_known=True) as connection:
        write_ahead.fit(connection, len(picture), recorded=keep.recording)
        before, again = _before(connection, store, run_id, number)
        due = last or again or _picture_due(before, cycle, keep)
        bound = history_rule.Bound(keep.history_error_m, keep.history_max_s)
        moved = columns.motion(picture.velocity_m_s, picture.covariance) if due else None
        points, added = history_rule.step(before.points, bound, number, cycle.time_s, before.time_s, picture, moved)
        _cycle_row(connection, run_id, number, cycle, reports, keep, due, added)
        _timings(connection, run_id, number, seconds, _rows_by_stage(cycle, reports, before.source_kinds))
        rows = append(connection, TABLES["history"], [run_id, number, *added.columns])
        rows += write_identities(connection, run_id, number, added)
        tail = blocks.extend(connection, run_id, number, blocks.placed(number, added.columns), before.tail)
        if moved is not None:
            names = columns.sources(picture.vessel_id, members, before.source_names)
            rows += _picture(connection, run_id, cycle, picture, moved, names)
        rows += _stays(connection, run_id, number, before, members, picture.vessel_id[:, None], picture.since_s)
        rows += _details(connection, run_id, number, cycle, members, keep)
        known = statics.merge(connection, run_id, before.statics, reports.statics)
        heard = registrations.merge(connection, run_id, number, before.heard, cycle, reports, keep.registration_every)
        forgotten = retention.forget(connection, run_id, number, before.period_s, keep, before.forgotten, rows)
        key = _record(connection, run_id, number, picture, cycle.members, before.key) if keep.recording else None
        if checkpoint is not None:
            _checkpoint(connection, run_id, number, checkpoint)
    now = members, picture.vessel_id[:, None], points, before.source_names, before.source_kinds, known, heard, forgotten
    store.newest[run_id] = Newest(number, cycle.time_s, *now, before.period_s, tail, key)
    return Written(rows, write_ahead.complaint(store, len(picture)))


def _in_order(picture: Picture) -> Picture:
    """The picture sorted by vessel."""
    return picture if (np.diff(picture.vessel_id) > 0).all() else picture.take(np.argsort(picture.vessel_id, kind="stable"))


def _before(connection: Connection, store: Store, run_id: int, number: int) -> tuple[Newest, bool]:
    """The cycle before this one, and whether the run was taken back to it."""
    newest.look(connection, run_id, store.where)
    before = store.newest.get(run_id) or newest.read(connection, run_id, store.where)
    if number > before.cycle + 1:
        raise StoreError(f"{store.where}: run {run_id}: got cycle {number}, needed {before.cycle + 1}")
    if number == before.cycle + 1:
        return before, False
    rewind(connection, run_id, number)
    return newest.read(connection, run_id, store.where), True


def _picture_due(before: Newest, cycle: Cycle, keep: StoreSettings) -> bool:
    """Whether the current picture is written: in every cycle while it is small, else in the first one of each interval."""
    small = len(cycle.tracks) + len(cycle.bearing_tracks) <= keep.picture_large or keep.picture_every_s == 0.0
    if small or not math.isfinite(before.time_s):
        return True
    return math.floor(cycle.time_s / keep.picture_every_s) > math.floor(before.time_s / keep.picture_every_s)


def _picture(connection: Connection, run_id: int, cycle: Cycle, picture: Picture, moved: columns.Motion, sources: Texts) -> int:
    now = columns.bearing_tracks(run_id, cycle.bearing_tracks, cycle.bearing_associations, cycle.picture)
    rows = _replace(connection, "vessel", run_id, columns.vessels(run_id, picture, moved, sources))
    write_places(connection, run_id, picture.vessel_id, picture.position_deg)
    return rows + _replace(connection, "bearing_track", run_id, now)


def _cycle_row(
    connection: Connection,
    run_id: int,
    number: int,
    cycle: Cycle,
    reports: Reports,
    keep: StoreSettings,
    picture_due: bool,
    history: history_rule.Added,
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
        "picture_kept": picture_due,
        "history_from": history.first_cycle,
        "history_points": history.points,
        "associations_kept": number % keep.associations_every == 0,
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


def _replace(connection: Connection, name: str, run_id: int, rows: Sequence[Column]) -> int:
    """A table of the current picture anew. Where it holds no other run SQLite, which has one writer, empties it without a look at rows."""
    table = TABLES[name]
    others = [select(table.c.run_id).where(other).limit(1) for other in (table.c.run_id < run_id, table.c.run_id > run_id)]
    alone = connection.dialect.name == "sqlite" and not any(connection.execute(query).first() for query in others)
    connection.execute(delete(table) if alone else delete(table).where(table.c.run_id == run_id))
    return append(connection, table, rows)


def _checkpoint(connection: Connection, run_id: int, number: int, memory: bytes) -> None:
    connection.execute(delete(Checkpoint).where(Checkpoint.run_id == run_id))
    for piece, low in enumerate(range(0, max(len(memory), 1), PIECE_BYTES)):
        row = {"run_id": run_id, "piece": piece, "cycle": number, "memory": memory[low : low + PIECE_BYTES]}
        connection.execute(insert(Checkpoint), [row])


def _details(connection: Connection, run_id: int, number: int, cycle: Cycle, members: Ints, keep: StoreSettings) -> int:
    """Spots and associations, in the cycles in which they are kept."""
    rows = 0
    if number % keep.spots_every == 0:
        rows += append(connection, TABLES["spot"], columns.spots(run_id, number, cycle.spots))
    if number % keep.associations_every == 0:
        found = columns.bearing_associations(run_id, number, cycle.bearing_tracks, cycle.bearing_associations, cycle.picture)
        rows += append(connection, TABLES["association"], columns.associations(run_id, number, cycle, members))
        rows += append(connection, TABLES["bearing_association"], found)
    return rows


def _record(connection: Connection, run_id: int, number: int, picture: Picture, members: Members, before: Key | None) -> Key:
    from coastwatch.store.chunks import record  # with kernels, which are slow to import

    return record(connection, run_id, number, picture, members, before)


def _stays(
    connection: Connection, run_id: int, number: int, before: Newest, members: Ints, vessels: Ints, since_s: Floats
) -> int:
    """Open and close what came and went since the last cycle; what stayed costs nothing."""
    gone, come = _changed(before.members, members)
    left = dict(zip(("vessel_id", "source", "track_id"), gone.T, strict=True))
    amend(connection, TABLES["member_history"], left, {"run_id": run_id, "to_cycle": None}, {"to_cycle": number - 1})
    erase(connection, TABLES["member"], left, {"run_id": run_id})
    rows = append(connection, TABLES["member"], [run_id, *come.T])
    rows += append(connection, TABLES["member_history"], [run_id, *come.T, number, None])
    gone, come = _changed(before.vessels, vessels)
    left = {"vessel_id": gone[:, 0]}
    amend(connection, TABLES["presence"], left, {"run_id": run_id, "to_cycle": None}, {"to_cycle": number - 1})
    since = since_s[np.searchsorted(vessels[:, 0], come[:, 0])]
    return rows + append(connection, TABLES["presence"], [run_id, come[:, 0], number, None, since])


def _changed(before: Ints, now: Ints) -> tuple[Ints, Ints]:
    """Rows that are only in the first and rows that are only in the second of two sorted tables without repetition."""
    from coastwatch.kernels.tables.sorted_rows import differences

    gone, come = np.zeros(len(before), np.bool_), np.zeros(len(now), np.bool_)
    differences(before, now, gone, come)
    return before[gone], now[come]
