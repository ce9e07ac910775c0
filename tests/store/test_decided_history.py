"""The corrected past of vessels is found again, beside a history that stays as it was, and goes with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import store_world as world
from sqlalchemy import text

from coastwatch import store as kept
from coastwatch.batches import DecidedPath, Members
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


def test_a_state_goes_to_the_vessel_that_had_its_track_at_the_time_of_the_state(url: str) -> None:
    """Track 1004 is of vessel 4 up to cycle 3, then of vessel 6, and leaves the picture after cycle 6. One of 1006 is older than it."""
    decided_at = {4: [(1004, 1), (1004, 4)], 5: [(1004, 3), (1006, 0)], 11: [(1004, 5), (1004, 6), (1004, 9)]}  # (track, cycle)
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number in range(CYCLES):
            track, of = np.array(decided_at.get(number, [(999_999, 0)])).T
            place, still = np.column_stack([-22.9 + 1e-3 * of, of * 0.0 - 43.1]), np.zeros((len(of), 2))
            ends_s = world.instant_s(of) - 0.5
            decided = DecidedPath(track, ends_s, place, still, np.tile(np.eye(4), (len(of), 1, 1)), np.ones(len(of), np.int64))
            cycle = world.cycle_of(number, 30)
            m = cycle.members
            vessel = np.where((m.track_id == 1004) & (number > 3), 6, m.vessel_id)
            rows = np.flatnonzero((m.track_id != 1004) | (number <= 6))
            rows = rows[(m.track_id[rows] != 1006) | (number >= 2)]
            rows = rows[np.lexsort((m.track_id[rows], m.source[rows], vessel[rows]))]
            members = Members(vessel[rows], m.track_id[rows], m.source[rows])
            world.write(store, run, number, cycle=replace(cycle, members=members, decided=decided))
        found = {
            vessel: [
                (track, round((s - world.START_S + 0.5) / world.PERIOD_S) - 1)
                for track, s in zip(rows.column("track_id"), rows.column("time_s"), strict=True)
            ]
            for vessel in SHIPS
            for rows in [kept.decided_path(store, run, vessel)]
        }
    assert found == {4: [(1004, 1), (1004, 3)], 6: [(1006, 0), (1004, 4), (1004, 5), (1004, 6), (1004, 9)]}


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
