"""The house style of DESIGN.md, sections 2 and 7, where a program can check it."""

import ast
import re
import subprocess
from functools import cache
from pathlib import Path

HOUSE = Path(__file__).parents[2]
TOP = ("coastwatch", "db", "scaling", "scenarios", "tests", "ops", "web")
FORBIDDEN = {"utils", "helpers", "common", "misc", "tools", "scripts", "core", "base", "contrib"}
GENERATED = {"__pycache__", "versions"}
IN_THE_README_ABOVE = ("web/src", "web/test")


@cache
def tracked() -> list[Path]:
    """Files of the house: what git knows or would take; in an export without git, all of them."""
    asked = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=HOUSE,
        capture_output=True,
        text=True,
        check=False,
    )
    names = asked.stdout.splitlines() if asked.returncode == 0 else []
    found = [HOUSE / name for name in names] or [p for top in TOP for p in (HOUSE / top).rglob("*")]
    return sorted(p for p in found if p.is_file() and "__pycache__" not in p.parts)


def modules() -> list[Path]:
    return [p for p in tracked() if p.suffix == ".py" and p.relative_to(HOUSE).parts[0] in ("coastwatch", "scaling")]


def folders() -> list[Path]:
    return sorted({parent for p in tracked() for parent in p.parents if parent != HOUSE and HOUSE in parent.parents})


def name_of(path: Path) -> str:
    return str(path.relative_to(HOUSE))


def needs_readme(folder: Path) -> bool:
    """Folders that hold modules or documents of their own; data of a test and Alembic's versions belong to the folder above."""
    top = folder.relative_to(HOUSE).parts[0]
    above = folder.name in {*GENERATED, "coastwatch"} or name_of(folder) in IN_THE_README_ABOVE
    return top in TOP and not above and len(folder.relative_to(HOUSE).parts) <= 2


def admission(folder: Path) -> str:
    """First line of text of the README of a folder; empty: there is none."""
    readme = folder / "README.md"
    lines = readme.read_text("utf-8").splitlines() if readme.is_file() else []
    return next((line for line in lines if line.strip() and not line.startswith("#")), "")


def test_every_folder_says_what_it_admits() -> None:
    said = {name_of(f): (f.parent == HOUSE / "scenarios", admission(f)) for f in folders() if needs_readme(f)}
    assert len(said) > 40
    wrong = [
        name for name, (free, line) in said.items() if not line or not (free or re.match(r"(A|An|One) \w+.* here\b", line))
    ]
    assert wrong == [], "no README.md, or its first line is no admission rule"


def test_no_forbidden_name() -> None:
    wrong = [name_of(p) for p in [*tracked(), *folders()] if p.stem.lower() in FORBIDDEN]
    assert wrong == []


def test_every_module_says_what_it_is() -> None:
    texts = {name_of(m): m.read_text("utf-8") for m in modules() if m.relative_to(HOUSE).parts[0] == "coastwatch"}
    assert len(texts) > 100
    assert [name for name, text in texts.items() if text.strip() and not ast.get_docstring(ast.parse(text))] == []


def test_every_module_of_the_tests_is_in_the_readme_of_its_folder() -> None:
    wrong = []
    for folder in {p.parent for p in tracked() if p.suffix == ".py" and p.relative_to(HOUSE).parts[0] == "tests"} - {
        HOUSE / "tests"
    }:
        named = set(re.findall(r"\w+\.py", (folder / "README.md").read_text("utf-8")))
        wrong += [f"{name_of(folder)}: {name} is not named" for name in sorted({p.name for p in folder.glob("*.py")} - named)]
        wrong += [f"{name_of(folder)}: {name} is gone" for name in named if not any((HOUSE / "tests").glob(f"*/{name}"))]
    assert wrong == []


def test_the_readme_gives_two_commands_that_the_makefile_has() -> None:
    verbs = set(re.findall(r"^([a-z]+):", (HOUSE / "Makefile").read_text("utf-8"), re.MULTILINE))
    named = set(re.findall(r"\bmake ([a-z]+)", (HOUSE / "README.md").read_text("utf-8")))
    assert {"demo", "test"} <= named
    assert named <= verbs


def test_ci_calls_verbs_that_the_makefile_has() -> None:
    verbs = set(re.findall(r"^([a-z]+):", (HOUSE / "Makefile").read_text("utf-8"), re.MULTILINE))
    assert set(re.findall(r"^make ([a-z]+)", (HOUSE / ".ci" / "run").read_text("utf-8"), re.MULTILINE)) <= verbs


def test_every_link_of_the_documentation_leads_somewhere() -> None:
    dead = []
    for page in [p for p in tracked() if p.suffix == ".md"]:
        for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text("utf-8")):
            if "://" not in target and not (page.parent / target).exists():
                dead.append(f"{name_of(page)}: {target}")
    assert dead == []
