"""Echoes that a clutter map hides from the tracker; empty for older runs."""

import sqlalchemy as sa
from alembic import op

revision = "0019"
down_revision = "0018"

WHOLE = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
REAL = sa.Float(53)


def upgrade() -> None:
    op.create_table(
        "standing_echo",
        sa.Column("run_id", WHOLE, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("number", WHOLE, primary_key=True, autoincrement=False),
        sa.Column("radar", WHOLE, nullable=False),
        sa.Column("cycle", WHOLE, nullable=False),
        sa.Column("latitude_deg", REAL, nullable=False),
        sa.Column("longitude_deg", REAL, nullable=False),
        sa.Column("extent_m", REAL, nullable=False),
        sa.Column("plots_per_turn", REAL, nullable=False),
        sa.Column("turns", REAL, nullable=False),
        sqlite_with_rowid=False,
    )
