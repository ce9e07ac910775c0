"""`coastwatch reproduce` refuses what cannot be done, and names the file and key of what is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from coastwatch.errors import InputError
from coastwatch.operators.cli import main
from coastwatch.reproduction import published

pytestmark = pytest.mark.contract


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (["nobody"], "got 'nobody', needed one of hem, heymann, liland, rangel, sagild"),
        (["rangel", "--runs", "0"], "got '0', needed 1 or more"),
        (["rangel", "--runs", "many"], "got 'many'"),
        (["rangel", "--workers", "0"], "got '0', needed 1 or more"),
        (["rangel", "--only", "table-9", "figure-2"], "--only: got table-9, needed some of rangel-figure-2, rangel-figure-3"),
        (["rangel", "--only", "figure-2", "--output", "/proc/nowhere"], "--output: got '/proc/nowhere', needed a folder that can be"),
        (["rangel", "--only", "figure-2", "--output", __file__], "needed a folder that can be written"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_one_line(words: list[str], wanted: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reproduce", *words]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert wanted in err
    assert err.splitlines()[-1].startswith("coastwatch: error: ")


HEAD = 'paper = "p"\norder = 1\ntitle = "t"\n'
VARIANT = '[[variant]]\nname = "default"\ntitle = "t"\n'


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        (HEAD, "variant: got nothing, needed tables [[variant]] with name, title"),
        (HEAD + "rums = 3\n" + VARIANT, "rums: got 3 for an unknown setting"),
        (HEAD + "runs = 0\n" + VARIANT, "runs: got 0, needed 1 or more"),
        (HEAD + VARIANT + VARIANT, "got names ['default', 'default'], needed each once"),
        (HEAD + VARIANT + '[[figure]]\nname = "f"\npath = "x"\n', "got variants ['literal'], needed some of ['default']"),
        (HEAD + VARIANT + '[[figure]]\nname = "f"\npath = "x"\nliteral = ""\nat = {a = 1}\n', "got a = 1, needed one of []"),
        (HEAD + 'variants_of = "atlantis"\n', "variants_of: got 'atlantis', needed a scenario"),
        ("paper is round", "cannot be read"),
    ],
)
def test_a_wrong_file_is_named_with_its_key(text: str, wanted: str, tmp_path: Path) -> None:
    path = tmp_path / "published.toml"
    path.write_text(text, "utf-8")
    with pytest.raises(InputError) as caught:
        published.read(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert wanted in str(caught.value)


def test_a_file_of_no_paper_is_passed_over(tmp_path: Path) -> None:
    (tmp_path / "published.toml").write_text('[[figure]]\nname = "f"\n', "utf-8")
    assert published.read(tmp_path / "published.toml") is None
