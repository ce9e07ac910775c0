"""One cycle of a run into the database, in one transaction: it is stored whole or not at all."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from sqlalchemy import Connection, Table, delete, insert as insert_one, select, update

from coastwatch.batches import AisStatics, EventChanges, Floats, Ints, Picture, Reports
from coastwatch.errors import StoreError
from coastwatch.store import history_rule
from coastwatch.store.journal import NOTHING_PASSED, ForCentres, compressed, write_for_centres
from coastwatch.store.recording import record as write_recording
from coastwatch.store.rows import Column, delete_rows, insert, source_texts, update_rows
from coastwatch.store.runs import is_there
from coastwatch.store.schema import database
from coastwatch.store.schema.database import Store
from coastwatch.store.schema.tables import (
    ASSOCIATION,
    BEARING_ASSOCIATION,
    BEARING_TRACK,
    CHECKPOINT,
    CYCLE,
    HISTORY,
    IDENTITY,
    MEMBER,
    MEMBER_HISTORY,
    PRESENCE,
    RUN,
    SENSOR_COVER,
    SENSOR_REGISTRATION,
    SPOT,
    STAGE_TIMING,
    STANDING_ECHO,
    VESSEL,
)
from coastwatch.store.write import events, retention, to_rows
from coastwatch.store.write.decided import write_decided
from coastwatch.store.write.run_state import RunState, no_such_run, read_run_state, truncate_run
from coastwatch.store.write.static_names import delete_names, write_names

if TYPE_CHECKING:  # to read a database needs no stage of the pipeline, which are slow to import
    from coastwatch.centre import Cycle
    from coastwatch.scenario import StoreSettings

PIECE_BYTES = 1 << 26
"""Of a checkpoint: no database takes more than a gigabyte in one value."""


class Written(NamedTuple):
    """The report of a written cycle."""

    rows: int  # that came into the tables of the picture, its history, stays and associations
    warning: str | None  # what an operator should see to
    log_bytes: int = 0  # of the write-ahead log of an SQLite database


@dataclass(frozen=True)
class SkippedCycle:
    """A cycle whose picture is not stored. What began or ended in it, names, and what passed between centres are."""

    number: int
    time_s: float
    why: Literal["merged", "not_stored"]  # its reports are in the next cycle; the database was away
    counts: Mapping[str, int]  # vessels, tracks, pairs, bearing_pairs, reports
    events: EventChanges = field(default_factory=EventChanges.empty)
    statics: AisStatics = field(default_factory=AisStatics.empty)
    heard: to_rows.LastReport = field(default_factory=dict)
    for_centres: ForCentres = NOTHING_PASSED


@dataclass(frozen=True)
class CycleRecord:
    """A cycle to be stored."""

    number: int  # from 0
    cycle: Cycle
    reports: Reports
    seconds: Mapping[str, float]  # of each stage, in order
    checkpoint: bytes | None = None  # the memory after this cycle, if one is to be kept
    last: bool = False  # the run ends here, so its picture is written whatever the settings say
    for_centres: ForCentres = NOTHING_PASSED
    merged: tuple[SkippedCycle, ...] = ()  # the cycles before it without a picture: merged, or not stored
    # (R, 9) `to_rows.VIDEO_VALUES` of the radars, NaN: not known; no rows: no radar sends video
    video: Floats = field(default_factory=lambda: np.empty((0, len(to_rows.VIDEO_VALUES))))

    def skipped(self) -> SkippedCycle:
        """What is kept of it where its picture cannot be stored."""
        return SkippedCycle(
            self.number,
            self.cycle.time_s,
            "not_stored",
            cycle_counts(self.cycle, self.reports),
            self.cycle.events,
            self.reports.statics,
            to_rows.last_reports({}, self.reports),
            self.for_centres,
        )


def write_cycle(store: Store, run_id: int, record: CycleRecord, keep: StoreSettings) -> Written:
    """Write all results of one cycle in one transaction: after a SIGKILL the cycle is there whole or not at all. Old rows go in another.

    The cycle becomes the newest of its run: where the database already holds it or later ones (a run that goes on from an older
    checkpoint), those are replaced in the same transaction.

    Args: keep: which tables get rows, and how often.
    Returns: rows written, and a warning for the operator.
    Raises: StoreError where the run is absent, a cycle is left out, the database is locked or the disk is full.
    """
    number, picture, members = record.number, record.cycle.picture, to_rows.membership(record.cycle)
    if not (np.diff(picture.vessel_id) > 0).all():
        picture = picture.take(np.argsort(picture.vessel_id, kind="stable"))
    skipped = record.merged
    database.require_room_for_log(store, len(picture))
    try:
        with database.writing(store) as connection:
            database.size_for(connection, len(picture))
            before, truncated = _state_before(connection, store, run_id, skipped[0].number if skipped else number)
            for one in skipped:
                before = _write_skipped(connection, run_id, before, one, keep)
            if number != before.cycle + len(skipped) + 1:
                raise StoreError(f"{store.where}: run {run_id}: got cycle {number}, needed {before.cycle + len(skipped) + 1}")
            after, rows = _write(connection, run_id, before, record, picture, members, keep, truncated)
    except BaseException:  # the database may have the cycle although its answer was lost
        store.run_states.pop(run_id, None)
        raise
    store.run_states[run_id] = after
    if retention.is_limited(keep) or number % retention.ENDED_EVERY == 0:  # it may finish a deletion that was interrupted
        with suppress(StoreError):  # the next cycle tries again
            _delete_old(store, run_id, keep, rows, picture)
    return Written(rows, database.long_log_warning(store, len(picture)), database.log_size(store))


def _write(
    connection: Connection,
    run_id: int,
    before: RunState,
    record: CycleRecord,
    picture: Picture,
    members: Ints,
    keep: StoreSettings,
    truncated: bool,
) -> tuple[RunState, int]:
    """Write a cycle behind the newest one. Returns: the state after it, and rows.

    Args: picture: sorted by vessel; members: from `to_rows.membership`; truncated: later cycles were deleted.
    """
    number, cycle, reports = record.number, record.cycle, record.reports
    bound = history_rule.Bound(keep.history_error_m, keep.history_max_s)
    points, added = history_rule.extend(before.points, bound, number, cycle.time_s, before.time_s, picture)
    is_small = len(cycle.tracks) + len(cycle.bearing_tracks) <= keep.picture_large
    picture_due = record.last or truncated or is_small or _is_due(before, cycle, keep.picture_every_s)
    of_cycle = {
        "run_id": run_id,
        "number": number,
        "time_s": cycle.time_s,
        **cycle_counts(cycle, reports),
        "picture_kept": picture_due,
        "history_from": added.first_cycle,
        "history_points": added.points,
        "associations_kept": number % keep.associations_every == 0,
        "recorded": keep.recording,
    }
    connection.execute(insert_one(CYCLE), [of_cycle])
    timings = to_rows.timing_rows(run_id, number, cycle, reports, record.seconds, before.source_kinds)
    insert(connection, STAGE_TIMING, timings)
    rows = write_history(connection, run_id, before.cycle, number, added)
    if picture_due:
        intervals = to_rows.ais_intervals(picture, cycle.members, cycle.alarms)
        sources = source_texts(picture.vessel_id, members, before.source_names)
        rows += _replace(connection, VESSEL, run_id, to_rows.vessel_rows(run_id, picture, sources, intervals))
        rows += _replace(connection, BEARING_TRACK, run_id, to_rows.bearing_track_rows(run_id, cycle))
    rows += _write_stays(connection, run_id, number, before, members, picture)
    rows += write_decided(connection, run_id, number, cycle.decided, members, before.timeline)
    rows += events.write_events(connection, run_id, number, cycle.events, before.timeline)
    if number % keep.spots_every == 0:
        rows += insert(connection, SPOT, to_rows.spot_rows(run_id, number, cycle.spots))
    if number % keep.associations_every == 0:
        rows += insert(connection, ASSOCIATION, to_rows.association_rows(run_id, number, cycle, members))
        rows += insert(connection, BEARING_ASSOCIATION, to_rows.bearing_association_rows(run_id, number, cycle))
    names = write_names(connection, run_id, before.names, reports.statics)
    last_report = to_rows.last_reports(before.last_report, reports)
    radar_states = tuple(cycle.corrections.state.tolist())
    is_due = number % keep.registration_every == 0 or (record.last and len(record.video) > 0)
    if not is_due and radar_states == before.radar_states and not cycle.corrections.jumped.any():
        radar_states = before.radar_states
    else:
        of_sensors = to_rows.registration_rows(run_id, number, cycle, last_report, before.stations, before.feeds, record.video)
        insert(connection, SENSOR_REGISTRATION, of_sensors)
    if record.last or _is_due(before, cycle, keep.cover_every_s):
        _replace(connection, SENSOR_COVER, run_id, to_rows.cover_rows(run_id, number, cycle.radar_cover))
        _replace(connection, STANDING_ECHO, run_id, to_rows.standing_echo_rows(run_id, number, cycle.standing_echoes))
    if keep.recording:
        write_recording(connection, run_id, number, picture, cycle.members)
    kept_messages = _kept_messages(keep, before.timeline.period_s)
    write_for_centres(connection, run_id, number, cycle.time_s, record.for_centres, kept_messages)
    if record.checkpoint is not None:
        _write_checkpoint(connection, run_id, number, record.checkpoint)
    after = replace(
        before,
        cycle=number,
        time_s=cycle.time_s,
        members=members,
        vessels=picture.vessel_id[:, None],
        points=points,
        names=names,
        last_report=last_report,
        radar_states=radar_states,
    )
    return after, rows


def _delete_old(store: Store, run_id: int, keep: StoreSettings, rows: int, picture: Picture) -> None:
    """Delete a little of what is too old, in a transaction of its own: the cycle is there before. Args: rows: that the cycle added.

    Raises: StoreError.
    """
    state = store.run_states[run_id]
    with database.writing(store) as connection:
        kept, period_s, names = (state.first_history, state.first_details), state.timeline.period_s, state.names
        kept = retention.delete_old(connection, run_id, state.cycle, period_s, keep, kept, rows)
        if state.cycle % retention.ENDED_EVERY == 0:
            retention.delete_ended(connection, run_id, keep)
        if (kept_s := retention.longest_kept_s(keep)) is not None:
            names = delete_names(connection, run_id, names, state.time_s - kept_s, picture.mmsi)
    store.run_states[run_id] = replace(state, names=names, first_history=kept[0], first_details=kept[1])


def _write_skipped(
    connection: Connection, run_id: int, before: RunState, skipped: SkippedCycle, keep: StoreSettings
) -> RunState:
    """Write what is kept of a skipped cycle. Returns: the state with its names and newest reports; its cycle stays the stored one."""
    none = {"picture_kept": False, "history_from": None, "history_points": 0, "associations_kept": False, "recorded": False}
    row = {"run_id": run_id, "number": skipped.number, "time_s": skipped.time_s, "skipped": skipped.why, **none}
    connection.execute(insert_one(CYCLE), [row | dict(skipped.counts)])
    events.write_events(connection, run_id, skipped.number, skipped.events, before.timeline)
    kept = _kept_messages(keep, before.timeline.period_s)
    write_for_centres(connection, run_id, skipped.number, skipped.time_s, skipped.for_centres, kept)
    return replace(
        before,
        names=write_names(connection, run_id, before.names, skipped.statics),
        last_report=to_rows.newest_reports(before.last_report, skipped.heard),
    )


def _kept_messages(keep: StoreSettings, period_s: float) -> int:
    """How many messages for other centres are kept."""
    return max(math.ceil(keep.journal_minutes * 60.0 / period_s), 1)


def _state_before(connection: Connection, store: Store, run_id: int, number: int) -> tuple[RunState, bool]:
    """The state after the cycle before this one, and whether later cycles were deleted to get there."""
    _note_running(connection, store, run_id)
    before = store.run_states.get(run_id) or read_run_state(connection, run_id, store.where)
    if number > before.cycle + 1:
        raise StoreError(f"{store.where}: run {run_id}: got cycle {number}, needed {before.cycle + 1}")
    if number == before.cycle + 1:
        return before, False
    truncate_run(connection, run_id, number)
    return read_run_state(connection, run_id, store.where), True


def note_running(store: Store, run_id: int) -> None:
    """Note that a run is still there, although it writes no cycle. Raises: StoreError."""
    with database.writing(store) as connection:
        _note_running(connection, store, run_id)


def _note_running(connection: Connection, store: Store, run_id: int) -> None:
    written = update(RUN).where(*is_there(run_id)).values(written_utc=database.now_utc(connection))
    if connection.execute(written).rowcount == 0:
        raise no_such_run(run_id, store.where)


def _is_due(before: RunState, cycle: Cycle, every_s: float) -> bool:
    """Whether a new interval has begun since the cycle before."""
    if every_s == 0.0 or not math.isfinite(before.time_s):
        return True
    return math.floor(cycle.time_s / every_s) > math.floor(before.time_s / every_s)


def cycle_counts(cycle: Cycle, reports: Reports) -> dict[str, int]:
    """The columns of table `cycle` that say how much there was."""
    return {
        "vessels": len(cycle.picture),
        "tracks": len(cycle.tracks) + len(cycle.bearing_tracks),
        "pairs": len(cycle.associations.first),
        "bearing_pairs": len(cycle.bearing_associations.bearing_row),
        "reports": len(reports),
    }


def write_history(connection: Connection, run_id: int, before: int, number: int, added: history_rule.Added) -> int:
    """The points of a cycle, and which vessel has which MMSI since then. Args: before: the stored cycle before it."""
    ended = dict(zip(("mmsi", "vessel_id"), added.ended.T, strict=True))
    lasting: dict[str, int | None] = {"run_id": run_id, "to_cycle": None}
    update_rows(connection, IDENTITY, ended, lasting, {"to_cycle": before})
    rows = insert(connection, IDENTITY, [run_id, *added.begun.T, number, None])
    return rows + insert(connection, HISTORY, [run_id, number, *added.columns])


def _replace(connection: Connection, table: Table, run_id: int, rows: Sequence[Column]) -> int:
    """Replace the rows of a run. Where there is no other run, SQLite empties the table page by page (no WHERE)."""
    others = [select(table.c.run_id).where(other).limit(1) for other in (table.c.run_id < run_id, table.c.run_id > run_id)]
    alone = connection.dialect.name == "sqlite" and not any(connection.execute(query).first() for query in others)
    connection.execute(delete(table) if alone else delete(table).where(table.c.run_id == run_id))
    return insert(connection, table, rows)


def _write_stays(connection: Connection, run_id: int, number: int, before: RunState, members: Ints, picture: Picture) -> int:
    """End the stays of members and vessels that left, and begin those of new ones."""
    lasting: dict[str, int | None] = {"run_id": run_id, "to_cycle": None}
    left, came = to_rows.changed_rows(before.members, members)
    keys = dict(zip(("vessel_id", "source", "track_id"), left.T, strict=True))
    update_rows(connection, MEMBER_HISTORY, keys, lasting, {"to_cycle": before.cycle})
    delete_rows(connection, MEMBER, keys, {"run_id": run_id})
    rows = insert(connection, MEMBER, [run_id, *came.T])
    rows += insert(connection, MEMBER_HISTORY, [run_id, *came.T, number, None])
    left, came = to_rows.changed_rows(before.vessels, picture.vessel_id[:, None])
    update_rows(connection, PRESENCE, {"vessel_id": left[:, 0]}, lasting, {"to_cycle": before.cycle})
    since_s: Floats = picture.since_s[np.searchsorted(picture.vessel_id, came[:, 0])]
    return rows + insert(connection, PRESENCE, [run_id, came[:, 0], number, None, since_s])


def write_checkpoint(store: Store, run_id: int, number: int, memory: bytes) -> Written:
    """Replace the checkpoint of a run. Args: number: of the cycle, stored before. Raises: StoreError."""
    with database.writing(store) as connection:
        _write_checkpoint(connection, run_id, number, memory)
    return Written(0, None)


def _write_checkpoint(connection: Connection, run_id: int, number: int, memory: bytes) -> None:
    memory = compressed(memory)
    connection.execute(delete(CHECKPOINT).where(CHECKPOINT.c.run_id == run_id))
    for piece, low in enumerate(range(0, max(len(memory), 1), PIECE_BYTES)):
        row = {"run_id": run_id, "piece": piece, "cycle": number, "memory": memory[low : low + PIECE_BYTES]}
        connection.execute(insert_one(CHECKPOINT), [row])
