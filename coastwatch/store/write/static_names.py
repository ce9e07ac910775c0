"""Names, types and sizes of vessels: one row an MMSI, the newest that came. Old ones go where the run has a retention."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from sqlalchemy import Connection

from coastwatch.batches import AisStatics, Floats, Ints
from coastwatch.kernels.tables.lookup import find
from coastwatch.store.rows import delete_rows, insert, take, update_rows
from coastwatch.store.schema.tables import VESSEL_STATIC
from coastwatch.store.write import to_rows

MOST_NAMES = 500_000
"""Names that a run with a retention keeps. Of more, those that were heard longest ago go."""

AT_ONCE = 2_000
"""Names that are deleted in a cycle, on top of as many as it adds."""


@dataclass(frozen=True, eq=False)
class StoredNames:
    """Of which MMSI names are stored."""

    mmsi: Ints  # (S,) sorted
    heard_s: Floats  # (S,) when the newest one came

    def __len__(self) -> int:
        return len(self.mmsi)


def write_names(connection: Connection, run_id: int, stored: StoredNames, reports: AisStatics) -> StoredNames:
    """Write new names, types and sizes of vessels. Returns: what is stored afterwards."""
    if not len(reports):
        return stored
    mmsi, columns = to_rows.static_rows(reports)
    row = find(stored.mmsi, mmsi)
    new = row < 0
    insert(connection, VESSEL_STATIC, [run_id, mmsi[new], *(take(column, new) for column in columns.values())])
    changed = {name: take(column, ~new) for name, column in columns.items()}
    update_rows(connection, VESSEL_STATIC, {"mmsi": mmsi[~new]}, {"run_id": run_id}, changed)
    heard_s, when = stored.heard_s.copy(), np.asarray(columns["updated_s"])
    heard_s[row[~new]] = when[~new]
    at = np.searchsorted(stored.mmsi, mmsi[new])
    return StoredNames(np.insert(stored.mmsi, at, mmsi[new]), np.insert(heard_s, at, when[new]))


def delete_names(connection: Connection, run_id: int, stored: StoredNames, before_s: float, present: Ints) -> StoredNames:
    """Delete some names that were not heard since an instant, or that are too many. Returns: what is stored afterwards.

    Args: present: MMSI of the vessels in the picture, whose names stay.
    """
    beyond = len(stored) - MOST_NAMES
    old = stored.heard_s < before_s
    if beyond <= 0 and not old.any():
        return stored
    most = AT_ONCE + max(beyond, 0)
    absent = np.flatnonzero(~np.isin(stored.mmsi, present))
    oldest = absent[np.argsort(stored.heard_s[absent], kind="stable")]
    gone = oldest[: min(most, max(int(old[absent].sum()), beyond))]
    delete_rows(connection, VESSEL_STATIC, {"mmsi": stored.mmsi[gone]}, {"run_id": run_id})
    return StoredNames(np.delete(stored.mmsi, gone), np.delete(stored.heard_s, gone))
