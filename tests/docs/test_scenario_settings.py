"""The settings that the README of a scenario lists are those of the scenario: their names, and their values where it gives one."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from coastwatch.scenario import Scenario, load_scenario
from coastwatch.scenario.refusing import models_of

HOUSE = Path(__file__).parents[2]
READMES = [path.with_name("README.md") for path in sorted((HOUSE / "scenarios").glob("*/scenario.toml"))]
SETTING = re.compile(r"`([a-z_]+(?:\.[a-z_0-9]+)*)`(?: ([\w.+-]+)(?=[ |;,]|$))?")


def listed(text: str) -> Iterator[tuple[str, str, bool]]:
    """Each setting in a column "setting": its key, the value behind it, empty: none, and whether the table is of this scenario alone."""
    column, own = -1, False
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if not line.startswith("|"):
            column = -1
        elif "setting" in cells:
            column, own = cells.index("setting"), cells[0] == "setting"
        elif column >= 0 and column < len(cells) and not set(line) <= set("|-: "):
            stage = ""
            for key, value in SETTING.findall(cells[column]):
                stage, whole = (key.rpartition(".")[0], key) if "." in key or not stage else (stage, f"{stage}.{key}")
                yield whole, value, own


def has(model: type[BaseModel], path: list[str]) -> bool:
    """Whether some method of a stage has a setting."""
    field = model.model_fields.get(path[0])
    rest = [part for part in path[1:] if not part.isdecimal()]
    return field is not None and (not rest or any(has(found, rest) for found in models_of(field.annotation)[0]))


def value_of(scenario: Scenario, key: str) -> Any:
    """The value of a setting. Raises: AttributeError, LookupError: the scenario has none of this name."""
    found: Any = scenario
    for part in key.split("."):
        found = found[int(part)] if part.isdecimal() else getattr(found, part)
    return found


def wrong(scenario: Scenario, text: str) -> list[str]:
    """The settings of a README that the scenario has not, or has with another value."""
    out = []
    for key, said, own in listed(text):
        if not own:  # of a paper: a setting of one of its variants
            out += [] if has(Scenario, key.split(".")) else [f"{key}: no stage has it"]
            continue
        try:
            value = value_of(scenario, key)
        except (AttributeError, LookupError):
            out.append(f"{key}: the scenario has it not")
            continue
        value = getattr(value, "method", value) if isinstance(value, BaseModel) else value
        same = said == str(value) or (
            isinstance(value, int | float) and re.fullmatch(r"[-\d.e]+", said) and float(said) == value
        )
        out += [] if not said or same else [f"{key}: {said} in the README, {value} in the scenario"]
    return out


def test_the_readmes_list_settings() -> None:
    count = {path.parent.name: len(list(listed(path.read_text("utf-8")))) for path in READMES}
    assert sum(found > 0 for found in count.values()) >= 10
    assert count["small-craft-harbour"] >= 6
    assert count["context-driven-1000"] >= 6


@pytest.mark.parametrize("readme", READMES, ids=lambda path: path.parent.name)
def test_each_setting_of_a_readme_is_that_of_the_scenario(readme: Path) -> None:
    assert wrong(load_scenario(readme.parent.name), readme.read_text("utf-8")) == []


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("`tracks.upkeep.delete_misses` 3", "tracks.upkeep.delete_misses: 3 in the README, 4 in the scenario"),
        ("`tracks.upkeep.delete_mises` 4", "tracks.upkeep.delete_mises: the scenario has it not"),
        ("`tracks.method` sided_imm", "tracks.method: sided_imm in the README, vimmjipda in the scenario"),
    ],
)
def test_a_wrong_setting_is_found(row: str, said: str) -> None:
    assert wrong(load_scenario("autoferry-3"), f"| setting | reason |\n|---|---|\n| {row} | why |\n") == [said]
