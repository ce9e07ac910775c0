"""A scenario file laid over the one that it extends, and that over the next."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from coastwatch.shipped import scenarios_folder

OWN = ("name", "title", "extends")  # never taken over: a run is kept under its own scenario's name


class ScenarioError(ValueError):
    """A scenario cannot be read; the message names the file, the key, what it got and what it needed."""


def extended(path: Path) -> dict[str, Any]:
    """The TOML document in this file, laid over the one that its `extends` names.

    Tables are laid over each other key by key; anything else, lists too, stands as the nearer file has it. Of a table that names
    another `method` nothing is taken over: its settings would be of that other method. Name and title are always a file's own.
    Raises: ScenarioError that names the file.
    """
    return _extended(path, ())


def over(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    """A table laid over another one; neither is changed."""
    if "method" in above and above["method"] != below.get("method", above["method"]):
        return dict(above)
    out = dict(below)
    for key, value in above.items():
        both = isinstance(value, dict) and isinstance(out.get(key), dict)
        out[key] = over(out[key], value) if both else value
    return out


def _extended(path: Path, before: tuple[Path, ...]) -> dict[str, Any]:
    here = path.resolve()
    if here in before:
        chain = " extends ".join(_called(p) for p in (*before[before.index(here) :], here))
        raise ScenarioError(f"{before[0]}: extends: {chain}: a scenario cannot extend itself")
    data = _document(path)
    named = data.pop("extends", None)
    if named is None:
        return data
    below = _extended(_below(path, named), (*before, here))
    return over({key: value for key, value in below.items() if key not in OWN}, data)


def _document(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text("utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{path}: cannot be read: {error}") from error
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{path}: not TOML: {error}") from error


def _below(path: Path, named: object) -> Path:
    """The file that `extends` names: a shipped scenario, or a .toml file seen from the file that names it."""
    if not isinstance(named, str) or not named:
        raise ScenarioError(f"{path}: extends: got {named!r}, needed the name of a scenario or a path to a .toml file")
    found = path.parent / named if named.endswith(".toml") else scenarios_folder() / named / "scenario.toml"
    if not found.is_file():
        raise ScenarioError(f"{path}: extends: got {named!r}, and there is no {found}")
    return found


def _called(path: Path) -> str:
    return path.parent.name if path.name == "scenario.toml" else str(path)
