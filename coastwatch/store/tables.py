"""Every table of the database: SQLAlchemy models with the unit of each column.

Column names carry units; positions are degrees, speeds knots, times seconds since 1970 UTC.

`history` is the largest table. Its key is (run, cycle, vessel): rows arrive in key order, so the tree grows at its right end and the
millionth cycle costs what the first one does. One index, (run, cycle, latitude, longitude), answers boxes in a span of time. An index
by vessel would be written in random places: `previous_cycle` links the points of a vessel instead.
"""

from __future__ import annotations

from typing import Any

from sqlalchemy import JSON, BigInteger, Boolean, Float, ForeignKey, Index, Integer, LargeBinary, String, Text, false, text
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

REVISION = "0007"
"""The migration at which the database equals the models below; a test compares it with db/migrations."""

REVISION_TABLE = "coastwatch_revision"
"""Not Alembic's default name, so that a PostgreSQL schema may be shared with another program that uses Alembic."""

Key = BigInteger().with_variant(Integer, "sqlite")
"""An id of eight bytes. SQLite needs the type name INTEGER for a column that is the row's own address."""

IN_KEY_ORDER = {"sqlite_with_rowid": False}
"""WITHOUT ROWID: rows are stored in the B-tree of the primary key. One tree is written, and neighbours in key are so on disk."""


class Base(DeclarativeBase):
    """What every table shares: how Python types become columns."""

    type_annotation_map = {int: Key, float: Float(53), str: Text, bytes: LargeBinary, bool: Boolean, dict[str, Any]: JSON}  # noqa: RUF012


def of_run() -> Mapped[int]:
    """The column that names the run a row belongs to, first in the primary key."""
    return mapped_column(ForeignKey("run.id"), primary_key=True)


def key() -> Mapped[int]:
    """A further column of the primary key."""
    return mapped_column(primary_key=True, autoincrement=False)


ENDED = text("to_cycle IS NOT NULL")


class Run(Base):
    """One run of a scenario. Ids are never used twice."""

    __tablename__ = "run"
    __table_args__ = {"sqlite_autoincrement": True}  # noqa: RUF012
    id: Mapped[int] = mapped_column(primary_key=True)
    scenario: Mapped[str]
    title: Mapped[str]
    seed: Mapped[int]
    version: Mapped[str] = mapped_column(String(32))
    settings: Mapped[dict[str, Any]]
    command: Mapped[str]
    started_utc: Mapped[str] = mapped_column(String(32))
    finished_utc: Mapped[str | None] = mapped_column(String(32))
    status: Mapped[str] = mapped_column(String(16))  # running, finished, interrupted, failed
    period_s: Mapped[float]
    cycles: Mapped[int]  # planned, warm-up included
    warmup_cycles: Mapped[int]
    start_s: Mapped[float]
    workers: Mapped[int]
    scores: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))
    faults: Mapped[list[Any]] = mapped_column(JSON)


class Sensor(Base):
    """A radar, AIS receiver or sonar by its specification."""

    __tablename__ = "sensor"
    run_id: Mapped[int] = of_run()
    kind: Mapped[str] = mapped_column(String(16), primary_key=True)  # radar, ais, bearing
    number: Mapped[int] = key()  # within its kind
    name: Mapped[str]
    latitude_deg: Mapped[float]
    longitude_deg: Mapped[float]
    range_m: Mapped[float]
    region: Mapped[str | None]
    spec: Mapped[dict[str, Any]]


class Source(Base):
    """A source of tracks: a region of radars, AIS, or one sonar."""

    __tablename__ = "source"
    run_id: Mapped[int] = of_run()
    number: Mapped[int] = key()
    name: Mapped[str]
    kind: Mapped[str] = mapped_column(String(16))


class Cycle(Base):
    """One row a cycle, written in the same transaction as everything else of the cycle."""

    __tablename__ = "cycle"
    __table_args__ = (Index("cycle_time", "run_id", "time_s"),)
    run_id: Mapped[int] = of_run()
    number: Mapped[int] = key()
    time_s: Mapped[float]
    vessels: Mapped[int]
    tracks: Mapped[int]
    pairs: Mapped[int]
    bearing_pairs: Mapped[int]
    reports: Mapped[int]
    picture_kept: Mapped[bool]  # tables `vessel` and `bearing_track` were written in this cycle
    # Each vessel of this cycle has its newest point in one of the cycles from here to this one; null: no longer kept.
    history_from: Mapped[int | None]
    history_points: Mapped[int]  # rows of `history` of this cycle, closing ones included
    associations_kept: Mapped[bool]
    recorded: Mapped[bool] = mapped_column(server_default=false())  # table `recording` has the whole picture


