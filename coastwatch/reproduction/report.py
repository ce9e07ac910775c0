"""A reproduction assembled from the finished runs and written: lines for a terminal, an HTML page, a JSON file."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path

from coastwatch.reproduction import html_report
from coastwatch.reproduction.figures import Made, lines as lines_of, orders
from coastwatch.reproduction.finished_runs import FinishedRuns, code
from coastwatch.reproduction.json_report import Folder, Reproduction, as_object
from coastwatch.reproduction.planning import Wanted
from coastwatch.reproduction.published import Published
from coastwatch.reproduction.running import records
from coastwatch.server.timing import date_utc, machine

PAGE, NUMBERS = "report.html", "report.json"


def made(
    paper: str, folders: Mapping[str, Published], plan: Mapping[str, list[Wanted]], kept: FinishedRuns, command: str
) -> Reproduction:
    """The figures of the finished runs of a plan, with the date and this machine."""
    found = []
    for name, of in folders.items():
        measured = tuple(Made(wanted, tuple(records(kept, wanted.jobs))) for wanted in plan[name])
        found.append(Folder(name, of, measured, tuple(lines_of(of, measured)), tuple(orders(of, measured))))
    return Reproduction(paper, tuple(found), date_utc(), code(), machine(), command)


def written_page(kept: FinishedRuns, reproduction: Reproduction) -> Path:
    """The HTML page, written."""
    return kept.write(PAGE, html_report.text(reproduction))


def written_numbers(kept: FinishedRuns, reproduction: Reproduction) -> Path:
    """The JSON file, written."""
    return kept.write(NUMBERS, json.dumps(as_object(reproduction), allow_nan=False, indent=1))


def lines(reproduction: Reproduction) -> Iterator[str]:
    """One line per figure and method, then the orderings, what is not compared, and what fails."""
    for folder in reproduction.folders:
        yield folder.of.title
        yield f"  {'':<44} {'method':<30} {'published':>10} {'measured':>20} {folder.of.bound_name:>10}"
        for line in folder.lines:
            f = line.figure
            published = "" if line.published is None else line.written(line.published)
            measured = line.written(line.measured.mean)
            if not math.isnan(line.measured.std):
                measured += f" +- {line.written(line.measured.std)}"
            marks = [line.against_published, {True: "asked: reached", False: "asked: missed", None: ""}[line.reached]]
            marks += ["laid out by hand"] if f.by_hand else []
            said = "; ".join(mark for mark in marks if mark)
            head = f"  {f.name[:44]:<44} {line.variant.title[:30]:<30} {published:>10}"
            yield f"{head} {measured:>20} {line.written(line.bound.mean):>10}  {said}".rstrip()
        for order in folder.orders:
            apart = f"{order.difference.mean:.3g} +- {order.error:.2g} (standard error)"
            yield f"  {order.ordering.title} {f'at {order.at}' if order.at else ''}: {order.verdict}: {apart}"
    yield from html_report.in_short(reproduction)
    for reason, names in html_report.not_compared(reproduction):
        yield f"Not compared, {reason}: {len(names)} figures"
    for sentence in reproduction.failures:
        yield f"Fails: {sentence}"
