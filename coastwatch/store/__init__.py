"""Where the picture is kept. README.md shows the way; `schema/tables.py` has every table."""

from coastwatch.store.acknowledgements import (
    Acknowledgement as Acknowledgement,
    AlarmKey as AlarmKey,
    Beginnings as Beginnings,
    Seen as Seen,
    acknowledge as acknowledge,
    acknowledge_all as acknowledge_all,
    acknowledged_since as acknowledged_since,
)
from coastwatch.store.audit import Change as Change, changes as changes, note_change as note_change
from coastwatch.store.deletion import delete_run as delete_run, discard_runs as discard_runs, keep_runs as keep_runs
from coastwatch.store.journal import (
    ForCentres as ForCentres,
    Intake as Intake,
    journal_after as journal_after,
    journal_start as journal_start,
    region_positions as region_positions,
    run_key as run_key,
)
from coastwatch.store.read.alarms import (
    Asked as Asked,
    Cursor as Cursor,
    State as State,
    alarms as alarms,
    alarms_before as alarms_before,
    changed_alarms as changed_alarms,
    left_unacknowledged as left_unacknowledged,
)
from coastwatch.store.read.history_queries import encounters as encounters, history as history, traffic as traffic
from coastwatch.store.read.picture_queries import (
    bearing_tracks as bearing_tracks,
    decided_path as decided_path,
    newest_statics as newest_statics,
    picture as picture,
    picture_cycle as picture_cycle,
    track as track,
)
from coastwatch.store.read.questions import operator_queries as operator_queries, operator_query as operator_query
from coastwatch.store.read.sensors import (
    radar_covers as radar_covers,
    sensor_states as sensor_states,
    sensors as sensors,
    sources as sources,
    standing_echoes as standing_echoes,
)
from coastwatch.store.read.server_runs import first_instant as first_instant, run_at as run_at, runs_between as runs_between
from coastwatch.store.recording import Recorded as Recorded, replay as replay
from coastwatch.store.rows import INSTANTS as INSTANTS, Rows as Rows, Table as Table
from coastwatch.store.runs import (
    Unfinished as Unfinished,
    begin_run as begin_run,
    finish_run as finish_run,
    has_run as has_run,
    last_good_run as last_good_run,
    last_instant as last_instant,
    latest_run as latest_run,
    newest_picture as newest_picture,
    read_checkpoint as read_checkpoint,
    refuse_second_writer as refuse_second_writer,
    resume_run as resume_run,
    run as run,
    run_status as run_status,
    runs as runs,
    set_verdict as set_verdict,
    sole_server as sole_server,
    unfinished_runs as unfinished_runs,
)
from coastwatch.store.schema.database import (
    NoSuchRunError as NoSuchRunError,
    NotThere as NotThere,
    QueryLimit as QueryLimit,
    Store as Store,
)
from coastwatch.store.schema.opening import backup as backup, open_store as open_store, restore as restore
from coastwatch.store.write.retention import prune as prune
from coastwatch.store.write.to_rows import VIDEO_VALUES as VIDEO_VALUES
from coastwatch.store.write.write_cycle import (
    CycleRecord as CycleRecord,
    SkippedCycle as SkippedCycle,
    Written as Written,
    cycle_counts as cycle_counts,
    note_running as note_running,
    write_checkpoint as write_checkpoint,
    write_cycle as write_cycle,
)
from coastwatch.store.zones import (
    StoredZone as StoredZone,
    add_zone as add_zone,
    change_zone as change_zone,
    zone_changes as zone_changes,
    zone_version as zone_version,
    zones as zones,
)
