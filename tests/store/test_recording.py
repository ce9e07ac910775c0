"""A recorded run is read back bit for bit: now, at an instant, in a box, after a crash and after its beginning was discarded."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import store_world as world
from as_bytes import same
from sqlalchemy import insert, text

from coastwatch import store as kept
from coastwatch.batches import Members, Picture
from coastwatch.errors import StoreError
from coastwatch.scenario import StoreSettings
from coastwatch.store import Store, recording
from coastwatch.store.schema.database import reading, writing
from coastwatch.store.schema.tables import CYCLE

pytestmark = pytest.mark.contract

CYCLES = 45


def drifting(number: int, vessels: int = 700) -> tuple[Picture, Members]:
    """A picture in which everything changes: vessels come and go, members too, and numbers are of every kind."""
    rng = np.random.default_rng([number, 61])
    k = np.flatnonzero(np.random.default_rng(62).random(vessels) + 0.02 * number < 1.4)
    k = np.sort(np.concatenate([k, vessels + np.flatnonzero(rng.random(10 * number) < 0.9)]))
    n = len(k)
    covariance = rng.normal(0.0, 1.0, (n, 4, 4)) * 10.0 ** rng.integers(-20, 20, (n, 1, 1))
    covariance[: n // 3] = np.nan
    covariance[n // 3 : n // 2] = np.eye(4) * (1.0 + 1e-13 * number)
    place = np.stack([-23.0 + (k % 97) * 0.03, 179.0 + (k % 89) * 0.03], 1) + 1e-6 * rng.normal(0.0, 1.0, (n, 2))
    place[:, 1] = np.where(place[:, 1] > 180.0, place[:, 1] - 360.0, place[:, 1])
    place[rng.random(n) < 0.01] = np.nan
    picture = Picture(
        k + 1, np.full(n, world.instant_s(number)), place, rng.normal(0.0, 5.0, (n, 2)), covariance, 1e9 + k / 7.0,
        rng.uniform(1e9, 2e9, n), np.where(k % 2, k + 200_000_000, -1), rng.integers(0, 64, n), k % 50 - 1,
    )  # fmt: skip
    row = np.repeat(np.arange(n), rng.integers(0, 4, n))
    track = rng.integers(0, 2**40, len(row)) if number % 5 == 0 else k[row] * 3
    return picture, Members(k[row] + 1, track, np.arange(len(row)) % 3)


def record(store: Store, run: int, made: Sequence[tuple[Picture, Members]], first: int = 0) -> None:
    """Record cycles from a number on."""
    for number, (picture, members) in enumerate(made, first):
        row = dict.fromkeys(("tracks", "pairs", "bearing_pairs", "reports", "history_points"), 0)
        flags = dict.fromkeys(("picture_kept", "associations_kept"), False)
        with writing(store) as connection:
            row |= {
                "run_id": run,
                "number": number,
                "time_s": world.instant_s(number),
                "vessels": len(picture),
                "recorded": True,
                **flags,
            }
            connection.execute(insert(CYCLE), [row])
            recording.record(connection, run, number, picture, members)


def test_every_cycle_comes_back_bit_for_bit(url: str) -> None:
    made = [drifting(number) for number in range(CYCLES)]
    made[7] = Picture.empty(), Members.empty()
    with kept.open_store(url) as store:
        run = world.begin(store)
        record(store, run, made)
        found = list(kept.replay(store, run))
        assert [r.cycle for r in found] == list(range(CYCLES))
        assert [r.time_s for r in found] == [world.instant_s(number) for number in range(CYCLES)]
        assert all(same(r.picture, p) and same(r.members, m) for r, (p, m) in zip(found, made, strict=True))
        (middle,) = kept.replay(store, run, world.instant_s(33), world.instant_s(33) + 1.0)
        assert middle.cycle == 33
        assert same(middle.picture, made[33][0])
        span = list(kept.replay(store, run, world.instant_s(8), world.instant_s(12)))
        assert [r.cycle for r in span] == [8, 9, 10, 11, 12]


@pytest.mark.parametrize("bbox", [(-22.5, 179.5, -21.5, 179.9), (-22.5, 179.5, -21.5, -179.0), (50.0, 0.0, 51.0, 1.0)])
def test_a_box_has_its_vessels_and_their_members(url: str, bbox: Any) -> None:
    south, west, north, east = bbox
    with kept.open_store(url) as store:
        run = world.begin(store)
        made = [drifting(number) for number in range(4)]
        record(store, run, made)
        for found, (picture, members) in zip(kept.replay(store, run, bbox=bbox), made, strict=True):
            latitude, longitude = picture.position_deg.T
            beside = (longitude >= west) & (longitude <= east) if west < east else (longitude >= west) | (longitude <= east)
            wanted = picture.take((latitude >= south) & (latitude <= north) & beside)
            assert same(found.picture, wanted)
            assert same(found.members, members.take(np.isin(members.vessel_id, wanted.vessel_id)))
            assert (len(wanted) > 0) == (south < 0.0)


def recorded(store: Store) -> list[tuple[Any, ...]]:
    with reading(store) as connection:
        return [tuple(row) for row in connection.execute(text("SELECT * FROM recording ORDER BY run_id, cycle"))]


def test_what_is_discarded_is_gone_and_the_rest_is_whole(url: str) -> None:
    made = [drifting(number) for number in range(CYCLES)]
    with kept.open_store(url) as store:
        run = world.begin(store)
        record(store, run, made)
        with writing(store) as connection:
            recording.delete_recording(connection, run, 27, None)
        found = list(kept.replay(store, run))
        assert [r.cycle for r in found] == list(range(27, CYCLES))
        assert same(found[-1].picture, made[-1][0])
        assert list(kept.replay(store, run, to_s=world.instant_s(3))) == []
        with writing(store) as connection:
            recording.delete_recording(connection, run, 1000, None)
        assert list(kept.replay(store, run)) == []
        assert recorded(store) == []


def test_members_of_no_vessel_are_refused(url: str) -> None:
    picture, members = drifting(0)
    wrong = Members(*(np.append(a, 10**6) for a in vars(members).values()))
    with kept.open_store(url) as store:
        run = world.begin(store)
        with pytest.raises(ValueError, match="members: got 1 of no vessel"):
            record(store, run, [(picture, wrong)])
        assert recorded(store) == []


def test_a_run_is_recorded_where_its_settings_say_so(url: str) -> None:
    """Also one that goes on from a checkpoint."""
    with kept.open_store(url) as store:
        run, without = world.begin(store), world.begin(store)
        made = [world.write(store, run, number, keep=StoreSettings(recording=True)) for number in range(24)]
        world.write(store, without, 0)
        for number in (22, 23):
            world.write(store, run, number, keep=StoreSettings(recording=True))
        found = list(kept.replay(store, run))
        assert len(found) == 24
        assert all(same(r.picture, c.picture) and same(r.members, c.members) for r, c in zip(found, made, strict=True))
        assert list(kept.replay(store, without)) == []
        with pytest.raises(StoreError, match="there is no run 9"):
            next(kept.replay(store, 9))
