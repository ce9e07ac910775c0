"""A scenario file laid over the one that it extends."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from coastwatch.scenario import ScenarioError, load_scenario
from coastwatch.scenario.reading import merged

pytestmark = pytest.mark.contract

BELOW = """
name = "below"
title = "what is extended"
extends = "context-driven-100"
cycles = 7

[associations]
method = "windowed_covariance_literal"
window = 12
"""
ABOVE = """
name = "above"
title = "what extends"
extends = "below.toml"
sonars = []
"""


def written(folder: Path, **texts: str) -> Path:
    """Writes TOML files; returns that of `above`."""
    for name, text in texts.items():
        (folder / f"{name}.toml").write_text(text, "utf-8")
    return folder / "above.toml"


def refusal(path: Path) -> str:
    with pytest.raises(ScenarioError) as caught:
        load_scenario(str(path))
    return str(caught.value)


def test_a_chain_of_files_is_laid_over_each_other(tmp_path: Path) -> None:
    made = load_scenario(str(written(tmp_path, above=ABOVE, below=BELOW)))
    plain = load_scenario("context-driven-100")
    assert (made.name, made.title, made.cycles, made.sonars) == ("above", "what extends", 7, ())
    assert made.associations.method == "windowed_covariance_literal"
    assert made.radars == plain.radars
    assert made.input == plain.input
    assert plain.input.count == 100
    changed = {"name", "title", "cycles", "sonars", "associations"}
    assert made.model_dump(exclude=changed) == plain.model_dump(exclude=changed)


def test_an_override_comes_after_what_is_extended(tmp_path: Path) -> None:
    path = str(written(tmp_path, above=ABOVE, below=BELOW))
    made = load_scenario(path, {"cycles": "3", "associations.window": "20", "radars.1.rpm": "24", "input.count": "5"})
    assert (made.cycles, made.associations.window, made.radars[1].rpm, made.input.count) == (3, 20, 24.0, 5)


def test_tables_are_joined_lists_replaced_and_settings_of_another_method_left_behind() -> None:
    below = {
        "a": {"x": 1, "deep": {"p": 1, "q": 2}},
        "list": [1, 2],
        "m": {"method": "one", "s": 1},
        "same": {"method": "one", "s": 1},
    }
    before = str(below)
    above = {"a": {"deep": {"q": 3}}, "list": [9], "m": {"method": "two"}, "same": {"method": "one", "t": 2}}
    assert merged(below, above) == {
        "a": {"x": 1, "deep": {"p": 1, "q": 3}},
        "list": [9],
        "m": {"method": "two"},
        "same": {"method": "one", "s": 1, "t": 2},
    }
    assert str(below) == before


def test_a_name_is_never_taken_over(tmp_path: Path) -> None:
    said = refusal(written(tmp_path, above='extends = "context-driven-100"'))
    assert "name: got nothing" in said
    assert "title" not in said


@pytest.mark.parametrize("levels", [1, 2, 3])
def test_a_title_is_taken_over_from_any_level(levels: int, tmp_path: Path) -> None:
    wanted, below = load_scenario("autoferry-2"), "autoferry-2"
    for level in range(levels):
        written(
            tmp_path, **{f"level-{level}": f'name = "level-{level}"\nextends = "{below}"\n\n[input]\nscenario = {level + 3}\n'}
        )
        below = f"level-{level}.toml"
    made = load_scenario(str(tmp_path / below))
    assert (made.name, made.title) == (f"level-{levels - 1}", wanted.title)
    assert made.input == wanted.input.model_copy(update={"scenario": levels + 2})


@pytest.mark.parametrize(
    ("texts", "wanted"),
    [
        ({"above": 'extends = "atlantis"'}, ("above.toml: extends: got 'atlantis'", "atlantis/scenario.toml")),
        ({"above": 'extends = "none.toml"'}, ("above.toml: extends: got 'none.toml'", "there is no")),
        ({"above": "extends = 3"}, ("above.toml: extends: got 3", "needed the name of a scenario")),
        ({"above": 'extends = ""'}, ("extends: got ''",)),
        ({"above": 'extends = "above.toml"'}, ("above.toml extends", "cannot extend itself")),
        ({"above": ABOVE, "below": 'extends = "above.toml"'}, ("above.toml extends", "below.toml extends", "cannot extend itself")),
        ({"above": ABOVE, "below": "radars are round"}, ("below.toml: got text that is not TOML",)),
        ({"above": ABOVE, "below": BELOW + "windov = 3"}, ("above.toml: associations", "windov", "got 3")),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(texts: dict[str, str], wanted: tuple[str, ...], tmp_path: Path) -> None:
    said = refusal(written(tmp_path, **texts))
    assert all(part in said for part in wanted), said


def test_a_key_that_is_extended_can_be_told_from_the_file() -> None:
    """What a shipped scenario says itself is short; what it is comes from the one that it extends."""
    path = Path(__file__).parents[2] / "scenarios" / "context-driven-200" / "scenario.toml"
    assert set(tomllib.loads(path.read_text("utf-8"))) == {"name", "title", "extends", "input"}
    assert load_scenario("context-driven-200").input.count == 200
