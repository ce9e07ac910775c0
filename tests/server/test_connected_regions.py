"""Regional and high-level centres over real sockets: a region that was away leaves no hole, and no cycle is used twice."""

from __future__ import annotations

import math
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from region_world import PERIOD_S, START_S, VESSELS, Region, centre, centre_scenario
from server_world import listening, wait_for
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from coastwatch.server.feeds.live_input import LiveInput
from coastwatch.server.regions.client import parsed_region
from coastwatch.server.regions.intake import LATE, WITHOUT
from coastwatch.server.regions.message import decode
from coastwatch.store import open_store
from scaling.load.kills import is_right, kill

pytestmark = pytest.mark.whole

CYCLES = 6
AWAY = 30  # cycles: more than a region sends ahead, and than a centre merges
TABLES = ("cycle", "vessel", "history", "member_history", "presence", "recording", "region_intake")


@pytest.fixture
def region(tmp_path: Path) -> Iterator[Region]:
    with open_store(str(tmp_path / "region.db")) as opened:
        yield Region(opened)


@contextmanager
def running(path: Path, address: str) -> Iterator[tuple[Any, Any]]:
    with open_store(str(path)) as opened:
        source, run = centre(opened, path, address)
        with source, run:
            yield source, run
            assert not run.ended, run.error()


def rows(path: Path) -> dict[str, list[Any]]:
    with closing(sqlite3.connect(path)) as raw:
        return {table: sorted(raw.execute(f"SELECT * FROM {table}").fetchall(), key=repr) for table in TABLES}


def intake(path: Path) -> list[tuple[int, int]]:
    with closing(sqlite3.connect(path)) as raw:
        return raw.execute("SELECT first_seq, last_seq FROM region_intake ORDER BY cycle").fetchall()


