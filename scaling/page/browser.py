"""Chromium of the system, driven by playwright."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from playwright.sync_api import sync_playwright

from coastwatch.operators.api.application import WEB

WAIT_S = 60.0


@contextmanager
def chromium(*flags: str) -> Iterator[Any]:
    """A browser. Ends the program with one sentence where it or the page is missing."""
    found = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if found is None:
        sys.exit("chromium: not found, needed on the PATH; on Debian: apt-get install chromium")
    if not (WEB / "index.html").is_file():
        sys.exit(f"{WEB}/index.html: not found; build the page with `make web`")
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=found, args=list(flags))
        try:
            yield started
        finally:
            started.close()


def draws(page: Any) -> None:
    """Wait until vessels have been drawn. Raises: TimeoutError."""
    end = time.monotonic() + WAIT_S
    while not page.evaluate("Boolean(window.coastwatch?.points?.uploaded)"):
        if time.monotonic() > end:
            raise TimeoutError(f"the page has drawn no vessel in {WAIT_S:.0f} s")
        time.sleep(0.1)