class StageTiming(Base):
    """How long a stage took in a cycle, in the order in which stages ran."""

    __tablename__ = "stage_timing"
    __table_args__ = IN_KEY_ORDER
    run_id: Mapped[int] = of_run()
    cycle: Mapped[int] = key()
    number: Mapped[int] = key()
    stage: Mapped[str]
    seconds: Mapped[float]
    rows: Mapped[int | None]


class Vessel(Base):
    """The current picture: each vessel once. All rows are written again each time, with the row of `cycle` that names the run:
    a foreign key of their own would double the time that PostgreSQL takes.
    """

    __tablename__ = "vessel"
    __table_args__ = IN_KEY_ORDER
    run_id: Mapped[int] = key()
    vessel_id: Mapped[int] = key()
    time_s: Mapped[float]
    latitude_deg: Mapped[float]
    longitude_deg: Mapped[float]
    sog_kn: Mapped[float | None]
    cog_deg: Mapped[float | None]
    major_m: Mapped[float | None]  # 1-sigma ellipse of position
    minor_m: Mapped[float | None]
    orientation_deg: Mapped[float | None]  # of the major axis, clockwise from north, 0..180
    since_s: Mapped[float]
    updated_s: Mapped[float]
    mmsi: Mapped[int | None]
    flags: Mapped[int]  # sum of batches.Flag
    sources: Mapped[str]  # names, "guanabara,ais"
    covariance: Mapped[bytes | None]  # ten little-endian float64: upper triangle of east, north, east rate, north rate


class Member(Base):
    """Which tracks are in which vessel now."""

    __tablename__ = "member"
    __table_args__ = IN_KEY_ORDER
    run_id: Mapped[int] = of_run()
    vessel_id: Mapped[int] = key()
    source: Mapped[int] = key()
    track_id: Mapped[int] = key()


class MemberHistory(Base):
    """Which tracks were in which vessel, one row a stay. to_cycle is the last cycle of the stay, null while it lasts."""

    __tablename__ = "member_history"
    __table_args__ = (
        Index("member_history_from", "run_id", "from_cycle"),
        Index("member_history_to", "run_id", "to_cycle", sqlite_where=ENDED, postgresql_where=ENDED),
        IN_KEY_ORDER,
    )
    run_id: Mapped[int] = of_run()
    vessel_id: Mapped[int] = key()
    source: Mapped[int] = key()
    track_id: Mapped[int] = key()
    from_cycle: Mapped[int] = key()
    to_cycle: Mapped[int | None]


class Presence(Base):
    """When a vessel was in the picture. to_cycle is the last cycle of it, null while it is there."""

    __tablename__ = "presence"
    __table_args__ = (
        Index("presence_from", "run_id", "from_cycle"),
        Index("presence_to", "run_id", "to_cycle", sqlite_where=ENDED, postgresql_where=ENDED),
        IN_KEY_ORDER,
    )
    run_id: Mapped[int] = of_run()
    vessel_id: Mapped[int] = key()
    from_cycle: Mapped[int] = key()
    to_cycle: Mapped[int | None]
    since_s: Mapped[float]  # when the vessel was first seen, by its own account


class History(Base):
    """Points from which the past is dead-reckoned: a vessel is where the velocity of its newest point takes it (history_rule.py).

    The first point of a stay is in the stay's first cycle. The cycle after its last one has a closing point: the last position,
    dead-reckoned from the point before. It belongs to no picture.
    """

    __tablename__ = "history"
    __table_args__ = (
        Index("history_box", "run_id", "cycle", "latitude_deg", "longitude_deg"),
        IN_KEY_ORDER,
    )
    run_id: Mapped[int] = of_run()
    cycle: Mapped[int] = key()
    vessel_id: Mapped[int] = key()
    latitude_deg: Mapped[float]
    longitude_deg: Mapped[float]
    sog_kn: Mapped[float | None]
    cog_deg: Mapped[float | None]
    major_m: Mapped[float | None]
    minor_m: Mapped[float | None]
    orientation_deg: Mapped[float | None]
    updated_s: Mapped[float]
    mmsi: Mapped[int | None]
    flags: Mapped[int]
    previous_cycle: Mapped[int | None]  # of the vessel's point before in this stay; null: the first
    closing: Mapped[bool] = mapped_column(server_default=false())


class Association(Base):
    """Two tracks that a cycle took for one vessel, with the statistic of the method that decided."""

    __tablename__ = "association"
    __table_args__ = IN_KEY_ORDER
    run_id: Mapped[int] = of_run()
    cycle: Mapped[int] = key()
    vessel_id: Mapped[int] = key()  # -1: the tracks are not in the picture
    first_source: Mapped[int] = key()
    first_track: Mapped[int] = key()
    second_source: Mapped[int] = key()
    second_track: Mapped[int] = key()
    statistic: Mapped[float | None]


