"""`coastwatch plot SCENARIO --video RADAR` draws one turn of radar video, and says what is not there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib import image
from video_world import START_S, arrivals, captured, messages

from coastwatch.geodesy import difference_m
from coastwatch.operators import radar_turn
from coastwatch.operators.cli import main
from coastwatch.scenario import load_scenario

pytestmark = pytest.mark.whole

SCENE = {"radars.0.range_nm": "2.5", "input.cells": "427", "input.spokes": "512", "cycles": "12", "seed": "5"}
SET = [word for key, value in SCENE.items() for word in ("--set", f"{key}={value}")]
RANGE_M = 2.5 * 1852.0
NEAR = 4  # pixels about a ship, inside the circle of its plot
BESIDE_M = 350.0
MORE = 1.5  # times the light beside a ship, in the sea clutter, at its strongest
COLOURED = 0.05  # least difference of the channels of what is no grey


def test_a_turn_has_light_where_ships_are_and_circles_around_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "turn.png"
    words = ["plot", "heymann-table-1", "--video", "radar", "--turn", "8", *SET, "--output", str(path)]
    assert main(words) == 0, capsys.readouterr().err
    assert capsys.readouterr().out == f"{path}\n"
    drawn = image.imread(path)[::-1, :, :3]
    height, width = drawn.shape[:2]
    left, bottom, wide, high = radar_turn.AXES

    scenario = load_scenario("heymann-table-1", SCENE)
    sensors, plan = scenario.sensors(), scenario.plan()
    truth = scenario.input.load(sensors, scenario.seed, plan).truth
    assert truth is not None
    ships = difference_m(truth.at(plan.start_s + 7.5 * 2.4).position_deg, sensors.radars.site_deg[0])
    ships = ships[np.hypot(*ships.T) > 500.0]  # the anchored one has the radar
    assert len(ships) == 2

    def pixels(east_north_m: np.ndarray, near: int) -> np.ndarray:
        at = 0.5 + 0.5 * east_north_m / (radar_turn.EDGE * RANGE_M)
        x, y = round(width * (left + wide * at[0])), round(height * (bottom + high * at[1]))
        return drawn[y - near : y + near + 1, x - near : x + near + 1]

    def light(east_north_m: np.ndarray) -> float:
        """Of grey pixels alone: a range ring and the circle of a plot have a colour."""
        found = pixels(east_north_m, NEAR)
        return float(np.where(np.ptp(found, axis=-1) < COLOURED, found.mean(axis=-1), 0.0).mean())

    for ship in ships:
        around = [light(ship + BESIDE_M * np.array([np.sin(a), np.cos(a)])) for a in np.arange(8) * np.pi / 4.0]
        assert light(ship) > MORE * max(around)
        circle = pixels(ship, 5 * NEAR)
        assert ((circle[..., 0] - circle[..., 2]) > 0.5).sum() > 20  # amber is red and not blue


def scenario_of_file(folder: Path) -> str:
    """A scenario of the radars `north`, which sent three turns, and `south`, which sent nothing."""
    capture = captured(folder / "x.pcap", arrivals(messages(turns=3)))
    site = "latitude_deg = 54.0\nlongitude_deg = 12.0\n"
    radars = "".join(f'[[radars]]\nname = "{name}"\n{site}range_nm = 6.0\nrpm = 25.0\n' for name in ("north", "south"))
    head = f'name = "x"\ntitle = "x"\nperiod_s = 2.4\ncycles = 0\nwarmup_s = 0.0\n[area]\n{site}{radars}'
    path = folder / "scenario.toml"
    path.write_text(f'{head}[input]\nmethod = "video_files"\nfiles = ["video+file:{capture}?25/1=north"]\n')
    return str(path)


def test_the_turn_of_a_file_is_from_north_to_north_and_lost_spokes_stay_blank(tmp_path: Path) -> None:
    turn = radar_turn.load(load_scenario(scenario_of_file(tmp_path)), "north", START_S + 3.0, None)
    assert len(turn.video) == 256
    assert (turn.video.time_s[[0, -1]] - START_S) == pytest.approx([2.4, 4.8], abs=0.02)
    half = radar_turn.HALF
    whole = radar_turn.picture(turn)
    assert (whole[half, :] >= 0).all()
    kept = np.abs(turn.video.azimuth_rad - np.pi / 2.0) > 0.2
    cut = radar_turn.picture(turn._replace(video=turn.video.take(kept), shade=turn.shade[kept]))
    assert (cut[half, half + 9 :] == -1).all()  # east
    assert (cut[half, : half - 9] == whole[half, : half - 9]).all()


def test_the_turn_of_a_feed_among_tables_is_drawn_as_that_of_a_file(tmp_path: Path) -> None:
    path = Path(scenario_of_file(tmp_path))
    alone = radar_turn.load(load_scenario(str(path)), "north", START_S + 3.0, None)
    (tmp_path / "ais.csv").write_text(f"time,mmsi,latitude,longitude\n{START_S},211000000,54.0,12.0\n")
    text = path.read_text().replace('"video_files"\nfiles', f'"tables"\nais = ["{tmp_path / "ais.csv"}"]\nfeeds')
    path.write_text(text)
    among = radar_turn.load(load_scenario(str(path)), "north", START_S + 3.0, None)
    assert among.title == alone.title
    assert (radar_turn.picture(among) == radar_turn.picture(alone)).all()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["heymann-table-1", "--video", "radr"], "got 'radr', needed one of radar; did you mean 'radar'?"),
        (["guanabara", "--video", "radar"], "no radar video"),
        (["heymann-table-1", "--video", "radar", "--turn", "13", *SET], "plot --turn: got 13, needed 1 to 12"),
        (["heymann-table-1", "--video", "radar", "--at", "2015-01-01"], "needed 2016-06-01T12:00:00.000Z to 2016-06-01T13"),
        (["heymann-table-1", "--video", "radar", "--at", "2016-06-01T12:01", "--turn", "1"], "needed one of them"),
        (["heymann-table-1", "--video", "radar", "--cover", "clutter"], "got --cover"),
        (["--video", "radar"], "got no scenario"),
        (["heymann-table-1"], "got a scenario, needed --video RADAR"),
        (["--turn", "1"], "got --turn, needed --video RADAR"),
        (["FILE", "--video", "south"], "south sent no video about"),
    ],
)
def test_what_is_not_there_is_said(words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    named = [scenario_of_file(tmp_path) if word == "FILE" else word for word in words]
    output = tmp_path / "turn.png"
    assert main(["plot", *named, "--output", str(output)]) == 2
    assert said in capsys.readouterr().err
    assert not output.exists()
