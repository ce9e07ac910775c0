"""The probability that a vessel exists, null for older runs."""

import sqlalchemy as sa
from alembic import op

revision = "0016"
down_revision = "0015"


def upgrade() -> None:
    for table, kind in (("vessel", sa.Float(53)), ("recording", sa.LargeBinary())):
        op.add_column(table, sa.Column("existence", kind, nullable=True))
