"""A long file of AIS, fused as a stream: stopped in the middle and resumed, nothing of it is lost and nothing is taken twice."""

from __future__ import annotations

import json
import signal
import time
from pathlib import Path

import pytest
from run_world import Start, column, rows, stored

from coastwatch.operators.cli import main
from coastwatch.sensors.recorded.nmea.feed import BLOCK
from coastwatch.store.schema.migrate import check
from scaling.load.ais_feed import write_feed

pytestmark = pytest.mark.whole

PATIENCE_S = 600.0  # a busy machine that compiles the kernels for the first time
SENTENCES = 5 * BLOCK // 4  # the first cycle is stored long before the end of the file is read


@pytest.fixture(scope="module")
def feed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("feed") / "feed.nmea"
    write_feed(path, SENTENCES, 2000, 1)
    return path


@pytest.fixture(scope="module")
def uninterrupted(feed: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "x.db"
    assert main(command(feed, path)) == 0
    return path


def command(feed: Path, path: Path, *words: str) -> list[str]:
    return ["fuse", "--ais", str(feed), "--db", f"sqlite:///{path}", "--json", "--set", "store.checkpoint_every=4", *words]


@pytest.mark.parametrize("stop", [signal.SIGKILL, pytest.param(signal.SIGINT, marks=pytest.mark.slow)])
def test_stopped_in_the_middle_of_a_file_and_resumed_it_ends_as_if_it_had_not_been_stopped(
    stop: signal.Signals, feed: Path, uninterrupted: Path, start: Start, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, whole = tmp_path / "x.db", stored(uninterrupted)
    begun = start(*command(feed, path))
    until = time.monotonic() + PATIENCE_S
    while stored(path) < 8:  # after the checkpoint of cycle 4
        assert begun.poll() is None, begun.communicate()
        assert time.monotonic() < until, "no cycle was stored"
        time.sleep(0.02)  # a cycle takes longer
    begun.send_signal(stop)
    begun.communicate(timeout=PATIENCE_S)
    assert 8 <= stored(path) < whole
    assert main(command(feed, path, "--resume")) == 0
    printed = capsys.readouterr().out
    assert check(f"sqlite:///{path}") == []
    assert rows(path) == rows(uninterrupted)
    count = "SELECT reports FROM cycle ORDER BY number"
    assert column(path, count) == column(uninterrupted, count)
    (file,) = json.loads(printed)["files"]
    assert file["records"] == sum(column(uninterrupted, count)) - _statics(feed)


def _statics(feed: Path) -> int:
    """Messages of type 5 and 24: whole or the first part."""
    return sum(b",A,5" in line or b",A,H" in line for line in feed.read_bytes().splitlines())
