"""Where the vessels of the current picture are in short, made with the next picture; which vessel had which MMSI, from the history."""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"

KEY = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
ENDED = sa.text("to_cycle IS NOT NULL")

FROM_HISTORY = """
INSERT INTO identity (run_id, mmsi, vessel_id, from_cycle, to_cycle)
SELECT s.run_id, s.mmsi, s.vessel_id, s.from_cycle, CASE WHEN v.vessel_id IS NULL THEN s.to_cycle ELSE NULL END
FROM (
    SELECT run_id, mmsi, vessel_id, min(cycle) AS from_cycle, max(cycle) AS to_cycle
    FROM history WHERE mmsi IS NOT NULL GROUP BY run_id, mmsi, vessel_id
) s
    LEFT JOIN vessel v ON v.run_id = s.run_id AND v.vessel_id = s.vessel_id AND v.mmsi = s.mmsi
"""


def upgrade() -> None:
    op.create_table(
        "vessel_place",
        sa.Column("run_id", KEY, primary_key=True, autoincrement=False),
        sa.Column("part", KEY, primary_key=True, autoincrement=False),
        sa.Column("data", sa.LargeBinary(), nullable=False),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "identity",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        *(sa.Column(name, KEY, primary_key=True, autoincrement=False) for name in ("mmsi", "vessel_id", "from_cycle")),
        sa.Column("to_cycle", KEY, nullable=True),
        sqlite_with_rowid=False,
    )
    op.execute(sa.text(FROM_HISTORY))
    op.create_index("identity_to", "identity", ["run_id", "to_cycle"], sqlite_where=ENDED, postgresql_where=ENDED)
    op.create_index("member_history_from", "member_history", ["run_id", "from_cycle"])
    op.create_index("cycle_time", "cycle", ["run_id", "time_s"])
