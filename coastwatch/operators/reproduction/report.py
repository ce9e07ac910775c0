"""A reproduction put together from what is kept, and written: lines for a terminal, a page, a JSON file."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path

from coastwatch.operators.reproduction import page
from coastwatch.operators.reproduction.figures import Made, Row, Spread, rows
from coastwatch.operators.reproduction.keeping import Kept, code
from coastwatch.operators.reproduction.numbers import Folder, Reproduction, as_object
from coastwatch.operators.reproduction.planning import Wanted
from coastwatch.operators.reproduction.published import Published
from coastwatch.operators.reproduction.running import records
from coastwatch.server.machine import date_utc, machine

PAGE, NUMBERS = "report.html", "report.json"


def made(
    paper: str, folders: Mapping[str, Published], plan: Mapping[str, list[Wanted]], kept: Kept, command: str
) -> Reproduction:
    """What the kept runs of a plan say, as of now and of this machine."""
    found = []
    for name, of in folders.items():
        measured = tuple(Made(wanted, tuple(records(kept, wanted.jobs))) for wanted in plan[name])
        found.append(Folder(name, of, measured, tuple(rows(of, measured))))
    return Reproduction(paper, tuple(found), date_utc(), code(), machine(), command)


def written_page(kept: Kept, said: Reproduction) -> Path:
    """The HTML page, written."""
    return kept.write(PAGE, page.text(said))


def written_numbers(kept: Kept, said: Reproduction) -> Path:
    """The JSON file, written."""
    return kept.write(NUMBERS, json.dumps(as_object(said), allow_nan=False, indent=1))


def lines(said: Reproduction) -> Iterator[str]:
    """Every figure on a line."""
    for folder in said.folders:
        yield folder.of.title
        yield f"  {'':<44} {'published':>10} {'literal':>20} {'our default':>20} {'bound':>10}"
        for row in folder.rows:
            f = row.figure
            said_, bound = (_number(v, row) for v in (math.nan if f.published is None else f.published, row.bound.mean))
            missed = "  missed" if row.reached is False else ""
            yield f"  {f.name[:44]:<44} {said_:>10} {_spread(row.literal, row):>20} {_spread(row.default, row):>20} {bound:>10}{missed}"


def _spread(spread: Spread, row: Row) -> str:
    apart = "" if math.isnan(spread.std) else f" +- {_number(spread.std, row)}"
    return _number(spread.mean, row) + apart


def _number(value: float, row: Row) -> str:
    if math.isnan(value):
        return ""
    return f"{value * (100.0 if row.figure.unit == '%' else 1.0):.{row.figure.digits}f}"
