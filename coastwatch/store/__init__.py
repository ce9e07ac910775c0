"""Where the picture is kept. README.md says what is in it; `tables` is every table."""

from coastwatch.store.lifetime import begin_run, discard_runs, finish_run, resume_point
from coastwatch.store.opening import Store, StoreError, open_store
from coastwatch.store.questions import Parameter, Question, operator_queries, operator_query
from coastwatch.store.read import (
    INSTANTS,
    bearing_tracks,
    history,
    latest_run,
    picture,
    run,
    runs,
    sensors,
    sources,
    timings,
    track,
)
from coastwatch.store.registrations import sensor_states
from coastwatch.store.rows import Rows
from coastwatch.store.write import Written, write_cycle

__all__ = [
    "INSTANTS",
    "Parameter",
    "Question",
    "Rows",
    "Store",
    "StoreError",
    "Written",
    "bearing_tracks",
    "begin_run",
    "discard_runs",
    "finish_run",
    "history",
    "latest_run",
    "open_store",
    "operator_queries",
    "operator_query",
    "picture",
    "resume_point",
    "run",
    "runs",
    "sensor_states",
    "sensors",
    "sources",
    "timings",
    "track",
    "write_cycle",
]
