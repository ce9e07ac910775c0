"""`coastwatch video` says what comes from files and feeds, and its settings can be used."""

from __future__ import annotations

import threading
import tomllib
from pathlib import Path

import pytest
from feed_world import put_datagrams
from server_world import wait_for
from video_world import arrivals, captured, messages

from coastwatch.operators.cli import main
from coastwatch.operators.cli.arguments import RADAR, sensor
from coastwatch.server.feeds import transport

pytestmark = pytest.mark.whole


def said(capsys: pytest.CaptureFixture[str], *words: str, code: int = 0) -> tuple[str, dict]:
    """What is printed, and the settings in it."""
    assert main(["video", *words]) == code
    text = capsys.readouterr().out
    return text, tomllib.loads(text[text.find("# settings") :]) if "# settings" in text else {}


def test_a_capture_is_described_with_settings_that_can_be_used(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one = arrivals((m for k, m in enumerate(messages(turns=3, parts=2)) if k not in (90, 201, 400, 401)), parts=2)
    other = arrivals(messages(turns=3, sic=2, bits=4, compressed=True, timed=False))
    path = captured(tmp_path / "x.pcap", sorted(one + other, key=lambda item: item[0]))
    text, settings = said(capsys, str(path))
    for line in (
        "SAC 25, SIC 1",
        "  turn          2.400 s a turn, 25.0 rpm",
        "  spokes        256 a turn, 2 messages each; lost: 1 spokes, 2 parts",
        "  cells         64 of 14.99 m, from 0 m to 0.52 NM",
        "  depth         4 bits, compressed (zlib)",
        "  time of day   not sent: that of arrival is taken",
    ):
        assert line in text.splitlines()
    assert [radar["name"] for radar in settings["radars"]] == ["radar-25-1", "radar-25-2"]
    assert settings["radars"][0]["rpm"] == pytest.approx(25.0, abs=0.1)
    assert settings["input"]["files"] == [f"video+file:{path}?25/1=radar-25-1&25/2=radar-25-2"]
    spec = text.split("--radar '")[1].partition("'")[0]
    given = sensor(RADAR)(spec.replace("LATITUDE", "54.0").replace("LONGITUDE", "12.0"))
    shown = settings["radars"][0]
    assert given == {name: given[name] if name.endswith("tude_deg") else shown[name] for name in shown}


def test_a_feed_is_described_while_it_comes(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[transport.Receiver] = []
    enter = transport.Receiver.__enter__
    monkeypatch.setattr(transport.Receiver, "__enter__", lambda self: (opened.append(self), enter(self))[1])

    def sent() -> None:
        wait_for(lambda: opened and opened[0].inboxes[0].port)
        summary = bytes([240, 0, 12, 0b11010000, 25, 1, 1, 4]) + b"NOVA"
        put_datagrams(
            opened[0].inboxes[0].port, [summary, b"\xf0\0\1", *(data for _, data, _ in arrivals(messages(turns=0.5)))]
        )

    thread = threading.Thread(target=sent)
    thread.start()
    text, settings = said(capsys, "video+udp://127.0.0.1:0", "--seconds", "0.6")
    thread.join()
    assert "SAC 25, SIC 1: NOVA" in text
    assert "128 so far" in text
    assert "left out: 1 block: cut short (first at datagram 2)" in text
    assert "input" not in settings
    assert "# coastwatch serve SCENARIO --feed 'video+udp://127.0.0.1:0?25/1=radar-25-1'" in text


def test_what_is_no_video_is_said_or_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "x.ast").write_bytes(bytes([48, 0, 4, 0]))
    text, _ = said(capsys, str(tmp_path / "x.ast"), code=1)
    assert "no radar video" in text
    assert main(["video", "ais+udp://127.0.0.1:0"]) == 2
    assert main(["video", str(tmp_path / "none.pcap")]) == 2
