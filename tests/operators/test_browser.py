"""The page of the map in a real Chromium: it draws, follows, selects, searches, filters, replays, and survives a restart."""

from __future__ import annotations

import io
import json
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx2 as httpx
import numpy as np
import pytest
import store_world
from browser_world import ANY_TIME_S, SIZE, Watch, grave_faults
from PIL import Image
from server_world import listening, wait_for

from coastwatch.batches import Flag
from coastwatch.centre import Cycle
from coastwatch.geodesy import KNOT_M_S
from coastwatch.operators.api import people
from coastwatch.operators.api.application import WEB
from coastwatch.operators.api.guard import Guard
from coastwatch.operators.cli import main
from coastwatch.operators.cli.serving import bound, following
from coastwatch.store import Store, open_store
from scaling.page.fleet import served_fleet

pytestmark = pytest.mark.whole

VESSELS = 60
SHADE = 4  # of 255, between a colour of the theme and a pixel of it
DARK, IN_DISTRESS = 4, 10  # vessel ids
UNSENT_DEG = 11.0 / 111_120.0  # the server sends a vessel again when it is 10 m from where the page draws it; 1 m for rounding
TOLD_S = 10.0  # 1 s is asked, measured in scaling/results/page.md


def cycle_of(number: int, dark: Sequence[int] = (DARK,)) -> Cycle:
    """A cycle of the small sea with dark vessels and a man overboard."""
    picture = store_world.picture_of(number, VESSELS)
    flags = np.where(np.isin(picture.vessel_id, dark), int(Flag.DARK), 0)
    flags |= np.where(picture.vessel_id == IN_DISTRESS, int(Flag.MAN_OVERBOARD), 0)
    return store_world.cycle_of(number, VESSELS, replace(picture, flags=flags))


class World:
    """A server on a growing database, which can be killed and started again at the same port."""

    def __init__(self, folder: Path) -> None:
        self.number = self.port = 0
        self._opened, self._server = ExitStack(), ExitStack()
        self.url = f"sqlite:///{folder / 'sea.db'}"
        self.store: Store = self._opened.enter_context(open_store(self.url))
        self.run_id = store_world.begin(self.store)
        for _ in range(4):
            self.write()
        self.start()

    def write(self, dark: Sequence[int] = (DARK,)) -> None:
        """One cycle more."""
        store_world.write(self.store, self.run_id, self.number, VESSELS, cycle=cycle_of(self.number, dark))
        self.number += 1

    def raise_alarms(self, after: int, count: int) -> list[int]:
        """One cycle more, in which some vessels are dark too: the first ones after a vessel id. Returns: their ids."""
        there = store_world.picture_of(self.number, VESSELS).vessel_id
        more = [int(number) for number in there[there > after][:count]]
        self.write((DARK, *more))
        return more

    def start(self) -> None:
        service = self._server.enter_context(following(self.store, None, poll_s=0.05))
        address = self._server.enter_context(listening(service, web=WEB, port=self.port))
        wait_for(lambda: service.hub.picture)
        self.port = int(address.rpartition(":")[2])

    def stop(self) -> None:
        self._server.close()

    def close(self) -> None:
        self.stop()
        self._opened.close()


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    made = World(tmp_path_factory.mktemp("page"))
    yield made
    made.close()


@pytest.fixture(scope="module")
def opened(browser: Any, world: World) -> Iterator[Watch]:
    """One page for all tests: loading it takes most of the time."""
    watch = Watch(browser.new_page(viewport=SIZE), world.port)
    watch.open()
    yield watch
    assert watch.errors == []


@pytest.fixture
def watch(opened: Watch) -> Watch:
    """The page with nothing selected, no filter and no drawer."""
    opened.ask("(coastwatch.select(0), coastwatch.openDrawer(''), document.activeElement.blur())")
    return opened


