"""Every table of the database as SQLAlchemy Core tables, with the unit of each column. Mapped classes would import the whole ORM.

Column names carry units; positions are degrees, speeds knots, times seconds since 1970 UTC.

`history` is the largest table. Its key is (run, cycle, vessel): rows arrive in key order, so the tree grows at its right end and the
millionth cycle costs what the first one does. One index, (run, cycle, latitude, longitude), answers boxes in a span of time. An index
by vessel would be written in random places: `previous_cycle` links the points of a vessel instead.
"""

from __future__ import annotations

from typing import TypeVar

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    Column,
    ColumnElement,
    Float,
    ForeignKey,
    FromClause,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    PrimaryKeyConstraint,
    String,
    Table,
    Text,
    and_,
    false,
    text,
)
from sqlalchemy.schema import SchemaItem
from sqlalchemy.types import TypeEngine

T = TypeVar("T")
Kind = TypeEngine[T] | type[TypeEngine[T]]

REVISION = "0028"
"""The migration at which the database equals the tables below; a test compares it with db/migrations."""

REVISION_TABLE = "coastwatch_revision"
"""Not Alembic's default name, so that a PostgreSQL schema may be shared with another program that uses Alembic."""

REVISIONS = Table(
    REVISION_TABLE,
    MetaData(),
    Column("version_num", String(32), nullable=False),
    PrimaryKeyConstraint("version_num", name=f"{REVISION_TABLE}_pkc"),
)
"""The table in which Alembic keeps the migration, as it makes it."""

METADATA = MetaData()
"""All tables below."""

WHOLE = BigInteger().with_variant(Integer, "sqlite")
"""A whole number of eight bytes. SQLite needs the type name INTEGER for a column that is the row's own address."""

REAL, BYTES = Float(53), LargeBinary()
WORD, FLAG = String(16), String(32)


def of_run(name: str, *columns: SchemaItem, in_key_order: bool = True) -> Table:
    """A table whose rows belong to a run: column `run_id` is first in its primary key.

    Args: in_key_order: SQLite stores the rows in the tree of the key (WITHOUT ROWID): one tree is written, and neighbours in key are
    so on disk. It keeps long rows better apart from the tree.
    """
    run_id = Column("run_id", WHOLE, ForeignKey("run.id"), primary_key=True)
    return Table(name, METADATA, run_id, *columns, sqlite_with_rowid=not in_key_order)


def keys(*names: str) -> list[Column[int]]:
    """Further columns of the primary key."""
    return [Column(name, WHOLE, primary_key=True, autoincrement=False) for name in names]


def required(kind: Kind[T], *names: str, server_default: ColumnElement[bool] | None = None) -> list[Column[T]]:
    """Columns of one type that have a value in every row."""
    return [Column(name, kind, nullable=False, server_default=server_default) for name in names]


def nullable(kind: Kind[T], *names: str) -> list[Column[T]]:
    """Columns of one type that may be null."""
    return [Column(name, kind) for name in names]


def index_of_ended(name: str) -> Index:
    """An index of the stays that have ended, by their last cycle. `migrate` gives PostgreSQL the same condition."""
    return Index(name, "run_id", "to_cycle", sqlite_where=text("to_cycle IS NOT NULL"))


RUN = Table(
    "run",
    METADATA,
    Column("id", WHOLE, primary_key=True),
    *required(Text, "scenario", "title"),
    *required(WHOLE, "seed"),
    *required(String(32), "version"),
    *required(JSON, "settings"),
    *required(Text, "command"),
    *required(String(32), "started_utc"),
    *nullable(String(32), "finished_utc"),
    *nullable(String(32), "written_utc"),  # when the process that writes it last wrote: a cycle, or that it waits for one
    *nullable(Text, "machine"),  # where the process that writes it runs
    *nullable(WHOLE, "process"),  # its number there
    *required(WORD, "status"),  # running, finished, interrupted, failed, deleting
    *required(REAL, "period_s"),
    *required(WHOLE, "cycles"),  # planned, warm-up included
    *required(WHOLE, "warmup_cycles"),
    *required(REAL, "start_s"),
    *required(WHOLE, "workers"),
    *nullable(JSON(none_as_null=True), "scores"),
    *nullable(JSON(none_as_null=True), "verdict"),  # a sentence for each figure that fell; null: nothing was required
    *required(JSON, "faults"),
    sqlite_autoincrement=True,
)
"""One run of a scenario. Ids are never used twice."""

DELETING = "deleting"
"""Status of a run of which rows are being deleted. Nobody reads, writes or resumes it; the list of runs has it."""

