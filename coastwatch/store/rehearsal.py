"""The first cycle of a process, written into memory before it is written: what must be compiled is, while no lock is held.

A fresh installation compiles the code that writes for longer than another program waits for SQLite's only write lock
(`open_store`, wait_s): of two runs begun together in one database one would end there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from sqlalchemy import insert, select

from coastwatch.batches import Associations, BearingAssociations, Reports
from coastwatch.store import blocks
from coastwatch.store.bulk import NATIVE_FROM
from coastwatch.store.opening import Store, StoreError, connect, is_sqlite, reading, writing
from coastwatch.store.tables import Base

if TYPE_CHECKING:  # to read a database needs no stage of the pipeline, which are slow to import
    from coastwatch.pipeline import Cycle
    from coastwatch.scenario import StoreSettings

Found = TypeVar("Found", Associations, BearingAssociations)

MOST = 2048
"""Vessels of a rehearsal: enough for every way into a table."""

_done: set[tuple[bool, bool, bool]] = set()  # in this process: whether there were many tracks, many vessels, a recording


def rehearse(
    write: Callable[..., Any],
    store: Store,
    run_id: int,
    cycle: Cycle,
    reports: Reports,
    seconds: Mapping[str, float],
    keep: StoreSettings,
) -> None:
    """Write the first rows of a cycle, then half of them, into a database in memory, unless this process has written such cycles.

    Args: write: `write_cycle`; the others: as of that. What is wrong with them is left to be said by the writing itself.
    """
    kind = len(cycle.tracks) >= NATIVE_FROM, len(cycle.picture) >= NATIVE_FROM, keep.recording
    if kind in _done or not store.shared or not is_sqlite(store.engine.url):
        return
    with suppress(StoreError), connect("sqlite://", store.wait_s, may_create=True) as memory:
        _copy_run(store, memory, run_id)
        write(memory, run_id, 0, _first(cycle, MOST), reports, seconds, keep)
        if len(cycle.picture) >= NATIVE_FROM:  # then a block is due with the next cycle
            due = blocks.Tail(0, blocks.BLOCK_POINTS, None)
            memory.newest[run_id] = replace(memory.newest[run_id], tail=due)
        write(memory, run_id, 1, _first(cycle, MOST // 2), reports, seconds, keep)
    _done.add(kind)


def _copy_run(store: Store, memory: Store, run_id: int) -> None:
    """What the rows of a cycle refer to."""
    with reading(store) as here, writing(memory) as there:
        Base.metadata.create_all(there)
        for name in ("run", "sensor", "source"):
            table = Base.metadata.tables[name]
            of_run = table.c.id if name == "run" else table.c.run_id
            rows = [dict(row) for row in here.execute(select(table).where(of_run == run_id)).mappings()]
            if rows:
                there.execute(insert(table), rows)


def _first(cycle: Cycle, most: int) -> Cycle:
    """A cycle whose picture has its first vessels alone, and no bearing given to any."""
    few, bearings = cycle.picture.take(np.arange(min(most, len(cycle.picture)))), cycle.bearing_tracks
    return replace(
        cycle,
        picture=few,
        members=cycle.members.take(np.isin(cycle.members.vessel_id, few.vessel_id)),
        associations=_rows(cycle.associations, ("first", "second", "statistic"), most),
        bearing_tracks=bearings.take(np.arange(min(most, len(bearings)))),
        bearing_associations=_rows(cycle.bearing_associations, ("bearing_row", "vessel_row", "statistic"), 0),
    )


def _rows(found: Found, columns: tuple[str, ...], most: int) -> Found:
    return replace(found, **{name: getattr(found, name)[:most] for name in columns})
