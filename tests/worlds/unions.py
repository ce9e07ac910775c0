"""The methods of a stage, from the union that registers them: a new method is tested without further code."""

from __future__ import annotations

from typing import Annotated, Any, get_args, get_origin


def kinds_in(union: Any) -> tuple[type, ...]:
    """The classes of a union of settings, such as `Fuser`."""
    inside = get_args(union)[0] if get_origin(union) is Annotated else union
    return (inside,) if isinstance(inside, type) else get_args(inside)


def methods_in(union: Any) -> list[Any]:
    """One method of each class, with its default settings."""
    return [kind() for kind in kinds_in(union)]
