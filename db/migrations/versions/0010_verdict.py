"""The verdict on a run, null for older runs: one sentence for each figure that is not as required."""

import sqlalchemy as sa
from alembic import op

revision = "0010"
down_revision = "0009"


def upgrade() -> None:
    op.add_column("run", sa.Column("verdict", sa.JSON(none_as_null=True), nullable=True))
