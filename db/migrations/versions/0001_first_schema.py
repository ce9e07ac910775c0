"""The first schema: runs, cycles, the current picture, its history and associations."""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None

KEY = sa.BigInteger().with_variant(sa.Integer(), "sqlite")


def upgrade() -> None:
    op.create_table(
        "run",
        sa.Column("id", KEY, primary_key=True),
        sa.Column("scenario", sa.Text(), nullable=False),
        sa.Column("title", sa.Text(), nullable=False),
        sa.Column("seed", KEY, nullable=False),
        sa.Column("version", sa.String(32), nullable=False),
        sa.Column("settings", sa.JSON(), nullable=False),
        sa.Column("command", sa.Text(), nullable=False),
        sa.Column("started_utc", sa.String(32), nullable=False),
        sa.Column("finished_utc", sa.String(32), nullable=True),
        sa.Column("status", sa.String(16), nullable=False),
        sa.Column("period_s", sa.Float(53), nullable=False),
        sa.Column("cycles", KEY, nullable=False),
        sa.Column("warmup_cycles", KEY, nullable=False),
        sa.Column("start_s", sa.Float(53), nullable=False),
        sa.Column("workers", KEY, nullable=False),
        sa.Column("scores", sa.JSON(), nullable=True),
        sa.Column("faults", sa.JSON(), nullable=False),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "association",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("cycle", KEY, primary_key=True, autoincrement=False),
        sa.Column("vessel_id", KEY, primary_key=True, autoincrement=False),
        sa.Column("first_source", KEY, primary_key=True, autoincrement=False),
        sa.Column("first_track", KEY, primary_key=True, autoincrement=False),
        sa.Column("second_source", KEY, primary_key=True, autoincrement=False),
        sa.Column("second_track", KEY, primary_key=True, autoincrement=False),
        sa.Column("statistic", sa.Float(53), nullable=True),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "bearing_association",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("cycle", KEY, primary_key=True, autoincrement=False),
        sa.Column("vessel_id", KEY, primary_key=True, autoincrement=False),
        sa.Column("source", KEY, primary_key=True, autoincrement=False),
        sa.Column("bearing_track", KEY, primary_key=True, autoincrement=False),
        sa.Column("statistic", sa.Float(53), nullable=True),
        sa.Column("bearing_deg", sa.Float(53), nullable=False),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "bearing_track",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("source", KEY, primary_key=True, autoincrement=False),
        sa.Column("track_id", KEY, primary_key=True, autoincrement=False),
        sa.Column("bearing_deg", sa.Float(53), nullable=False),
        sa.Column("rate_deg_s", sa.Float(53), nullable=True),
        sa.Column("latitude_deg", sa.Float(53), nullable=False),
        sa.Column("longitude_deg", sa.Float(53), nullable=False),
        sa.Column("vessel_id", KEY, nullable=True),
        sa.Column("updated_s", sa.Float(53), nullable=False),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "checkpoint",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("cycle", KEY, nullable=False),
        sa.Column("memory", sa.LargeBinary(), nullable=False),
    )
    op.create_table(
        "cycle",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("number", KEY, primary_key=True, autoincrement=False),
        sa.Column("time_s", sa.Float(53), nullable=False),
        sa.Column("vessels", KEY, nullable=False),
        sa.Column("tracks", KEY, nullable=False),
        sa.Column("pairs", KEY, nullable=False),
        sa.Column("bearing_pairs", KEY, nullable=False),
        sa.Column("reports", KEY, nullable=False),
        sa.Column("history_kept", sa.Boolean(), nullable=False),
        sa.Column("associations_kept", sa.Boolean(), nullable=False),
    )
    op.create_table(
        "history",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("cycle", KEY, primary_key=True, autoincrement=False),
        sa.Column("vessel_id", KEY, primary_key=True, autoincrement=False),
        sa.Column("latitude_deg", sa.Float(53), nullable=False),
        sa.Column("longitude_deg", sa.Float(53), nullable=False),
        sa.Column("sog_kn", sa.Float(53), nullable=True),
        sa.Column("cog_deg", sa.Float(53), nullable=True),
        sa.Column("major_m", sa.Float(53), nullable=True),
        sa.Column("minor_m", sa.Float(53), nullable=True),
        sa.Column("orientation_deg", sa.Float(53), nullable=True),
        sa.Column("updated_s", sa.Float(53), nullable=False),
        sa.Column("mmsi", KEY, nullable=True),
        sa.Column("flags", KEY, nullable=False),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "member",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("vessel_id", KEY, primary_key=True, autoincrement=False),
        sa.Column("source", KEY, primary_key=True, autoincrement=False),
        sa.Column("track_id", KEY, primary_key=True, autoincrement=False),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "member_history",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("vessel_id", KEY, primary_key=True, autoincrement=False),
        sa.Column("source", KEY, primary_key=True, autoincrement=False),
        sa.Column("track_id", KEY, primary_key=True, autoincrement=False),
        sa.Column("from_cycle", KEY, primary_key=True, autoincrement=False),
        sa.Column("to_cycle", KEY, nullable=True),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "sensor",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("kind", sa.String(16), primary_key=True),
        sa.Column("number", KEY, primary_key=True, autoincrement=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("latitude_deg", sa.Float(53), nullable=False),
        sa.Column("longitude_deg", sa.Float(53), nullable=False),
        sa.Column("range_m", sa.Float(53), nullable=False),
        sa.Column("region", sa.Text(), nullable=True),
        sa.Column("spec", sa.JSON(), nullable=False),
    )
    op.create_table(
        "source",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("number", KEY, primary_key=True, autoincrement=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("kind", sa.String(16), nullable=False),
    )
    op.create_table(
        "spot",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("cycle", KEY, primary_key=True, autoincrement=False),
        sa.Column("spot", KEY, primary_key=True, autoincrement=False),
        sa.Column("latitude_deg", sa.Float(53), nullable=False),
        sa.Column("longitude_deg", sa.Float(53), nullable=False),
        sa.Column("members", KEY, nullable=False),
        sa.Column("halo", KEY, nullable=False),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "stage_timing",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("cycle", KEY, primary_key=True, autoincrement=False),
        sa.Column("number", KEY, primary_key=True, autoincrement=False),
        sa.Column("stage", sa.Text(), nullable=False),
        sa.Column("seconds", sa.Float(53), nullable=False),
        sa.Column("rows", KEY, nullable=True),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "vessel",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("vessel_id", KEY, primary_key=True, autoincrement=False),
        sa.Column("time_s", sa.Float(53), nullable=False),
        sa.Column("latitude_deg", sa.Float(53), nullable=False),
        sa.Column("longitude_deg", sa.Float(53), nullable=False),
        sa.Column("sog_kn", sa.Float(53), nullable=True),
        sa.Column("cog_deg", sa.Float(53), nullable=True),
        sa.Column("major_m", sa.Float(53), nullable=True),
        sa.Column("minor_m", sa.Float(53), nullable=True),
        sa.Column("orientation_deg", sa.Float(53), nullable=True),
        sa.Column("since_s", sa.Float(53), nullable=False),
        sa.Column("updated_s", sa.Float(53), nullable=False),
        sa.Column("mmsi", KEY, nullable=True),
        sa.Column("flags", KEY, nullable=False),
        sa.Column("sources", sa.Text(), nullable=False),
        sa.Column("covariance", sa.LargeBinary(), nullable=True),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "vessel_static",
        sa.Column("run_id", KEY, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False),
        sa.Column("mmsi", KEY, primary_key=True, autoincrement=False),
        sa.Column("name", sa.String(20), nullable=True),
        sa.Column("call_sign", sa.String(7), nullable=True),
        sa.Column("ship_type", KEY, nullable=True),
        sa.Column("length_m", sa.Float(53), nullable=True),
        sa.Column("beam_m", sa.Float(53), nullable=True),
        sa.Column("updated_s", sa.Float(53), nullable=False),
        sqlite_with_rowid=False,
    )
