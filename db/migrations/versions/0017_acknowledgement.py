"""Who acknowledged which alarm; empty for older runs."""

import sqlalchemy as sa
from alembic import op

revision = "0017"
down_revision = "0016"

WHOLE = sa.BigInteger().with_variant(sa.Integer(), "sqlite")


def upgrade() -> None:
    op.create_table(
        "acknowledgement",
        sa.Column("run_id", WHOLE, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("vessel_id", WHOLE, primary_key=True, autoincrement=False),
        sa.Column("kind", sa.String(32), primary_key=True, autoincrement=False),
        sa.Column("from_cycle", WHOLE, primary_key=True, autoincrement=False),
        sa.Column("acknowledged_s", sa.Float(53), nullable=False),
        sa.Column("acknowledged_by", sa.Text(), nullable=False),
        sa.Column("note", sa.Text(), nullable=False),
        sa.Column("who", sa.Text(), nullable=False),
        sqlite_with_rowid=False,
    )
