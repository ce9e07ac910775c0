"""The sensors and sources of a run: specification, state, registration, learnt cover and standing echoes."""

from __future__ import annotations

import numpy as np
from sqlalchemy import ColumnElement, and_, func, literal, null, select

from coastwatch.batches import COVER_AZIMUTHS, COVER_RANGES, RadarCover
from coastwatch.store.rows import Rows, fetch_rows
from coastwatch.store.runs import cycle_at
from coastwatch.store.schema.database import Store, reading
from coastwatch.store.schema.tables import (
    AIS_FEED,
    CYCLE,
    SENSOR,
    SENSOR_COVER,
    SENSOR_REGISTRATION,
    SOURCE,
    STANDING_ECHO,
    TRACK_SOURCE,
)


def sensors(store: Store, run_id: int) -> Rows:
    """The sensors of a run; `spec` is a dict."""
    s = SENSOR.c
    columns = [c for c in s if c is not s.run_id]
    with reading(store) as connection:
        return fetch_rows(connection, select(*columns).where(s.run_id == run_id).order_by(s.kind, s.number))


def sources(store: Store, run_id: int) -> Rows:
    """The sources of tracks in a run: number, name, kind (radar, ais, bearing)."""
    s = SOURCE.c
    with reading(store) as connection:
        return fetch_rows(connection, select(s.number, s.name, s.kind).where(s.run_id == run_id).order_by(s.number))


def sensor_states(store: Store, run_id: int, at_s: float | None = None) -> Rows:
    """One row a sensor: specification, when it was heard last, and its registration; now, or up to an instant. The feeds of AIS
    follow, each with the jitter of its times, and the track sources with what they sent.

    Raises: StoreError where there is no such run, or nothing is stored so early.
    """
    s, t = SENSOR.c, SENSOR_REGISTRATION.c
    with reading(store) as connection:
        last = cycle_at(connection, store, run_id, at_s)
        newest = select(t.kind, t.number, func.max(t.cycle).label("cycle")).where(t.run_id == run_id, t.cycle <= last)
        newest_cycle = newest.group_by(t.kind, t.number).subquery()
        row = and_(
            t.run_id == run_id,
            t.cycle == newest_cycle.c.cycle,
            t.kind == newest_cycle.c.kind,
            t.number == newest_cycle.c.number,
        )
        when = and_(CYCLE.c.run_id == run_id, CYCLE.c.number == newest_cycle.c.cycle)
        f, state_columns = AIS_FEED.c, [c for c in t if not c.primary_key] + [CYCLE.c.time_s]
        of_sensor = {c.name: c for c in s if c is not s.run_id}
        nothing, source = {name: null().label(name) for name in of_sensor}, TRACK_SOURCE.c
        of_feed = nothing | {"kind": literal("feed").label("kind"), "number": f.number, "name": f.name}
        of_source = nothing | {"kind": literal("tracks").label("kind"), "number": source.number, "name": source.name}
        of_source |= {"latitude_deg": source.latitude_deg, "longitude_deg": source.longitude_deg}
        answers = []
        for table, columns in ((SENSOR, of_sensor), (AIS_FEED, of_feed), (TRACK_SOURCE, of_source)):
            same = and_(newest_cycle.c.kind == columns["kind"], newest_cycle.c.number == columns["number"])
            joined = table.outerjoin(newest_cycle, same).outerjoin(SENSOR_REGISTRATION, row).outerjoin(CYCLE, when)
            query = select(*columns.values(), *state_columns).select_from(joined).where(table.c.run_id == run_id)
            answers.append(fetch_rows(connection, query.order_by(columns["kind"], columns["number"])))
        return Rows(answers[0].columns, [row for answer in answers for row in answer.rows])


def radar_covers(store: Store, run_id: int) -> tuple[list[str], RadarCover]:
    """Names of the radars with a learnt cover, and the newest cover of each."""
    c, same = SENSOR_COVER.c, _is_radar(run_id, SENSOR_COVER.c.number)
    query = select(SENSOR.c.name, SENSOR_COVER).select_from(SENSOR_COVER.join(SENSOR, same)).where(c.run_id == run_id)
    with reading(store) as connection:
        rows = connection.execute(query.order_by(c.number)).mappings().all()
    names = ("ais_detection", "ais_looks", "track_detection", "track_looks", "false_plots_per_km2")
    read = [[np.frombuffer(row[name], "<f4") for row in rows] for name in names]
    seen, looks, tracks, track_looks, per_km2 = (
        np.array(each, np.float64).reshape(-1, COVER_AZIMUTHS, COVER_RANGES) for each in read
    )
    range_m, turns = (np.array([row[name] for row in rows], np.float64) for name in ("range_m", "turns"))
    sites = [(row["latitude_deg"], row["longitude_deg"]) for row in rows]
    site_deg = np.array(sites, np.float64).reshape(-1, 2)
    return [row["name"] for row in rows], RadarCover(range_m, site_deg, turns, seen, looks, tracks, track_looks, 1e-6 * per_km2)


def standing_echoes(store: Store, run_id: int) -> Rows:
    """The newest echoes that the clutter maps of radars hide, by radar and place; `name` is of the radar."""
    e, same = STANDING_ECHO.c, _is_radar(run_id, STANDING_ECHO.c.radar)
    query = select(SENSOR.c.name, e.latitude_deg, e.longitude_deg, e.extent_m, e.plots_per_turn, e.turns)
    query = query.select_from(STANDING_ECHO.join(SENSOR, same)).where(e.run_id == run_id)
    with reading(store) as connection:
        return fetch_rows(connection, query.order_by(e.radar, e.latitude_deg, e.longitude_deg))


def _is_radar(run_id: int, number: ColumnElement[int]) -> ColumnElement[bool]:
    """That a sensor is the radar of this number."""
    return and_(SENSOR.c.run_id == run_id, SENSOR.c.kind == "radar", SENSOR.c.number == number)
