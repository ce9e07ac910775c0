"""TOML file, merged over the one that it extends, to Scenario; errors name the file and the key."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path

from pydantic import BaseModel, ValidationError

from coastwatch.errors import InputError
from coastwatch.scenario.model import Scenario
from coastwatch.scenario.refusing import methods_of, models_of, refusals
from coastwatch.shipped import scenarios_folder
from coastwatch.spelling import did_you_mean
from coastwatch.tracks import TableTracker

OWN = ("name", "extends")  # never inherited: a run is stored under the name of its own scenario


class ScenarioError(InputError):
    """A scenario cannot be read; the message names the file, the key, what it got and what it needed."""


def scenario_names() -> list[tuple[str, str]]:
    """Name and title of every shipped scenario, sorted."""
    paths = sorted(scenarios_folder().glob("*/scenario.toml"))
    return [(path.parent.name, str(tomllib.loads(path.read_text("utf-8")).get("title", ""))) for path in paths]


def load_scenario(name_or_path: str, overrides: Mapping[str, str] | None = None) -> Scenario:
    """The scenario of this name, or in this file or folder, with settings overridden.

    Args: overrides: dotted key to value as in TOML; a bare word counts as text. `radars.0.rpm` names an item of a list. They
    replace the settings of the file and of those that it extends.
    Raises: ScenarioError that names the file and the key.
    """
    path = _find(name_or_path)
    return make_scenario(extended(path), str(path), overrides or {})


def make_scenario(data: dict[str, object], where: str, overrides: Mapping[str, str]) -> Scenario:
    """The scenario that a parsed TOML document describes, with settings overridden. Raises: ScenarioError."""
    for key, text in overrides.items():
        stage, _, last = key.rpartition(".")
        if last == "method":
            _leave_out_unknown(data, stage, text)
        _override(data, key, text)
    try:
        return Scenario.model_validate(data)
    except ValidationError as error:
        raise ScenarioError(
            "\n".join(f"{_origin_of(refusal, where, overrides)}{refusal}" for refusal in refusals(error, Scenario))
        ) from error


def _leave_out_unknown(data: dict[str, object], stage: str, method: str) -> None:
    """Leave out the settings of a stage that its method in the file has and another method does not, in place."""
    field, table = Scenario.model_fields.get(stage), data.get(stage)
    if field is None or not isinstance(table, dict):
        return
    models = {name: model for model in models_of(field.annotation)[0] for name in methods_of(model)}
    former = table.get("method", getattr(field.default, "method", ""))
    before, after = models.get(former), models.get(method)
    if before and after:
        for key in _settings_of(before, former) - _settings_of(after, method):
            table.pop(key, None)


def _settings_of(model: type[BaseModel], method: str) -> set[str]:
    """The settings that a method takes."""
    return model.settings_of(method) if issubclass(model, TableTracker) else set(model.model_fields)


def _origin_of(refusal: str, where: str, overrides: Mapping[str, str]) -> str:
    """Where a refused setting was given: by --set, or in the file."""
    path = refusal.partition(": ")[0]
    return "--set " if path and any(path in (key, f"{key}.method") for key in overrides) else f"{where}: "


def _find(name_or_path: str) -> Path:
    path = Path(name_or_path)
    if path.is_dir():
        if not (path / "scenario.toml").is_file():
            raise ScenarioError(f"{path}: got a folder without scenario.toml, needed one with it, or a .toml file")
        return path / "scenario.toml"
    if path.suffix == ".toml":
        return path
    shipped = scenarios_folder() / name_or_path / "scenario.toml"
    if path.is_file():
        raise ScenarioError(f"{path}: got a file that is no .toml, needed a scenario; `coastwatch fuse` takes recorded files")
    if not shipped.is_file():
        names = [name for name, _ in scenario_names()]
        raise ScenarioError(
            f"scenario: got {name_or_path!r}, needed one of {', '.join(names)}, or a path to a .toml file"
            f"{did_you_mean(name_or_path, names)}"
        )
    return shipped


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


def typed_value(text: str) -> object:
    """A value as written in TOML; what is no TOML is a text."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _override(data: dict[str, object], key: str, text: str) -> None:
    value = typed_value(text)
    *parents, last = key.split(".")
    here: dict[str, object] | list[object] = data
    for depth, part in enumerate(parents):
        path = ".".join(parents[: depth + 1])
        below = here[_index(here, part, path)] if isinstance(here, list) else here.setdefault(part, {})
        if not isinstance(below, dict | list):
            raise ScenarioError(f"--set {path}: got {below!r} there, needed a table")
        here = below
    if isinstance(here, list):
        here[_index(here, last, key)] = value
    else:
        here[last] = value


def _index(items: list[object], part: str, path: str) -> int:
    if not (part.isascii() and part.isdigit()) or int(part) >= len(items):
        raise ScenarioError(f"--set {path}: got {part!r}, needed a number from 0 to {len(items) - 1}")
    return int(part)
