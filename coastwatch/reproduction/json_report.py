"""The whole reproduction as one JSON object: figures, raw values of every run, settings, code, machine, date."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from coastwatch.reproduction.figures import Made, Order, Record, Row, Spread
from coastwatch.reproduction.published import Published

SCHEMA = 1  # of this object; incremented if a key is removed or changes its meaning
LARGE = ("picture", "roc")  # in the report as plots


@dataclass(frozen=True)
class Folder:
    """A scenario folder, reproduced."""

    name: str
    of: Published
    made: tuple[Made, ...]
    rows: tuple[Row, ...]
    orders: tuple[Order, ...] = ()


@dataclass(frozen=True)
class Reproduction:
    """The content of a report."""

    paper: str
    folders: tuple[Folder, ...]
    date_utc: str
    code: str
    machine: Mapping[str, Any]
    command: str


def as_object(reproduction: Reproduction) -> dict[str, object]:
    """Plain values. A number that is not finite is null."""
    return {
        "schema": SCHEMA,
        "paper": reproduction.paper,
        "command": reproduction.command,
        "date_utc": reproduction.date_utc,
        "code": reproduction.code,
        "machine": dict(reproduction.machine),
        "scenarios": {
            folder.name: {
                "title": folder.of.title,
                "figures": [_figure(row) for row in folder.rows],
                "orderings": [_order(order) for order in folder.orders],
                "variants": [_variant(made) for made in folder.made],
            }
            for folder in reproduction.folders
        },
    }


def _figure(row: Row) -> dict[str, object]:
    f = row.figure
    return {
        "name": f.name,
        "source": f.source,
        "published": f.published,
        "asked": f.asked,
        "asked_of": f.asked_of if f.asked is not None else None,
        "reached": row.reached,
        "better": f.better,
        "unit": "fraction of 1" if f.unit == "%" else f.unit,
        "path": f.path,
        "at": dict(f.at),
        **{
            name: {"variant": variant, **_spread(spread)}
            for name, variant, spread in (("literal", f.literal, row.literal), ("default", f.default, row.default))
        },
        "bound": _spread(row.bound),
    }


def _order(order: Order) -> dict[str, object]:
    o = order.ordering
    return {
        "path": o.path,
        "than": o.than or o.path,
        "less": o.less,
        "more": o.more,
        "at": dict(order.point),
        "verdict": order.verdict,
        "difference": _spread(order.difference),
    }


def _spread(spread: Spread) -> dict[str, object]:
    return {"mean": _finite(spread.mean), "std": _finite(spread.std), "runs": len(spread.values), "values": list(spread.values)}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _variant(made: Made) -> dict[str, object]:
    return {
        "name": made.wanted.variant.name,
        "title": made.wanted.variant.title,
        "settings": list(made.wanted.settings),
        "at": dict(made.wanted.point),
        "scenario": made.wanted.jobs[0].subject.model_dump(mode="json"),
        "runs": [_run(record) for record in made.records],
    }


def _run(record: Record) -> dict[str, object]:
    plain = {key: value for key, value in record.items() if key not in LARGE}
    shown = record.get("picture")
    return plain | ({"picture": {k: v for k, v in shown.items() if k != "png"}} if shown else {})


def seeds(folders: Sequence[Folder]) -> list[int]:
    """The seeds of all runs, sorted."""
    return sorted({int(record["seed"]) for folder in folders for made in folder.made for record in made.records})
