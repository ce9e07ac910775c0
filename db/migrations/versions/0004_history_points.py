"""The history as points from which the past is dead-reckoned, and of each cycle from which cycle on its points are.

Older runs have a row a vessel in each kept cycle: those are points too. A vessel that left gets the closing point that it has today,
where its last row left it. Their `previous_cycle` stays null.
"""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

KEY = sa.BigInteger().with_variant(sa.Integer(), "sqlite")

CLOSING = """
INSERT INTO history (run_id, cycle, vessel_id, latitude_deg, longitude_deg, sog_kn, cog_deg, major_m, minor_m, orientation_deg,
    updated_s, mmsi, flags, closing)
SELECT h.run_id, e.cycle, h.vessel_id, h.latitude_deg, h.longitude_deg, h.sog_kn, h.cog_deg, h.major_m, h.minor_m,
    h.orientation_deg, h.updated_s, h.mmsi, h.flags, true
FROM (
    SELECT p.run_id, p.vessel_id, p.from_cycle, p.to_cycle + 1 AS cycle, (
        SELECT max(k.number) FROM cycle k WHERE k.run_id = p.run_id AND k.number <= p.to_cycle AND k.history_kept
    ) AS kept
    FROM presence p
        JOIN cycle c ON c.run_id = p.run_id AND c.number = p.to_cycle + 1
) e
    JOIN history h ON h.run_id = e.run_id AND h.cycle = e.kept AND h.vessel_id = e.vessel_id
WHERE e.kept >= e.from_cycle
ORDER BY h.run_id, e.cycle, h.vessel_id
"""

FROM_CYCLE = """
UPDATE cycle SET
    history_from = (
        SELECT max(k.number) FROM cycle k WHERE k.run_id = cycle.run_id AND k.number <= cycle.number AND k.history_kept
    ),
    history_points = (SELECT count(*) FROM history h WHERE h.run_id = cycle.run_id AND h.cycle = cycle.number)
"""


def upgrade() -> None:
    op.add_column("history", sa.Column("previous_cycle", KEY, nullable=True))
    op.add_column("history", sa.Column("closing", sa.Boolean(), nullable=False, server_default=sa.false()))
    op.execute(sa.text(CLOSING))
    with op.batch_alter_table("cycle") as cycle:
        cycle.add_column(sa.Column("picture_kept", sa.Boolean(), nullable=False, server_default=sa.true()))
        cycle.add_column(sa.Column("history_from", KEY, nullable=True))
        cycle.add_column(sa.Column("history_points", KEY, nullable=False, server_default="0"))
    op.execute(sa.text(FROM_CYCLE))
    with op.batch_alter_table("cycle") as cycle:
        for name in ("picture_kept", "history_points"):
            cycle.alter_column(name, server_default=None)
        cycle.drop_column("history_kept")
