"""Radar video over sockets: a scenario is sent and served, and its vessels are tracked."""

from __future__ import annotations

import csv
import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import httpx2 as httpx
import numpy as np
import pytest
from server_world import listening, wait_for
from video_world import arrivals, captured, messages, sensors

from coastwatch import store
from coastwatch.errors import InputError
from coastwatch.geodesy import to_plane
from coastwatch.operators.api.service import Service
from coastwatch.operators.cli import main
from coastwatch.scenario import Scenario, load_scenario
from coastwatch.server.feeds.address import parsed
from coastwatch.server.feeds.live_input import LiveInput
from coastwatch.server.feeds.sending import of_file, of_scenario, send
from coastwatch.server.live import LiveRun
from coastwatch.server.live_video import LiveVideo, Sector

pytestmark = pytest.mark.whole

SMALL = {"radars.0.range_nm": "3.0", "input.cells": "256", "input.spokes": "512", "cycles": "14"}
SPEED = 15.0
GROUP = "239.192.7.32"


@contextmanager
def sent(scenario: Scenario, port: int) -> Iterator[dict[str, int]]:
    """Send a scenario to a group. Yields: how many datagrams were sent, once it is over."""
    stop, counts = threading.Event(), dict[str, int]()
    to = parsed(f"video+udp://{GROUP}:{port}?interface=127.0.0.1")
    batches = of_scenario(scenario, scenario.sensors(), ["video"], now=False)
    thread = threading.Thread(target=lambda: counts.update(send(batches, [to], SPEED, stop)))
    thread.start()
    try:
        yield counts
    finally:
        stop.set()
        thread.join()


def check_levels(scenario: Scenario, sector: Sector) -> None:
    """That a sector has the levels of the simulation, from 0 to 15: two rows a spoke, two columns a cell."""
    plan, period_s = scenario.plan(), 2.4
    begun_s = plan.start_s + (sector.time_s - plan.start_s) // period_s * period_s
    stream = scenario.input.load(scenario.sensors(), scenario.seed, plan).reports
    (turn,) = stream.between(begun_s - 1e-3, begun_s + period_s - 1e-3).video.parts
    sent = turn.level[sector.place * 32 : sector.place * 32 + 32].repeat(2, axis=0).repeat(2, axis=1)
    found = sector.levels()
    spans = [(sent[found == level].min(), sent[found == level].max()) for level in np.unique(found)]
    assert len(spans) >= 3
    assert all(before[1] < after[0] for before, after in pairwise(spans))


def test_a_recording_is_sent_again_as_it_is_at_any_speed(tmp_path: Path) -> None:
    items = arrivals(messages(turns=1.0))
    path = captured(tmp_path / "x.pcap", items)
    with LiveInput([parsed("video+udp://127.0.0.1:0?25/1=north")], sensors(), clock="feeds") as source:
        to = parsed(f"video+udp://127.0.0.1:{source.ports[0]}")
        begun_s = time.monotonic()
        assert send(of_file(path, ["video"]), [to], 4.0, threading.Event()) == {to.text: len(items)}
        assert 0.5 < time.monotonic() - begun_s < 2.3  # 2.4 s of video
        wait_for(lambda: source.feeds()[0]["received"] == len(items))
        assert [data for _, data, _ in source._receiver.inboxes[0].pop_first(len(items))] == [data for _, data, _ in items]


def test_blocks_of_cat_240_are_sent_by_their_time_of_day_over_midnight(tmp_path: Path) -> None:
    begun_s = 1.6e9 // 86_400.0 * 86_400.0 - 0.3
    items = [data for _, data, _ in arrivals(messages(turns=0.5, begun_s=begun_s))]
    path = tmp_path / "x.cat240"
    path.write_bytes(b"".join(items))
    batches = list(of_file(path, ["video"]))
    address = parsed("video+udp://127.0.0.1:8600")
    assert [data for _, made in batches for data in made(address)] == items
    assert np.diff([at_s for at_s, _ in batches]).sum() == pytest.approx(0.5 * 2.4 * (1.0 - 2.0 / len(items)), abs=0.02)
    path.write_bytes(b"".join(data for _, data, _ in arrivals(messages(turns=0.1, timed=False))))
    with pytest.raises(InputError, match=r"x\.cat240: got video without time of day"):
        list(of_file(path, ["video"]))


