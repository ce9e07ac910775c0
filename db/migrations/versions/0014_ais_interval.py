"""The interval at which AIS reports of a vessel are expected, null for older runs."""

import sqlalchemy as sa
from alembic import op

revision = "0014"
down_revision = "0013"


def upgrade() -> None:
    op.add_column("vessel", sa.Column("interval_s", sa.Float(53), nullable=True))
