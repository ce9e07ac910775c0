"""Alarms that nobody has acknowledged, by an index of their own; cycles that were skipped; acknowledgements by their time."""

import sqlalchemy as sa
from alembic import op

revision = "0023"
down_revision = "0022"

SAME = " AND ".join(f"a.{name} = event.{name}" for name in ("run_id", "vessel_id", "kind", "subject", "from_cycle"))


def upgrade() -> None:
    op.add_column("cycle", sa.Column("skipped", sa.String(16), nullable=True))
    op.add_column("event", sa.Column("unacknowledged", sa.Boolean(), nullable=False, server_default=sa.false()))
    waits = f"kind NOT IN ('coasting', 'stationary') AND NOT EXISTS (SELECT 1 FROM acknowledgement a WHERE {SAME})"
    op.execute(sa.text(f"UPDATE event SET unacknowledged = true WHERE {waits}"))
    where = sa.text("unacknowledged")
    op.create_index("event_unacknowledged", "event", ["run_id", "start_s"], sqlite_where=where, postgresql_where=where)
    op.create_index("acknowledgement_time", "acknowledgement", ["run_id", "acknowledged_s"])
