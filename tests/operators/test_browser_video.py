"""Radar video on the page in a real Chromium: lit where an echo is, in three themes, by gain; a replay has none and says so."""

from __future__ import annotations

import io
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import store_world
from browser_world import ANY_TIME_S, SIZE, VIEW, Watch
from PIL import Image
from server_world import listening, wait_for

from coastwatch.batches import RadarVideo
from coastwatch.geodesy import offset_deg
from coastwatch.operators.api.application import WEB
from coastwatch.operators.cli.serving import following
from coastwatch.scenario.sites import Radar, sensors_of
from coastwatch.server.live_video import LiveVideo
from coastwatch.store import open_store

pytestmark = pytest.mark.whole

SITE_DEG = np.array([-22.898, -43.155])
SPOKES, CELLS, CELL_M, TURN_S = 1024, 256, 20.0, 2.4
ECHO = slice(180, 190), slice(120, 136)  # spokes and cells
ECHO_RAD, ECHO_M = 185 / SPOKES * 2.0 * np.pi, 128 * CELL_M
SHADE = 6  # of 255, between a colour that is computed and that of a pixel
OPACITY = 0.75
NIGHT = 0.0284  # relative luminance of (43, 48, 48)


def turn() -> RadarVideo:
    """A turn and two spokes, so that its last sector is closed."""
    level = np.zeros((SPOKES + 2, CELLS), np.uint8)
    level[ECHO] = 15
    part = (np.arange(len(level)) + 0.5) / SPOKES
    return RadarVideo(
        sensor=0, first_m=0.0, cell_m=CELL_M, time_s=part * TURN_S, received_s=part * TURN_S,
        azimuth_rad=part % 1.0 * 2.0 * np.pi, site_deg=np.tile(SITE_DEG, (len(level), 1)), level=level, bits=4,
    )  # fmt: skip


@pytest.fixture
def watch(browser: Any, tmp_path: Path) -> Iterator[Watch]:
    """The page on a small sea with one radar whose picture goes on."""
    latitude, longitude = SITE_DEG.tolist()
    radar = Radar(name="north", latitude_deg=latitude, longitude_deg=longitude, range_nm=3.0, rpm=25.0)
    video, stop = LiveVideo(sensors_of((radar,), (), (), ()).radars), threading.Event()

    def go_on() -> None:
        while not stop.wait(0.3):
            video.take_as_sent(turn())

    with open_store(str(tmp_path / "sea.db")) as opened:
        run_id = store_world.begin(opened)
        for number in range(4):
            store_world.write(opened, run_id, number, 60)
        with following(opened, None, poll_s=0.05) as service:
            service.video = video
            with listening(service, web=WEB) as address:
                wait_for(lambda: service.hub.picture)
                thread = threading.Thread(target=go_on)
                thread.start()
                made = Watch(browser.new_page(viewport=SIZE), int(address.rpartition(":")[2]))
                made.open(f"{VIEW}&layers=video")
                yield made
                assert made.errors == []
                stop.set()
                thread.join()


def drawn(watch: Watch, azimuth_rad: float, range_m: float) -> np.ndarray:
    """The colours of the chart about a place. (5, 5, 3)"""
    latitude, longitude = offset_deg(SITE_DEG, range_m * np.array([np.sin(azimuth_rad), np.cos(azimuth_rad)])).tolist()
    watch.ask("new Promise(done => coastwatch.map.once('render', () => requestAnimationFrame(done)).triggerRepaint())")
    x, y = watch.ask(
        f"(() => {{ const p = coastwatch.map.project([{longitude}, {latitude}]), box = coastwatch.map.getCanvas().getBoundingClientRect();"
        "return [p.x + box.left, p.y + box.top]; })()"
    )
    taken = watch.page.screenshot(clip={"x": round(x) - 2, "y": round(y) - 2, "width": 5, "height": 5})
    return np.asarray(Image.open(io.BytesIO(taken)).convert("RGB"), np.float64)


def is_shown(watch: Watch, azimuth_rad: float, range_m: float, colours: list[np.ndarray]) -> bool:
    """Whether a place has one of these colours before long: a busy browser draws the chart before the video."""
    end = time.monotonic() + ANY_TIME_S
    while not (shown := is_one_of(drawn(watch, azimuth_rad, range_m), colours)) and time.monotonic() < end:
        pass
    return shown


def is_one_of(pixels: np.ndarray, colours: list[np.ndarray]) -> bool:
    return any(bool((np.abs(np.median(pixels, axis=(0, 1)) - colour) <= SHADE).all()) for colour in colours)


def test_pixels_are_lit_where_an_echo_is_and_a_replay_has_none(watch: Watch) -> None:
    watch.until("coastwatch.video.picture.radars.get(0)?.cells.some(cell => cell)")
    for theme in ("day", "dusk", "night"):
        watch.ask(f"(coastwatch.state.theme = '{theme}', coastwatch.themeChanged())")
        colours = watch.ask("(({sea, land, echo}) => ({sea, land, echo}))(coastwatch.theme())")
        echo, grounds = np.array(colours["echo"]), [np.array(colours[name]) for name in ("sea", "land")]
        lit = [OPACITY * echo + (1.0 - OPACITY) * ground for ground in grounds]
        assert is_shown(watch, ECHO_RAD, ECHO_M, lit), theme
        for azimuth_rad, range_m in ((ECHO_RAD + np.pi, ECHO_M), (ECHO_RAD, 0.9 * ECHO_M), (ECHO_RAD - 0.06, ECHO_M)):
            assert is_shown(watch, azimuth_rad, range_m, grounds), (theme, azimuth_rad, range_m)
        if theme == "night":
            linear = ((drawn(watch, ECHO_RAD, ECHO_M) / 255.0 + 0.055) / 1.055) ** 2.4
            assert (linear @ [0.2126, 0.7152, 0.0722]).max() < 1.1 * NIGHT
    watch.ask("(coastwatch.openDrawer('layers'), 0)")
    watch.page.locator("#gain").fill("0.5")
    half = [0.5 * OPACITY * echo + (1.0 - 0.5 * OPACITY) * ground for ground in grounds]
    assert is_shown(watch, ECHO_RAD, ECHO_M, half)
    watch.ask(f"coastwatch.replay.enter({store_world.instant_s(1)})")
    assert "replay" in watch.ask("document.getElementById('video-words').textContent")
    assert watch.ask("coastwatch.video.picture.radars.size") == 0
    assert is_shown(watch, ECHO_RAD, ECHO_M, grounds)
    watch.ask("coastwatch.replay.leave()")
    watch.until("coastwatch.video.picture.radars.get(0)?.cells.some(cell => cell)")
    assert is_shown(watch, ECHO_RAD, ECHO_M, half)
    latitude, longitude = SITE_DEG.tolist()
    place = f"latitude_deg: {latitude}, longitude_deg: {longitude}, range_m: 6000"
    watch.ask(f"(coastwatch.sensors = [{{kind: 'radar', name: coastwatch.video.picture.names[0], {place}}}], 0)")
    watch.ask(f"(coastwatch.map.jumpTo({{center: [{longitude + 5.0}, {latitude}]}}), 0)")
    watch.until("document.getElementById('video-words').textContent === 'No radar is in view.'")
    watch.ask(f"(coastwatch.map.jumpTo({{center: [{longitude}, {latitude}]}}), 0)")
    watch.until("document.getElementById('video-words').textContent === ''")
    watch.page.get_by_label("Radar video").uncheck()
    assert is_shown(watch, ECHO_RAD, ECHO_M, grounds)
