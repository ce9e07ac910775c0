"""Progress on stderr: a bar on a terminal, otherwise a line after two seconds and then every ten."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import lazy_loader

from coastwatch.spelling import printable

tqdm = lazy_loader.load("tqdm")  # only a terminal has a bar

FIRST_LINE_S, LINE_EVERY_S = 2.0, 10.0


Progress = Callable[[int, int, str], None]


@contextmanager
def report_progress(unit: str = "cycle") -> Iterator[Progress]:
    """A function (done, total, what) that shows the progress in these units until the block ends."""
    if sys.stderr.isatty():
        with tqdm.tqdm(
            unit=unit, file=sys.stderr, dynamic_ncols=True, leave=False, delay=1e-6
        ) as bar:  # nothing before the first

            def show(done: int, total: int, what: str) -> None:
                bar.total = total
                bar.set_postfix_str(printable(what), refresh=False)
                bar.update(done - bar.n)

            yield show
        return
    next_s = time.monotonic() + FIRST_LINE_S

    def print_line(done: int, total: int, what: str) -> None:
        nonlocal next_s
        now_s = time.monotonic()
        if now_s >= next_s:
            next_s = now_s + LINE_EVERY_S
            with suppress(OSError):  # nobody reads stderr any more: no reason to end a run
                print(f"{unit} {done} of {total}: {printable(what)}", file=sys.stderr, flush=True)

    yield print_line
