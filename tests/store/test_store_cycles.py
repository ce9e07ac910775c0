"""What a cycle yields is found again as it was: now, at an instant, through time, and whole while the next is written."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import store_world as world
from hypothesis import given, strategies as st
from sqlalchemy import text

from coastwatch import store as kept
from coastwatch.batches import AisStatics, Reports
from coastwatch.errors import StoreError
from coastwatch.store import Rows
from coastwatch.store.rows import source_texts, to_python
from coastwatch.store.schema.database import reading
from coastwatch.store.schema.migrate import check
from coastwatch.store.schema.tables import METADATA
from coastwatch.store.write.to_rows import changed_rows

pytestmark = pytest.mark.contract


def test_the_picture_is_found_as_it_was(url: str) -> None:
    with kept.open_store(url) as store:
        run = world.begin(store)
        picture = world.write(store, run, 0).picture
        found = kept.picture(store, run)
        assert found.column("vessel_id") == picture.vessel_id.tolist()
        assert found.column("latitude_deg") == picture.position_deg[:, 0].tolist()
        assert found.column("longitude_deg") == picture.position_deg[:, 1].tolist()
        assert found.column("sog_kn") == pytest.approx((picture.vessel_id - 1) % 20)
        assert found.column("cog_deg")[0] is None
        assert found.column("cog_deg")[1] == 0.0
        assert found.column("mmsi")[:2] == [None, 710_000_001]
        assert found.column("sources")[:3] == ["ilha,mouth", "guanabara,ais", "ilha"]
        assert found.column("name")[:2] == [None, None]
        assert set(found.column("time_s")) == {world.instant_s(0)}
        # north is the surer axis of the world's covariance: the longer half axis, 3 m, points north
        assert found.rows[0][found.columns.index("major_m")] == 3.0
        assert found.rows[0][found.columns.index("orientation_deg")] == 0.0
        with reading(store) as connection:
            blobs = connection.execute(text("SELECT covariance FROM vessel ORDER BY vessel_id")).scalars().all()
        upper = np.frombuffer(b"".join(map(bytes, blobs)), "<f8").reshape(-1, 10)
        assert np.array_equal(upper, picture.covariance[(slice(None), *np.triu_indices(4))])


def test_the_order_of_rows_in_the_picture_does_not_matter(url: str) -> None:
    cycle = world.cycle_of(0, 30)
    back = np.arange(len(cycle.picture))[::-1]
    turned = replace(
        cycle,
        picture=cycle.picture.take(back),
        bearing_associations=replace(cycle.bearing_associations, vessel_row=np.array([len(back) - 1])),
    )
    with kept.open_store(url) as store:
        for made in (cycle, turned):
            world.write(store, world.begin(store), 0, cycle=made)
        with reading(store) as connection:
            for name in ("vessel", "history", "member", "association", "bearing_association", "bearing_track", "presence"):
                table = METADATA.tables[name]
                one, two = (
                    sorted(tuple(row)[1:] for row in connection.execute(table.select().where(table.c.run_id == k)))
                    for k in (1, 2)
                )
                assert one == two, name


def test_a_picture_of_the_past(url: str) -> None:
    with kept.open_store(url) as store:
        run = world.begin(store)
        made = [world.write(store, run, number).picture for number in range(12)]
        now = kept.picture(store, run)
        for number in (0, 5, 11):
            then = kept.picture(store, run, world.instant_s(number) + 0.5)
            assert then.columns == now.columns
            assert then.column("vessel_id") == made[number].vessel_id.tolist()
            assert then.column("latitude_deg") == made[number].position_deg[:, 0].tolist()
        assert kept.picture(store, run, world.instant_s(11)) == now
        with pytest.raises(StoreError, match="nothing up to"):
            kept.picture(store, run, world.START_S)
        with pytest.raises(StoreError, match="there is no run 99"):
            kept.picture(store, 99)


def test_a_box_may_cross_the_antimeridian(url: str) -> None:
    picture = world.picture_of(0, 3)
    place = np.array([[10.0, 179.9], [10.0, -179.9], [10.0, 170.0]])
    with kept.open_store(url) as store:
        run = world.begin(store)
        world.write(store, run, 0, cycle=world.cycle_of(0, 3, replace(picture, position_deg=place)))
        for at in (None, world.instant_s(0)):
            assert kept.picture(store, run, at, (9.0, 179.0, 11.0, -179.0)).column("vessel_id") == [1, 2]
            assert kept.picture(store, run, at, (9.0, 169.0, 11.0, 179.95)).column("vessel_id") == [1, 3]
            assert kept.picture(store, run, at, (11.0, -180.0, 12.0, 180.0)).rows == []


def test_one_vessel_through_time(url: str) -> None:
    """Vessel 8 is away in cycle 3 of 12, has an MMSI, and comes back with its number."""
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number in range(12):
            world.write(store, run, number)
        found = kept.track(store, run, 8)
        there = [number for number in range(12) if number != 3]
        assert found.history.column("cycle") == there
        assert found.history.column("time_s") == [world.instant_s(number) for number in there]
        assert found.stays.rows == [(0, 2, world.START_S), (4, None, world.START_S)]
        members = [row[:5] for row in found.members.rows]
        assert members == [
            ("guanabara", "radar", 1008, 0, 2),
            ("ais", "ais", 5_000_000_008, 0, 2),
            ("guanabara", "radar", 1008, 4, None),
            ("ais", "ais", 5_000_000_008, 4, None),
        ]
        assert found.associations.column("cycle") == there
        assert set(found.associations.column("second_track")) == {5_000_000_008}
        assert found.vessel["in_picture"]
        assert found.vessel["mmsi"] == 710_000_007
        assert kept.track(store, run, 1).bearing_associations.column("bearing_deg")[0] == pytest.approx(270.0)
        gone = kept.track(store, run, 11 * 2)  # away in cycle 0 and 11
        assert not gone.vessel["in_picture"]
        assert gone.vessel["sources"] == "guanabara,ais"
        assert gone.history.column("cycle") == list(range(1, 11))
        with pytest.raises(StoreError, match="never had a vessel 99"):
            kept.track(store, run, 99)


def test_cycles_without_vessels(url: str) -> None:
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number, vessels in enumerate((0, 5, 0, 0, 1)):
            world.write(store, run, number, vessels)
        assert kept.picture(store, run).column("vessel_id") == [1]
        assert kept.picture(store, run, world.instant_s(3)).rows == []
        assert kept.track(store, run, 3).stays.rows == [(1, 1, world.START_S)]
    assert check(url) == []


def test_what_a_message_leaves_out_is_remembered(url: str) -> None:
    def heard(name: str, call_sign: str, ship_type: int, length_m: float) -> Reports:
        one = np.array([1.0])
        said = AisStatics(
            one,
            np.array([710_000_001]),
            np.array([name]),
            np.array([call_sign]),
            np.array([ship_type]),
            one * length_m,
            one * np.nan,
        )
        return replace(world.reports_of(0, 1), statics=said)

    with kept.open_store(url) as store:
        run = world.begin(store)
        world.write(store, run, 0, reports=heard("ALPHA\x00", "", -1, np.nan))
        world.write(store, run, 1, reports=heard("", "PX1", 70, 120.0))
        store.run_states.clear()  # as after a restart
        world.write(store, run, 2, reports=heard("BETA@@", "", -1, np.nan))
        found = kept.picture(store, run)
        row = dict(zip(found.columns, found.rows[1], strict=True))
        said = {name: row[name] for name in ("name", "call_sign", "ship_type", "length_m", "beam_m")}
        assert said == {"name": "BETA", "call_sign": "PX1", "ship_type": 70, "length_m": 120.0, "beam_m": None}


def test_a_reader_sees_whole_cycles_while_they_are_written(url: str) -> None:
    """Every look finds as many vessels as the cycle says, all of one instant, and the members that belong to them."""
    with kept.open_store(url) as store:
        run = world.begin(store)
        world.write(store, run, 0, 400)
        looks: list[tuple[Any, ...]] = []
        stop = threading.Event()

        def look() -> None:
            with kept.open_store(url, create=False) as reader:
                while not stop.is_set():
                    with reading(reader) as connection:
                        looks.append(tuple(connection.execute(text(LOOK)).one()))

        thread = threading.Thread(target=look)
        thread.start()
        for number in range(1, 25):
            world.write(store, run, number, 400)
        stop.set()
        thread.join()
    assert len({look[0] for look in looks}) > 3
    for number, vessels, counted, first, last, members, history in looks:
        assert vessels == counted == history
        assert first == last == world.instant_s(number)
        assert members == len(world.cycle_of(number, 400).members) + 1


LOOK = """
SELECT number, vessels, (SELECT count(*) FROM vessel), (SELECT min(time_s) FROM vessel), (SELECT max(time_s) FROM vessel),
    (SELECT count(*) FROM member), (SELECT count(*) FROM history h WHERE h.cycle = c.number AND NOT closing)
