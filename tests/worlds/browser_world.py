"""The page in a real Chromium."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from coastwatch.operators.api.application import WEB

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
AXE = Path(__file__).parents[2] / "web" / "node_modules" / "axe-core" / "axe.min.js"
SIZE = {"width": 900, "height": 600}
VIEW = "lat=-22.898&lon=-43.155&zoom=11"
ANY_TIME_S = 30.0  # the machine may be busy


class Watch:
    """A page in the browser, and what went wrong in it."""

    def __init__(self, page: Any, port: int) -> None:
        self.page, self.port = page, port
        self.requests: list[str] = []
        self.errors: list[str] = []
        page.on("request", lambda request: self.requests.append(request.url))
        page.on("pageerror", lambda error: self.errors.append(str(error)))

    def open(self, query: str = VIEW) -> None:
        self.page.goto(f"http://127.0.0.1:{self.port}/?{query}")
        self.until("window.coastwatch?.points?.uploaded")

    def ask(self, script: str) -> Any:
        return self.page.evaluate(script)

    def ask_a_loading_page(self, script: str) -> Any:
        """As `ask`; None while the page is replaced by another one."""
        from playwright.sync_api import Error

        try:
            return self.ask(script)
        except Error as error:
            if "Execution context was destroyed" not in str(error):
                raise
            return None

    def until(self, script: str, found: Callable[[Any], Any] = bool) -> Any:
        """Ask until the answer is as wanted: the page's policy forbids Playwright's own waiting for a text."""
        end = time.monotonic() + ANY_TIME_S
        while (answer := self.ask_a_loading_page(script)) is None or not found(answer):
            assert time.monotonic() < end, f"{script}: got {answer!r}; errors of the page: {self.errors}"
            time.sleep(0.05)
        return answer


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium, where it is installed and the page is built. It runs an event loop: modules without it would find one that runs."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("no Chromium is installed")
    if not (WEB / "index.html").is_file():
        pytest.skip("the page is not built; `make web` builds it")
    with sync_api.sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=CHROMIUM)
        yield started
        started.close()


def grave_faults(watch: Watch) -> list[tuple[str, str]]:
    """The serious faults that axe finds in the page as it is now: rule and element."""
    if not AXE.is_file():
        pytest.skip("axe-core is not installed; `make web` installs it")
    if not watch.ask("'axe' in window"):
        watch.ask(AXE.read_text("utf-8") + "; 0")
    found = watch.ask("axe.run(document, {resultTypes: ['violations']}).then(done => done.violations)")
    return [(v["id"], v["nodes"][0]["html"][:200]) for v in found if v["impact"] in ("serious", "critical")]
