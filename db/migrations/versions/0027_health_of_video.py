"""Turns, losses and plots of radars that send video, null for older runs."""

import sqlalchemy as sa
from alembic import op

revision = "0027"
down_revision = "0026"

WHOLE = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
REAL = sa.Float(53)


def upgrade() -> None:
    whole = ("spokes_a_turn", "spokes_lost", "parts_lost")
    real = ("lost_share", "plots_a_turn", "threshold_db", "detection_probability", "false_plots_a_turn")
    for name, kind in (("turn_s", REAL), *((name, WHOLE) for name in whole), *((name, REAL) for name in real)):
        op.add_column("sensor_registration", sa.Column(name, kind, nullable=True))
