"""Cycles of tracks between regional and high-level centres; empty for older runs."""

import sqlalchemy as sa
from alembic import op

revision = "0021"
down_revision = "0020"

WHOLE = sa.BigInteger().with_variant(sa.Integer(), "sqlite")


def upgrade() -> None:
    op.create_table(
        "track_journal",
        sa.Column("run_id", WHOLE, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("cycle", WHOLE, primary_key=True, autoincrement=False),
        sa.Column("time_s", sa.Float(53), nullable=False),
        sa.Column("message", sa.LargeBinary(), nullable=False),
    )
    op.create_table(
        "region_intake",
        sa.Column("run_id", WHOLE, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("cycle", WHOLE, primary_key=True, autoincrement=False),
        sa.Column("number", WHOLE, primary_key=True, autoincrement=False),
        sa.Column("region", sa.Text(), nullable=False),
        sa.Column("region_run", sa.String(64), nullable=False),
        sa.Column("first_seq", WHOLE, nullable=False),
        sa.Column("last_seq", WHOLE, nullable=False),
        sa.Column("late", WHOLE, nullable=False),
        sqlite_with_rowid=False,
    )
