"""Where the picture is kept. README.md says what is in it; `tables` is every table."""

from coastwatch.store.chunks_table import discard_chunks_before
from coastwatch.store.lifetime import begin_run, discard_runs, finish_run, resume_point
from coastwatch.store.opening import Store, StoreError, open_store
from coastwatch.store.questions import Parameter, Question, operator_queries, operator_query
from coastwatch.store.read import (
    INSTANTS,
    bearing_tracks,
    history,
    picture,
    sensors,
    sources,
    track,
)
from coastwatch.store.registrations import sensor_states
from coastwatch.store.replay import Recorded, recorded_at, replay
from coastwatch.store.rows import Rows, Table
from coastwatch.store.runs import latest_run, run, runs, timings
from coastwatch.store.traffic import encounters, traffic
from coastwatch.store.write import Written, write_cycle

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
    "discard_chunks_before",
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
