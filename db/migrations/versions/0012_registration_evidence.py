"""Evidence for the registration errors of a radar, null for older runs: candidate, odds, voices and the best other bias."""

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"

WHOLE = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
REALS = ("candidate_azimuth_deg", "candidate_range_m", "odds", "found_odds")


def upgrade() -> None:
    columns = [
        ("compared", WHOLE),
        *((name, sa.Float()) for name in REALS),
        ("voices", WHOLE),
        ("rival_share", sa.Float()),
    ]
    for name, kind in columns:
        op.add_column("sensor_registration", sa.Column(name, kind, nullable=True))