def test_it_draws_the_vessels_of_the_server_and_follows(world: World, watch: Watch) -> None:
    assert watch.ask("coastwatch.live.vessels") == len(store_world.present(0, VESSELS).nonzero()[0])
    before = watch.ask("coastwatch.live.seq")
    world.write()
    watch.until("coastwatch.live.seq", lambda seq: seq > before)
    assert watch.ask("coastwatch.stats.refused") == []
    latitude = watch.ask("coastwatch.live.position(coastwatch.live.slotOf.get(5), coastwatch.live.at)[0]")
    sent = float(store_world.picture_of(world.number - 1, VESSELS).position_deg[4, 0])
    assert latitude == pytest.approx(sent, abs=UNSENT_DEG)


def test_pixels_are_lit_where_a_vessel_is_drawn_and_a_click_selects_it(watch: Watch) -> None:
    x, y = watch.ask(
        "(() => { const slot = coastwatch.live.slotOf.get(9), [lat, lon] = coastwatch.live.position(slot, coastwatch.clock());"
        "const p = coastwatch.map.project([lon, lat]), box = coastwatch.map.getCanvas().getBoundingClientRect();"
        "return [p.x + box.left, p.y + box.top]; })()"
    )
    lit = watch.ask(
        "new Promise(done => { coastwatch.map.once('render', () => { const gl = coastwatch.map.getCanvas().getContext('webgl2');"
        "const slot = coastwatch.live.slotOf.get(9), [lat, lon] = coastwatch.live.position(slot, coastwatch.clock());"
        "const p = coastwatch.map.project([lon, lat]), r = coastwatch.map.getPixelRatio(), n = 12, data = new Uint8Array(4 * n * n);"
        "gl.readPixels(p.x * r - n / 2, gl.drawingBufferHeight - p.y * r - n / 2, n, n, gl.RGBA, gl.UNSIGNED_BYTE, data);"
        "let dark = 0; for (let k = 0; k < data.length; k += 4) if (data[k] < 100 && data[k + 2] < 140) dark++; done(dark); });"
        "coastwatch.map.triggerRepaint(); })"
    )
    assert lit > 5
    watch.page.mouse.click(x, y)
    watch.until("coastwatch.state.selected", lambda number: number == 9)
    watch.until("document.querySelector('#why table')?.textContent ?? ''", lambda text: "1009" in text)  # its radar track
    watch.page.keyboard.press("f")
    watch.until("location.search", lambda query: "vessel=9" in query and "follow=1" in query)


def test_search_finds_by_mmsi_and_the_keyboard_takes_the_first_hit(watch: Watch) -> None:
    watch.page.keyboard.press("/")
    watch.page.keyboard.type("710000021")
    watch.until("document.querySelectorAll('#hits li strong').length", lambda hits: hits == 1)
    watch.page.keyboard.press("Enter")
    watch.until("coastwatch.state.selected", lambda number: number == 22)


def test_the_list_sorts_and_the_filters_hide_all_but_alarms(watch: Watch) -> None:
    watch.page.keyboard.press("t")
    first = "Number(document.querySelector('#rows .row')?.dataset.id)"
    watch.until(first, lambda number: number == IN_DISTRESS)  # gravest flags first
    watch.page.click("#list-head .sog button")
    watch.until("document.querySelector('#rows .row .sog').textContent", lambda text: text == "19.0")
    watch.ask("coastwatch.openDrawer('layers')")
    watch.page.uncheck("#filter-radar")
    watch.page.uncheck("#filter-ais")
    watch.page.fill("#filter-minsog", "50")
    ids = "[...coastwatch.picture.id].filter((_, slot) => coastwatch.shown[slot]).sort((a, b) => a - b)"
    watch.until(ids, lambda shown: shown == [DARK, IN_DISTRESS])
    assert watch.ask("document.getElementById('filter-words').textContent").startswith("Filter: sources: bearing, from 50 kn")
    watch.ask("document.activeElement.blur()")
    watch.page.keyboard.press("Shift+Digit1")
    watch.page.click("#no-filter")
    watch.until("[...coastwatch.shown].filter(Boolean).length", lambda shown: shown > 50)
    watch.page.keyboard.press("1")  # the view that was kept
    watch.until(ids, lambda shown: shown == [DARK, IN_DISTRESS])
    assert watch.ask("document.getElementById('filter-minsog').value") == "50"
    watch.page.click("#no-filter")


