"""Table `presence`: in which cycles a vessel was in the picture.

With it the history needs no index on (vessel, time), and vessels that came or went lately are found without reading the history.
The rows of older runs are made from their history: consecutive kept cycles are one stay.
"""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"

KEY = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
ENDED = sa.text("to_cycle IS NOT NULL")

FROM_HISTORY = """
INSERT INTO presence (run_id, vessel_id, from_cycle, to_cycle, since_s)
WITH kept AS (
    SELECT run_id, number, time_s, row_number() OVER (PARTITION BY run_id ORDER BY number) AS place
    FROM cycle WHERE history_kept
), seen AS (
    SELECT h.run_id, h.vessel_id, h.cycle, k.time_s,
        k.place - row_number() OVER (PARTITION BY h.run_id, h.vessel_id ORDER BY h.cycle) AS stay
    FROM history h JOIN kept k ON k.run_id = h.run_id AND k.number = h.cycle
), stays AS (
    SELECT run_id, vessel_id, min(cycle) AS from_cycle, max(cycle) AS to_cycle, min(time_s) AS first_s
    FROM seen GROUP BY run_id, vessel_id, stay
), newest AS (
    SELECT run_id, vessel_id, max(to_cycle) AS to_cycle FROM stays GROUP BY run_id, vessel_id
)
SELECT s.run_id, s.vessel_id, s.from_cycle,
    CASE WHEN v.vessel_id IS NOT NULL AND s.to_cycle = n.to_cycle THEN NULL ELSE s.to_cycle END,
    coalesce(v.since_s, s.first_s)
FROM stays s
    JOIN newest n ON n.run_id = s.run_id AND n.vessel_id = s.vessel_id
    LEFT JOIN vessel v ON v.run_id = s.run_id AND v.vessel_id = s.vessel_id
"""

NEVER_KEPT = """
INSERT INTO presence (run_id, vessel_id, from_cycle, to_cycle, since_s)
SELECT v.run_id, v.vessel_id, (SELECT max(number) FROM cycle c WHERE c.run_id = v.run_id), NULL, v.since_s
FROM vessel v
WHERE NOT EXISTS (SELECT 1 FROM presence p WHERE p.run_id = v.run_id AND p.vessel_id = v.vessel_id AND p.to_cycle IS NULL)
"""


def upgrade() -> None:
    op.create_table(
        "presence",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("vessel_id", KEY, primary_key=True, autoincrement=False),
        sa.Column("from_cycle", KEY, primary_key=True, autoincrement=False),
        sa.Column("to_cycle", KEY, nullable=True),
        sa.Column("since_s", sa.Float(53), nullable=False),
        sqlite_with_rowid=False,
    )
    op.execute(sa.text(FROM_HISTORY))
    op.execute(sa.text(NEVER_KEPT))
    op.create_index("presence_from", "presence", ["run_id", "from_cycle"])
    op.create_index("presence_to", "presence", ["run_id", "to_cycle"], sqlite_where=ENDED, postgresql_where=ENDED)