SENSOR = of_run(
    "sensor",
    Column("kind", WORD, primary_key=True),  # radar, ais, bearing
    *keys("number"),  # within its kind
    *required(Text, "name"),
    *required(REAL, "latitude_deg", "longitude_deg", "range_m"),
    *nullable(Text, "region"),
    *required(JSON, "spec"),
    in_key_order=False,
)
"""A radar, AIS receiver or sonar by its specification."""

AIS_FEED = of_run("ais_feed", *keys("number"), *required(Text, "name"), in_key_order=False)
"""A feed of AIS: a file. Its reports carry its number."""

TRACK_SOURCE = of_run(
    "track_source",
    *keys("number"),
    *required(Text, "name"),
    *nullable(REAL, "latitude_deg", "longitude_deg"),  # of its radar; null: not known
    in_key_order=False,
)
"""A system that sends finished tracks."""

SOURCE = of_run("source", *keys("number"), *required(Text, "name"), *required(WORD, "kind"), in_key_order=False)
"""A source of tracks: a region of radars, AIS, or one sonar."""

CYCLE = of_run(
    "cycle",
    *keys("number"),
    *required(REAL, "time_s"),
    *required(WHOLE, "vessels", "tracks", "pairs", "bearing_pairs", "reports"),
    *required(Boolean, "picture_kept"),  # tables `vessel` and `bearing_track` were written in this cycle
    # Each vessel of this cycle has its newest point in one of the cycles from here to this one; null: no longer kept.
    *nullable(WHOLE, "history_from"),
    *required(WHOLE, "history_points"),  # rows of `history` of this cycle, closing ones included
    *required(Boolean, "associations_kept"),
    *required(Boolean, "recorded", server_default=false()),  # table `recording` has the whole picture
    *nullable(WORD, "skipped"),  # merged: computed with the next one; not_stored: the database was away; null: neither
    Index("cycle_time", "run_id", "time_s"),
    in_key_order=False,
)
"""One row a cycle, written in the same transaction as everything else of the cycle."""

STAGE_TIMING = of_run(
    "stage_timing",
    *keys("cycle", "number"),
    *required(Text, "stage"),
    *required(REAL, "seconds"),
    *nullable(WHOLE, "rows"),
)
"""How long a stage took in a cycle, in the order in which stages ran."""

VESSEL = Table(
    "vessel",
    METADATA,
    *keys("run_id", "vessel_id"),
    *required(REAL, "time_s", "latitude_deg", "longitude_deg"),
    *nullable(REAL, "sog_kn", "cog_deg"),
    *nullable(REAL, "major_m", "minor_m"),  # 1-sigma ellipse of position
    *nullable(REAL, "orientation_deg"),  # of the major axis, clockwise from north, 0..180
    *required(REAL, "since_s", "updated_s"),
    *nullable(WHOLE, "mmsi"),
    *required(WHOLE, "flags"),  # sum of batches.Flag
    *required(Text, "sources"),  # names, "guanabara,ais"
    *nullable(BYTES, "covariance"),  # ten little-endian float64: upper triangle of east, north, east rate, north rate
    *nullable(WHOLE, "nav_status"),  # batches.NavStatus; null: none was sent
    *nullable(REAL, "interval_s"),  # expected between its AIS reports, by class, status and speed, or learnt; null: no AIS now
    *nullable(REAL, "existence"),  # probability that it exists; null: no tracker estimates it
    *nullable(REAL, "echo_length_m", "echo_width_m", "echo_axis_deg"),  # size and direction by radar video; null: not known
    *nullable(REAL, "alternative_m"),  # how far away it may be instead, by another history of its plots; null: it is sure
    sqlite_with_rowid=False,
)
"""The current picture: each vessel once. All rows are written again each time, with the row of `cycle` that names the run:
a foreign key of their own would double the time that PostgreSQL takes.
"""

MEMBER = of_run("member", *keys("vessel_id", "source", "track_id"))
"""Which tracks are in which vessel now."""

MEMBER_HISTORY = of_run(
    "member_history",
    *keys("vessel_id", "source", "track_id", "from_cycle"),
    *nullable(WHOLE, "to_cycle"),
    Index("member_history_from", "run_id", "from_cycle"),
    index_of_ended("member_history_to"),
)
"""Which tracks were in which vessel, one row a stay. to_cycle is the last cycle of the stay, null while it lasts."""

