"""Sources of finished tracks and what they sent: none, and null, for older runs."""

import sqlalchemy as sa
from alembic import op

revision = "0013"
down_revision = "0012"

KEY = sa.BigInteger().with_variant(sa.Integer(), "sqlite")


def upgrade() -> None:
    op.create_table(
        "track_source",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("number", KEY, primary_key=True, autoincrement=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("latitude_deg", sa.Float(53), nullable=True),
        sa.Column("longitude_deg", sa.Float(53), nullable=True),
    )
    whole = ((name, KEY) for name in ("states", "dropped", "tracks"))
    real = ((name, sa.Float(53)) for name in ("position_sigma_m", "velocity_sigma_m_s"))
    for name, kind in (*whole, *real):
        op.add_column("sensor_registration", sa.Column(name, kind, nullable=True))