def test_alarms_are_listed_and_lead_to_the_vessel(watch: Watch) -> None:
    watch.until("coastwatch.alarms.count()", lambda count: count >= 2)
    watch.page.click("#open-alarms")
    watch.until("document.querySelectorAll('#alarm-rows li.open').length", lambda rows: rows >= 2)
    watch.page.keyboard.press("Escape")
    watch.page.keyboard.press("n")
    assert watch.until("coastwatch.state.selected") in (DARK, IN_DISTRESS)
    assert watch.ask("coastwatch.shown[coastwatch.selectedSlot()]") == 2  # it flashes
    watch.page.keyboard.press("a")  # nobody has given a name yet
    watch.until("document.activeElement.id", lambda name: name == "watch-name")


def test_an_alarm_is_acknowledged_here_and_one_that_another_page_acknowledged_goes(watch: Watch) -> None:
    address = f"http://127.0.0.1:{watch.port}/api/v1/alarms"
    first = watch.until("coastwatch.alarms.first()?.alarm_id")
    watch.ask("coastwatch.openDrawer('alarms')")
    watch.page.fill("#watch-name", "Ana")
    watch.page.click("#strip-acknowledge")
    done = "[...document.querySelectorAll('#alarm-rows li.done')].map((row) => row.textContent).join()"
    watch.until(done, lambda text: "acknowledged by Ana" in text)
    rows = httpx.get(address).json()["alarms"]
    assert {row["alarm_id"] for row in rows if row["acknowledged_by"] == "Ana"} == {first}
    other = next(row["alarm_id"] for row in rows if row["acknowledged_by"] is None)
    began = time.monotonic()
    httpx.post(f"{address}/{other}/acknowledge", json={"name": "Rui"}).raise_for_status()
    watch.until(done, lambda text: "acknowledged by Rui" in text)
    watch.until(f"!document.querySelector('#alarm-rows li.open[data-alarm=\"{other}\"]')")
    assert time.monotonic() - began < TOLD_S


@pytest.mark.parametrize("width", [1024, 1280, 1920])
def test_nothing_is_cut_off_or_overhangs(watch: Watch, width: int) -> None:
    watch.page.set_viewport_size({"width": width, "height": 700})
    outside = """(() => { const box = (of) => of.getBoundingClientRect(), found = [];
      for (const of of document.querySelectorAll('header, footer > div, #drawer, #panel')) for (const part of of.querySelectorAll('*'))
        if (box(part).width > 1 && !part.closest('#hits, #list-scroll, option, svg, table')
          && (box(part).left < box(of).left - 1 || box(part).right > box(of).right + 1)) found.push(part.id || part.outerHTML.slice(0, 80));
      const search = document.getElementById('search');
      if (search.scrollWidth > search.clientWidth) found.push('search');
      for (const cut of [document.getElementById('title'), document.getElementById('counts')])
        if (cut.clientWidth > 1 && innerWidth < 1500 && cut.scrollWidth > cut.clientWidth) found.push(cut.id);
      return found; })()"""
    try:
        watch.ask(f"coastwatch.select({DARK})")
        for drawer in ("vessels", "alarms", "zones", "layers"):
            watch.ask(f"coastwatch.openDrawer('{drawer}')")
            assert watch.ask(outside) == [], drawer
            assert watch.ask("document.getElementById('chart').clientWidth") >= 300, drawer
    finally:
        watch.page.set_viewport_size(SIZE)