def test_a_feed_all_of_whose_video_is_refused_is_in_trouble(tmp_path: Path) -> None:
    path = captured(tmp_path / "x.pcap", arrivals(messages(turns=0.5)))
    with LiveInput([parsed("video+udp://127.0.0.1:0?9/9=north")], sensors(), clock="feeds") as source:
        to = parsed(f"video+udp://127.0.0.1:{source.ports[0]}")
        send(of_file(path, ["video"]), [to], 40.0, threading.Event())
        wait_for(lambda: source.feeds()[0]["received"] > 0)
        feed = source._feeds[0]
        feed.look()
        feed.items = feed.inbox.pop_first(1000)
        feed.decode(None)
        assert feed.troubles() == []
        feed.look()
        (said,) = feed.troubles()
    assert "records of the last minute could be used, most often: video of no radar of the scenario: SAC 25, SIC 1" in said


def test_video_that_is_sent_over_a_group_is_served_as_tracks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("coastwatch.server.live_video.LOOKED_S", 1e9)  # kernels may be compiled for minutes
    url, scenario = f"sqlite:///{tmp_path / 'live.db'}", load_scenario("heymann-table-1", SMALL)
    address = parsed(f"video+udp://{GROUP}:0?interface=127.0.0.1&25/1=radar&date=2016-06-01")
    video = LiveVideo(scenario.sensors().radars)
    video.ask([0])
    with (
        store.open_store(url) as opened,
        LiveInput([address], scenario.sensors(), clock="feeds", on_video=video.take_as_sent) as source,
    ):
        service = Service(opened)
        run = LiveRun(scenario, source, service.receive, database=url, workers=1)
        service.source = run
        with listening(service, web=tmp_path) as where, sent(scenario, source.ports[0]), run:
            wait_for(lambda: service.hub.picture is not None and len(service.picture()) >= 2, 300.0)
            picture = service.picture()
            wait_for(lambda: run.cycles >= 6, 60.0)
            sectors = video.turn(0) or ()
            (feed,) = httpx.get(f"http://{where}/api/v1/feeds").json()["feeds"]
            said = httpx.get(f"http://{where}/metrics").text
            assert main(["sensors", "--video", f"http://{where}", "--format", "csv"]) == 0
    assert not run.failed
    truth = scenario.input.load(scenario.sensors(), 1, scenario.plan()).truth
    assert truth is not None
    true_deg = truth.at(picture.time_s).position_deg
    off_m = [np.hypot(*to_plane(picture.positions_deg(), one).T).min() for one in true_deg]
    assert max(off_m) < 60.0
    for sector in sectors:
        check_levels(scenario, sector)
    assert len(sectors) == 16
    assert (feed["late"], feed["refused"], feed["dropped"]) == (0, 0, 0)
    assert feed["records"] >= 4 * 512
    (table,) = csv.DictReader(capsys.readouterr().out.splitlines())
    assert (table["radar"], table["spokes_a_turn"], table["spokes_lost"]) == ("radar", "512", "0")
    (radar,) = feed["radars"]
    assert (radar["name"], radar["spokes_a_turn"], radar["spokes_lost"], radar["parts_lost"]) == ("radar", 512, 0, 0)
    assert radar["turn_s"] == pytest.approx(2.4, abs=0.01)
    assert (radar["cells"], radar["bits"], radar["range_m"]) == (256, 8, pytest.approx(5556.0, abs=2.0))
    assert 1.0 <= radar["plots_a_turn"] < 60.0
    assert 8.0 < radar["threshold_db"] < 40.0
    assert main(["sensors", "--db", url, "--json"]) == 0
    (stored,) = json.loads(capsys.readouterr().out)
    assert (stored["spokes_a_turn"], stored["spokes_lost"], stored["parts_lost"]) == (512, 0, 0)
    assert 1.0 <= stored["plots_a_turn"] < 60.0
    assert 8.0 < stored["threshold_db"] < 40.0
    name = feed["name"]
    assert f'coastwatch_radar_state{{feed="{name}",radar="radar",value="spokes_a_turn"}} 512.0' in said
    assert f'coastwatch_radar_total{{count="spokes_lost",feed="{name}",radar="radar"}} 0.0' in said
