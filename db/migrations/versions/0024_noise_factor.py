"""By how much more the ranges and azimuths of a radar err than it states, null for older runs."""

import sqlalchemy as sa
from alembic import op

revision = "0024"
down_revision = "0023"


def upgrade() -> None:
    for name in ("range_noise_factor", "azimuth_noise_factor"):
        op.add_column("sensor_registration", sa.Column(name, sa.Float(53), nullable=True))
