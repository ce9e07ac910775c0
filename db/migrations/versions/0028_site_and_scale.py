"""Error of the stated site of a radar, and of the scale of its ranges, null for older runs."""

import sqlalchemy as sa
from alembic import op

revision = "0028"
down_revision = "0027"


def upgrade() -> None:
    for name in ("range_scale", "range_scale_sigma", "site_east_m", "site_north_m", "site_sigma_m"):
        op.add_column("sensor_registration", sa.Column(name, sa.Float(53), nullable=True))
