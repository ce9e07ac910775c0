"""One sentence for each setting that is refused: its path as in the file, what was found, what was needed."""

from __future__ import annotations

import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from coastwatch.spelling import ONE_LINE, did_you_mean

Loc = tuple[int | str, ...]

RENAMED = {
    "heard": "detection_probability",
    "give_up": "rejection_log_odds",
    "unknown_kick_m_s2": "unknown_manoeuvre_m_s2",
    "kick_m_s": "velocity_jump_m_s",
    "kick_interval_s": "velocity_jump_interval_s",
    "kick_share": "velocity_jump_share",
    "on_line": "online",
    "open_cycles": "open_s, in seconds",
    "close_cycles": "close_s, in seconds",
    "cpa_open_cycles": "cpa_open_s, in seconds",
}
"""Settings and methods of earlier versions and their names today, for the message that refuses the old name."""

TABLE, LIST, INSTANT = "a table", "a list", "an instant with a time zone, such as 2026-07-01T12:00:00Z"
WANTED: dict[str, str] = {
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float", "int_parsing_size"), "a whole number"),
    **dict.fromkeys(("float_type", "float_parsing"), "a number"),
    "finite_number": "a finite number",
    **dict.fromkeys(("bool_type", "bool_parsing"), "true or false"),
    "string_type": "text",
    "string_unicode": "text without lone surrogates",
    "path_type": "a path",
    **dict.fromkeys(("tuple_type", "list_type"), LIST),
    **dict.fromkeys(("model_type", "model_attributes_type", "dict_type"), TABLE),
    **dict.fromkeys(("timezone_aware", "datetime_type", "datetime_parsing", "datetime_from_date_parsing"), INSTANT),
}
"""What is needed, by the type of the error."""

LIMITS: dict[str, Callable[[Mapping[str, Any]], str]] = {
    "greater_than": lambda c: f"more than {c['gt']:g}",
    "greater_than_equal": lambda c: f"{c['ge']:.12g} or more",
    "less_than": lambda c: f"less than {c['lt']:g}",
    "less_than_equal": lambda c: f"{c['le']:.12g} or less",
    "string_too_short": lambda c: f"at least {c['min_length']} character",
    "string_too_long": lambda c: f"at most {c['max_length']} characters",
    "too_short": lambda c: f"at least {c['min_length']}",
    "too_long": lambda c: f"at most {c['max_length']}",
    "string_pattern_mismatch": lambda c: (
        "text without control characters" if c["pattern"] == ONE_LINE else f"text that matches {c['pattern']}"
    ),
    "literal_error": lambda c: str(c["expected"]),
    "union_tag_invalid": lambda c: f"one of {c['expected_tags']}",
}
"""The same for errors with a limit or a choice."""


def refusals(error: ValidationError, model: type[BaseModel]) -> list[str]:
    """A sentence for each error. Args: model: that refused the settings."""
    return [sentence(dict(refused), model) for refused in error.errors()]


def in_brackets(path: Sequence[str]) -> str:
    """A path as in JSON: points_deg[2], where the command line has points_deg.2."""
    return "".join(f"[{part}]" if part.isdecimal() else f".{part}" for part in path).removeprefix(".")


