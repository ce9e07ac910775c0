"""A reproduction assembled from the finished runs and written: lines for a terminal, an HTML page, a JSON file."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path

from coastwatch.reproduction import html_report
from coastwatch.reproduction.figures import Made, Row, Spread, orders, rows
from coastwatch.reproduction.finished_runs import FinishedRuns, code
from coastwatch.reproduction.json_report import Folder, Reproduction, as_object
from coastwatch.reproduction.planning import Wanted
from coastwatch.reproduction.published import Published
from coastwatch.reproduction.running import records
from coastwatch.server.machine import date_utc, machine

PAGE, NUMBERS = "report.html", "report.json"


def made(
    paper: str, folders: Mapping[str, Published], plan: Mapping[str, list[Wanted]], kept: FinishedRuns, command: str
) -> Reproduction:
    """The figures of the finished runs of a plan, with the date and this machine."""
    found = []
    for name, of in folders.items():
        measured = tuple(Made(wanted, tuple(records(kept, wanted.jobs))) for wanted in plan[name])
        found.append(Folder(name, of, measured, tuple(rows(of, measured)), tuple(orders(of, measured))))
    return Reproduction(paper, tuple(found), date_utc(), code(), machine(), command)


def written_page(kept: FinishedRuns, reproduction: Reproduction) -> Path:
    """The HTML page, written."""
    return kept.write(PAGE, html_report.text(reproduction))


def written_numbers(kept: FinishedRuns, reproduction: Reproduction) -> Path:
    """The JSON file, written."""
    return kept.write(NUMBERS, json.dumps(as_object(reproduction), allow_nan=False, indent=1))


def lines(reproduction: Reproduction) -> Iterator[str]:
    """One line per figure."""
    for folder in reproduction.folders:
        yield folder.of.title
        yield f"  {'':<44} {'published':>10} {'literal':>20} {'our default':>20} {folder.of.bound_name:>10}"
        for row in folder.rows:
            f = row.figure
            published, bound = (_number(v, row) for v in (math.nan if f.published is None else f.published, row.bound.mean))
            missed = "  missed" if row.reached is False else ""
            yield f"  {f.name[:44]:<44} {published:>10} {_spread(row.literal, row):>20} {_spread(row.default, row):>20} {bound:>10}{missed}"
        for order in folder.orders:
            o, at = (
                order.ordering,
                ", ".join(f"{value:g}" if isinstance(value, float) else str(value) for _, value in order.point),
            )
            apart = f"{order.difference.mean:.3g} +- {order.error:.2g} (standard error)"
            yield f"  {o.title} {f'at {at}' if at else ''}: {order.verdict}: {apart}"


def _spread(spread: Spread, row: Row) -> str:
    apart = "" if math.isnan(spread.std) else f" +- {_number(spread.std, row)}"
    return _number(spread.mean, row) + apart


def _number(value: float, row: Row) -> str:
    if math.isnan(value):
        return ""
    return f"{value * (100.0 if row.figure.unit == '%' else 1.0):.{row.figure.digits}f}"