class BearingAssociation(Base):
    """A bearing track that a cycle took for a vessel."""

    __tablename__ = "bearing_association"
    __table_args__ = IN_KEY_ORDER
    run_id: Mapped[int] = of_run()
    cycle: Mapped[int] = key()
    vessel_id: Mapped[int] = key()
    source: Mapped[int] = key()
    bearing_track: Mapped[int] = key()
    statistic: Mapped[float | None]
    bearing_deg: Mapped[float]


class BearingTrack(Base):
    """The bearing tracks of now."""

    __tablename__ = "bearing_track"
    __table_args__ = IN_KEY_ORDER
    run_id: Mapped[int] = of_run()
    source: Mapped[int] = key()
    track_id: Mapped[int] = key()
    bearing_deg: Mapped[float]
    rate_deg_s: Mapped[float | None]
    latitude_deg: Mapped[float]  # of the sensor
    longitude_deg: Mapped[float]
    vessel_id: Mapped[int | None]
    updated_s: Mapped[float]


class Spot(Base):
    """The groups into which a cycle cut its tracks."""

    __tablename__ = "spot"
    __table_args__ = IN_KEY_ORDER
    run_id: Mapped[int] = of_run()
    cycle: Mapped[int] = key()
    spot: Mapped[int] = key()
    latitude_deg: Mapped[float]
    longitude_deg: Mapped[float]
    members: Mapped[int]
    halo: Mapped[int]


class VesselStatic(Base):
    """The newest name, type and size that came with an MMSI."""

    __tablename__ = "vessel_static"
    __table_args__ = IN_KEY_ORDER
    run_id: Mapped[int] = of_run()
    mmsi: Mapped[int] = key()
    name: Mapped[str | None] = mapped_column(String(20))
    call_sign: Mapped[str | None] = mapped_column(String(7))
    ship_type: Mapped[int | None]
    length_m: Mapped[float | None]
    beam_m: Mapped[float | None]
    updated_s: Mapped[float]


class Checkpoint(Base):
    """The memory of the chain after a cycle: the newest only, in pieces, since no database takes more than a gigabyte in one."""

    __tablename__ = "checkpoint"
    run_id: Mapped[int] = of_run()
    piece: Mapped[int] = key()
    cycle: Mapped[int]
    memory: Mapped[bytes]


class SensorRegistration(Base):
    """What is known of a sensor after a cycle. Biases are of what it measures, to be subtracted; a lag is how late its stamps are."""

    __tablename__ = "sensor_registration"
    __table_args__ = IN_KEY_ORDER
    run_id: Mapped[int] = of_run()
    cycle: Mapped[int] = key()
    kind: Mapped[str] = mapped_column(String(16), primary_key=True)  # radar, ais, bearing
    number: Mapped[int] = key()  # within its kind
    heard_s: Mapped[float | None]  # newest arrival; of AIS that of any receiver, reports do not say which it was
    state: Mapped[str | None] = mapped_column(String(16))  # of radars: unknown, acquiring, settled
    azimuth_bias_deg: Mapped[float | None]
    azimuth_sigma_deg: Mapped[float | None]
    range_bias_m: Mapped[float | None]
    range_sigma_m: Mapped[float | None]
    time_lag_s: Mapped[float | None]
    estimated_lag_s: Mapped[float | None]
    lag_sigma_s: Mapped[float | None]  # of the estimate
    vessels: Mapped[int | None]  # behind the estimate
    residuals: Mapped[float | None]  # plots behind it, the older the less


class Identity(Base):
    """Which vessel had which MMSI, one row a stay. to_cycle is the last cycle of the stay, null while it lasts."""

    __tablename__ = "identity"
    __table_args__ = (
        Index("identity_to", "run_id", "to_cycle", sqlite_where=ENDED, postgresql_where=ENDED),
        IN_KEY_ORDER,
    )
    run_id: Mapped[int] = of_run()
    mmsi: Mapped[int] = key()
    vessel_id: Mapped[int] = key()
    from_cycle: Mapped[int] = key()
    to_cycle: Mapped[int | None]


class Recording(Base):
    """The whole picture of a cycle with its members: one compressed value for each column (recording.py)."""

    __tablename__ = "recording"  # not in key order: SQLite keeps long rows better apart from the tree of keys
    run_id: Mapped[int] = of_run()
    cycle: Mapped[int] = key()
    vessels: Mapped[int]
    members: Mapped[int]
    vessel_id: Mapped[bytes]
    time_s: Mapped[bytes]
    position_deg: Mapped[bytes]
    velocity_m_s: Mapped[bytes]
    covariance: Mapped[bytes]
    since_s: Mapped[bytes]
    updated_s: Mapped[bytes]
    mmsi: Mapped[bytes]
    flags: Mapped[bytes]
    origin: Mapped[bytes]
    member_vessel_id: Mapped[bytes]
    member_track_id: Mapped[bytes]
    member_source: Mapped[bytes]
