"""Where compiled kernels are kept: one folder for a program and for the processes that it starts."""

from pathlib import Path

import pytest

from coastwatch.kernels.jit import cache_folder

pytestmark = pytest.mark.contract


def test_a_child_process_keeps_its_kernels_in_the_folder_of_its_parent(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    folder = cache_folder()
    assert folder.parent == tmp_path
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(folder))
    assert cache_folder() == folder
