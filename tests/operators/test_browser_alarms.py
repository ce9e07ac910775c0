"""The page in a real Chromium when much is wrong: distress before all else, alarms of sensors, troubles of the server, lost streams."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from alarm_world import begun
from browser_world import SIZE, Watch, grave_faults
from server_world import listening

from coastwatch.batches import Flag
from coastwatch.operators.api.application import WEB
from coastwatch.operators.api.service import Service
from coastwatch.server.alarm_book import Alarm
from coastwatch.server.troubles import Trouble, of_feeds
from coastwatch.stage import Plan
from coastwatch.store import Rows, begin_run, open_store
from scaling.page.fleet import NO_SENSORS, Fleet, Simulated

pytestmark = pytest.mark.whole

VESSELS, OVERBOARD, SEED = 2_000, 1_234, 5
PERIOD_S = 1.0
ROWS = "[...document.querySelectorAll('#alarm-rows li')]"
BADGE = "document.getElementById('badge').dataset.is + ': ' + document.getElementById('badge').textContent"
LISTED = "[...document.querySelectorAll('#trouble-rows li')].map(row => row.textContent)"


class Told(Simulated):
    """A source whose troubles a test sets."""

    def __init__(self) -> None:
        super().__init__()
        self.said: list[Trouble] = []
        self.why: str | None = None

    def error(self) -> str | None:  # type: ignore[override]
        return self.why

    def troubles(self) -> list[Trouble]:
        return self.said


class Sea:
    """A server with a live picture of a fleet, whose alarms a test raises."""

    def __init__(self, folder: Path) -> None:
        self._opened, self._stop, self.source = ExitStack(), threading.Event(), Told()
        store = self._opened.enter_context(open_store(str(folder / "fleet.db")))
        plan = Plan(start_s=time.time(), period_s=PERIOD_S, cycles=1_000_000)
        about: dict[str, Any] = {"title": "A fleet", "version": "", "settings": {}, "sensors": NO_SENSORS}
        self.run_id = begin_run(store, scenario="fleet", seed=SEED, plan=plan, **about)
        self.service = Service(store)
        self.service.source = self.source
        self.fleet = Fleet.of(VESSELS, SEED)
        self.begin()
        self._thread = threading.Thread(target=self._go_on)
        self._thread.start()
        self.port = int(self._opened.enter_context(listening(self.service, web=WEB)).rpartition(":")[2])

    def _go_on(self) -> None:
        cycle = 0
        while not self._stop.is_set():
            self.service.receive(self.fleet.picture(self.run_id, cycle, time.time()))
            cycle += 1
            self._stop.wait(PERIOD_S)

    def begin(self) -> None:
        """No alarm and no trouble."""
        self.source.alarms.begin(self.run_id)
        self.source.said, self.source.why = [], None
        self.fleet.flags = np.zeros(VESSELS, np.int64)

    def raise_alarms(self, *rows: tuple[int, str, float]) -> None:
        """Alarms of one cycle. Args: rows: vessel, kind, start in seconds from now."""
        places = np.stack([self.fleet.latitude_deg, self.fleet.longitude_deg], 1)
        there = places[[(vessel - 1) % VESSELS for vessel, _, _ in rows]]
        from_now = ((vessel, kind, time.time() + start) for vessel, kind, start in rows)
        self.source.alarms.apply(begun(*from_now, text="why it is", position_deg=there))

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self._opened.close()


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Sea]:
    found = Sea(tmp_path_factory.mktemp("fleet"))
    yield found
    found.close()


@pytest.fixture(scope="module")
def opened(browser: Any, made: Sea) -> Iterator[Watch]:
    """One page for all tests: loading it takes most of the time."""
    watch = Watch(browser.new_page(viewport=SIZE), made.port)
    watch.open("")
    yield watch
    assert watch.errors == []


@pytest.fixture
def sea(made: Sea, opened: Watch) -> Sea:
    """The sea with no alarm, which the page knows."""
    made.begin()
    opened.until("[coastwatch.alarms.failed, coastwatch.alarms.rows.length].join()", lambda said: said == ",0")
    return made


@pytest.fixture
def watch(opened: Watch, sea: Sea) -> Watch:
    """The page with the list of alarms."""
    opened.ask("(coastwatch.select(0), coastwatch.openTroubles(false), coastwatch.openDrawer('alarms'))")
    return opened


def test_a_man_overboard_is_the_first_row_and_flashes_though_2000_vessels_are_dark_in_the_same_cycle(
    sea: Sea, watch: Watch, record_property: Any
) -> None:
    dark = [(vessel, "dark", 0.0) for vessel in range(1, VESSELS + 1) if vessel != OVERBOARD]
    sea.fleet.flags = np.where(np.arange(1, VESSELS + 1) == OVERBOARD, int(Flag.MAN_OVERBOARD), int(Flag.DARK))
    asked = sum("/alarms?" in url for url in watch.requests)
    began_s = time.monotonic()
    sea.raise_alarms(*dark[:1000], (OVERBOARD, "man_overboard", -1.0), *dark[1000:])
    first = f"{ROWS}[0]?.textContent ?? ''"
    watch.until(first, lambda text: text.startswith(f"man overboard, #{OVERBOARD}"))
    flashes = "(id => getComputedStyle(id).animationName)"
    assert watch.ask(f"{flashes}({ROWS}[0])") == "flash"
    record_property("shown_s", round(time.monotonic() - began_s, 3))
    assert watch.ask(f"{flashes}(document.getElementById('strip'))") == "flash"
    assert "man overboard" in watch.ask("document.getElementById('strip-text').textContent")
    assert watch.ask(f"coastwatch.alarms.flashing.has({OVERBOARD})")
    watch.until("coastwatch.alarms.count()", lambda count: count == VESSELS)
    watch.until(first, lambda text: text.startswith(f"man overboard, #{OVERBOARD}"))
    watch.until(f"coastwatch.shown[coastwatch.live.slotOf.get({OVERBOARD})]", lambda shown: shown == 2)
    assert watch.ask("document.getElementById('strip-text').textContent").startswith(f"man overboard, #{OVERBOARD}")
    assert watch.ask(f"{ROWS}.filter(row => row.classList.contains('distress')).length") == 1
    assert watch.ask(f"{ROWS}.length") < 40, "only rows in sight are made"
    assert sum("/alarms?" in url for url in watch.requests) == asked, "the stream says everything"


def test_3000_later_alarms_leave_a_lasting_one_on_the_page_and_filters_reach_it(sea: Sea, watch: Watch) -> None:
    sea.raise_alarms((7, "dark", -600.0))
    sea.raise_alarms(*((10_000 + k, "ais_without_radar", -float(k % 60)) for k in range(3000)))
    watch.until("coastwatch.alarms.count()", lambda count: count == 3001)
    row = f"{ROWS}.find(row => row.dataset.alarm.startsWith('7-dark-'))"
    assert watch.ask(f"{row} === undefined"), "it is the last one"
    watch.ask("(box => { box.scrollTop = box.scrollHeight; })(document.getElementById('alarm-scroll'))")
    watch.until(f"Boolean({row})")
    inside = (
        f"{row}.getBoundingClientRect().bottom <= document.getElementById('alarm-scroll').getBoundingClientRect().bottom + 1"
    )
    assert watch.ask(inside)
    top = f"{ROWS}.at(-1).dataset.alarm"
    before = watch.ask(top)
    sea.raise_alarms((8, "man_overboard", 0.0))
    watch.until("coastwatch.alarms.count()", lambda count: count == 3002)
    assert watch.ask(top) == before, "what somebody looks at stays where it is"
    watch.page.select_option("#alarm-kind", "dark")
    watch.until(f"{ROWS}.map(row => row.dataset.alarm.split('-')[0]).join()", lambda ids: ids == "7")
    watch.page.select_option("#alarm-kind", "")


def test_an_alarm_of_a_sensor_is_listed_with_its_text_and_leads_to_no_vessel(sea: Sea, watch: Watch) -> None:
    columns, none = Alarm._fields, (None,) * 3
    silent = Alarm(
        0, "radar_silent", 3, time.time(), None, 0, None, None, None, None, None, "AIS station hill is silent", *none
    )
    sea.source.alarms.compare(Rows(columns, [tuple(silent)]))
    row = f"{ROWS}[0]"
    text = watch.until(f"{row}?.textContent ?? ''", lambda text: "radar silent" in text)
    assert "AIS station hill is silent" in text
    assert "#0" not in text
    assert watch.ask(f"{row}.querySelector('.plain').tagName") == "DIV"
    strip = watch.ask("document.getElementById('strip-text').textContent")
    assert strip.startswith("radar silent: AIS station hill is silent")
    assert watch.ask("document.getElementById('strip-show').hidden")
    assert watch.ask("coastwatch.alarms.flashing.size") == 0
    watch.ask("document.activeElement.blur()")
    watch.page.keyboard.press("n")
    assert watch.ask("coastwatch.state.selected") == 0
    sea.raise_alarms((9, "dark", -60.0))
    watch.until("coastwatch.alarms.count()", lambda count: count == 2)
    watch.page.keyboard.press("n")
    assert watch.ask("coastwatch.state.selected") == 9


def test_the_page_says_that_no_feed_is_heard_and_lists_what_is_wrong_and_since_when(sea: Sea, watch: Watch) -> None:
    watch.until(BADGE, lambda text: text.startswith("live: LIVE"))
    assert watch.ask("document.getElementById('troubles').hidden")
    now_s = time.time()
    feeds = [{"name": "north", "silent_s": 150.0, "error": None}, {"name": "south", "silent_s": 180.0, "error": None}]
    sea.source.said = [
        *of_feeds(feeds, now_s),
        Trouble("store", "", now_s - 20.0, "the database cannot be written: disk full", False),
    ]
    watch.until(BADGE, lambda text: text.startswith("late: NO FEED  3 min"))
    line = watch.ask("document.getElementById('open-troubles').textContent")
    assert "4 troubles" in line
    assert "Feed: no feed has been heard for 150 s · " in line
    assert watch.ask("document.getElementById('shout').textContent") == "Trouble: Feed: no feed has been heard for 150 s"
    watch.page.click("#open-troubles")
    rows = watch.ask(LISTED)
    assert [row.partition(" since ")[0].strip() for row in rows] == [
        "Feed no feed has been heard for 150 s",
        "Feed north nothing has come for 150 s",
        "Feed south nothing has come for 180 s",
        "Database the database cannot be written: disk full",
    ]
    assert all(" since " in row for row in rows)
    watch.page.keyboard.press("Escape")
    assert watch.ask("document.getElementById('trouble-rows').hidden")
    sea.source.said = sea.source.said[3:]
    watch.until(BADGE, lambda text: text.startswith("degraded: LIVE") and text.endswith("1 TROUBLE"))
    sea.source.why = "the run has failed: disk I/O error"
    watch.until(BADGE, lambda text: text == "late: RUN FAILED")
    assert "Run: the run has failed: disk I/O error" in watch.ask("document.getElementById('trouble-text').textContent")
    sea.begin()
    watch.until(BADGE, lambda text: text.startswith("live: LIVE"))
    assert watch.ask("document.getElementById('troubles').hidden")


@pytest.mark.parametrize("width", [1024, 1920])
def test_distress_and_troubles_fit_and_axe_finds_no_serious_fault_in_any_theme(sea: Sea, watch: Watch, width: int) -> None:
    long = "the database cannot be written: " + "database or disk is full, " * 12
    sea.source.said = [Trouble("feed", "", time.time() - 90.0, "no feed has been heard for 90 s", True)]
    sea.source.said += [Trouble("store", "", None, long, False)]
    sea.raise_alarms((OVERBOARD, "man_overboard", 0.0), *((k, "dark", -1.0) for k in range(1, 40)))
    watch.page.set_viewport_size({"width": width, "height": 700})
    outside = """(() => { const box = (of) => of.getBoundingClientRect(), found = [];
      for (const of of document.querySelectorAll('#strip, #troubles')) for (const part of [of, ...of.querySelectorAll('*')])
        if (box(part).width > 1 && (box(part).left < -1 || box(part).right > innerWidth + 1)) found.push(part.id || part.outerHTML);
      const high = box(document.getElementById('open-troubles')).height;
      if (high > 40) found.push(`a line of ${high} px`);
      return found; })()"""
    try:
        watch.until("coastwatch.alarms.count()", lambda count: count == 40)
        watch.until(BADGE, lambda text: text.startswith("late: NO FEED"))
        for theme in ("day", "dusk", "night"):
            watch.ask(f"(coastwatch.state.theme = '{theme}', coastwatch.themeChanged(), coastwatch.openTroubles(true))")
            assert watch.ask(outside) == [], theme
            assert grave_faults(watch) == [], theme
    finally:
        watch.ask("(coastwatch.state.theme = 'day', coastwatch.themeChanged())")
        watch.page.set_viewport_size(SIZE)


@pytest.mark.parametrize(
    "answer",
    [
        {"status": 503, "body": "no"},
        {"status": 200, "content_type": "text/event-stream", "body": 'retry: 200\nid: 1-0-x\nevent: run\ndata: {"run": 1}\n\n'},
    ],
    ids=["refused", "stands still"],
)
def test_where_the_stream_is_lost_the_page_asks_for_the_list(sea: Sea, browser: Any, answer: dict[str, Any]) -> None:
    sea.raise_alarms((OVERBOARD, "man_overboard", 0.0), (3, "dark", 5.0))
    watch = Watch(browser.new_page(viewport=SIZE), sea.port)
    try:
        watch.page.route("**/api/v1/alarms/stream", lambda route: route.fulfill(**answer))
        watch.open("drawer=alarms")
        watch.until(f"{ROWS}.map(row => row.dataset.alarm?.split('-')[0]).join()", lambda ids: ids == f"{OVERBOARD},3")
        assert watch.ask("coastwatch.alarms.asked") > 0
        watch.page.unroute("**/api/v1/alarms/stream")
        sea.raise_alarms((4, "dark", 6.0))
        watch.until("coastwatch.alarms.count()", lambda count: count == 3)
        watch.until("coastwatch.alarms.failed", lambda said: said == "")
        assert watch.errors == []
    finally:
        watch.page.close()
