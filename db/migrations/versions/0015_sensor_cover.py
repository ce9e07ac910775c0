"""The learnt cover of each radar; empty for older runs."""

import sqlalchemy as sa
from alembic import op

revision = "0015"
down_revision = "0014"

WHOLE = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
GRIDS = ("ais_detection", "ais_looks", "track_detection", "track_looks", "false_plots_per_km2")


def upgrade() -> None:
    op.create_table(
        "sensor_cover",
        sa.Column("run_id", WHOLE, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("number", WHOLE, primary_key=True, autoincrement=False),
        sa.Column("cycle", WHOLE, nullable=False),
        *(sa.Column(name, sa.Float(53), nullable=True) for name in ("latitude_deg", "longitude_deg")),
        *(sa.Column(name, sa.Float(53), nullable=False) for name in ("range_m", "turns")),
        *(sa.Column(name, sa.LargeBinary(), nullable=False) for name in GRIDS),
        sqlite_with_rowid=False,
    )
