"""The whole reproduction as one JSON object: figures, raw values of every run, settings, code, machine, date."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from coastwatch.reproduction.figures import Line, Made, Order, Record, Spread
from coastwatch.reproduction.published import Published

SCHEMA = 2  # of this object; incremented if a key is removed or changes its meaning
LARGE = ("picture", "roc")  # in the report as plots


@dataclass(frozen=True)
class Folder:
    """A scenario folder, reproduced."""

    name: str
    of: Published
    made: tuple[Made, ...]
    lines: tuple[Line, ...]
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

    @property
    def failures(self) -> list[str]:
        """A sentence for each target that is missed and each ordering that fails."""
        failed = []
        for folder in self.folders:
            for line in folder.lines:
                if line.reached is False and line.asked is not None:
                    got, asked = line.written(line.measured.mean), line.written(line.asked)
                    against = f"{got} {'>' if line.figure.better == 'lower' else '<'} {asked} {line.figure.unit}".rstrip()
                    failed.append(f"{folder.name}: {line.figure.name}, {line.variant.title}: {against}")
            for order in folder.orders:
                if order.verdict == "fails":
                    at = f" at {order.at}" if order.point else ""
                    apart = f"{order.difference.mean:.3g} +- {order.error:.2g}"
                    failed.append(f"{folder.name}: {order.ordering.title}{at}: {apart}")
        return failed


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
                "figures": [_figure(line) for line in folder.lines],
                "orderings": [_order(order) for order in folder.orders],
                "absent": [one.model_dump() for one in folder.of.absent],
                "variants": [_variant(made) for made in folder.made],
            }
            for folder in reproduction.folders
        },
    }


def _figure(line: Line) -> dict[str, object]:
    f = line.figure
    return {
        "name": f.name,
        "source": f.source,
        "variant": line.variant.name,
        "published": line.published,
        "measured": _spread(line.measured),
        "against_published": line.against_published or None,
        "not_compared": line.not_compared or None,
        "asked": line.asked,
        "asked_by": f.asked_by or None,
        "reached": line.reached,
        "by_hand": f.by_hand,
        "better": f.better,
        "unit": "fraction of 1" if f.unit == "%" else f.unit,
        "path": f.path,
        "at": dict(f.at),
        "bound": _spread(line.bound),
    }


def _order(order: Order) -> dict[str, object]:
    o = order.ordering
    return {
        "path": o.path,
        "than": o.than or o.path,
        "less": o.less,
        "more": o.more,
        "at": dict(order.point),
        "ours": o.ours,
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