PRESENCE = of_run(
    "presence",
    *keys("vessel_id", "from_cycle"),
    *nullable(WHOLE, "to_cycle"),
    *required(REAL, "since_s"),  # when the vessel was first seen, by its own account
    Index("presence_from", "run_id", "from_cycle"),
    index_of_ended("presence_to"),
)
"""When a vessel was in the picture. to_cycle is the last cycle of it, null while it is there."""

HISTORY = of_run(
    "history",
    *keys("cycle", "vessel_id"),
    *required(REAL, "latitude_deg", "longitude_deg"),
    *nullable(REAL, "sog_kn", "cog_deg", "major_m", "minor_m", "orientation_deg"),
    *required(REAL, "updated_s"),
    *nullable(WHOLE, "mmsi"),
    *required(WHOLE, "flags"),
    *nullable(WHOLE, "previous_cycle"),  # of the vessel's point before in this stay; null: the first
    *required(Boolean, "closing", server_default=false()),
    *nullable(WHOLE, "nav_status"),
    Index("history_box", "run_id", "cycle", "latitude_deg", "longitude_deg"),
)
"""Points from which the past is dead-reckoned: a vessel is where the velocity of its newest point takes it (history_rule.py).

The first point of a stay is in the stay's first cycle. The cycle after its last one has a closing point: the last position,
dead-reckoned from the point before. It belongs to no picture.
"""

DECIDED_PATH = of_run(
    "decided_path",
    *keys("cycle", "vessel_id", "number"),  # number: within the cycle
    *required(REAL, "time_s", "latitude_deg", "longitude_deg"),  # of the plot or message
    *nullable(REAL, "sog_kn", "cog_deg", "major_m", "minor_m", "orientation_deg"),
    *required(WHOLE, "track_id"),
    *nullable(WHOLE, "radar"),  # null: an AIS message
)
"""The corrected past of vessels: states of their radar tracks whose plots became final in a cycle, smoothed by the plots after them.

It stands beside `history`, which stays what the watch saw, and is kept as long. Only trackers that decide later have it.
"""

ASSOCIATION = of_run(
    "association",
    *keys("cycle", "vessel_id"),  # vessel -1: the tracks are not in the picture
    *keys("first_source", "first_track", "second_source", "second_track"),
    *nullable(REAL, "statistic"),
)
"""Two tracks that a cycle took for one vessel, with the statistic of the method that decided."""

BEARING_ASSOCIATION = of_run(
    "bearing_association",
    *keys("cycle", "vessel_id", "source", "bearing_track"),
    *nullable(REAL, "statistic"),
    *required(REAL, "bearing_deg"),
)
"""A bearing track that a cycle took for a vessel."""

BEARING_TRACK = of_run(
    "bearing_track",
    *keys("source", "track_id"),
    *required(REAL, "bearing_deg"),
    *nullable(REAL, "rate_deg_s"),
    *required(REAL, "latitude_deg", "longitude_deg"),  # of the sensor
    *nullable(WHOLE, "vessel_id"),
    *required(REAL, "updated_s"),
)
"""The bearing tracks of now."""

SPOT = of_run(
    "spot",
    *keys("cycle", "spot"),
    *required(REAL, "latitude_deg", "longitude_deg"),
    *required(WHOLE, "members", "halo"),
)
"""The groups into which a cycle cut its tracks."""

VESSEL_STATIC = of_run(
    "vessel_static",
    *keys("mmsi"),
    *nullable(String(20), "name"),
    *nullable(String(7), "call_sign"),
    *nullable(WHOLE, "ship_type"),
    *nullable(REAL, "length_m", "beam_m"),
    *required(REAL, "updated_s"),
)
"""The newest name, type and size that came with an MMSI."""

CHECKPOINT = of_run("checkpoint", *keys("piece"), *required(WHOLE, "cycle"), *required(BYTES, "memory"), in_key_order=False)
"""The memory of the chain after a cycle: the newest only, in pieces, since no database takes more than a gigabyte in one."""

