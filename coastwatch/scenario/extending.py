"""`extends`: the settings of a scenario file merged over those of the file that it extends."""

from __future__ import annotations

import tomllib
from pathlib import Path

from coastwatch.errors import InputError
from coastwatch.shipped import scenarios_folder

OWN = ("name", "extends")  # never inherited: a run is stored under the name of its own scenario


class ScenarioError(InputError):
    """A scenario cannot be read; the message names the file, the key, what it got and what it needed."""


def extended(path: Path, before: tuple[Path, ...] = ()) -> dict[str, object]:
    """The TOML document in this file, merged over the one that its `extends` names.

    Tables are merged key by key; other values, also lists, are those of the extending file. A table that names another `method`
    replaces the table below it, whose settings belong to the other method. The name is never inherited.
    Args: before: the files that extend this one. Raises: ScenarioError that names the file.
    """
    here = path.resolve()
    if here in before:
        names = [p.parent.name if p.name == "scenario.toml" else str(p) for p in (*before[before.index(here) :], here)]
        raise ScenarioError(f"{before[0]}: extends: {' extends '.join(names)}: a scenario cannot extend itself")
    data = _document(path)
    named = data.pop("extends", None)
    if named is None:
        return data
    below = extended(_extended_file(path, named), (*before, here))
    return merged({key: value for key, value in below.items() if key not in OWN}, data)


def merged(below: dict[str, object], above: dict[str, object]) -> dict[str, object]:
    """A table merged over another one; neither is changed."""
    if "method" in above and above["method"] != below.get("method", above["method"]):
        return dict(above)
    table = dict(below)
    for key, value in above.items():
        under = table.get(key)
        table[key] = merged(under, value) if isinstance(value, dict) and isinstance(under, dict) else value
    return table


def _document(path: Path) -> dict[str, object]:
    try:
        content = path.read_bytes()
        data = tomllib.loads(content.decode("utf-8"))
    except FileNotFoundError as error:
        raise ScenarioError(f"{path}: there is no such file") from error
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise ScenarioError(f"{path}: line {line}: got the byte 0x{content[error.start]:02x}, needed text in UTF-8") from error
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{path}: got text that is not TOML, needed [table] and key = value: {error}") from error
    if not data:
        raise ScenarioError(f"{path}: got a file without settings, needed name, title, [area] and [input]")
    return data


def _extended_file(path: Path, named: object) -> Path:
    """The file that `extends` names: a shipped scenario, or a .toml file relative to the extending file."""
    if not isinstance(named, str) or not named:
        raise ScenarioError(f"{path}: extends: got {named!r}, needed the name of a scenario or a path to a .toml file")
    file = path.parent / named if named.endswith(".toml") else scenarios_folder() / named / "scenario.toml"
    if not file.is_file():
        raise ScenarioError(f"{path}: extends: got {named!r}, but there is no {file}")
    return file
