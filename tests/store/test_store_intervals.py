"""How often rows are written: when something changes, at an interval, and in the last cycle."""

from __future__ import annotations

from dataclasses import replace

import pytest
import store_world as world
from sqlalchemy import text

from coastwatch import store as kept
from coastwatch.scenario import StoreSettings
from coastwatch.store.schema.database import reading
from coastwatch.store.schema.migrate import check

pytestmark = pytest.mark.contract


def test_memberships_are_written_when_they_change(url: str) -> None:
    with kept.open_store(url) as store:
        run = world.begin(store)
        same = world.cycle_of(0, 30)
        for number in range(5):
            world.write(store, run, number, cycle=replace(same, time_s=world.instant_s(number)))
        with reading(store) as connection:
            rows = connection.execute(text("SELECT DISTINCT from_cycle, to_cycle FROM member_history")).all()
            assert [tuple(row) for row in rows] == [(0, None)]
            count = connection.execute(text("SELECT count(*) FROM member_history")).scalar_one()
        assert count == len(same.members) + 1  # and the bearing track


def test_how_often_the_large_tables_get_rows(url: str) -> None:
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number in range(7):
            world.write(store, run, number, keep=StoreSettings(spots_every=3, associations_every=2))
        with reading(store) as connection:
            cycles = {name: [row[0] for row in connection.execute(text(f"SELECT DISTINCT cycle FROM {name} ORDER BY 1"))]
                      for name in ("spot", "association", "bearing_association", "stage_timing")}  # fmt: skip
        assert cycles["spot"] == [0, 3, 6]
        assert cycles["association"] == cycles["bearing_association"] == [0, 2, 4, 6]
        assert cycles["stage_timing"] == list(range(7))
    assert check(url) == []


def test_a_large_picture_is_written_at_an_interval(url: str) -> None:
    """Cycles come every 3 s, the picture every 9 s and in the last cycle; what has happened since is in the history."""
    keep = StoreSettings(picture_large=10, picture_every_s=9.0)
    with kept.open_store(url) as store:
        run = world.begin(store)
        of_cycle = []
        for number in range(9):
            world.write(store, run, number, keep=keep, last=number == 8)
            of_cycle.append(round((kept.picture(store, run).column("time_s")[0] - world.START_S) / world.PERIOD_S) - 1)
            assert number % 3 != 1 or check(url) == []  # between two pictures
        first_of_interval = [n for n in range(9) if n == 0 or world.instant_s(n) // 9.0 > world.instant_s(n - 1) // 9.0]
        assert of_cycle == [max(f for f in first_of_interval if f <= n) for n in range(8)] + [8]
        assert len(first_of_interval) == 4
        with reading(store) as connection:
            written = connection.execute(text("SELECT number FROM cycle WHERE picture_kept ORDER BY number")).scalars().all()
        assert written == [*first_of_interval, 8]
        come = kept.track(store, run, 11)  # away in cycle 0
        assert come.vessel["in_picture"]
    assert check(url) == []


def test_after_a_restart_the_picture_is_not_of_a_cycle_to_come(url: str) -> None:
    keep = StoreSettings(picture_large=10, picture_every_s=1000.0)
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number in range(5):
            world.write(store, run, number, keep=keep, last=number == 4)
        store.run_states.clear()
        world.write(store, run, 2, keep=keep)
        assert kept.picture(store, run).column("time_s")[0] == world.instant_s(2)
    assert check(url) == []