SENSOR_REGISTRATION = of_run(
    "sensor_registration",
    *keys("cycle"),
    Column("kind", WORD, primary_key=True),  # radar, ais, bearing, feed, tracks
    *keys("number"),  # within its kind
    *nullable(REAL, "heard_s"),  # newest arrival; of AIS that of any receiver, reports do not say which it was
    *nullable(WORD, "state"),  # of radars: unknown, acquiring, probable, found, settled, doubtful
    *nullable(REAL, "azimuth_bias_deg", "azimuth_sigma_deg", "range_bias_m", "range_sigma_m"),
    *nullable(REAL, "time_lag_s", "estimated_lag_s", "lag_sigma_s"),  # sigma: of the estimated lag
    *nullable(WHOLE, "vessels"),  # behind the estimate; of track sources: differences of a track to an AIS partner
    *nullable(REAL, "residuals"),  # plots behind it, the older the less
    *nullable(REAL, "time_jitter_s"),  # of feeds: standard deviation of the times of their reports
    *nullable(WHOLE, "compared"),  # AIS vessels in cover; null where the radar sent no plot
    *nullable(REAL, "candidate_azimuth_deg", "candidate_range_m"),  # the bias with the most evidence
    *nullable(REAL, "odds", "found_odds"),  # of the candidate against chance; the same when the bias that is applied was found
    *nullable(WHOLE, "voices"),  # vessels under way, and squares with vessels at rest, that speak for the candidate
    *nullable(REAL, "rival_share"),  # of all evidence, that the best other bias has
    *nullable(WHOLE, "states", "dropped"),  # of track sources, since the start of the run: received, and not used
    *nullable(WHOLE, "tracks"),  # of track sources, alive now
    *nullable(REAL, "position_sigma_m", "velocity_sigma_m_s"),  # of track sources, per axis, of tracks without covariance
    *nullable(REAL, "range_scale", "range_scale_sigma"),  # by which share of themselves the ranges of a radar are too long
    *nullable(REAL, "site_east_m", "site_north_m", "site_sigma_m"),  # how far the stated site of a radar is off
    *nullable(REAL, "range_noise_factor", "azimuth_noise_factor"),  # of radars: learnt standard deviation over the stated one
    *nullable(REAL, "turn_s"),  # this and the following: of radars that send video; of the newest whole turn
    *nullable(WHOLE, "spokes_a_turn", "spokes_lost", "parts_lost"),  # lost: since the start of the feed
    *nullable(REAL, "lost_share"),  # of the spokes of the last minute, with those of which a part is missing
    *nullable(REAL, "plots_a_turn", "threshold_db"),  # plots: of the last minute; threshold: over the background
    *nullable(REAL, "detection_probability", "false_plots_a_turn"),  # learnt
)
"""What is known of a sensor after a cycle. Biases are of what it measures, to be subtracted; a lag is how late its stamps are."""

SENSOR_COVER = of_run(
    "sensor_cover",
    *keys("number"),  # of the radar
    *required(WHOLE, "cycle"),
    *nullable(REAL, "latitude_deg", "longitude_deg"),  # of the antenna; null before its first plot
    *required(REAL, "range_m", "turns"),
    *required(BYTES, "ais_detection", "ais_looks", "track_detection", "track_looks", "false_plots_per_km2"),
)
"""The newest learnt cover of each radar. A value has 72 sectors of 5 deg, clockwise from north, by 16 rings: little-endian float32."""

STANDING_ECHO = of_run(
    "standing_echo",
    *keys("number"),
    *required(WHOLE, "radar", "cycle"),
    *required(REAL, "latitude_deg", "longitude_deg", "extent_m", "plots_per_turn", "turns"),
)
"""The newest echoes that a clutter map hides from the tracker: quays, piles, moored boats. `number` is within the run."""

IDENTITY = of_run(
    "identity",
    *keys("mmsi", "vessel_id", "from_cycle"),
    *nullable(WHOLE, "to_cycle"),
    index_of_ended("identity_to"),
)
"""Which vessel had which MMSI, one row a stay. to_cycle is the last cycle of the stay, null while it lasts."""

EVENT = of_run(
    "event",
    *keys("vessel_id"),
    Column("kind", FLAG, primary_key=True),  # name of batches.Flag or batches.AlarmKind in lower case
    *keys("subject"),  # number of the zone or sensor, or id of the other vessel; 0: none
    *keys("from_cycle"),
    *nullable(WHOLE, "to_cycle"),
    *required(REAL, "start_s"),
    *nullable(REAL, "end_s"),
    *required(REAL, "latitude_deg", "longitude_deg"),  # at the start, as are the columns that follow
    *nullable(REAL, "sog_kn"),
    *nullable(WHOLE, "mmsi"),
    *required(Text, "evidence"),
    *required(Boolean, "unacknowledged", server_default=false()),  # an alarm that nobody has acknowledged
    Index("event_start", "run_id", "start_s"),
    Index("event_to", "run_id", "to_cycle"),
    Index("event_unacknowledged", "run_id", "start_s", sqlite_where=text("unacknowledged")),
)
"""When a vessel had a flag or an alarm. to_cycle and end_s are the last cycle with it, null while it lasts. One that returns within
`store.event_gap_s` goes on with the event before.
"""

