"""When the newest cycle of a run was written, null for older runs: a run that says nothing for long has died."""

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"


def upgrade() -> None:
    op.add_column("run", sa.Column("written_utc", sa.String(32), nullable=True))
