"""Navigational status, null for older runs; feeds of AIS and the jitter of their times, none for older runs."""

import sqlalchemy as sa
from alembic import op

revision = "0011"
down_revision = "0010"

KEY = sa.BigInteger().with_variant(sa.Integer(), "sqlite")


def upgrade() -> None:
    for table, kind in (("vessel", KEY), ("history", KEY), ("recording", sa.LargeBinary())):
        op.add_column(table, sa.Column("nav_status", kind, nullable=True))
    op.add_column("sensor_registration", sa.Column("time_jitter_s", sa.Float(53), nullable=True))
    op.create_table(
        "ais_feed",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("number", KEY, primary_key=True, autoincrement=False),
        sa.Column("name", sa.Text(), nullable=False),
    )
