"""Table `sensor_registration`: when each sensor was heard last, and what is known of its registration errors.

Older runs have no row: nothing was estimated then.
"""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"

KEY = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
MEASURED = (
    "azimuth_bias_deg",
    "azimuth_sigma_deg",
    "range_bias_m",
    "range_sigma_m",
    "time_lag_s",
    "estimated_lag_s",
    "lag_sigma_s",
)


def upgrade() -> None:
    op.create_table(
        "sensor_registration",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("cycle", KEY, primary_key=True, autoincrement=False),
        sa.Column("kind", sa.String(16), primary_key=True),
        sa.Column("number", KEY, primary_key=True, autoincrement=False),
        sa.Column("heard_s", sa.Float(53), nullable=True),
        sa.Column("state", sa.String(16), nullable=True),
        *(sa.Column(name, sa.Float(53), nullable=True) for name in MEASURED),
        sa.Column("vessels", KEY, nullable=True),
        sa.Column("residuals", sa.Float(53), nullable=True),
        sqlite_with_rowid=False,
    )
