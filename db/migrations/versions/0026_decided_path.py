"""The corrected past of vessels, and how far away they may be instead; empty for older runs."""

import sqlalchemy as sa
from alembic import op

revision = "0026"
down_revision = "0025"

WHOLE = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
REAL = sa.Float(53)


def upgrade() -> None:
    op.create_table(
        "decided_path",
        sa.Column("run_id", WHOLE, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("cycle", WHOLE, primary_key=True, autoincrement=False),
        sa.Column("vessel_id", WHOLE, primary_key=True, autoincrement=False),
        sa.Column("number", WHOLE, primary_key=True, autoincrement=False),
        sa.Column("time_s", REAL, nullable=False),
        sa.Column("latitude_deg", REAL, nullable=False),
        sa.Column("longitude_deg", REAL, nullable=False),
        *(sa.Column(name, REAL) for name in ("sog_kn", "cog_deg", "major_m", "minor_m", "orientation_deg")),
        sa.Column("track_id", WHOLE, nullable=False),
        sa.Column("radar", WHOLE),
        sqlite_with_rowid=False,
    )
    op.add_column("vessel", sa.Column("alternative_m", REAL, nullable=True))
    op.add_column("recording", sa.Column("alternative_m", sa.LargeBinary(), nullable=True))
