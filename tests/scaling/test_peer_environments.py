"""Pins are exact; an environment is made, kept, made again, or missed with a reason; a peer's README says what it must."""

import re
import sys
from pathlib import Path

import pytest

from scaling.peers import environment
from scaling.peers.environment import HERE, installed, peers, pins, prepare

pytestmark = pytest.mark.contract

NO_INDEX = "ERROR: No matching distribution found"


class Shell:
    """A shell that makes environments of nothing, or fails where a command has a certain word."""

    def __init__(self, fails_at: str = "") -> None:
        self.fails_at, self.commands = fails_at, []

    def __call__(self, command: list[str]) -> str:
        self.commands.append(command)
        if self.fails_at and self.fails_at in command:
            return NO_INDEX
        if "venv" in command:
            python = Path(command[-1]) / "bin" / "python"
            python.parent.mkdir(parents=True, exist_ok=True)
            python.touch()
        return ""


def test_there_are_the_peers_asked_for() -> None:
    assert peers() == ["filterpy", "scipy", "stonesoup"]


@pytest.mark.parametrize("peer", peers())
def test_every_requirement_is_an_exact_pin(peer: str) -> None:
    lines = [line for line in (HERE / peer / "requirements.txt").read_text("utf-8").splitlines() if not line.startswith("#")]
    assert len(pins(peer)) == len(lines)
    assert peer in pins(peer)


@pytest.mark.parametrize("peer", peers())
def test_a_readme_says_what_is_compared_and_with_which_version(peer: str) -> None:
    text = (HERE / peer / "README.md").read_text("utf-8")
    assert re.match(r"(A|An|One) \w+.* here\b", text.splitlines()[0])
    assert "What is compared" in text
    assert "left out" in text
    stated = re.findall(rf"{peer}\D*\) (\d[\d.]*\d)", text, re.IGNORECASE) + re.findall(r"Stone-Soup\) (\d[\d.]*\d)", text)
    assert all(version == pins(peer)[peer] for version in stated)
    assert stated or peer == "scipy"


@pytest.mark.parametrize("line", ["numpy>=2", "numpy", "numpy==2.*", "git+https://x/y", "numpy==2.4 ; python_version<'4'"])
def test_a_loose_requirement_is_refused(line: str, tmp_path, monkeypatch) -> None:
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "requirements.txt").write_text(f"scipy==1.17.1\n{line}\n", "utf-8")
    monkeypatch.setattr(environment, "HERE", tmp_path)
    with pytest.raises(ValueError, match=r"one/requirements.txt:2: got .*, needed package==version"):
        pins("one")


def test_an_environment_is_made_once_and_again_when_its_pins_change(tmp_path, monkeypatch) -> None:
    first, second, third = Shell(), Shell(), Shell()
    made = prepare("filterpy", tmp_path, first)
    assert made.python == tmp_path / "filterpy" / "bin" / "python"
    assert [("venv" in c, "pip" in c) for c in first.commands] == [(True, False), (False, True)]
    assert prepare("filterpy", tmp_path, second).python == made.python
    assert second.commands == []
    changed = pins("filterpy") | {"numpy": "2.4.5"}
    monkeypatch.setattr(environment, "pins", lambda peer: changed)
    prepare("filterpy", tmp_path, third)
    assert len(third.commands) == 2


def test_without_an_index_the_environment_of_the_project_serves_where_it_has_the_same_versions(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(environment, "pins", lambda peer: {"numpy": installed("numpy")})
    found = prepare("scipy", tmp_path, Shell("pip"))
    assert found.python == Path(sys.executable)
    assert NO_INDEX in found.message
    assert not (tmp_path / "scipy" / environment.MARK).exists()


def test_without_an_index_and_with_other_versions_a_peer_is_left_out(tmp_path) -> None:
    found = prepare("stonesoup", tmp_path, Shell("pip"))
    assert found.python is None
    assert found.message == f"stonesoup: left out, its environment cannot be made: {NO_INDEX}"


def test_a_command_that_fails_says_its_last_line() -> None:
    assert environment.run_command([sys.executable, "-c", "pass"]) == ""
    assert environment.run_command([sys.executable, "-c", "raise SystemExit('one\\ntwo')"]) == "two"
    assert environment.run_command([sys.executable, "-c", "raise SystemExit(3)"]) == "exit code 3"