def test_the_panel_has_the_tracks_and_statistics_of_coastwatch_track(
    world: World, watch: Watch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["track", "12", "--db", world.url, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    watch.ask("coastwatch.select(12)")
    rows = """(() => Object.fromEntries([...document.querySelectorAll('#why table')].map(table => [table.caption.textContent,
      [...table.tBodies[0].rows].map(row => [...row.cells].map(cell => cell.textContent))])))()"""
    shown = {name.partition(" (")[0]: found for name, found in watch.until(rows).items()}
    assert [row[:2] for row in shown["Contributing tracks"]] == [
        [row["source"], str(row["track_id"])] for row in told["members"]
    ]
    newest = sorted(told["associations"], key=lambda row: row["time_utc"], reverse=True)[: len(shown["Associations"])]
    assert [(row[0], row[3]) for row in shown["Associations"]] == [
        (row["time_utc"][11:19], f"{row['statistic']:.4g}") for row in newest
    ]
    assert len(newest) > 1


def test_every_key_works_without_a_mouse(world: World, watch: Watch) -> None:
    press, ask = watch.page.keyboard.press, watch.ask

    def tab_to(name: str) -> None:
        """Go to an element with the tabulator, and see where the focus is on the way."""
        for _ in range(120):
            if ask("document.activeElement.id") == name:
                return
            press("Tab")
            ring = ask("[getComputedStyle(document.activeElement).outlineStyle, document.activeElement.outerHTML.slice(0, 80)]")
            assert ring[0] != "none" or ring[1].startswith("<body"), ring
        raise AssertionError(f"the tabulator does not reach {name}")

    press("/")
    watch.page.keyboard.type("710000023")
    press("Enter")  # before the server has answered
    first = watch.until("coastwatch.state.selected", lambda number: number == 24)
    press("f")
    assert ask("coastwatch.state.follow")
    for key in ("c", "t", "Home"):
        press(key)
    other = watch.until("coastwatch.state.selected", lambda number: number != first)
    press("ArrowDown")
    watch.until("coastwatch.state.selected", lambda number: number not in (first, other))
    watch.until("document.getElementById('second').textContent", lambda text: "TCPA" in text)
    press("t")
    press("m")
    at = ask("coastwatch.map.getCenter().lng")
    press("ArrowRight")
    watch.until("[coastwatch.map.getCenter().lng, coastwatch.measure.to?.lon ?? -180]", lambda longitudes: min(longitudes) > at)
    for _ in range(3):  # the measure, the second vessel, the selected one
        press("Escape")
    assert ask("[coastwatch.measure, coastwatch.second, coastwatch.state.selected]") == [None, 0, 0]
    zoom = ask("coastwatch.map.getZoom()")
    press("+")
    watch.until("coastwatch.map.getZoom()", lambda now: now > zoom + 0.9)
    press("-")
    watch.until("coastwatch.map.getZoom()", lambda now: abs(now - zoom) < 0.1)
    press("?")
    assert ask("document.getElementById('help').open")
    press("Escape")
    assert not ask("document.getElementById('help').open")
    key = "new KeyboardEvent('keydown', {key: 'm', bubbles: true})"  # until its next drawing the browser sends keys there
    assert ask(f"(document.getElementById('close-help').dispatchEvent({key}), coastwatch.measure !== null)")
    press("m")
    ask("{ const r = coastwatch.replay, play = r.play.bind(r); r.play = on => { play(on); coastwatch.began = r.playing; }; }")
    press("Space")  # the short past may be over before a busy machine asks
    assert watch.until("coastwatch.began")
    press("l")
    assert ask("coastwatch.replay.at") is None
    tab_to("time")
    press("ArrowLeft")
    watch.until("coastwatch.replay.at")
    ask("document.activeElement.blur()")
    press("l")

    tab_to("open-alarms")
    press("Enter")
    tab_to("watch-name")
    watch.page.keyboard.type("Eva")
    press("Enter")
    more = world.raise_alarms(after=30, count=2)
    waiting = "[...document.querySelectorAll('#alarm-rows li.open')].map(row => Number(row.dataset.alarm.split('-')[0]))"
    watch.until(waiting, lambda ids: set(more) <= set(ids))
    press("n")  # distress comes first, unless another test has acknowledged it
    assert watch.until("coastwatch.state.selected") in (IN_DISTRESS, *more)
    before = ask("coastwatch.alarms.count()")
    press("a")
    watch.until("coastwatch.alarms.count()", lambda count: count == before - 1)
    world.write()

    tab_to("open-zones")
    press("Enter")
    tab_to("zone-name")
    watch.page.keyboard.type("by keys")
    tab_to("zone-draw")
    press("Enter")
    for key in ("ArrowRight", "ArrowDown", "ArrowLeft"):
        press("Enter")
        centre = ask("coastwatch.map.getCenter().toString()")
        press(key)
        watch.until(
            "coastwatch.map.isMoving() ? '' : coastwatch.map.getCenter().toString()",
            lambda now, was=centre: now not in ("", was),
        )
    tab_to("zone-save")
    press("Enter")
    watch.until("document.getElementById('zone-rows').textContent", lambda text: "by keys polygon" in text)
    zones = f"http://127.0.0.1:{watch.port}/api/v1/zones"
    (zone,) = httpx.get(zones).json()["features"]
    assert len(zone["properties"]["points_deg"]) == 3
    httpx.delete(f"{zones}/{zone['id']}").raise_for_status()
    tab_to("open-layers")
    press("Enter")
    press("Escape")
    press("Escape")
    assert ask("coastwatch.state.drawer") == ""


def test_each_theme_is_drawn_in_its_colours_and_by_night_no_pixel_is_brighter_than_the_table(watch: Watch) -> None:
    ground = "(({sea, land}) => ({sea, land}))(coastwatch.theme())"
    box = watch.page.locator("#chart").bounding_box()
    middle = {
        "x": box["x"],
        "y": box["y"] + 60,
        "width": box["width"],
        "height": box["height"] - 120,
    }  # without the words at its edges
    try:
        for theme in ("day", "dusk", "night"):
            watch.ask(f"(coastwatch.state.theme = '{theme}', coastwatch.themeChanged())")
            watch.ask("new Promise(done => coastwatch.map.once('idle', () => done(0)).triggerRepaint())")
            colours = watch.ask(ground)
            taken = np.asarray(Image.open(io.BytesIO(watch.page.screenshot(clip=middle))).convert("RGB"), np.float64)
            even = [np.abs(taken - colours[name]).max(axis=2) <= SHADE for name in ("sea", "land")]
            assert (even[0] | even[1]).mean() > 0.5, theme
            brightest = luminance(taken).max()
            if theme == "night":
                table = luminance(np.array([43.0, 48.0, 48.0]))
                assert 0.8 * table < brightest < 1.1 * table
            elif theme == "day":
                assert luminance(taken).min() < 0.02
    finally:
        watch.ask("(coastwatch.state.theme = 'day', coastwatch.themeChanged())")


def luminance(colour: np.ndarray) -> np.ndarray:
    """Relative luminance. Args: colour: (..., 3) of 255. Source: W3C, WCAG 2.2, "relative luminance"."""
    share = colour / 255.0
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return linear @ np.array([0.2126, 0.7152, 0.0722])


def test_a_replay_at_sixty_times_shows_each_vessel_where_it_was_and_l_returns_to_live(world: World, watch: Watch) -> None:
    for _ in range(40):
        world.write()
    last_s = store_world.instant_s(world.number - 1)
    watch.until("coastwatch.live.at", lambda at: at == last_s)
    speed_deg_s = (4 * KNOT_M_S) / 111_120.0  # of vessel 5, to the north
    first = watch.ask("(coastwatch.state.speed = 60, coastwatch.replay.play(true), coastwatch.replay.at)")
    shown = """(() => { const {picture, at} = coastwatch.replay, slot = picture.slotOf.get(5);
      return [at === null ? 0 : picture.at, slot === undefined ? null : picture.lat[slot] / 1e7]; })()"""
    seen: dict[float, float | None] = {}
    while watch.ask("coastwatch.replay.playing"):
        at, latitude = watch.ask(shown)
        if at >= first:
            seen[at] = latitude
    assert len(seen) >= 3
    for at, latitude in seen.items():
        number = int((at - store_world.START_S) // store_world.PERIOD_S) - 1
        if not store_world.present(number, VESSELS)[4]:
            assert latitude is None
            continue
        (row,) = np.flatnonzero(store_world.picture_of(number, VESSELS).vessel_id == 5)
        then = float(store_world.picture_of(number, VESSELS).position_deg[row, 0])
        assert latitude == pytest.approx(then + speed_deg_s * (at - store_world.instant_s(number)), abs=2e-6), at
    watch.page.keyboard.press("l")
    assert watch.ask("[coastwatch.picture === coastwatch.live, coastwatch.live.at]") == [True, last_s]


def test_the_past_is_shown_as_stored_and_l_returns_to_the_live_picture(watch: Watch) -> None:
    at_s = store_world.instant_s(1)
    watch.ask(f"coastwatch.replay.enter({at_s})")
    watch.until("coastwatch.picture === coastwatch.replay.picture && coastwatch.picture.at", lambda at: at == at_s)
    latitude = watch.ask("coastwatch.picture.lat[coastwatch.picture.slotOf.get(5)] / 1e7")
    assert latitude == pytest.approx(float(store_world.picture_of(1, VESSELS).position_deg[4, 0]), abs=1e-6)
    assert watch.ask("document.getElementById('badge').textContent") == "REPLAY"
    watch.page.keyboard.press("l")
    assert watch.ask("coastwatch.picture === coastwatch.live")


def test_a_zone_is_drawn_on_the_chart_saved_and_deleted(world: World, watch: Watch) -> None:
    address = f"http://127.0.0.1:{watch.port}/api/v1/zones"
    watch.ask("coastwatch.openDrawer('zones')")
    watch.page.fill("#zone-name", "ring")
    watch.page.select_option("#zone-kind", "circle")  # begins to draw
    watch.page.check("#zone-enter")
    box = watch.page.locator("#map").bounding_box()
    for across in (0.87, 0.96):  # beside the drawer
        watch.page.mouse.click(box["x"] + across * box["width"], box["y"] + 0.5 * box["height"])
        time.sleep(0.4)  # else the map takes them for a double click
    watch.until("!document.getElementById('zone-save').disabled")
    watch.page.click("#zone-save")
    watch.until("document.getElementById('zone-rows').textContent", lambda text: "ring circle: enter" in text)
    (zone,) = httpx.get(address).json()["features"]
    assert zone["properties"]["enter"]
    assert zone["properties"]["radius_nm"] > 0.1
    assert watch.ask("coastwatch.state.selected") == 0  # a click while drawing selects nothing
    watch.page.click("#zone-rows button[aria-label='Change ring']")
    own = zone["properties"]
    theirs = {name: own[name] for name in ("name", "kind", "centre_deg", "radius_nm")} | {"max_speed_kn": 7.0}
    httpx.put(f"{address}/{zone['id']}", json=theirs).raise_for_status()  # another operator, meanwhile
    watch.page.click("#zone-save")
    watch.until("document.getElementById('message').textContent", lambda text: "changed it meanwhile" in text)
    assert httpx.get(f"{address}/{zone['id']}").json()["properties"]["max_speed_kn"] == 7.0
    watch.until("document.getElementById('zone-rows').textContent", lambda text: "over 7 kn" in text)
    watch.page.once("dialog", lambda dialog: dialog.accept())
    watch.page.click("#zone-rows button[aria-label='Delete ring']")
    watch.until("document.getElementById('zone-rows').textContent", lambda text: text == "no zones")


def test_a_corner_is_undone_the_shape_ended_and_a_zone_without_rules_said_so(watch: Watch) -> None:
    address = f"http://127.0.0.1:{watch.port}/api/v1/zones"
    watch.ask("coastwatch.openDrawer('zones')")
    watch.page.fill("#zone-name", "quiet")
    watch.page.click("#zone-draw")
    box = watch.page.locator("#map").bounding_box()
    corners = "document.getElementById('zone-hint').textContent"

    def at(across: float, down: float) -> tuple[float, float]:
        return box["x"] + across * box["width"], box["y"] + down * box["height"]

    for place in ((0.85, 0.3), (0.96, 0.3), (0.96, 0.6)):
        watch.page.mouse.click(*at(*place))
        time.sleep(0.4)  # else the map takes them for a double click
    watch.until(corners, lambda text: "So far: 3." in text)
    watch.page.keyboard.press("Backspace")
    watch.until(corners, lambda text: "So far: 2." in text)
    zoom = watch.ask("coastwatch.map.getZoom()")
    watch.page.mouse.dblclick(*at(0.9, 0.7))  # the last corner, once
    watch.until("!coastwatch.zones.drawing")
    assert watch.ask("[document.activeElement.id, coastwatch.map.getZoom()]") == ["zone-save", zoom]
    watch.page.keyboard.press("Enter")
    watch.until("document.getElementById('message').textContent", lambda text: "raises no alarm" in text)
    (zone,) = httpx.get(address).json()["features"]
    assert len(zone["properties"]["points_deg"]) == 3
    httpx.delete(f"{address}/{zone['id']}").raise_for_status()


def test_shown_alarms_are_acknowledged_together_and_a_replay_has_no_ring_of_now(world: World, watch: Watch) -> None:
    more = world.raise_alarms(after=45, count=3)
    watch.until("[...coastwatch.alarms.flashing]", lambda ids: set(more) <= set(ids))
    lit = "coastwatch.shown.filter((state) => state === 2).length"
    assert watch.until(lit) >= 3
    watch.ask(f"coastwatch.replay.enter({store_world.instant_s(1)})")
    watch.until(lit, lambda count: count == 0)
    watch.page.keyboard.press("l")
    watch.until(lit)
    watch.ask("coastwatch.openDrawer('alarms')")
    watch.page.fill("#watch-name", "Ana")
    watch.page.fill("#alarm-note", "exercise")
    watch.page.select_option("#alarm-kind", "dark")
    assert "to acknowledge" in watch.ask("document.getElementById('alarm-words').textContent")
    watch.page.once("dialog", lambda dialog: dialog.accept())
    for _ in range(4):
        watch.page.keyboard.press("Tab")
        if watch.ask("document.activeElement.id") == "acknowledge-shown":
            break
    watch.page.keyboard.press("Enter")
    watch.until("document.getElementById('alarm-words').textContent", lambda text: text == "Nothing to acknowledge.")
    rows = httpx.get(f"http://127.0.0.1:{watch.port}/api/v1/alarms?kind=dark&state=all").json()["alarms"]
    said = {row["vessel_id"]: (row["acknowledged_by"], row["note"]) for row in rows if row["vessel_id"] in more}
    assert said == dict.fromkeys(more, ("Ana", "exercise"))
    watch.page.select_option("#alarm-kind", "")
    world.write()


def test_axe_finds_no_serious_fault_in_any_theme(watch: Watch) -> None:
    watch.ask(f"(coastwatch.select({DARK}), coastwatch.openDrawer('vessels'))")
    watch.until("document.querySelectorAll('#why table').length")
    for theme, drawer in (("day", "vessels"), ("dusk", "alarms"), ("night", "layers"), ("day", "zones")):
        watch.ask(f"(coastwatch.state.theme = '{theme}', coastwatch.themeChanged(), coastwatch.openDrawer('{drawer}'))")
        assert grave_faults(watch) == [], theme
    watch.ask("document.getElementById('help').showModal()")
    assert grave_faults(watch) == []
    watch.ask("document.getElementById('help').close()")


def test_it_survives_a_restart_of_the_server(world: World, watch: Watch) -> None:
    watch.until("coastwatch.live.at", lambda at: at == store_world.instant_s(world.number - 1))
    before, ids = watch.ask("[coastwatch.live.run, [...coastwatch.live.slotOf.keys()].sort()]")
    watch.ask("coastwatch.openDrawer('alarms')")
    world.stop()
    watch.until("document.getElementById('badge').textContent", lambda text: text.startswith("NO CONNECTION"))
    said = "document.getElementById('alarm-words').textContent"
    watch.until(said, lambda text: text == "Not up to date: the server does not answer.")
    world.start()
    watch.until(said, lambda text: "to acknowledge" in text)
    watch.until("coastwatch.live.run", lambda run: run != before)
    watch.until("document.getElementById('badge').textContent", lambda text: not text.startswith("NO CONNECTION"))
    assert watch.ask("[...coastwatch.live.slotOf.keys()].sort()") == ids


def test_no_request_leaves_loopback(watch: Watch) -> None:
    assert len(watch.requests) > 10
    allowed = (f"http://127.0.0.1:{watch.port}/", f"blob:http://127.0.0.1:{watch.port}/", "data:")
    assert [url for url in watch.requests if not url.startswith(allowed)] == []


@pytest.mark.slow
def test_after_kill_9_of_the_server_the_page_follows_the_next_one_within_15_seconds(world: World, browser: Any) -> None:
    with bound("127.0.0.1", 0) as free:
        port = free.getsockname()[1]
    code = "import sys; from coastwatch.operators.cli import main; sys.exit(main())"
    line = [sys.executable, "-c", code, "serve", "--db", world.url, "--port", str(port)]

    def started() -> subprocess.Popen[bytes]:
        made = subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        wait_for(lambda: _answers(f"http://127.0.0.1:{port}/readyz"), ANY_TIME_S)
        return made

    server = started()
    watch = Watch(browser.new_page(viewport=SIZE), port)
    try:
        watch.open()
        run, ids = watch.ask("[coastwatch.live.run, [...coastwatch.live.slotOf.keys()].sort()]")
        server.kill()
        server.wait()
        watch.until("document.getElementById('badge').textContent", lambda text: text.startswith("NO CONNECTION"))
        server = started()
        began = time.monotonic()
        watch.until("coastwatch.live.run", lambda now: now != run)
        assert time.monotonic() - began < 15.0
        assert watch.ask("[...coastwatch.live.slotOf.keys()].sort()") == ids
        assert watch.errors == []
    finally:
        server.kill()
        server.wait()
        watch.page.close()


def _answers(address: str) -> bool:
    with suppress(httpx.TransportError):
        return httpx.get(address).status_code == 200
    return False


def test_without_an_area_all_vessels_come_into_sight(browser: Any, tmp_path: Path) -> None:
    with served_fleet(200, 1, tmp_path, WEB) as address:
        watch = Watch(browser.new_page(viewport=SIZE), int(address.rpartition(":")[2]))
        watch.open("")
        assert watch.ask("coastwatch.live.vessels") == 200
        inside = "[...coastwatch.live.slotOf.values()].every(slot => coastwatch.map.getBounds().contains("
        assert watch.ask(inside + "[coastwatch.live.lon[slot] / 1e7, coastwatch.live.lat[slot] / 1e7]))")
        assert watch.errors == []
        watch.page.close()


def test_a_token_is_asked_for_and_opens_the_page(world: World, browser: Any, tmp_path: Path) -> None:
    made = people.add(tmp_path / "tokens.toml", "ana", "viewer", None)
    guard = Guard(tokens=people.Tokens(tmp_path / "tokens.toml"))
    with following(world.store, None, poll_s=0.05) as service, listening(service, guard, web=WEB) as address:
        wait_for(lambda: service.hub.picture)
        watch = Watch(browser.new_page(viewport=SIZE), int(address.rpartition(":")[2]))
        watch.page.goto(f"http://{address}/")
        watch.until("document.getElementById('login').open")
        watch.page.fill("#token", made)
        watch.page.keyboard.press("Enter")
        watch.until("window.coastwatch?.status?.role ?? ''", lambda role: role == "viewer")
        assert watch.ask("document.getElementById('login').open") is False
        assert made not in watch.ask("document.cookie + location.href")
        watch.page.close()
