"""Where compiled kernels are kept: one folder for a program, the processes that it starts, and other checkouts of equal kernels."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from coastwatch.kernels.jit import KERNELS, cache_folder

pytestmark = pytest.mark.contract


def test_a_child_process_keeps_its_kernels_in_the_folder_of_its_parent(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    folder = cache_folder()
    assert folder.parent == tmp_path
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(folder))
    assert cache_folder() == folder


CALL = """
import numba  # a program may have it before ours
import numpy as np
import coastwatch.kernels.jit as jit
from coastwatch.kernels.tables.counting_sort import counting_sort
begun = []
with jit.compilations(lambda: begun.append(1)):
    counting_sort(np.array([1, 0, 1]), 2)
print(len(begun), jit.KERNELS)
"""


def test_a_second_checkout_with_equal_kernels_compiles_none(tmp_path: Path) -> None:
    def compiled_in(checkout: Path) -> int:
        environment = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
        environment |= {"PYTHONPATH": str(checkout), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        said = subprocess.run(
            [sys.executable, "-c", CALL], env=environment, cwd=tmp_path, capture_output=True, text=True, check=True
        )
        count, kernels = said.stdout.split()
        assert Path(kernels) == checkout / "coastwatch/kernels"
        return int(count)

    first, second, changed = (tmp_path / name for name in ("first", "second", "changed"))
    for checkout in (first, second, changed):
        shutil.copytree(KERNELS, checkout / "coastwatch/kernels", ignore=shutil.ignore_patterns("__pycache__"))
        (checkout / "coastwatch/__init__.py").touch()
    with (changed / "coastwatch/kernels/arrays.py").open("a") as other:
        other.write("# a kernel may use what is here\n")
    assert compiled_in(first) > 0
    assert compiled_in(second) == 0
    assert compiled_in(changed) > 0
