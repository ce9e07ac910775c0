"""The API by its own description: schemathesis asks every path with good and bad values, with each role."""

from __future__ import annotations

import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
from server_world import Served, listening

from coastwatch.operators.api.guard import Guard
from coastwatch.operators.api.people import Limits, Tokens, add

pytestmark = pytest.mark.whole

SETTINGS = """
[checks.positive_data_acceptance]
expected-statuses = ["2xx", 304, 400, 401, 403, 404, 503]  # 400: of its type, and wrong by its meaning, as a box with south > north
"""
EXAMPLES = 30


@pytest.mark.slow
@pytest.mark.parametrize("role", ["viewer", "operator", "admin", None])
def test_every_check_finds_nothing(served: Served, tmp_path: Path, role: str | None) -> None:
    program = Path(sys.executable).with_name("schemathesis")
    if not program.is_file():
        pytest.skip("schemathesis is not installed")
    tokens, settings = tmp_path / "tokens.toml", tmp_path / "schemathesis.toml"
    settings.write_text(SETTINGS, "utf-8")
    given = add(tokens, "tester", role or "viewer", None)
    guard = Guard(tokens=Tokens(tokens), limits=partial(Limits, 1e9, 1e9)) if role else Guard()
    with listening(served.service, guard, tmp_path) as address:
        words = [program, "--config-file", settings, "run", f"http://{address}/api/v1/openapi.json", "--checks", "all"]
        words += ["--exclude-path", "/api/v1/alarms/stream", "--max-examples", str(EXAMPLES), "--seed", "1", "--no-color"]
        header = ["--header", f"Authorization: Bearer {given}"] if role else []
        done = subprocess.run([*words, *header], capture_output=True, text=True, cwd=tmp_path, timeout=1200, check=False)
    assert done.returncode == 0, done.stdout[-20_000:]
