"""Table `sensor_registration`: when each sensor was heard last, and what is known of its registration errors."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from sqlalchemy import Connection, String, and_, func, select
from sqlalchemy.orm import Mapped, mapped_column

from coastwatch.batches import Floats, RegistrationState, Reports
from coastwatch.store.bulk import append
from coastwatch.store.cells import Column, Named, Texts
from coastwatch.store.opening import Store, reading
from coastwatch.store.rows import Rows
from coastwatch.store.runs import cycle_at
from coastwatch.store.tables import IN_KEY_ORDER, Base, Cycle, Sensor, key, of_run

if TYPE_CHECKING:
    from coastwatch import pipeline


KINDS = ("ais", "bearing", "radar")  # in the order of the key


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


class Heard(NamedTuple):
    """What is kept in hand of each sensor between cycles."""

    at_s: dict[tuple[str, int], float]  # newest arrival
    states: tuple[int, ...]  # of the radars as last written


def known(connection: Connection, run_id: int) -> Heard:
    """What the database holds."""
    t = SensorRegistration
    newest = select(t.kind, t.number, func.max(t.heard_s)).where(t.run_id == run_id).group_by(t.kind, t.number)
    last = select(func.max(t.cycle)).where(t.run_id == run_id).scalar_subquery()
    radars = select(t.state).where(t.run_id == run_id, t.cycle == last, t.kind == "radar").order_by(t.number)
    states = tuple(int(RegistrationState[str(row.state).upper()]) for row in connection.execute(radars))
    return Heard({(row[0], row[1]): row[2] for row in connection.execute(newest) if row[2] is not None}, states)


def merge(
    connection: Connection, run_id: int, number: int, before: Heard, cycle: pipeline.Cycle, reports: Reports, every: int
) -> Heard:
    """Writes the sensors' rows in every so many cycles, and where the state of a radar has changed or its corrections jumped.

    Returns: what is kept in hand for the next cycle.
    """
    at_s = dict(before.at_s)
    for kind, part in (("radar", reports.radar), ("bearing", reports.bearing)):
        newest_s = np.full(int(part.sensor.max(initial=-1)) + 1, -np.inf)
        np.maximum.at(newest_s, part.sensor, part.received_s)
        for sensor in np.flatnonzero(newest_s > -np.inf).tolist():
            at_s[kind, sensor] = max(float(newest_s[sensor]), at_s.get((kind, sensor), -np.inf))
    if len(reports.ais):
        newest = float(reports.ais.received_s.max())
        at_s["ais", 0] = max(newest, at_s.get(("ais", 0), newest))
    states = tuple(cycle.corrections.state.tolist())
    if number % every and states == before.states and not cycle.corrections.jumped.any():
        return Heard(at_s, before.states)
    stations = connection.scalar(select(func.count()).where(Sensor.run_id == run_id, Sensor.kind == "ais")) or 0
    append(connection, Base.metadata.tables["sensor_registration"], _columns(run_id, number, cycle, at_s, stations))
    return Heard(at_s, states)


def _columns(
    run_id: int, number: int, cycle: pipeline.Cycle, at_s: dict[tuple[str, int], float], stations: int
) -> list[Column]:
    """In key order: AIS receivers, sensors of bearings, radars."""
    c, bias = cycle.corrections, np.degrees(cycle.bearing_associations.sensor_bias_rad)
    kinds = np.repeat([0, 1, 2], [stations, len(bias), len(c)])
    numbers = np.concatenate([np.arange(n) for n in (stations, len(bias), len(c))])
    heard = [at_s.get(("ais", 0) if kind == 0 else (KINDS[kind], k), np.nan) for kind, k in zip(kinds, numbers, strict=True)]
    others = stations + len(bias)

    def of_radars(values: Floats) -> Floats:
        known = np.where(np.isfinite(values), values, np.nan)
        return np.concatenate([np.full(others, np.nan), known])

    azimuth = np.concatenate([np.full(stations, np.nan), bias, np.degrees(c.azimuth_bias_rad)])
    radars = (np.degrees(c.azimuth_sigma_rad), c.range_bias_m, c.range_sigma_m, c.time_lag_s, c.estimated_lag_s, c.lag_sigma_s)
    none = np.full(others, -1)
    return [
        run_id,
        number,
        Texts(kinds, KINDS),
        numbers,
        np.array(heard),
        Texts(np.concatenate([none, c.state]), [state.name.lower() for state in RegistrationState]),
        azimuth,
        *map(of_radars, radars),
        Named(np.concatenate([none, c.references])),
        of_radars(c.residuals),
    ]


def sensor_states(store: Store, run_id: int, at_s: float | None = None) -> Rows:
    """One row a sensor: specification, when it was heard last, and its registration; now, or up to an instant.

    Raises: StoreError where there is no such run, or nothing is stored so early.
    """
    t = SensorRegistration
    sensor = [c for c in Sensor.__table__.columns if c.name != "run_id"]
    with reading(store) as connection:
        last = cycle_at(connection, store, run_id, at_s)
        newest = select(t.kind, t.number, func.max(t.cycle).label("cycle")).where(t.run_id == run_id, t.cycle <= last)
        found = newest.group_by(t.kind, t.number).subquery()
        same = and_(found.c.kind == Sensor.kind, found.c.number == Sensor.number)
        row = and_(t.run_id == run_id, t.cycle == found.c.cycle, t.kind == found.c.kind, t.number == found.c.number)
        when = and_(Cycle.run_id == run_id, Cycle.number == found.c.cycle)
        said = [c for c in t.__table__.columns if c.name not in ("run_id", "cycle", "kind", "number")]
        query = select(*sensor, *said, Cycle.time_s).where(Sensor.run_id == run_id)
        query = query.outerjoin(found, same).outerjoin(t, row).outerjoin(Cycle, when).order_by(Sensor.kind, Sensor.number)
        result = connection.execute(query)
        return Rows(tuple(result.keys()), [tuple(r) for r in result])
