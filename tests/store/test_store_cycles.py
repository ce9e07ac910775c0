"""What a cycle yields is found again as it was: now, at an instant, and through time."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import store_world as world
from sqlalchemy import text

from coastwatch import store as kept
from coastwatch.batches import AisStatics, Picture, RadarReports, Reports
from coastwatch.scenario import StoreSettings
from coastwatch.store import Rows, Store, StoreError, columns
from coastwatch.store.cells import plain
from coastwatch.store.migrate import check
from coastwatch.store.opening import reading
from coastwatch.store.tables import Base


def everything(store: Store) -> dict[str, list[tuple[Any, ...]]]:
    """All rows of all tables but the run itself, sorted."""
    tables = {name: table for name, table in Base.metadata.tables.items() if name != "run"}
    with reading(store) as connection:
        return {name: sorted(map(repr, map(tuple, connection.execute(table.select())))) for name, table in tables.items()}


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
                table = Base.metadata.tables[name]
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
        assert found["history"].column("cycle") == there
        assert found["history"].column("time_s") == [world.instant_s(number) for number in there]
        assert found["stays"].rows == [(0, 2, world.START_S), (4, None, world.START_S)]
        members = [row[:5] for row in found["members"].rows]
        assert members == [
            ("guanabara", "radar", 1008, 0, 2),
            ("ais", "ais", 5_000_000_008, 0, 2),
            ("guanabara", "radar", 1008, 4, None),
            ("ais", "ais", 5_000_000_008, 4, None),
        ]
        assert found["associations"].column("cycle") == there
        assert set(found["associations"].column("second_track")) == {5_000_000_008}
        assert found["vessel"]["in_picture"]
        assert found["vessel"]["mmsi"] == 710_000_007
        assert kept.track(store, run, 1)["bearing_associations"].column("bearing_deg")[0] == pytest.approx(270.0)
        gone = kept.track(store, run, 11 * 2)  # away in cycle 0 and 11
        assert not gone["vessel"]["in_picture"]
        assert gone["vessel"]["sources"] == "guanabara,ais"
        assert gone["history"].column("cycle") == list(range(1, 11))
        with pytest.raises(StoreError, match="never had a vessel 99"):
            kept.track(store, run, 99)


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
            assert check(url) == []
        first_of_interval = [n for n in range(9) if n == 0 or world.instant_s(n) // 9.0 > world.instant_s(n - 1) // 9.0]
        assert of_cycle == [max(f for f in first_of_interval if f <= n) for n in range(8)] + [8]
        assert len(first_of_interval) == 4
        with reading(store) as connection:
            written = connection.execute(text("SELECT number FROM cycle WHERE picture_kept ORDER BY number")).scalars().all()
        assert written == [*first_of_interval, 8]
        come = kept.track(store, run, 11)  # away in cycle 0
        assert come["vessel"]["in_picture"]


def test_after_a_restart_the_picture_is_not_of_a_cycle_to_come(url: str) -> None:
    keep = StoreSettings(picture_large=10, picture_every_s=1000.0)
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number in range(5):
            world.write(store, run, number, keep=keep, last=number == 4)
        store.newest.clear()
        world.write(store, run, 2, keep=keep)
        assert kept.picture(store, run).column("time_s")[0] == world.instant_s(2)
    assert check(url) == []


def test_cycles_without_vessels(url: str) -> None:
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number, vessels in enumerate((0, 5, 0, 0, 1)):
            world.write(store, run, number, vessels)
        assert kept.picture(store, run).column("vessel_id") == [1]
        assert kept.picture(store, run, world.instant_s(3)).rows == []
        assert kept.track(store, run, 3)["stays"].rows == [(1, 1, world.START_S)]
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
        store.newest.clear()  # as after a restart
        world.write(store, run, 2, reports=heard("BETA@@", "", -1, np.nan))
        found = kept.picture(store, run)
        row = dict(zip(found.columns, found.rows[1], strict=True))
        said = {name: row[name] for name in ("name", "call_sign", "ship_type", "length_m", "beam_m")}
        assert said == {"name": "BETA", "call_sign": "PX1", "ship_type": 70, "length_m": 120.0, "beam_m": None}


def test_runs(url: str) -> None:
    with kept.open_store(url) as store:
        with pytest.raises(StoreError, match="holds no run"):
            kept.latest_run(store)
        one = world.begin(store, "sea", settings={"a": [1, float("nan")], "b": np.float64(2.0)}, command="coastwatch run sea")
        two = world.begin(store, "lake", 7)
        assert (kept.latest_run(store), kept.latest_run(store, "sea")) == (two, one)
        world.write(store, one, 0)
        kept.finish_run(store, one, "finished", {"f1": 0.5, "mcc": float("nan")})
        stored = kept.run(store, one)
        assert (stored["status"], stored["scores"], stored["settings"]) == (
            "finished", {"f1": 0.5, "mcc": None}, {"a": [1, None], "b": 2.0}
        )  # fmt: skip
        assert stored["started_utc"] <= stored["finished_utc"] < "2200"
        assert stored["finished_utc"].endswith("Z")
        listed = kept.runs(store)
        assert listed.column("id") == [two, one]
        assert listed.column("cycles_stored") == [0, 1]
        with pytest.raises(ValueError, match="status: got 'done'"):
            kept.finish_run(store, one, "done")
        with pytest.raises(StoreError, match="no run of pond"):
            kept.latest_run(store, "pond")
        found = kept.sensors(store, one)
        assert [row[:3] for row in found.rows] == [
            ("ais", 0, "hill"), ("bearing", 0, "mouth"), ("radar", 0, "fort"), ("radar", 1, "island")
        ]  # fmt: skip
        assert found.rows[1][-1]["arc_from_deg"] == 90.0
        assert found.column("region") == [None, None, "guanabara", "ilha"]
        assert kept.sources(store, one).column("kind") == ["radar", "radar", "ais", "bearing"]


def test_timings(url: str) -> None:
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number in range(4):
            world.write(store, run, number)
        found = kept.timings(store, run)
        assert found.column("stage") == list(world.SECONDS)
        assert found.column("median_ms") == pytest.approx([1e3 * s for s in world.SECONDS.values()])
        assert sum(found.column("share")) == pytest.approx(1.0)
        assert found.rows[1][found.columns.index("rows")] == pytest.approx(
            np.mean([world.present(n, 30).sum() for n in range(4)])
        )


def test_cycles_come_in_order(url: str) -> None:
    with kept.open_store(url) as store:
        run = world.begin(store)
        world.write(store, run, 0)
        with pytest.raises(StoreError, match="got cycle 2, needed 1"):
            world.write(store, run, 2)
        with pytest.raises(StoreError, match="no run 99"):
            world.write(store, 99, 0)
        world.write(store, run, 1)
    assert check(url) == []


@pytest.mark.parametrize("again_from", [0, 4, 9, 10])
def test_a_run_that_goes_on_from_a_checkpoint_ends_as_one_that_never_stopped(url: str, again_from: int) -> None:
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number in range(10):
            world.write(store, run, number, checkpoint=b"x" * 100_000 if number == again_from - 1 else None)
        kept.finish_run(store, run, "interrupted")
    with kept.open_store(url) as store:
        point = kept.resume_point(store, "sea", 1, "0.1.0", {"period_s": world.PERIOD_S})
        assert point == ((run, again_from - 1, b"x" * 100_000) if again_from else None)
        for number in range(again_from, 14):
            world.write(store, run, number)
            assert number > again_from or check(url) == []
        assert kept.run(store, run)["status"] == "running"
        resumed = everything(store)
        kept.discard_runs(store, "sea")
        assert all(rows == [] for rows in everything(store).values())
        again = world.begin(store)
        assert again == run + 1
        for number in range(14):
            world.write(store, again, number)
        straight = everything(store)
    assert {name: len(rows) for name, rows in resumed.items()} == {name: len(rows) for name, rows in straight.items()}
    assert resumed == {name: [row.replace(f"({again},", f"({run},", 1) for row in rows] for name, rows in straight.items()}


def test_a_checkpoint_larger_than_a_piece_comes_back_whole(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("coastwatch.store.write.PIECE_BYTES", 1000)
    memory = np.random.default_rng(1).bytes(3500)
    with kept.open_store(url) as store:
        run = world.begin(store)
        for number, said in enumerate((memory, memory[:1000], b"", memory[::-1])):
            world.write(store, run, number, checkpoint=said)
            assert kept.resume_point(store, "sea", 1, "0.1.0") == (run, number, said)
        with reading(store) as connection:
            assert connection.execute(text("SELECT count(*) FROM checkpoint")).scalar_one() == 4
    assert check(url) == []


def test_only_an_unfinished_run_of_the_same_kind_is_resumed(url: str) -> None:
    with kept.open_store(url) as store:
        run = world.begin(store)
        assert kept.resume_point(store, "sea", 1, "0.1.0") is None
        world.write(store, run, 0)
        assert kept.resume_point(store, "sea", 1, "0.1.0") == (run, 0, b"memory 0")
        assert kept.resume_point(store, "sea", 2, "0.1.0") is None
        assert kept.resume_point(store, "sea", 1, "0.2.0") is None
        assert kept.resume_point(store, "lake", 1, "0.1.0") is None
        assert kept.resume_point(store, "sea", 1, "0.1.0", {"period_s": 4.0}) is None
        kept.finish_run(store, run, "finished")
        assert kept.resume_point(store, "sea", 1, "0.1.0") is None


def test_discarded_runs_leave_nothing_and_others_stay(url: str) -> None:
    with kept.open_store(url) as store:
        one, two, other = world.begin(store, seed=1), world.begin(store, seed=2), world.begin(store, "lake")
        for run in (one, two, other):
            world.write(store, run, 0)
        assert kept.discard_runs(store, "sea", 1) == [one]
        assert kept.runs(store).column("id") == [other, two]
        assert kept.discard_runs(store, "sea") == [two]
        assert len(kept.picture(store, other).rows) == len(world.picture_of(0, 30))
    assert check(url) == []


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
    found = columns.sources(np.arange(1, 6), members, ("a", "b", "c", "d"))
    assert plain(found, 5) == ["a,c", "", "b,c,d", "a,c", "c"]
    assert len(found.of) == 7  # of each set and of what it grew from, one text
    assert plain(columns.sources(np.zeros(0, np.int64), members[:0], ("a",)), 0) == []


def test_rows_have_columns() -> None:
    rows = Rows(("a", "b"), [(1, 2), (3, 4)])
    assert rows.column("b") == [2, 4]
    assert isinstance(world.picture_of(0, 3), Picture)


def test_sensors_as_they_were(url: str) -> None:
    """Registration and the newest arrival of each sensor, now and at an instant; rows come at an interval and on change."""
    with kept.open_store(url) as store:
        run = world.begin(store)
        keep = StoreSettings(registration_every=8)
        for number in range(23):
            world.write(store, run, number, keep=keep)
        with reading(store) as connection:
            cycles = connection.execute(text("SELECT DISTINCT cycle FROM sensor_registration ORDER BY cycle")).scalars().all()
        assert cycles == [0, 8, 16, 20]  # in cycle 20 the first radar settles
        now, before = (kept.sensor_states(store, run, at_s) for at_s in (None, world.instant_s(9)))
        assert now.column("name") == ["hill", "mouth", "fort", "island"]
        assert now.column("state") == [None, None, "settled", "unknown"]
        assert now.column("azimuth_bias_deg")[2] == pytest.approx(5.02)
        assert before.column("state") == [None, None, "acquiring", "unknown"]
        assert before.column("azimuth_bias_deg")[2] == pytest.approx(5.008)
        assert before.column("azimuth_bias_deg")[1] == 0.0
        with pytest.raises(StoreError, match="holds nothing up to"):
            kept.sensor_states(store, run, world.START_S - 1.0)
        empty = kept.sensor_states(store, world.begin(store, "other"))
        assert empty.column("state") == [None] * 4


def test_when_a_sensor_was_heard_outlasts_its_silence(url: str) -> None:
    one = np.array([world.START_S + 1.0])
    said = RadarReports(np.array([1]), one, one + 0.5, one * 0.0, one * 0.0, np.zeros((1, 2)), np.array([-1]))
    with kept.open_store(url) as store:
        run = world.begin(store)
        world.write(store, run, 0, reports=replace(world.reports_of(0, 30), radar=said))
    with kept.open_store(url) as store:
        world.write(store, run, 1)
        assert kept.sensor_states(store, run).column("heard_s") == [None, None, None, world.START_S + 1.5]
