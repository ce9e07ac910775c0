"""Length, width and axis of a vessel by radar video, null for older runs."""

import sqlalchemy as sa
from alembic import op

revision = "0025"
down_revision = "0024"


def upgrade() -> None:
    for table, kind in (("vessel", sa.Float(53)), ("recording", sa.LargeBinary())):
        for column in ("echo_length_m", "echo_width_m", "echo_axis_deg"):
            op.add_column(table, sa.Column(column, kind, nullable=True))
