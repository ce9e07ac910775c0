"""Events of flags, empty for older runs: a run that goes on begins them in its next cycle."""

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"

KEY = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
REAL = sa.Float(53)


def upgrade() -> None:
    op.create_table(
        "event",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("vessel_id", KEY, primary_key=True, autoincrement=False),
        sa.Column("kind", sa.String(32), primary_key=True, autoincrement=False),
        sa.Column("from_cycle", KEY, primary_key=True, autoincrement=False),
        sa.Column("to_cycle", KEY, nullable=True),
        sa.Column("start_s", REAL, nullable=False),
        sa.Column("end_s", REAL, nullable=True),
        *(sa.Column(name, REAL, nullable=False) for name in ("latitude_deg", "longitude_deg")),
        sa.Column("sog_kn", REAL, nullable=True),
        sa.Column("mmsi", KEY, nullable=True),
        sa.Column("evidence", sa.Text(), nullable=False),
        sqlite_with_rowid=False,
    )
    op.create_index("event_start", "event", ["run_id", "start_s"])
    op.create_index("event_to", "event", ["run_id", "to_cycle"])
    op.create_table(
        "event_gap",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("vessel_id", KEY, primary_key=True, autoincrement=False),
        sa.Column("kind", sa.String(32), primary_key=True, autoincrement=False),
        *(sa.Column(name, KEY, primary_key=True, autoincrement=False) for name in ("from_cycle", "cycle")),
        sa.Column("last_cycle", KEY, nullable=False),
        sa.Column("last_s", REAL, nullable=False),
        sqlite_with_rowid=False,
    )
    op.create_index("event_gap_cycle", "event_gap", ["run_id", "cycle"])
