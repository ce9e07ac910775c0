"""A capture of the video of two radars, fused without a scenario to a stored picture; what is no video is refused."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import image
from video_world import captured

from coastwatch.batches import RadarVideo
from coastwatch.formats.asterix.video import VideoMessage, decode, encode
from coastwatch.formats.decoding import Item
from coastwatch.geodesy import difference_m
from coastwatch.operators.cli import main
from coastwatch.scenario import Scenario, load_scenario
from coastwatch.server.feeds.address import parsed
from coastwatch.server.feeds.sending import of_scenario

pytestmark = pytest.mark.whole

SCENE = {"radars.0.range_nm": "2.5", "input.cells": "427", "input.spokes": "512", "cycles": "10", "seed": "5"}
NORTH, SOUTH = (54.4, 12.0), (54.3, 12.0)  # 6 NM apart: none sees the vessels of the other
LATE_S = 0.05
POSITION_M = 60.0


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    """A capture in which two radars, SIC 1 and 2, send the same video; and where the two tugs are at its end about the radar at `SOUTH`."""
    scenario = load_scenario("heymann-table-1", SCENE)
    sensors, plan, address = scenario.sensors(), scenario.plan(), parsed("video+udp://127.0.0.1:8600")
    items: list[Item] = []
    for until_s, encoded in of_scenario(scenario, sensors, ["video"], now=False):
        for data in encoded(address):
            (message,) = decode(data)[0]
            assert isinstance(message, VideoMessage)
            items += [(until_s + LATE_S, encode(message._replace(sic=sic)), 0) for sic in (1, 2)]
    truth = scenario.input.load(sensors, scenario.seed, plan).truth
    assert truth is not None
    return captured(tmp_path_factory.mktemp("video") / "turns.pcap", items), truth.at(plan.instant_s(9)).position_deg


def radar(name: str, site: tuple[float, float]) -> str:
    return f"--radar={name},{site[0]},{site[1]},2.5,25,,,1.0,45,0.5"


def test_the_video_of_two_radars_becomes_the_vessels_around_each(
    scene: tuple[Path, np.ndarray], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, truth = scene
    words = ["--video", f"video+file:{path}?25/1=north&25/2=south", radar("south", SOUTH), radar("north", NORTH)]
    url = f"sqlite:///{tmp_path / 'x.db'}"
    assert main(["fuse", *words, "--period", "2.4", "--db", url]) == 0, capsys.readouterr().err
    assert "10,240 video reports" in capsys.readouterr().out
    assert main(["picture", "--db", url, "--json"]) == 0
    vessels = json.loads(capsys.readouterr().out)
    found = np.array([[vessel["latitude_deg"], vessel["longitude_deg"]] for vessel in vessels])
    assert len(found) == 4
    wanted = np.concatenate([truth, truth + np.array([NORTH[0] - SOUTH[0], 0.0])])
    for place in wanted:
        assert np.hypot(*difference_m(found, place).T).min() < POSITION_M
    assert all(5.0 < vessel["sog_kn"] < 14.0 for vessel in vessels)


def test_a_feed_of_video_is_the_same_as_video(
    scene: tuple[Path, np.ndarray], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, _ = scene
    pictures = []
    for k, words in enumerate((["--video", str(path)], ["--feed", f"video+file:{path}"])):
        url = f"sqlite:///{tmp_path / f'{k}.db'}"
        assert main(["fuse", *words, radar("south", SOUTH), "--db", url]) == 0  # SIC 1 is the first radar
        assert "video of no radar of the scenario" in capsys.readouterr().out
        assert main(["picture", "--db", url, "--json"]) == 0
        pictures.append(json.loads(capsys.readouterr().out))
    assert len(pictures[0]) == 2
    assert pictures[0] == pictures[1]


def turns_of(scenario: Scenario, count: int) -> Iterator[RadarVideo]:
    """The first turns of the video of a scenario."""
    plan = scenario.plan()
    stream = scenario.input.load(scenario.sensors(), scenario.seed, plan).reports
    for k in range(count):
        yield from stream.between(plan.start_s + k * 2.4 - 1e-3, plan.start_s + (k + 1) * 2.4 - 1e-3).video.parts


def fused(words: list[str], folder: Path, capsys: pytest.CaptureFixture[str]) -> tuple[list[dict[str, Any]], str]:
    """The vessels of the last picture, and what was printed."""
    url = f"sqlite:///{folder / 'x.db'}"
    assert main(["fuse", *words, "--period", "2.4", "--db", url]) == 0, capsys.readouterr().err
    said = capsys.readouterr().out
    assert main(["picture", "--db", url, "--json"]) == 0
    return json.loads(capsys.readouterr().out), said


def test_pictures_of_a_screen_become_vessels(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario, half = load_scenario("heymann-table-1", SCENE), 427
    truth = scenario.input.load(scenario.sensors(), scenario.seed, scenario.plan()).truth
    assert truth is not None
    east, north = np.meshgrid(np.arange(-half, half + 1), -np.arange(-half, half + 1))
    rows, end_s = ["file,time"], 0.0
    for k, turn in enumerate(turns_of(scenario, 10)):
        spoke = np.floor(np.arctan2(east, north) % (2.0 * np.pi) / (2.0 * np.pi) * len(turn)).astype(int) % len(turn)
        level = turn.level[spoke, np.hypot(east, north).astype(int).clip(0, turn.level.shape[1] - 1)]
        image.imsave(tmp_path / f"{k}.png", np.repeat(level[..., None], 3, axis=2))
        end_s = float(turn.time_s.mean())
        rows.append(f"{k}.png,{end_s}")
    (tmp_path / "turns.csv").write_text("\n".join(rows) + "\n")
    words = [f"{tmp_path / 'turns.csv'}?pixel_m={turn.cell_m}&radius_pixels=427&spokes=512", radar("r", SOUTH)]
    vessels, said = fused(["--video", *words], tmp_path, capsys)
    assert "10 pictures of a radar" in said
    found = np.array([[one["latitude_deg"], one["longitude_deg"]] for one in vessels])
    for place in truth.at(end_s).position_deg[:2]:
        assert np.hypot(*difference_m(found, place).T).min() < POSITION_M


def test_hdf5_of_haxr_becomes_vessels_by_absolute_levels(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    h5py = pytest.importorskip("h5py", reason="the package h5py is not installed")
    scenario = load_scenario("heymann-table-1", SCENE)
    columns: dict[str, list[np.ndarray]] = {name: [] for name in ("tod", "az1", "az2", "r1", "r2", "amp")}
    for turn in turns_of(scenario, 10):
        cleaned = np.where(turn.level > 58, turn.level, 0)  # 19 dB over the noise
        cleaned[:, :120] = 0  # sea clutter
        row, cell = np.nonzero(cleaned)
        middle, half = np.degrees(turn.azimuth_rad[row]), 180.0 / len(turn)
        values = (turn.time_s[row] % 86_400.0, middle - half, middle + half, cell * turn.cell_m, (cell + 1) * turn.cell_m)
        for name, value in zip(columns, (*values, cleaned[row, cell]), strict=True):
            columns[name].append(value)
    with h5py.File(tmp_path / "x.hdf5", "w") as file:
        for name, parts in columns.items():
            file[name] = np.concatenate(parts)
    vessels, said = fused(["--video", f"{tmp_path / 'x.hdf5'}?day=2016-06-01", radar("r", SOUTH)], tmp_path, capsys)
    assert "spokes of video" in said
    truth = scenario.input.load(scenario.sensors(), scenario.seed, scenario.plan()).truth
    assert truth is not None
    found = np.array([[one["latitude_deg"], one["longitude_deg"]] for one in vessels])
    for place in truth.at(scenario.plan().instant_s(9)).position_deg[:2]:
        assert np.hypot(*difference_m(found, place).T).min() < POSITION_M


def test_what_is_no_video_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "x.h5").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    (tmp_path / "x.csv").write_text("file,time,heading\n")
    image.imsave(tmp_path / "x.png", np.zeros((9, 9, 3)))
    (tmp_path / "x.ast").write_bytes(bytes([240, 0, 3]))
    for words, message in (
        (
            ["--video", str(tmp_path / "x.ast")],
            "got no radar, needed --radar for each radar in the file: see coastwatch video FILE",
        ),
        (["--feed", f"video+file:{tmp_path / 'x.ast'}"], "got no radar, needed --radar"),
        (
            ["--video", "asterix+file:x.ast", radar("r", SOUTH)],
            "got 'asterix+file:x.ast', needed a capture or a file of CAT 240",
        ),
        (["--video", "none.pcap", radar("r", SOUTH)], "none.pcap: there is no such file"),
        (["--video", str(tmp_path / "x.ast"), radar("r", SOUTH)], "?date=YYYY-MM-DD"),
        (["--video", f"{tmp_path / 'x.ast'}", "--radar=r,,,2.5,25"], "--radar r: got no latitude and longitude"),
        (
            ["--video", str(tmp_path / "x.h5"), radar("r", SOUTH)],
            "day: got nothing, needed a value; settings stand behind '?', as in haxr+file:port.hdf5?day=2025-06-01",
        ),
        (["--video", str(tmp_path / "x.png"), radar("r", SOUTH)], "x.png: got a picture, needed a table with columns file"),
        (["--video", str(tmp_path / "x.csv")], "got no radar, needed --radar"),
        (["--video", f"{tmp_path / 'x.csv'}?pixel_m=10&mid=3", radar("r", SOUTH)], "?pixel_m=10&mid=3: mid: "),
        (["--video", f"video+file:{tmp_path / 'x.csv'}?date=2026-01-01", radar("r", SOUTH)], "x.csv: byte 18"),
    ):
        assert main(["fuse", *words, "--db", f"sqlite:///{tmp_path / 'x.db'}"]) == 2, words
        assert message in capsys.readouterr().err
