"""Events of zones and pairs: their subject is in the key, 0 for all that are stored already. Zones that were drawn or sent."""

import sqlalchemy as sa
from alembic import op

revision = "0022"
down_revision = "0021"

WHOLE = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
REAL, FLAG = sa.Float(53), sa.String(32)


def key(*names: str) -> list[sa.Column]:
    return [sa.Column(name, WHOLE, primary_key=True, autoincrement=False) for name in names]


def first() -> list[sa.Column]:
    run = sa.Column("run_id", WHOLE, sa.ForeignKey("run.id"), primary_key=True, autoincrement=False)
    return [run, *key("vessel_id"), sa.Column("kind", FLAG, primary_key=True), *key("subject")]


def required(*names: str, kind: sa.types.TypeEngine = REAL) -> list[sa.Column]:
    return [sa.Column(name, kind, nullable=False) for name in names]


def again(name: str, *columns: sa.Column) -> None:
    """The table with its new key and its old rows."""
    before = f"{name}_before"
    op.rename_table(name, before)
    if op.get_bind().dialect.name == "postgresql":  # the key keeps its name, which the new table needs
        op.execute(sa.text(f"ALTER INDEX {name}_pkey RENAME TO {before}_pkey"))
    op.create_table(name, *first(), *columns, sqlite_with_rowid=False)
    names = ", ".join(["run_id", "vessel_id", "kind", *(column.name for column in columns)])
    op.execute(sa.text(f"INSERT INTO {name} (subject, {names}) SELECT 0, {names} FROM {before}"))
    op.drop_table(before)


def upgrade() -> None:
    for name, table in (("event_start", "event"), ("event_to", "event"), ("event_gap_cycle", "event_gap")):
        op.drop_index(name, table)
    ends = sa.Column("to_cycle", WHOLE), *required("start_s"), sa.Column("end_s", REAL)
    then = *required("latitude_deg", "longitude_deg"), sa.Column("sog_kn", REAL), sa.Column("mmsi", WHOLE)
    again("event", *key("from_cycle"), *ends, *then, *required("evidence", kind=sa.Text()))
    again("event_gap", *key("from_cycle", "cycle"), *required("last_cycle", kind=WHOLE), *required("last_s"))
    said = required("acknowledged_by", "note", "who", kind=sa.Text())
    again("acknowledgement", *key("from_cycle"), *required("acknowledged_s"), *said)
    op.create_index("event_start", "event", ["run_id", "start_s"])
    op.create_index("event_to", "event", ["run_id", "to_cycle"])
    op.create_index("event_gap_cycle", "event_gap", ["run_id", "cycle"])
    op.create_table(
        "zone",
        *key("number", "version"),
        *required("scenario", kind=sa.Text()),
        sa.Column("definition", sa.JSON(none_as_null=True), nullable=True),
        *required("changed_s"),
        *required("changed_by", kind=sa.Text()),
        sqlite_with_rowid=False,
    )
    op.create_index("zone_scenario", "zone", ["scenario", "number", "version"])
