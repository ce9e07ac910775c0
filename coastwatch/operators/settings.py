"""Every setting of a scenario, from the pydantic models: its table, kind, default and meaning."""

from __future__ import annotations

import ast
import inspect
import io
import json
import textwrap
import tokenize
import types
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal, Union, get_args, get_origin

from pydantic import BaseModel

from coastwatch.scenario.refusing import models_of

UNITS = {
    "latitude_deg": "deg, north positive",
    "longitude_deg": "deg, east positive",
    "_m2_s3": "m2/s3",
    "_m2_s5": "m2/s5",
    "_rad2_s3": "rad2/s3",
    "_m_s15": "m/s^1.5",
    "_mb_s": "MB/s",
    "_deg_h": "deg/h",
    "_m_s2": "m/s2",
    "_m_s": "m/s",
    "_rad_s": "rad/s",
    "_deg_s": "deg/s",
    "_per_m2": "1/m2",
    "_per_s": "1/s",
    "_m2": "m2",
    "_nm": "NM",
    "_kn": "kn",
    "db_per_level": "dB",
    "_db": "dB",
    "_deg": "deg",
    "_rad": "rad",
    "_ms": "ms",
    "_min": "min",
    "_s": "s",
    "_m": "m",
    "rpm": "turns a minute",
    "_hours": "h",
    "_turns": "turns of the radar",
    **dict.fromkeys(("_looks", "_hits", "_misses"), "looks"),
    "_every": "cycles",
    "_sigmas": "standard deviations",
    "_intervals": "intervals",
    **dict.fromkeys(("share", "_fraction", "_accuracy", "_habit"), "share"),
    **dict.fromkeys(("probability", "confidence", "_doubt", "false_alarm", "significance"), "probability"),
    **dict.fromkeys(("_weight", "_factor", "_margin", "correlation"), "ratio"),
    "_log_odds": "natural log of odds",
}
"""Unit by the ending of a name; shares and probabilities are 0 to 1, a ratio has no unit."""
BOUNDS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<=", "min_length": "length >=", "max_length": "length <="}
NAMES: dict[object, str] = {
    float: "number",
    int: "whole number",
    str: "text",
    bool: "true or false",
    dict: "table",
    type(None): "nothing",
}


@dataclass(frozen=True)
class Setting:
    """One key of a table."""

    key: str
    kind: str
    unit: str
    default: str
    meaning: str


@dataclass(frozen=True)
class Table:
    """One table of a scenario file, or one method of a table."""

    header: str  # as in TOML: [tracks], [[radars]]
    method: str  # empty if the table has no choice
    chosen: bool  # the default
    model: type[BaseModel]
    settings: tuple[Setting, ...]
    below: tuple[tuple[str, tuple[type[BaseModel], ...]], ...] = ()  # keys of the tables below, with what they may be

    @property
    def meaning(self) -> str:
        """The docstring."""
        return inspect.cleandoc(self.model.__doc__ or "")


def tables(model: type[BaseModel], header: str = "", default: BaseModel | None = None) -> Iterator[Table]:
    """The table of this model and every table below it, in order of declaration.

    Args: default: what holds where a scenario says nothing; none: the default of each field.
    """
    yield _table(model, header, default)
    for key, field in model.model_fields.items():
        used = getattr(default, key, field.default)
        below, many = models_of(field.annotation)
        path = f"{header}.{key}" if header else key
        for choice in below:
            for table in tables(choice, path, used if type(used) is choice else None):
                head = f"[[{path}]]" if many and table.header == path else table.header
                chosen = table.chosen and (len(below) == 1 or type(used) is choice)
                yield replace(table, header=head, chosen=chosen)


def _table(model: type[BaseModel], header: str, holds: BaseModel | None) -> Table:
    meanings = _comments(model)
    settings, below, method = [], [], ""
    for key, field in model.model_fields.items():
        if key == "method":
            method = str(getattr(holds, key, get_args(field.annotation)[0]))
        elif models := models_of(field.annotation)[0]:
            below.append((key, tuple(models)))
        else:
            meaning = " ".join((field.description or meanings.get(key, "")).split())
            value = None if field.is_required() else field.get_default(call_default_factory=True)
            value = getattr(holds, key, value)
            default = "needed" if field.is_required() else "none" if value is None else json.dumps(value, default=str)
            settings.append(Setting(key, kind_of(field.annotation, field.metadata), unit_of(key), default, meaning))
    return Table(header, method, True, model, tuple(settings), tuple(below))


def unit_of(key: str) -> str:
    """The unit of a name, from its ending."""
    return next((unit for ending, unit in UNITS.items() if key.endswith(ending)), "")


def kind_of(annotation: object, metadata: Sequence[object] = ()) -> str:
    """The allowed values in words: "number > 0", "text", or a choice of words."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        text = kind_of(parts[0], (*parts[1:], *metadata))
    elif origin is Literal:
        text = " or ".join(json.dumps(part) for part in parts)
    elif origin in (Union, types.UnionType):
        text = " or ".join(kind_of(part) for part in parts if part is not type(None)) + _limits(metadata)
    elif origin in (tuple, list):
        inner = [kind_of(part) for part in parts if part is not Ellipsis]
        text = (
            ("list of " + ", ".join(dict.fromkeys(inner))) if Ellipsis in parts or origin is list else f"[{', '.join(inner)}]"
        )
    else:
        text = NAMES.get(origin or annotation, "") or str(getattr(annotation, "__name__", annotation))
        text += _limits(metadata)
    return text.replace("Path", "text (path)").replace("datetime", "instant").replace("AwareDatetime", "instant")


def _limits(metadata: Sequence[object]) -> str:
    limits: list[str] = []
    for item in metadata:
        for constraint in getattr(item, "metadata", [item]):
            limits += [f"{sign} {getattr(constraint, name):g}" for name, sign in BOUNDS.items() if hasattr(constraint, name)]
    return " " + ", ".join(limits) if limits else ""


def _comments(model: type[BaseModel]) -> dict[str, str]:
    """By field: the comment on the lines of its declaration, or the text below it.

    `use_attribute_docstrings` of pydantic reads the source when a class is made: a start takes 0.6 s more and loads polars.
    """
    comments: dict[str, str] = {}
    for cls in reversed([cls for cls in model.__mro__ if issubclass(cls, BaseModel) and cls is not BaseModel]):
        source = textwrap.dedent(inspect.getsource(cls))
        tokens = tokenize.generate_tokens(io.StringIO(source).readline)
        by_line = {t.start[0]: t.string.lstrip("# ").strip() for t in tokens if t.type == tokenize.COMMENT}
        body = ast.parse(source).body[0].body  # type: ignore[attr-defined]
        for field, below in zip(body, [*body[1:], ast.Pass()], strict=True):
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                lines = range(field.lineno, (field.end_lineno or field.lineno) + 1)
                comment = " ".join(by_line[k] for k in lines if k in by_line)
                is_text = isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
                comments[field.target.id] = comment or (str(below.value.value) if is_text else "")
    return comments
