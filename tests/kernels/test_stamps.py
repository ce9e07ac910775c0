"""Code that was compiled before is used where nothing that it is made of has changed, and nowhere else."""

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from coastwatch.kernels import stamps
from coastwatch.kernels.compiling import njit
from coastwatch.kernels.facts import facts
from coastwatch.server import compiled

COMPILED = sorted(
    path
    for folder in ("kernels", "store")
    for path in (stamps.HOUSE / "coastwatch" / folder).glob("*.py")
    if "coastwatch.kernels.compiling" in path.read_text("utf-8")
)
INNER = "from coastwatch.kernels.compiling import part\n\n\n@part\ndef grown(x):\n    return {}\n"
OUTER = """from coastwatch.kernels.compiling import kernel
from coastwatch.kernels.ours_between import grown_twice


@kernel
def outer(x):
    return grown_twice(x)
"""
BETWEEN = """from coastwatch.kernels.compiling import part
from coastwatch.kernels.ours_inner import (
    grown,
)


@part
def grown_twice(x):
    return grown(grown(x))
"""
ASKED = """
from coastwatch.kernels.ours_outer import outer
print(outer(1), sum(outer.stats.cache_hits.values()), sum(outer.stats.cache_misses.values()))
"""


def reached(path: Path) -> set[Path]:
    """By Python's own parser."""
    found, new = {path}, [path]
    while new:
        names = []
        for node in ast.walk(ast.parse(new.pop().read_text("utf-8"))):
            if isinstance(node, ast.Import):
                names += [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        for name in names:
            place = stamps.HOUSE / name.replace(".", "/")
            for file in (place.with_suffix(".py"), place / "__init__.py"):
                if name.startswith("coastwatch") and file.exists() and file not in found:
                    found.add(file)
                    new.append(file)
    return found


@pytest.mark.parametrize("path", COMPILED, ids=lambda path: path.stem)
def test_all_that_a_module_imports_is_found(path: Path) -> None:
    assert stamps._reached(path, stamps.HOUSE) == reached(path)


def test_nothing_is_compiled_but_through_the_house() -> None:
    assert len(COMPILED) >= 60
    for path in (stamps.HOUSE / "coastwatch").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.ImportFrom) and str(node.module).startswith("numba") and path.name != "compiling.py":
                assert {alias.name for alias in node.names}.isdisjoint({"njit", "jit", "cfunc", "vectorize", "guvectorize"}), (
                    path
                )
            if isinstance(node, ast.Import):
                assert "numba" not in {alias.name.partition(".")[0] for alias in node.names}, path


def test_a_kernel_knows_the_modules_of_the_tuples_that_it_is_given() -> None:
    given = [(line.partition(" ")[0], re.findall(r"named\('([\w.]+)'", line)) for line in compiled.known()]
    assert sum(bool(tuples) for _, tuples in given) >= 3
    for kernel, tuples in given:
        for dotted in tuples:
            path, home = (stamps.HOUSE / name.rpartition(".")[0].replace(".", "/") for name in (kernel, dotted))
            assert home.with_suffix(".py") in stamps._reached(path.with_suffix(".py"), stamps.HOUSE), kernel


def asked(house: Path) -> tuple[int, int, int]:
    """What the function says, and whether it was there or was compiled."""
    environment = {**os.environ, "PYTHONPATH": str(house)}
    said = subprocess.run([sys.executable, "-c", ASKED], cwd=house, env=environment, capture_output=True, text=True, check=True)
    value, hits, misses = map(int, said.stdout.split())
    return value, hits, misses


def test_a_part_of_a_part_that_changes_is_compiled_again_and_nothing_else_is(tmp_path: Path) -> None:
    kernels = tmp_path / "coastwatch" / "kernels"
    kernels.mkdir(parents=True)
    for name in ("__init__.py", "kernels/__init__.py", "kernels/compiling.py", "kernels/stamps.py"):
        (tmp_path / "coastwatch" / name).write_bytes((stamps.HOUSE / "coastwatch" / name).read_bytes())
    (kernels / "ours_outer.py").write_text(OUTER)
    (kernels / "ours_between.py").write_text(BETWEEN)
    (kernels / "ours_inner.py").write_text(INNER.format("x + 1"))
    assert asked(tmp_path) == (3, 0, 1)
    (kernels / "ours_beside.py").write_text("UNKNOWN = 1\n")
    assert asked(tmp_path) == (3, 1, 0)
    (kernels / "ours_inner.py").write_text(INNER.format("x * 50"))
    assert asked(tmp_path) == (2500, 0, 1)
    assert asked(tmp_path) == (2500, 1, 0)


def stamp(dispatcher):
    return dispatcher._cache._impl.locator.get_source_stamp()


def test_functions_of_others_keep_the_stamp_of_numba(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "of_others.py").write_text("def twice(x):\n    return 2 * x\n")
    monkeypatch.syspath_prepend(tmp_path)
    import of_others  # type: ignore[import-not-found]

    assert isinstance(stamp(njit(cache=True)(of_others.twice)), bytes)
    assert stamp(facts)[1] == stamps.digest(Path(facts.py_func.__code__.co_filename))