EVENT_KEY = ("run_id", "vessel_id", "kind", "subject", "from_cycle")
"""What tells an event from the others, in each table that has rows of events."""


def same_event(one: FromClause, other: FromClause) -> ColumnElement[bool]:
    """That rows of two tables are of the same event."""
    return and_(*(one.c[name] == other.c[name] for name in EVENT_KEY))


EVENT_GAP = of_run(
    "event_gap",
    *keys("vessel_id"),
    Column("kind", FLAG, primary_key=True),
    *keys("subject", "from_cycle", "cycle"),  # of the event; in which the flag returned
    *required(WHOLE, "last_cycle"),  # with the flag before the gap
    *required(REAL, "last_s"),
    Index("event_gap_cycle", "run_id", "cycle"),
)
"""In which cycle a flag returned to an event that had ended."""

ACKNOWLEDGEMENT = of_run(
    "acknowledgement",
    *keys("vessel_id"),
    Column("kind", FLAG, primary_key=True),
    *keys("subject", "from_cycle"),  # of the event
    *required(REAL, "acknowledged_s"),
    *required(Text, "acknowledged_by"),  # the name that a person gave
    *required(Text, "note", "who"),  # who: the name of the token that was used
    Index("acknowledgement_time", "run_id", "acknowledged_s"),
)
"""Who acknowledged which event, the first time. An event that returned within `store.event_gap_s` stays acknowledged."""

AUDIT = Table(
    "audit",
    METADATA,
    Column("id", WHOLE, primary_key=True),
    *required(REAL, "time_s"),
    *required(Text, "who"),  # name of the token, or of the user of a trusted proxy; loopback: this machine, without a token
    *required(WORD, "role"),
    *required(Text, "client"),  # address of the other end
    *required(WORD, "method"),
    *required(Text, "path"),
    *required(WHOLE, "http_status"),  # of the answer
    *required(Text, "body"),  # its first 2,000 bytes
    sqlite_autoincrement=True,
)
"""Who changed what through the API of a server. It belongs to no run."""
ZONE = Table(
    "zone",
    METADATA,
    *keys("number", "version"),  # version: from 1, one a change
    *required(Text, "scenario"),  # whose runs watch the zone
    *nullable(JSON(none_as_null=True), "definition"),  # as in a scenario file; null: deleted
    *required(REAL, "changed_s"),
    *required(Text, "changed_by"),  # the name of the token that was used
    Index("zone_scenario", "scenario", "number", "version"),
    sqlite_with_rowid=False,
)
"""Zones that were drawn or sent, beside those of scenario files. A change is a new row, so the rows say who changed what and when."""

STAYS = (PRESENCE, MEMBER_HISTORY, IDENTITY)
"""Tables with a row a stay, from `from_cycle` to `to_cycle`, null while it lasts."""

OF_NO_RUN = (AUDIT, ZONE)
"""Tables whose rows stay when runs are deleted."""

RECORDING = of_run(  # not in key order: SQLite keeps long rows better apart from the tree of keys
    "recording",
    *keys("cycle"),
    *required(WHOLE, "vessels", "members"),
    *required(BYTES, "vessel_id", "time_s", "position_deg", "velocity_m_s", "covariance", "since_s", "updated_s"),
    *required(BYTES, "mmsi", "flags", "origin", "member_vessel_id", "member_track_id", "member_source"),
    *nullable(BYTES, "nav_status", "existence", "alternative_m"),  # null: of a version that did not have it
    *nullable(BYTES, "echo_length_m", "echo_width_m", "echo_axis_deg"),  # the same
    in_key_order=False,
)
"""The whole picture of a cycle with its members: one compressed value for each column (recording.py)."""

TRACK_JOURNAL = of_run(  # not in key order, as `recording`
    "track_journal",
    *keys("cycle"),
    *required(REAL, "time_s"),
    *required(BYTES, "message"),  # server/regions/message.py, compressed with zstd
    in_key_order=False,
)
"""The tracks of a regional centre after a cycle, for high-level centres that have fallen behind: the newest cycles only."""

REGION_INTAKE = of_run(
    "region_intake",
    *keys("cycle", "number"),
    *required(Text, "region"),  # name of its track source
    *required(String(64), "region_run"),  # number of the run in the region's database, and when it began
    *required(WHOLE, "first_seq", "last_seq"),  # cycles of the region that were used in this one, an unbroken range
    *required(WHOLE, "late"),  # of them: came after their cycle, left out
)
"""Which cycles of its regions a cycle of a high-level centre has used, written in its transaction."""
