"""The full recording, of which older cycles have none, and the history by place, which the next cycles of an older run make up for."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"

KEY = sa.BigInteger().with_variant(sa.Integer(), "sqlite")


def upgrade() -> None:
    op.add_column("cycle", sa.Column("recorded", sa.Boolean(), nullable=False, server_default=sa.false()))
    op.create_table(
        "chunk",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True),
        sa.Column("cycle", KEY, primary_key=True, autoincrement=False),
        sa.Column("part", KEY, primary_key=True, autoincrement=False),
        sa.Column("key_cycle", KEY, nullable=False),
        sa.Column("rows", KEY, nullable=False),
        *(sa.Column(name, sa.Float(53), nullable=False) for name in ("south_deg", "west_deg", "north_deg", "east_deg")),
        sa.Column("data", sa.LargeBinary(), nullable=False),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "history_block",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True),
        sa.Column("from_cycle", KEY, primary_key=True, autoincrement=False),
        *(sa.Column(name, KEY, nullable=False) for name in ("to_cycle", "points", "first_vessel")),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "history_cell",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True),
        sa.Column("from_cycle", KEY, primary_key=True, autoincrement=False),
        sa.Column("cell", KEY, primary_key=True, autoincrement=False),
        sa.Column("data", sa.LargeBinary(), nullable=False),
        sqlite_with_rowid=False,
    )
