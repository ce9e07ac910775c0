"""The process that writes a run, null for older runs: one that is no longer there has died."""

import sqlalchemy as sa
from alembic import op

revision = "0018"
down_revision = "0017"

WHOLE = sa.BigInteger().with_variant(sa.Integer(), "sqlite")


def upgrade() -> None:
    op.add_column("run", sa.Column("machine", sa.Text(), nullable=True))
    op.add_column("run", sa.Column("process", WHOLE, nullable=True))
