"""The database's clock: no other is read in the store."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

from sqlalchemy import Connection, func, select


def utc(connection: Connection, later: timedelta = timedelta()) -> str:
    """Now, or so much later, as tables have it: 2026-01-31T12:00:00Z, which sorts as time does."""
    now: datetime = connection.execute(select(func.current_timestamp())).scalar_one()
    there = (now.astimezone(UTC) if now.tzinfo else now) + later
    return there.strftime("%Y-%m-%dT%H:%M:%SZ")
