"""The history of an MMSI is every point with it, however vessels come, go, change it, or the run begins again from an older cycle."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import past_world
import pytest
import store_world as world
from sqlalchemy import select

from coastwatch import store as kept
from coastwatch.batches import Picture
from coastwatch.store.schema.database import reading
from coastwatch.store.schema.tables import IDENTITY

pytestmark = pytest.mark.contract

CYCLES = 30
MMSI = np.array([710_000_001, 710_000_002, 710_000_003, 710_000_004, -1])


def renamed(seed: int, made: list[Picture]) -> list[Picture]:
    """Vessels whose MMSI changes now and then, among a few, so that several have one at a time."""
    rng = np.random.default_rng([seed, 95])
    of = rng.choice(MMSI, 100)
    out = []
    for picture in made:
        changes = rng.random(len(of)) < 0.05
        of = np.where(changes, rng.choice(MMSI, len(of)), of)
        out.append(replace(picture, mmsi=of[picture.vessel_id]))
    return out


def wanted(store: kept.Store, run: int, mmsi: int, minutes: float) -> list[tuple[Any, ...]]:
    last_s = world.instant_s(CYCLES - 1)
    points = kept.history(store, run, last_s - minutes * 60.0, last_s)
    rows = [dict(zip(points.columns, row, strict=True)) for row in points.rows]
    return [(row["time_s"], row["vessel_id"], row["latitude_deg"], row["mmsi"]) for row in rows if row["mmsi"] == mmsi]


def found(store: kept.Store, run: int, mmsi: int, minutes: float) -> list[tuple[Any, ...]]:
    answer = kept.operator_query(store, "history_of_mmsi", {"mmsi": mmsi, "minutes": minutes, "run": run})
    rows = [dict(zip(answer.columns, row, strict=True)) for row in answer.rows]
    return [(row["time_s"], row["vessel_id"], row["latitude_deg"], row["mmsi"]) for row in rows]


def test_the_history_of_an_mmsi_is_every_point_with_it(url: str) -> None:
    made = renamed(1, past_world.pictures(5, CYCLES))
    with kept.open_store(url) as store:
        run = world.begin(store)
        past_world.write(store, run, made)
        for mmsi in MMSI[:-1].tolist():
            for minutes in (0.0, 0.5, 60.0):
                assert found(store, run, mmsi, minutes) == wanted(store, run, mmsi, minutes)
            assert len(found(store, run, mmsi, 60.0)) > 20
        assert found(store, run, 999_999_999, 60.0) == []


def test_stays_are_those_of_a_run_that_never_went_back(url: str) -> None:
    made, others = renamed(1, past_world.pictures(5, CYCLES)), renamed(2, past_world.pictures(6, CYCLES))
    with kept.open_store(url) as store:
        run, straight = world.begin(store), world.begin(store)
        past_world.write(store, run, [*made[:20], *others[20:30]])
        past_world.write(store, run, made[20:], first=20)
        past_world.write(store, straight, made)
        columns = (IDENTITY.c.mmsi, IDENTITY.c.vessel_id, IDENTITY.c.from_cycle, IDENTITY.c.to_cycle)
        with reading(store) as connection:
            stays = [
                connection.execute(select(*columns).where(IDENTITY.c.run_id == of).order_by(*columns[:3])).all()
                for of in (run, straight)
            ]
        assert stays[0] == stays[1]
        assert {row.to_cycle is None for row in stays[0]} == {True, False}
        for mmsi in MMSI[:-1].tolist():
            assert found(store, run, mmsi, 1.0) == wanted(store, run, mmsi, 1.0)


def test_a_box_now_is_what_the_picture_has_there(url: str) -> None:
    made = past_world.pictures(5, 3)
    with kept.open_store(url) as store:
        run = world.begin(store)
        past_world.write(store, run, made)
        shown = 0
        for bbox in (*past_world.BOXES, (-90.0, -180.0, 90.0, 180.0)):
            picture, here = kept.picture(store, run), kept.picture(store, run, bbox=bbox)
            south, west, north, east = bbox
            latitude, longitude = picture.array("latitude_deg"), picture.array("longitude_deg")
            across = (longitude >= west) & (longitude <= east) if west <= east else (longitude >= west) | (longitude <= east)
            rows = np.flatnonzero((latitude >= south) & (latitude <= north) & across)
            assert here.rows == [picture.rows[row] for row in rows.tolist()]
            shown += len(here)
        assert shown > len(picture)