FROM cycle c ORDER BY number DESC LIMIT 1
"""


def test_text_of_sources_is_in_the_order_of_their_numbers() -> None:
    members = np.array([[1, 0, 5], [1, 0, 6], [1, 2, 7], [3, 1, 8], [3, 2, 9], [3, 3, 9], [4, 0, 1], [4, 2, 4], [5, 2, 1]])
    found = source_texts(np.arange(1, 6), members, ("a", "b", "c", "d"))
    assert to_python(found, 5) == ["a,c", "", "b,c,d", "a,c", "c"]
    assert to_python(source_texts(np.zeros(0, np.int64), members[:0], ("a",)), 0) == []


@given(st.integers(0, 10**6), st.integers(0, 40), st.integers(0, 40))
def test_changed_rows_are_the_differences_of_two_sets(seed: int, before: int, now: int) -> None:
    rng = np.random.default_rng(seed)
    one, two = (np.unique(rng.integers(0, 5, (count, 3)), axis=0) for count in (before, now))
    two = np.unique(np.concatenate([two, one[rng.random(len(one)) < 0.7]]), axis=0)
    gone, come = ({tuple(row) for row in rows.tolist()} for rows in changed_rows(one, two))
    sets = [{tuple(row) for row in rows.tolist()} for rows in (one, two)]
    assert (gone, come) == (sets[0] - sets[1], sets[1] - sets[0])


def test_rows_have_columns() -> None:
    rows = Rows(("a", "b"), [(1, 2), (3, 4)])
    assert rows.column("b") == [2, 4]
