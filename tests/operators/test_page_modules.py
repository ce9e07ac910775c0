"""The page without a browser: its modules by node's own test program, equal bytes of two builds, and its place in a wheel."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

pytestmark = pytest.mark.whole

HOUSE = Path(__file__).parents[2]
NODE = shutil.which("node", path=f"{HOUSE / '.venv' / 'bin'}") or shutil.which("node")


@pytest.mark.skipif(NODE is None, reason="node is not installed; `make web` installs it")
def test_modules_of_the_page() -> None:
    files = sorted(str(path) for path in (HOUSE / "web" / "test").glob("*.test.js"))
    assert len(files) >= 2
    done = subprocess.run([str(NODE), "--test", *files], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stdout[-4000:]


@pytest.mark.skipif(NODE is None, reason="node is not installed; `make web` installs it")
@pytest.mark.skipif(not (HOUSE / "web" / "node_modules").is_dir(), reason="npm has not installed esbuild; `make web` does")
def test_two_builds_give_equal_bytes(tmp_path: Path) -> None:
    for name in ("one", "two"):
        subprocess.run(
            [str(NODE), str(HOUSE / "web" / "build.mjs"), str(tmp_path / name)], check=True, timeout=60, cwd=tmp_path
        )
    one, two = ({path.name: path.read_bytes() for path in (tmp_path / name).iterdir()} for name in ("one", "two"))
    assert {"index.html", "main.js", "main.css", "maplibre-gl-worker.mjs"} <= set(one)
    assert one == two


def hook(root: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The build hook on a checkout, without hatchling: it is installed only while a wheel is built."""
    interface = ModuleType("hatchling.builders.hooks.plugin.interface")
    interface.BuildHookInterface = type("BuildHookInterface", (), {})  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, interface.__name__, interface)
    for name in ("hatchling", "hatchling.builders", "hatchling.builders.hooks", "hatchling.builders.hooks.plugin"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    spec = importlib.util.spec_from_file_location("hatch_build", HOUSE / "hatch_build.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    made = module.PageOfTheMap()
    made.root = str(root)
    return made


def test_a_wheel_without_the_page_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made, page = hook(tmp_path, monkeypatch), tmp_path / "coastwatch" / "operators" / "web"
    build: dict[str, Any] = {"force_include": {}}
    made.initialize("editable", build)
    with pytest.raises(FileNotFoundError, match=r"web/index\.html: not found, a wheel needs it; build it with `make web`"):
        made.initialize("standard", build)
    assert build == {"force_include": {}}
    page.mkdir(parents=True)
    (page / "index.html").touch()
    made.initialize("standard", build)
    assert build == {"force_include": {str(page): "coastwatch/operators/web"}}
