"""The history as points from which the past is dead-reckoned, and of each cycle from which cycle on its points are.

Older runs have a row a vessel in each kept cycle: those are points too. A vessel that left gets the closing point that it has today,
where its last row left it. Their `previous_cycle` stays null. Table `vessel` loses its foreign key; stays of
tracks are found by their end, to be forgotten some day; a checkpoint may have more than one piece.
"""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"

KEY = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
ENDED = sa.text("to_cycle IS NOT NULL")

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

MOTION = ("latitude_deg", "longitude_deg", "sog_kn", "cog_deg", "major_m", "minor_m", "orientation_deg")
ALWAYS = ("time_s", "latitude_deg", "longitude_deg", "since_s", "updated_s")


def upgrade() -> None:
    without_key_of_run()
    checkpoint_in_pieces()
    op.create_index("member_history_to", "member_history", ["run_id", "to_cycle"], sqlite_where=ENDED, postgresql_where=ENDED)
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


def without_key_of_run() -> None:
    """SQLite cannot drop a constraint: the table is made anew. It holds the current picture only."""
    if op.get_bind().dialect.name == "postgresql":
        op.drop_constraint("vessel_run_id_fkey", "vessel", type_="foreignkey")
        return
    op.create_table(
        "vessel_of_0004",
        sa.Column("run_id", KEY, primary_key=True, autoincrement=False),
        sa.Column("vessel_id", KEY, primary_key=True, autoincrement=False),
        *(sa.Column(n, sa.Float(53), nullable=n not in ALWAYS) for n in ("time_s", *MOTION, "since_s", "updated_s")),
        sa.Column("mmsi", KEY, nullable=True),
        sa.Column("flags", KEY, nullable=False),
        sa.Column("sources", sa.Text(), nullable=False),
        sa.Column("covariance", sa.LargeBinary(), nullable=True),
        sqlite_with_rowid=False,
    )
    op.execute(sa.text("INSERT INTO vessel_of_0004 SELECT * FROM vessel ORDER BY run_id, vessel_id"))
    op.drop_table("vessel")
    op.rename_table("vessel_of_0004", "vessel")


def checkpoint_in_pieces() -> None:
    """The table made anew: its key is longer. Each checkpoint of before is one piece."""
    op.rename_table("checkpoint", "checkpoint_of_0003")
    if op.get_bind().dialect.name == "postgresql":  # the name of the key is the table's, and not renamed with it
        op.drop_constraint("checkpoint_pkey", "checkpoint_of_0003", type_="primary")
    op.create_table(
        "checkpoint",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("piece", KEY, primary_key=True, autoincrement=False),
        sa.Column("cycle", KEY, nullable=False),
        sa.Column("memory", sa.LargeBinary(), nullable=False),
    )
    op.execute(sa.text("INSERT INTO checkpoint SELECT run_id, 0, cycle, memory FROM checkpoint_of_0003"))
    op.drop_table("checkpoint_of_0003")
