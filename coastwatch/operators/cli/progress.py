"""Progress on stderr: a bar on a terminal, otherwise a line after two seconds and then every ten."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, Protocol

import lazy_loader

from coastwatch.spelling import printable

tqdm = lazy_loader.load("tqdm")  # only a terminal has a bar

FIRST_LINE_S, LINE_EVERY_S = 2.0, 10.0


class Progress(Protocol):
    def __call__(self, done: int, total: int, what: str) -> None: ...


@contextmanager
def report_progress(unit: str = "cycle") -> Iterator[Progress]:
    """A function (done, total, what) that shows the progress in these units until the block ends."""
    if sys.stderr.isatty():
        bar = _Bar(unit)
        try:
            yield bar
        finally:
            bar.close()
    else:
        yield _Lines(unit)


class _Bar:
    def __init__(self, unit: str) -> None:
        self._unit = unit
        self._bar: Any = None

    def __call__(self, done: int, total: int, what: str) -> None:
        if self._bar is None:
            self._bar = tqdm.tqdm(total=total, unit=self._unit, file=sys.stderr, dynamic_ncols=True, leave=False)
        if self._bar.total != total:
            self._bar.total = total
        self._bar.set_postfix_str(printable(what), refresh=False)
        self._bar.update(done - self._bar.n)

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()


class _Lines:
    def __init__(self, unit: str) -> None:
        self._unit = unit
        self._next_s = time.monotonic() + FIRST_LINE_S

    def __call__(self, done: int, total: int, what: str) -> None:
        now_s = time.monotonic()
        if now_s >= self._next_s:
            self._next_s = now_s + LINE_EVERY_S
            with suppress(OSError):  # nobody reads stderr any more: no reason to end a run
                print(f"{self._unit} {done} of {total}: {printable(what)}", file=sys.stderr, flush=True)
