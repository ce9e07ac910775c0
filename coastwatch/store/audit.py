"""Who changed what through the API of a server. Rows are only added; `coastwatch db prune` deletes old ones."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from sqlalchemy import func, insert, select

from coastwatch.store.rows import Rows, fetch_rows
from coastwatch.store.schema.database import Store, reading, writing
from coastwatch.store.schema.tables import AUDIT


@dataclass(frozen=True)
class Change:
    """A request that changed something."""

    time_s: float
    who: str  # name of the token, or of the user of the trusted proxy
    role: str
    client: str  # address
    method: str
    path: str
    http_status: int  # of the answer
    body: str  # its beginning


def note_change(store: Store, change: Change) -> None:
    """Add a change. Raises: StoreError."""
    with writing(store) as connection:
        connection.execute(insert(AUDIT).values(asdict(change)))


def changes(store: Store, limit: int, offset: int = 0) -> tuple[Rows, int]:
    """Changes, the newest first, and how many there are in all. Raises: StoreError."""
    query = (
        select(AUDIT.c.id.label("change_id"), *(c for c in AUDIT.c if c is not AUDIT.c.id))
        .order_by(AUDIT.c.id.desc())
        .limit(limit)
        .offset(offset)
    )
    with reading(store) as connection:
        total = connection.scalar(select(func.count()).select_from(AUDIT))
        return fetch_rows(connection, query), int(total or 0)