def test_a_region_that_was_away_leaves_a_picture_equal_to_one_that_never_was(
    region: Region, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("coastwatch.server.run.warm_up", lambda *_, **__: None)  # the first run compiles what it needs
    monkeypatch.setattr("coastwatch.server.live.CAUGHT_UP_S", math.inf)  # on a busy machine one of them would merge cycles
    whole, broken = tmp_path / "whole.db", tmp_path / "broken.db"
    with listening(region.service, web=tmp_path) as address:
        port = int(address.rpartition(":")[2])
        region.write(CYCLES)
        with running(whole, address) as (source, run):
            wait_for(lambda: run.cycles == CYCLES or run.ended, 300.0)  # kernels may be compiled first
    with listening(region.service, web=tmp_path, port=port), running(broken, address) as (source, run):
        wait_for(lambda: run.cycles == CYCLES)
        assert source.feeds()[0]["records"] == CYCLES
    region.write(5)
    with running(broken, address) as (source, run):  # the centre starts again while the region is away
        wait_for(lambda: source.feeds() and source.feeds()[0]["error"])
        assert run.cycles == 0
        with listening(region.service, web=tmp_path, port=port):
            wait_for(lambda: run.cycles == 5)
        region.write(AWAY)  # while the region cannot be reached
        with listening(region.service, web=tmp_path, port=port):
            wait_for(lambda: run.cycles == 5 + AWAY)
            assert source.feeds()[0]["connections"] == 2
    with listening(region.service, web=tmp_path, port=port), running(whole, address) as (source, run):
        wait_for(lambda: run.cycles == 5 + AWAY)
    one, other = rows(whole), rows(broken)
    assert len(one["vessel"]) == VESSELS
    assert len(one["recording"]) == CYCLES + 5 + AWAY
    for table in TABLES:
        assert one[table] == other[table], table
    assert intake(broken) == [(seq, seq) for seq in range(1, CYCLES + 6 + AWAY)]


@pytest.mark.parametrize("start_utc", [None, datetime(2012, 6, 1, tzinfo=UTC), datetime(2046, 6, 1, tzinfo=UTC)])
@pytest.mark.parametrize("period_s", [PERIOD_S, 4 * PERIOD_S])
def test_a_centre_of_regions_alone_begins_with_their_first_cycle_whenever_its_scenario_would(
    start_utc: datetime | None, period_s: float, region: Region, tmp_path: Path
) -> None:
    scenario = centre_scenario().model_copy(update={"start_utc": start_utc, "period_s": period_s})
    sensors, stop = scenario.sensors(), threading.Event()
    region.write(2)
    with listening(region.service, web=tmp_path) as where:
        address = [parsed_region(f"ws://{where}?name=north")]
        with LiveInput([], sensors, regions=address, clock="feeds") as source:
            _, plan = source.begin(scenario, sensors, 1, stop, {})
            assert plan.instant_s(0) == START_S + PERIOD_S
            assert source.wait(plan.instant_s(0), stop)
            assert len(source.between(plan.start_s, plan.instant_s(0)).tracks) == VESSELS
            _, again = source.begin(scenario, sensors, 1, stop, {})  # as after a failure
            assert again == plan


def test_a_centre_that_does_not_wait_goes_on_without_a_region_and_counts_what_comes_late(
    region: Region, tmp_path: Path
) -> None:
    scenario = centre_scenario()
    sensors, end = scenario.sensors(), [START_S + k * PERIOD_S for k in range(12)]
    region.write(2)
    with (
        listening(region.service, web=tmp_path) as address,
        LiveInput([], sensors, regions=[parsed_region(f"ws://{address}?name=north")], clock="feeds") as source,
    ):
        source.begin(scenario, sensors, 1, threading.Event(), {})
        wait_for(lambda: source.feeds()[0]["received"] == 2)
        found = [
            len(source.between(end[0], end[2])),
            len(source.between(end[2], end[3])),
            len(source.between(end[3], end[4])),
        ]
        assert found == [2 * VESSELS, 0, 0]
        assert source.intake() == []
        region.write(4)
        wait_for(lambda: source.feeds()[0]["received"] == 6)
        assert len(source.between(end[4], end[5])) == VESSELS
        assert [one[2:] for one in source.intake()] == [(3, 5, 2)]
        of_feeds = {"bytes", "records", "refused", "late", "dropped", "connections", "silent_s"}  # that metrics ask for
        assert of_feeds <= set(source.feeds()[0])
        assert [(fault.kind, fault.count) for fault in source.faults()] == [(LATE, 2), (WITHOUT, 2)]


def test_at_most_four_cycles_are_sent_before_they_are_acknowledged(region: Region, tmp_path: Path) -> None:
    region.write(20)
    with listening(region.service, web=tmp_path) as address:
        url = f"ws://{address}/api/v1/tracks/stream"
        with connect(f"{url}?from_s={START_S + 5 * PERIOD_S}") as link:
            found = [decode(link.recv(timeout=5.0)) for _ in range(4)]
            assert [cycle.seq for cycle in found] == [6, 7, 8, 9]
            with pytest.raises(TimeoutError):
                link.recv(timeout=0.2)
            link.send(f'{{"run": "{found[1].run}", "seq": 7}}')
            assert [decode(link.recv(timeout=5.0)).seq for _ in range(2)] == [10, 11]
            link.send("nonsense")
            with pytest.raises(ConnectionClosed, match="4400"):
                link.recv(timeout=5.0)
        with connect(f"{url}?run={found[0].run}&seq=19") as link:
            assert decode(link.recv(timeout=5.0)).seq == 20
            region.write(1)
            assert decode(link.recv(timeout=5.0)).seq == 21


def test_a_server_that_is_no_region_says_so(changing: Any) -> None:
    with connect(f"ws://{changing.address}/api/v1/tracks/stream") as link, pytest.raises(ConnectionClosed, match="4404"):
        link.recv(timeout=5.0)


@pytest.mark.slow
def test_killed_in_turn_a_region_and_its_centre_lose_and_repeat_no_cycle() -> None:
    found = kill(4, 1, "guanabara", (), seed=1)
    assert is_right(found), found
    assert found["centre"]["largest_vessel_id"] >= 1
