"""The modules of the page that need no browser, by node's own test program: frames, dead reckoning, filters, formats, colours."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

HOUSE = Path(__file__).parents[2]
NODE = shutil.which("node", path=f"{HOUSE / '.venv' / 'bin'}") or shutil.which("node")


@pytest.mark.skipif(NODE is None, reason="node is not installed; `make web` installs it")
def test_modules_of_the_page() -> None:
    files = sorted(str(path) for path in (HOUSE / "web" / "test").glob("*.test.js"))
    assert len(files) >= 2
    done = subprocess.run([str(NODE), "--test", *files], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stdout[-4000:]
