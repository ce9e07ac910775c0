"""The corrected past of vessels is found again, beside a history that stays as it was, and goes with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import store_world as world
from sqlalchemy import text

from coastwatch import store as kept
from coastwatch.batches import DecidedPath
from coastwatch.errors import StoreError
from coastwatch.operators import presentation
from coastwatch.operators.cli import main
from coastwatch.scenario import StoreSettings
from coastwatch.store.schema.database import reading

pytestmark = pytest.mark.contract

CYCLES = 12
SHIPS = (4, 6)  # vessels whose tracks are of source 0


def decided_of(number):
    """Two states of each ship, 9 and 10 s before the cycle: one by the second radar, one by a message. And one of no vessel."""
    track = np.array([*(1000 + np.repeat(SHIPS, 2)), 999_999])
    ends_s, place = world.instant_s(number), np.array([-22.9, -43.1]) + 1e-3 * number
    count = len(track)
    time_s = ends_s - np.array([9.0, 10.0, 9.0, 10.0, 9.0])
    covariance = np.tile(np.diag([16.0, 4.0, 0.1, 0.1]), (count, 1, 1))
    velocity = np.tile([0.0, 5.0], (count, 1))
    return DecidedPath(track, time_s, np.tile(place, (count, 1)), velocity, covariance, np.array([1, -1, 1, -1, 1]))


def write(store, run, number, **more):
    cycle = replace(world.cycle_of(number, 30), decided=decided_of(number))
    world.write(store, run, number, cycle=cycle, **more)


def test_the_decided_path_stands_beside_the_history(url: str) -> None:
    with kept.open_store(url) as store:
        run, plain = world.begin(store), world.begin(store)
        for number in range(CYCLES):
            write(store, run, number)
            world.write(store, plain, number)
        rows = kept.decided_path(store, run, 4)
        there = [k for k in range(CYCLES) if 4 in world.picture_of(k, 30).vessel_id]
        left = [k for k in there if k < CYCLES - 1 and k + 1 not in there]  # a track that ends leaves states one cycle later
        assert left
        assert len(rows.rows) == 2 * len(there) + 2 * len(left)
        assert rows.column("time_s") == sorted(rows.column("time_s"))
        assert set(rows.column("radar")) == {"island", None}
        assert set(rows.column("track_id")) == {1004}
        assert rows.column("latitude_deg")[0] == pytest.approx(-22.9 + 1e-3 * there[0])
        assert rows.column("major_m")[0] == pytest.approx(4.0)
        assert kept.track(store, run, 4).history == kept.track(store, plain, 4).history
        assert kept.decided_path(store, plain, 4).rows == []
        assert len(kept.decided_path(store, run, 4, newest=3).rows) == 3
        with pytest.raises(StoreError, match="never had a vessel 123456"):
            kept.decided_path(store, run, 123456)
        write(store, run, 3)  # from an older checkpoint
        assert len(kept.decided_path(store, run, 4).rows) == 2 * len([k for k in there if k <= 3]) + 2 * len(
            [k for k in left if k < 3]
        )


def test_old_states_go_with_the_history(url: str) -> None:
    keep = StoreSettings(history_hours=5 * world.PERIOD_S / 3600.0)
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number in range(CYCLES):
            write(store, run, number, keep=keep)
        with reading(store) as connection:
            first = connection.execute(text("SELECT min(cycle) FROM decided_path")).scalar_one()
        assert first == CYCLES - 5


def test_it_is_shown_in_place_of_the_history_where_asked(tmp_path, capsys) -> None:
    url = f"sqlite:///{tmp_path}/sea.db"
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number in range(3):
            write(store, run, number)
        of_vessel = presentation.vessel(store, presentation.run(store, run), 4)
        assert len(of_vessel.tables["decided"].rows) == 6
    for form, needed in (("csv", "decided_cycle"), ("gpx", "<trkpt"), ("json", '"radar": "island"'), ("table", "track_id")):
        assert main(["track", "4", "--decided", "--db", url, "--format", form]) == 0
        assert needed in capsys.readouterr().out
