"""Where the picture is kept. README.md shows the way; `tables.py` has every table."""

from coastwatch.store.database import Store, StoreError, open_store
from coastwatch.store.history_queries import encounters, history, traffic
from coastwatch.store.picture_queries import bearing_tracks, picture, track
from coastwatch.store.questions import Parameter, Question, operator_queries, operator_query
from coastwatch.store.recording import Recorded, discard_recording_before, recorded_at, replay
from coastwatch.store.rows import INSTANTS, Rows, Table
from coastwatch.store.runs import (
    begin_run,
    discard_runs,
    finish_run,
    latest_run,
    resume_point,
    run,
    runs,
    sensor_states,
    sensors,
    sources,
    timings,
)
from coastwatch.store.write_cycle import Written, write_cycle

__all__ = [
    "INSTANTS",
    "Parameter",
    "Question",
    "Recorded",
    "Rows",
    "Store",
    "StoreError",
    "Table",
    "Written",
    "bearing_tracks",
    "begin_run",
    "discard_recording_before",
    "discard_runs",
    "encounters",
    "finish_run",
    "history",
    "latest_run",
    "open_store",
    "operator_queries",
    "operator_query",
    "picture",
    "recorded_at",
    "replay",
    "resume_point",
    "run",
    "runs",
    "sensor_states",
    "sensors",
    "sources",
    "timings",
    "track",
    "traffic",
    "write_cycle",
]