def models_of(annotation: object) -> tuple[list[type[BaseModel]], bool]:
    """The models that an annotation allows, and whether it holds a list of them."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation], False
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return models_of(parts[0])
    models_of_parts = [models_of(part) for part in parts] if origin in (Union, types.UnionType, tuple, list) else []
    return [m for models, _ in models_of_parts for m in models], origin in (tuple, list) or any(
        many for _, many in models_of_parts
    )


def sentence(
    error: Mapping[str, Any],
    model: type[BaseModel],
    joined: Callable[[Sequence[str]], str] = ".".join,
    unknown: str = "setting",
) -> str:
    """What one error of pydantic says: path, what was found, what was needed.

    Args: error: of `errors()`; model: that refused the values; joined: writes a path; unknown: what a name is that the model has not.
    """
    kind, value, context = error["type"], error["input"], error.get("ctx", {})
    parts, holder = _place(error["loc"], model)
    noun = _noun(error["loc"], model)
    path = joined(parts[:-1] if noun else parts)
    last = str(error["loc"][-1]) if error["loc"] else ""
    if kind == "value_error":
        return f"{path}: {context['error']}" if path else str(context["error"])
    if kind == "missing":
        return f"{path}: got nothing, needed {f'a {noun}' if noun else _form(holder, last)}"
    if kind == "extra_forbidden":
        names = list(holder.model_fields) if holder else []
        hint = f"; its name is now {RENAMED[last]}" if last in RENAMED else did_you_mean(last, names)
        return f"{path or repr('')}: got {_short(value)} for an unknown {unknown}, needed one of {', '.join(names)}{hint}"
    if kind == "union_tag_not_found":
        return f"{path}.{_tag(context)}: got nothing, needed the name of a {_tag(context)}"
    if kind == "union_tag_invalid":
        names = [name.strip("' ") for name in str(context["expected_tags"]).split(",")]
        return f"{path}.{_tag(context)}: {_no_method(str(context['tag']), names)}"
    if kind == "literal_error" and last == "method" and isinstance(value, str):
        return f"{path}: {_no_method(value, list(methods_of(holder)) if holder else [])}"
    if WANTED.get(kind) == LIST and isinstance(value, Mapping) and _form(holder, last) != "a value":
        return f"{path}: got a table [{last}], needed {_form(holder, last)}"
    needed = LIMITS[kind](context) if kind in LIMITS else WANTED.get(kind, error["msg"])
    return f"{path}: got {f'{noun} ' if noun else ''}{_short(value)}, needed {needed}"


def _tag(context: Mapping[str, object]) -> str:
    """The setting by which a table says what it is: method, or kind."""
    return str(context["discriminator"]).strip("'")


def _no_method(name: str, names: list[str]) -> str:
    """What is said of a method that does not exist."""
    hint = f"; its name is now {RENAMED[name]}" if name in RENAMED else did_you_mean(name, names)
    return f"got {name!r}, needed one of {', '.join(names)}{hint}"


def _noun(loc: Loc, model: type[BaseModel]) -> str:
    """What an item of a list is, by the title of its type, such as latitude; empty: it has none."""
    kind: Any = model
    for part in loc:
        while get_origin(kind) is Annotated or get_origin(kind) in (Union, types.UnionType):
            kind = next((a for a in get_args(kind) if a is not types.NoneType), None)
        items = get_args(kind)
        if isinstance(part, int):
            part = 0 if items[1:] == (...,) else part
            kind = items[part] if get_origin(kind) in (tuple, list) and part < len(items) else None
        elif isinstance(kind, type) and issubclass(kind, BaseModel) and part in kind.model_fields:
            kind = kind.model_fields[part].annotation
        else:
            return ""
    about = kind.__metadata__ if loc and isinstance(loc[-1], int) and get_origin(kind) is Annotated else ()
    return next((str(mark.title) for mark in about if isinstance(mark, FieldInfo) and mark.title), "")


def _place(loc: Loc, model: type[BaseModel]) -> tuple[list[str], type[BaseModel] | None]:
    """Path of a setting as in the file, without the names of methods, and the model that would hold it."""
    path: list[str] = []
    choices: list[type[BaseModel]] = [model]
    holder: type[BaseModel] | None = model
    for part in loc:
        methods = {name: choice for choice in choices for name in methods_of(choice)}
        if path and part in methods and len(choices) > 1:
            choices = [methods[str(part)]]
            continue
        path.append(str(part))
        if isinstance(part, str):
            holder = choices[0] if len(choices) == 1 else None
            field = holder.model_fields.get(part) if holder else None
            choices = models_of(field.annotation)[0] if field else []
    return path, holder


def methods_of(model: type[BaseModel]) -> Iterator[str]:
    """The names of the method, or of the kind, that a model is, if it is one."""
    field = model.model_fields.get("method") or model.model_fields.get("kind")
    yield from (get_args(field.annotation) if field else ())


def _form(holder: type[BaseModel] | None, key: str) -> str:
    """What a setting is, for one that is absent."""
    field = holder.model_fields.get(key) if holder else None
    models, many = models_of(field.annotation) if field else ([], False)
    if not models:
        return "a value"
    if len(models) > 1:
        return f"a table [{key}] with a method"
    required = ", ".join(name for name, f in models[0].model_fields.items() if f.is_required())
    return f"{'tables [[' if many else 'a table ['}{key}{']]' if many else ']'} with {required}"


def _short(value: object) -> str:
    text = value.isoformat() if hasattr(value, "isoformat") else repr(value)
    return text if len(text) <= 80 else text[:77] + "..."
